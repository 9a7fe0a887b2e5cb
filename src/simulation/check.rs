//! Checks that a scenario can be simulated.

use super::scenario::Scenario;
use crate::error::{Error, Result};

impl Scenario {
    /// Checks that the scenario can be simulated, in bounded time and memory.
    ///
    /// # Errors
    /// Names the first invalid value.
    pub fn check(&self) -> Result<()> {
        for (key, value, (low, high)) in self.bounds() {
            // Written so that NaN fails as well.
            if !(low..=high).contains(&value) {
                return refuse(format!("{key} is {value}, not between {low} and {high}"));
            }
        }
        let soil = &self.soil;
        if soil.wavelengths_m.len() != soil.sigmas_m.len() {
            return refuse("soil.wavelengths_m and soil.sigmas_m differ in length");
        }
        let sensible = |v: &f64, low: f64| (low..=100.0).contains(v);
        if !soil
            .wavelengths_m
            .iter()
            .all(|v| sensible(v, 2.0 * soil.cell_m))
            || !soil.sigmas_m.iter().all(|v| sensible(v, 0.0))
        {
            return refuse(
                "a value of soil.wavelengths_m is shorter than two cells or longer than 100 m, or one of \
                 soil.sigmas_m is not between 0 and 100 m",
            );
        }
        let area: f64 = self
            .field
            .size_m
            .iter()
            .map(|s| s + 2.0 * self.field.margin_m)
            .product();
        if area / (soil.cell_m * soil.cell_m) > 5e7 {
            return refuse("the field has more than 50 million cells of soil.cell_m");
        }
        if !(2..=10_000).contains(&self.profiles.width) {
            return refuse(format!(
                "profiles.width is {}, not 2 to 10000",
                self.profiles.width
            ));
        }
        if self.profiles.range_m[1] <= self.profiles.range_m[0] {
            return refuse("profiles.range_m is empty");
        }
        self.check_boards()?;
        self.check_scanners()?;
        self.check_drives()?;
        self.check_durations()
    }

