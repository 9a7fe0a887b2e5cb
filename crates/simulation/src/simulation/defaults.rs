//! The paper's field, robot and drives.

use super::field::{
    BoardSettings, DriveSettings, Field, MotionSettings, Pass, PlantSettings, SoilSettings,
};
use super::scenario::Scenario;
use super::sensors::{
    DeformationSettings, HeadingSettings, ImuSettings, LidarSettings, PrismSettings,
    ProfileSettings, ProjectSettings, ReferenceSettings, ScannerKind, ScannerSettings,
};
use crate::geometry::BodyAxes;

impl Default for Scenario {
    fn default() -> Self {
        // Headings of the diagonals of the rectangle of boards, degrees clockwise from north.
        const TO_NE: f64 = 53.344;
        const TO_SW: f64 = TO_NE + 180.0;
        const TO_SE: f64 = 180.0 - TO_NE;
        const TO_NW: f64 = 360.0 - TO_NE;
        let board = |east, north, tilt_deg, azimuth_deg| BoardSettings {
            center_m: [east, north, 0.5],
            tilt_deg,
            azimuth_deg,
            size_m: [1.0, 1.0],
            moved_m: [0.0; 3],
        };
        let drive = |passes: &[(f64, &[usize])]| DriveSettings {
            passes: passes
                .iter()
                .flat_map(|&(heading_deg, boards)| {
                    boards
                        .iter()
                        .map(move |&board| Pass::Board { board, heading_deg })
                })
                .collect(),
        };
        Self {
            name: "demo".into(),
            seed: 1,
            body: BodyAxes::Frd,
            gravity_m_s2: 9.81,
            field: Field::default(),
            soil: SoilSettings::default(),
            plants: PlantSettings::default(),
            motion: MotionSettings::default(),
            imu: ImuSettings::default(),
            prism: PrismSettings::default(),
            heading: HeadingSettings::default(),
            profiles: ProfileSettings::default(),
            lidar: LidarSettings::default(),
            reference: ReferenceSettings::default(),
            deformation: DeformationSettings::default(),
            project: ProjectSettings::default(),
            boards: vec![
                board(1.6, 1.4, 30.0, 70.0),
                board(5.9, 1.4, 15.0, 310.0),
                board(3.75, 3.0, 0.0, 0.0),
                board(1.6, 4.6, 45.0, 160.0),
                board(5.9, 4.6, 55.0, 250.0),
            ],
            // Table I of the paper: result with reference, and initial values.
            scanners: vec![
                ScannerSettings {
                    name: "left".into(),
                    kind: ScannerKind::Profile,
                    translation_m: [1.254, -0.545, 0.587],
                    rotation_deg: [-143.769, -0.369, 89.833],
                    initial_translation_m: [1.2, -0.5, 0.5],
                    initial_rotation_deg: [-145.0, 0.0, 90.0],
                    latency_s: 0.0,
                    range_offset_m: 0.0,
                },
                ScannerSettings {
                    name: "right".into(),
                    kind: ScannerKind::Profile,
                    translation_m: [1.259, 0.656, 0.585],
                    rotation_deg: [144.396, -0.346, 91.705],
                    initial_translation_m: [1.2, 0.65, 0.5],
                    initial_rotation_deg: [145.0, 0.0, 90.0],
                    latency_s: 0.0,
                    range_offset_m: 0.0,
                },
            ],
            file: None,
            drives: vec![
                drive(&[
                    (90.0, &[0, 1]),
                    (270.0, &[4, 3]),
                    (TO_SE, &[3, 2, 1]),
                    (0.0, &[1, 4]),
                    (TO_SW, &[4, 2, 0]),
                ]),
                drive(&[
                    (TO_NE, &[0, 2, 4]),
                    (180.0, &[4, 1]),
                    (TO_NW, &[1, 2, 3]),
                    (180.0, &[3, 0]),
                ]),
                drive(&[
                    (270.0, &[1, 0]),
                    (TO_NE, &[0, 2, 4]),
                    (270.0, &[4, 3]),
                    (TO_SE, &[3, 2, 1]),
                ]),
            ],
        }
    }
}

impl Default for Field {
    fn default() -> Self {
        Self {
            size_m: [7.5, 6.0],
            margin_m: 5.0,
        }
    }
}

