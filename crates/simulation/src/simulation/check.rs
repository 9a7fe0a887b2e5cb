//! Checks that a scenario can be simulated.

use super::field::Pass;
use super::scenario::Scenario;
use crate::error::{Error, Result};

impl Scenario {
    /// Checks that the scenario can be simulated, in bounded time and memory.
    ///
    /// # Errors
    /// An invalid value; the error names the first.
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
        if soil.clod_height_m > 0.0 && soil.clod_size_m < 2.0 * soil.cell_m {
            return refuse(format!(
                "soil.clod_size_m is {}, less than two cells of {} m",
                soil.clod_size_m, soil.cell_m
            ));
        }
        let field_m2: f64 = self.field.size_m.iter().product();
        if self.plants.count_per_m2 * field_m2 > 1e6 {
            return refuse("plants.count_per_m2 gives more than a million plants");
        }
        for (key, count, (low, high)) in [
            ("profiles.width", self.profiles.width, (2, 10_000)),
            ("lidar.rings", self.lidar.rings, (1, 1_000)),
            ("lidar.columns", self.lidar.columns, (4, 100_000)),
        ] {
            if !(low..=high).contains(&count) {
                return refuse(format!("{key} is {count}, not {low} to {high}"));
            }
        }
        for (key, [near, far]) in [
            ("profiles.range_m", self.profiles.range_m),
            ("lidar.range_m", self.lidar.range_m),
        ] {
            if far <= near {
                return refuse(format!("{key} is empty"));
            }
        }
        if let Some([from, to]) = self.prism.lost_s.iter().find(|[from, to]| from >= to) {
            return refuse(format!("prism.lost_s from {from} to {to} is empty"));
        }
        self.check_boards()?;
        self.check_scanners()?;
        self.check_drives()?;
        self.check_durations()
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
        /// Control points of the motion per second.
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
                    "drive {} may last {longest_s:.0} s, too long for {rate_hz} samples per second",
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
            for pass in &drive.passes {
                match *pass {
                    Pass::Board { board, .. } if board >= self.boards.len() => {
                        return refuse(format!(
                            "drive {} passes board {board}, but boards are numbered 0 to {}",
                            d + 1,
                            self.boards.len() as i64 - 1
                        ));
                    }
                    Pass::Line { from_m, to_m } if from_m == to_m => {
                        return refuse(format!(
                            "a pass of drive {} begins and ends at {from_m:?}",
                            d + 1
                        ));
                    }
                    _ => {}
                }
            }
        }
        Ok(())
    }
}

fn refuse(problem: impl Into<String>) -> Result<()> {
    Err(Error::data(problem, "correct the scenario"))
}