    /// Values with their smallest and largest allowed value.
    fn bounds(&self) -> Vec<(&'static str, f64, (f64, f64))> {
        const POSITIVE: (f64, f64) = (1e-9, 1e4);
        const ANY: (f64, f64) = (0.0, 1e4);
        const SHARE: (f64, f64) = (0.0, 1.0);
        const SPEED: (f64, f64) = (1e-3, 10.0);
        const LENGTH: (f64, f64) = (0.01, 100.0);
        const COORDINATE: (f64, f64) = (-1e4, 1e4);
        const RATE: (f64, f64) = (0.01, 1e4);
        let (motion, imu, prism) = (&self.motion, &self.imu, &self.prism);
        let (profiles, reference, bend) = (&self.profiles, &self.reference, &self.deformation);
        let mut bounds = vec![
            ("gravity_m_s2", self.gravity_m_s2, (0.1, 100.0)),
            ("field.margin_m", self.field.margin_m, (0.0, 100.0)),
            ("soil.cell_m", self.soil.cell_m, (1e-3, 1.0)),
            ("motion.scan_speed_m_s", motion.scan_speed_m_s, SPEED),
            ("motion.transit_speed_m_s", motion.transit_speed_m_s, SPEED),
            ("motion.rest_s", motion.rest_s, (1.0, 1e4)),
            ("motion.turn_radius_m", motion.turn_radius_m, LENGTH),
            ("motion.imu_height_m", motion.imu_height_m, LENGTH),
            ("motion.wheel_wavelength_m", motion.wheel_wavelength_m, ANY),
            ("motion.suspension_hz", motion.suspension_hz, (0.1, 5.0)),
            (
                "motion.suspension_damping",
                motion.suspension_damping,
                (0.05, 1.0),
            ),
            ("imu.rate_hz", imu.rate_hz, RATE),
            ("imu.gyro_noise_deg_sqrt_h", imu.gyro_noise_deg_sqrt_h, ANY),
            (
                "imu.accel_noise_ug_sqrt_hz",
                imu.accel_noise_ug_sqrt_hz,
                ANY,
            ),
            (
                "imu.gyro_bias_instability_deg_h",
                imu.gyro_bias_instability_deg_h,
                ANY,
            ),
            (
                "imu.accel_bias_instability_ug",
                imu.accel_bias_instability_ug,
                ANY,
            ),
            ("imu.bias_time_s", imu.bias_time_s, POSITIVE),
            ("imu.gyro_bias_sigma_rad_s", imu.gyro_bias_sigma_rad_s, ANY),
            ("imu.accel_bias_sigma_m_s2", imu.accel_bias_sigma_m_s2, ANY),
            ("prism.rate_hz", prism.rate_hz, RATE),
            ("prism.sigma_m", prism.sigma_m, ANY),
            ("prism.latency_s", prism.latency_s, (-10.0, 10.0)),
            ("prism.incidence_bias_m", prism.incidence_bias_m, COORDINATE),
            ("heading.rate_hz", self.heading.rate_hz, RATE),
            ("heading.sigma_deg", self.heading.sigma_deg, ANY),
            (
                "heading.mounting_offset_deg",
                self.heading.mounting_offset_deg,
                (-360.0, 360.0),
            ),
            ("profiles.rate_hz", profiles.rate_hz, RATE),
            ("profiles.fan_deg", profiles.fan_deg, (1.0, 170.0)),
            ("profiles.grazing_deg", profiles.grazing_deg, (0.0, 90.0)),
            ("profiles.dropout", profiles.dropout, SHARE),
            ("profiles.edge_m", profiles.edge_m, POSITIVE),
            (
                "profiles.edge_lost_flying",
                profiles.edge_lost_flying[0],
                SHARE,
            ),
            (
                "profiles.edge_lost_flying",
                profiles.edge_lost_flying[1],
                SHARE,
            ),
            (
                "reference.board_spacing_m",
                reference.board_spacing_m,
                (1e-4, 1.0),
            ),
            (
                "reference.soil_spacing_m",
                reference.soil_spacing_m,
                (1e-4, 1.0),
            ),
            ("reference.sigma_m", reference.sigma_m, ANY),
            (
                "deformation.rotation_deg_per_deg",
                bend.rotation_deg_per_deg,
                COORDINATE,
            ),
            (
                "deformation.shift_m_per_deg",
                bend.shift_m_per_deg,
                COORDINATE,
            ),
            (
                "deformation.shift_m_per_m_s2",
                bend.shift_m_per_m_s2,
                COORDINATE,
            ),
            ("deformation.drift_deg", bend.drift_deg, COORDINATE),
            ("deformation.drift_m", bend.drift_m, COORDINATE),
        ];
        let each = |key, values: &[f64], range| {
            values
                .iter()
                .map(move |&v| (key, v, range))
                .collect::<Vec<_>>()
        };
        bounds.extend(each("field.size_m", &self.field.size_m, (0.1, 1e3)));
        bounds.extend(each(
            "motion.wheelbase_track_m",
            &motion.wheelbase_track_m,
            LENGTH,
        ));
        bounds.extend(each("prism.lever_arm_m", &prism.lever_arm_m, COORDINATE));
        bounds.extend(each("prism.station_m", &prism.station_m, COORDINATE));
        bounds.extend(each("profiles.range_m", &profiles.range_m, LENGTH));
        bounds.extend(each("profiles.sigma_m", &profiles.sigma_m, ANY));
        bounds.extend(each("reference.offset_m", &reference.offset_m, COORDINATE));
        for board in &self.boards {
            bounds.push(("boards.tilt_deg", board.tilt_deg, (0.0, 89.0)));
            bounds.push(("boards.azimuth_deg", board.azimuth_deg, (-360.0, 360.0)));
            bounds.extend(each("boards.center_m", &board.center_m, (-1e3, 1e3)));
            bounds.extend(each("boards.size_m", &board.size_m, LENGTH));
        }
        for scanner in &self.scanners {
            bounds.extend(each(
                "scanners.translation_m",
                &scanner.translation_m,
                LENGTH_FROM_IMU,
            ));
            bounds.extend(each("scanners.rotation_deg", &scanner.rotation_deg, ANGLE));
            let initial = &scanner.initial_translation_m;
            bounds.extend(each(
                "scanners.initial_translation_m",
                initial,
                LENGTH_FROM_IMU,
            ));
            let initial = &scanner.initial_rotation_deg;
            bounds.extend(each("scanners.initial_rotation_deg", initial, ANGLE));
        }
        for pass in self.drives.iter().flat_map(|drive| &drive.passes) {
            bounds.push(("drives.passes.heading_deg", pass.heading_deg, ANGLE));
        }
        bounds
    }