impl Default for SoilSettings {
    fn default() -> Self {
        Self {
            cell_m: 0.01,
            wavelengths_m: vec![2.6, 1.3, 0.7, 0.3, 0.12, 0.06, 0.03],
            sigmas_m: vec![0.016, 0.008, 0.004, 0.004, 0.003, 0.003, 0.0025],
            clod_height_m: 0.0,
            clod_size_m: 0.06,
            clod_cover: 0.2,
        }
    }
}

impl Default for PlantSettings {
    fn default() -> Self {
        Self {
            count_per_m2: 0.0,
            height_m: 0.2,
            leaf_m: 0.05,
            sway_m: 0.01,
        }
    }
}

impl Default for MotionSettings {
    fn default() -> Self {
        Self {
            scan_speed_m_s: 0.10,
            transit_speed_m_s: 0.26,
            rest_s: 8.0,
            turn_radius_m: 0.9,
            imu_height_m: 2.0,
            wheelbase_track_m: [1.6, 1.9],
            wheel_wavelength_m: 0.3,
            suspension_hz: 1.5,
            suspension_damping: 0.4,
        }
    }
}

impl Default for ImuSettings {
    fn default() -> Self {
        Self {
            rate_hz: 100.0,
            gyro_noise_deg_sqrt_h: 0.15,
            accel_noise_ug_sqrt_hz: 57.0,
            gyro_bias_instability_deg_h: 7.0,
            accel_bias_instability_ug: 14.0,
            bias_time_s: 100.0,
            gyro_bias_sigma_rad_s: 1.0e-3,
            accel_bias_sigma_m_s2: 0.03,
            vibration_m_s2: 0.0,
            vibration_hz: 30.0,
            noise: true,
            gyro_scale: 0.0,
        }
    }
}

impl Default for PrismSettings {
    fn default() -> Self {
        Self {
            rate_hz: 7.0,
            sigma_m: 0.005,
            lever_arm_m: [0.10, 0.05, -0.55],
            latency_s: 0.0,
            incidence_bias_m: 0.0,
            station_m: [-9.0, -7.0, 1.7],
            sigma_correlated_m: 0.0,
            correlation_s: 20.0,
            lost_s: Vec::new(),
            outlier_share: 0.0,
            outlier_m: 0.3,
            displaced_m: [0.0; 3],
            displaced_s: [0.0; 2],
            clock_ppm: 0.0,
        }
    }
}

impl Default for HeadingSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            rate_hz: 5.0,
            sigma_deg: 0.7,
            mounting_offset_deg: 0.0,
            latency_s: 0.0,
            sigma_correlated_deg: 0.0,
            correlation_s: 30.0,
        }
    }
}

impl Default for ProfileSettings {
    fn default() -> Self {
        Self {
            rate_hz: 25.0,
            width: 320,
            fan_deg: 70.0,
            range_m: [0.35, 1.85],
            sigma_m: [0.0001, 0.0003],
            step_m: 0.0,
            grazing_deg: 75.0,
            dropout: 0.003,
            edge_m: 0.03,
            edge_lost_flying: [0.7, 0.1],
        }
    }
}

impl Default for LidarSettings {
    fn default() -> Self {
        Self {
            rate_hz: 10.0,
            rings: 16,
            fan_deg: 30.0,
            columns: 180,
            range_m: [0.5, 10.0],
            sigma_m: 0.005,
            dropout: 0.003,
        }
    }
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            board_spacing_m: 0.003,
            soil_spacing_m: 0.006,
            sigma_m: 0.0005,
            offset_m: [0.0; 3],
            surface_error_m: 0.0,
            surface_error_scale_m: 0.3,
        }
    }
}

impl Default for ProjectSettings {
    fn default() -> Self {
        Self {
            voxel_sizes_m: vec![0.05, 0.04, 0.03, 0.02, 0.01, 0.005],
            states_errors: false,
            sigma_reference_m: 0.0,
        }
    }
}

impl Default for DeformationSettings {
    fn default() -> Self {
        Self {
            enabled: false,
            rotation_deg_per_deg: 0.2,
            shift_m_per_deg: 0.008,
            shift_m_per_m_s2: 0.005,
            drift_deg: 0.5,
            drift_m: 0.024,
            warming_deg: 0.0,
            warming_m: 0.0,
            hysteresis: 0.0,
            walk_deg: 0.0,
            walk_m: 0.0,
            walk_correlation_s: 5.0,
            walk_together: false,
            jump_m: 0.0,
        }
    }
}
