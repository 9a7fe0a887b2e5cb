//! Bounds of the numbers of a scenario.

use super::field::Pass;
use super::scenario::Scenario;

/// Coordinates on the robot, metres.
const LENGTH_FROM_IMU: (f64, f64) = (-100.0, 100.0);

/// Angles in degrees.
const ANGLE: (f64, f64) = (-360.0, 360.0);

impl Scenario {
    /// Values with their smallest and largest allowed value.
    pub(super) fn bounds(&self) -> Vec<(&'static str, f64, (f64, f64))> {
        const POSITIVE: (f64, f64) = (1e-9, 1e4);
        const ANY: (f64, f64) = (0.0, 1e4);
        const SHARE: (f64, f64) = (0.0, 1.0);
        const SPEED: (f64, f64) = (1e-3, 10.0);
        const LENGTH: (f64, f64) = (0.01, 100.0);
        const COORDINATE: (f64, f64) = (-1e4, 1e4);
        const RATE: (f64, f64) = (0.01, 1e4);
        const LATENCY: (f64, f64) = (-10.0, 10.0);
        let (plants, motion, imu) = (&self.plants, &self.motion, &self.imu);
        let (prism, heading) = (&self.prism, &self.heading);
        let (profiles, lidar) = (&self.profiles, &self.lidar);
        let (reference, bend) = (&self.reference, &self.deformation);
        let mut bounds = vec![
            ("gravity_m_s2", self.gravity_m_s2, (0.1, 100.0)),
            ("field.margin_m", self.field.margin_m, (0.0, 100.0)),
            ("soil.cell_m", self.soil.cell_m, (1e-3, 1.0)),
            ("soil.clod_height_m", self.soil.clod_height_m, (0.0, 1.0)),
            ("soil.clod_size_m", self.soil.clod_size_m, LENGTH),
            ("soil.clod_cover", self.soil.clod_cover, (0.0, 0.95)),
            ("plants.count_per_m2", plants.count_per_m2, (0.0, 1e4)),
            ("plants.height_m", plants.height_m, (0.01, 5.0)),
            ("plants.leaf_m", plants.leaf_m, (1e-3, 1.0)),
            ("plants.sway_m", plants.sway_m, (0.0, 1.0)),
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
            ("imu.gyro_scale", imu.gyro_scale, (-0.5, 0.5)),
            ("imu.vibration_m_s2", imu.vibration_m_s2, (0.0, 100.0)),
            // A slower vibration would move the robot by millimetres.
            ("imu.vibration_hz", imu.vibration_hz, (10.0, 1e4)),
            ("prism.rate_hz", prism.rate_hz, RATE),
            ("prism.sigma_m", prism.sigma_m, ANY),
            ("prism.latency_s", prism.latency_s, LATENCY),
            ("prism.incidence_bias_m", prism.incidence_bias_m, COORDINATE),
            ("prism.sigma_correlated_m", prism.sigma_correlated_m, ANY),
            ("prism.correlation_s", prism.correlation_s, POSITIVE),
            ("prism.outlier_share", prism.outlier_share, SHARE),
            ("prism.outlier_m", prism.outlier_m, ANY),
            ("prism.clock_ppm", prism.clock_ppm, (-1e4, 1e4)),
            ("heading.rate_hz", heading.rate_hz, RATE),
            ("heading.sigma_deg", heading.sigma_deg, ANY),
            (
                "heading.mounting_offset_deg",
                heading.mounting_offset_deg,
                ANGLE,
            ),
            ("heading.latency_s", heading.latency_s, LATENCY),
            (
                "heading.sigma_correlated_deg",
                heading.sigma_correlated_deg,
                ANY,
            ),
            ("heading.correlation_s", heading.correlation_s, POSITIVE),
            ("profiles.rate_hz", profiles.rate_hz, RATE),
            ("profiles.step_m", profiles.step_m, (0.0, 0.1)),
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
            ("lidar.rate_hz", lidar.rate_hz, RATE),
            ("lidar.fan_deg", lidar.fan_deg, (0.0, 170.0)),
            ("lidar.sigma_m", lidar.sigma_m, ANY),
            ("lidar.dropout", lidar.dropout, SHARE),
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
            ("reference.surface_error_m", reference.surface_error_m, ANY),
            (
                "reference.surface_error_scale_m",
                reference.surface_error_scale_m,
                LENGTH,
            ),
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
            ("deformation.warming_deg", bend.warming_deg, COORDINATE),
            ("deformation.warming_m", bend.warming_m, COORDINATE),
            ("deformation.hysteresis", bend.hysteresis, ANY),
            ("deformation.walk_deg", bend.walk_deg, ANY),
            ("deformation.walk_m", bend.walk_m, ANY),
            (
                "deformation.walk_correlation_s",
                bend.walk_correlation_s,
                LENGTH,
            ),
            ("deformation.jump_m", bend.jump_m, COORDINATE),
        ];
        let each = |key, values: &[f64], range| {
            values
                .iter()
                .map(move |&v| (key, v, range))
                .collect::<Vec<_>>()
        };
        let project = &self.project;
        bounds.push(("project.sigma_reference_m", project.sigma_reference_m, ANY));
        bounds.extend(each(
            "project.voxel_sizes_m",
            &project.voxel_sizes_m,
            POSITIVE,
        ));
        bounds.extend(each("field.size_m", &self.field.size_m, (0.1, 1e3)));
        bounds.extend(each(
            "motion.wheelbase_track_m",
            &motion.wheelbase_track_m,
            LENGTH,
        ));
        bounds.extend(each("prism.lever_arm_m", &prism.lever_arm_m, COORDINATE));
        bounds.extend(each("prism.station_m", &prism.station_m, COORDINATE));
        bounds.extend(each("prism.lost_s", prism.lost_s.as_flattened(), ANY));
        let displaced_m = &prism.displaced_m;
        bounds.extend(each("prism.displaced_m", displaced_m, COORDINATE));
        bounds.extend(each("prism.displaced_s", &prism.displaced_s, ANY));
        bounds.extend(each("profiles.range_m", &profiles.range_m, LENGTH));
        bounds.extend(each("lidar.range_m", &lidar.range_m, LENGTH));
        bounds.extend(each("profiles.sigma_m", &profiles.sigma_m, ANY));
        bounds.extend(each("reference.offset_m", &reference.offset_m, COORDINATE));
        for board in &self.boards {
            bounds.push(("boards.tilt_deg", board.tilt_deg, (0.0, 89.0)));
            bounds.push(("boards.azimuth_deg", board.azimuth_deg, (-360.0, 360.0)));
            bounds.extend(each("boards.center_m", &board.center_m, (-1e3, 1e3)));
            bounds.extend(each("boards.size_m", &board.size_m, LENGTH));
            bounds.extend(each("boards.moved_m", &board.moved_m, (-100.0, 100.0)));
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
            bounds.push(("scanners.latency_s", scanner.latency_s, LATENCY));
            let offset_m = scanner.range_offset_m;
            bounds.push(("scanners.range_offset_m", offset_m, (-1.0, 1.0)));
        }
        for pass in self.drives.iter().flat_map(|drive| &drive.passes) {
            match pass {
                Pass::Board { heading_deg, .. } => {
                    bounds.push(("drives.passes.heading_deg", *heading_deg, ANGLE));
                }
                Pass::Line { from_m, to_m } => {
                    for axis in 0..2 {
                        let margin = self.field.margin_m;
                        let on_ground = (-margin, self.field.size_m[axis] + margin);
                        bounds.push(("drives.passes.from_m", from_m[axis], on_ground));
                        bounds.push(("drives.passes.to_m", to_m[axis], on_ground));
                    }
                }
            }
        }
        bounds
    }
}