    fn check_boards(&self) -> Result<()> {
        let cells = |size: &[f64; 2], spacing: f64| size[0] * size[1] / (spacing * spacing);
        let soil = cells(&self.field.size_m, self.reference.soil_spacing_m);
        let boards: f64 = self
            .boards
            .iter()
            .map(|b| cells(&b.size_m, self.reference.board_spacing_m))
            .sum();
        if soil + boards > 2e9 {
            return refuse("the reference would have more than two billion points");
        }
        Ok(())
    }

    fn check_scanners(&self) -> Result<()> {
        if self.scanners.is_empty() {
            return refuse("the scenario has no scanner");
        }
        for (i, scanner) in self.scanners.iter().enumerate() {
            let name = &scanner.name;
            // Names become file names.
            let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
            if name.is_empty() || !name.chars().all(plain) {
                return refuse(format!(
                    "the scanner name {name:?} does not consist of letters, digits, - and _"
                ));
            }
            if self.scanners[..i].iter().any(|other| other.name == *name) {
                return refuse(format!("two scanners are named {name:?}"));
            }
        }
        Ok(())
    }

    /// A drive is held in memory: its motion, IMU and aiding.
    fn check_durations(&self) -> Result<()> {
        /// Samples of the fastest sensor; 48 bytes each and more.
        const MOST_SAMPLES: f64 = 1e8;
        /// Control points of the motion a second.
        const KNOTS_HZ: f64 = 50.0;
        let motion = &self.motion;
        let across_m = self.field.size_m[0].hypot(self.field.size_m[1]);
        let turns_m = 4.0 * std::f64::consts::PI * motion.turn_radius_m;
        let pass_m = 2.0 * (across_m + 2.0 * self.field.margin_m) + turns_m;
        let slowest_m_s = motion.scan_speed_m_s.min(motion.transit_speed_m_s);
        let rate_hz = [self.prism.rate_hz, self.heading.rate_hz, KNOTS_HZ]
            .into_iter()
            .fold(self.imu.rate_hz, f64::max);
        for (d, drive) in self.drives.iter().enumerate() {
            let longest_s = drive.passes.len() as f64 * pass_m / slowest_m_s + motion.rest_s;
            if longest_s * rate_hz > MOST_SAMPLES {
                return refuse(format!(
                    "drive {} may last {longest_s:.0} s, too long for {rate_hz} samples a second",
                    d + 1
                ));
            }
        }
        Ok(())
    }

    fn check_drives(&self) -> Result<()> {
        if self.drives.is_empty() {
            return refuse("the scenario has no drive");
        }
        for (d, drive) in self.drives.iter().enumerate() {
            if !(1..=1000).contains(&drive.passes.len()) {
                return refuse(format!(
                    "drive {} has {} passes, not 1 to 1000",
                    d + 1,
                    drive.passes.len()
                ));
            }
            if let Some(pass) = drive.passes.iter().find(|p| p.board >= self.boards.len()) {
                return refuse(format!(
                    "drive {} passes board {}, but boards are numbered 0 to {}",
                    d + 1,
                    pass.board,
                    self.boards.len() as i64 - 1
                ));
            }
        }
        Ok(())
    }
}

/// Coordinates on the robot, metres.
const LENGTH_FROM_IMU: (f64, f64) = (-100.0, 100.0);

/// Angles in degrees.
const ANGLE: (f64, f64) = (-360.0, 360.0);

fn refuse(problem: impl Into<String>) -> Result<()> {
    Err(Error::data(problem, "correct the scenario"))
}
