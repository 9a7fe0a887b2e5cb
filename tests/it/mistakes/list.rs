//! The list of mistakes.

use crate::common::small_field::Field;

/// One mistake.
pub struct Mistake {
    pub name: &'static str,
    pub make: fn(&Field),
    /// Verdict codes, or parts of an error, of which one must name the mistake; if empty, any warning will do.
    pub names: &'static [&'static str],
}

const fn mistake(name: &'static str, names: &'static [&'static str], make: fn(&Field)) -> Mistake {
    Mistake { name, make, names }
}

const LEVER_ARM: &str = "lever_arm_m = [0.1, 0.05, -0.55]";
const LEFT_ROTATION: &str = "rotation_deg = [-145.0, 0.0, 90.0]\nrotation_convention = \"bonn\"";
const RIGHT_ROTATION: &str = "rotation_deg = [145.0, 0.0, 90.0]\nrotation_convention = \"bonn\"";
const OFFSET: &str = "mounting_offset_deg = 0.0";

/// All mistakes, each on a copy of the small field.
pub const MISTAKES: &[Mistake] = &[
    mistake(
        "lever arm: signs of x and y",
        &["prism.lever_arm"],
        |field| {
            field.project(LEVER_ARM, "lever_arm_m = [-0.1, -0.05, -0.55]");
        },
    ),
    mistake("lever arm: sign of z", &["prism.lever_arm"], |field| {
        field.project(LEVER_ARM, "lever_arm_m = [0.1, 0.05, 0.55]");
    }),
    mistake("lever arm in FLU", &["prism.lever_arm"], |field| {
        field.project(LEVER_ARM, "lever_arm_m = [0.1, -0.05, 0.55]");
    }),
    mistake(
        "lever arm: x and y exchanged",
        &["prism.lever_arm"],
        |field| {
            field.project(LEVER_ARM, "lever_arm_m = [0.05, 0.1, -0.55]");
        },
    ),
    mistake("lever arm 20 cm too long", &["prism.lever_arm"], |field| {
        field.project(LEVER_ARM, "lever_arm_m = [0.3, 0.05, -0.55]");
    }),
    mistake("lever arm in mm", &["millimetres"], |field| {
        field.project(LEVER_ARM, "lever_arm_m = [100, 50, -550]");
    }),
    mistake("translation in mm", &["millimetres"], |field| {
        field.project(
            "translation_m = [1.2, -0.5, 0.5]",
            "translation_m = [1200, -500, 500]",
        );
    }),
    mistake("heading offset 3°", &["heading.mounting_offset"], |field| {
        field.project(OFFSET, "mounting_offset_deg = 3.0");
    }),
    mistake(
        "antennas exchanged",
        &["heading.mounting_offset", "heading.direction"],
        |field| {
            field.project(OFFSET, "mounting_offset_deg = 180.0");
        },
    ),
    mistake(
        "antennas across",
        &["heading.mounting_offset", "heading.direction"],
        |field| {
            field.project(OFFSET, "mounting_offset_deg = -90.0");
        },
    ),
    mistake("heading counter-clockwise", &["heading.sign"], |field| {
        field.rows("heading.csv", |row| row[1] = (-row[1]).rem_euclid(360.0));
    }),
    mistake("heading from east", &["heading.sign"], |field| {
        field.rows("heading.csv", |row| {
            row[1] = (90.0 - row[1]).rem_euclid(360.0)
        });
    }),
    mistake("heading in radians", &["heading_rad"], |field| {
        field.rows("heading.csv", |row| row[1] = row[1].to_radians());
    }),
    mistake("prism 100 ms late", &["prism.time_offset"], |field| {
        field.rows("prism.csv", |row| row[0] += 0.1);
    }),
    mistake("heading 500 ms late", &["heading.time_offset"], |field| {
        field.rows("heading.csv", |row| row[0] += 0.5);
    }),
    mistake("prism 18 s late", &["prism.time_offset"], |field| {
        field.rows("prism.csv", |row| row[0] += 18.0);
    }),
    mistake(
        "prism in GPS seconds of week",
        &["overlap", "span"],
        |field| {
            field.rows("prism.csv", |row| row[0] += 200_000.0);
        },
    ),
    mistake("scanners 100 ms late", &["scanner.time_offset"], |field| {
        field.project(
            "profiles = \"left.bin\"",
            "profiles = \"left.bin\"\ntime_offset_s = 0.1",
        );
        field.project(
            "profiles = \"right.bin\"",
            "profiles = \"right.bin\"\ntime_offset_s = 0.1",
        );
    }),
    mistake(
        "left scanner 100 ms late",
        &["scanner.time_offset"],
        |field| {
            field.project(
                "profiles = \"left.bin\"",
                "profiles = \"left.bin\"\ntime_offset_s = 0.1",
            );
        },
    ),
    mistake(
        "scanners 18 s late",
        &["scanner.time_offset", "reference.placement"],
        |field| {
            field.project(
                "profiles = \"left.bin\"",
                "profiles = \"left.bin\"\ntime_offset_s = 18.0",
            );
            field.project(
                "profiles = \"right.bin\"",
                "profiles = \"right.bin\"\ntime_offset_s = 18.0",
            );
        },
    ),
    mistake("reference 20 mm too high", &["reference.height"], |field| {
        field.reference(|p| p.z += 0.02);
    }),
    mistake("reference 0.6 m too low", &["reference.height"], |field| {
        field.reference(|p| p.z -= 0.6);
    }),
    mistake(
        "reference 50 mm to the side",
        &["reference.shift"],
        |field| {
            field.reference(|p| p.x += 0.05);
        },
    ),
    mistake(
        "reference 0.5 m to the side",
        &["reference.placement", "reference.shift"],
        |field| {
            field.reference(|p| p.y += 0.5);
        },
    ),
    mistake("reference turned by 1°", &["reference.shift"], |field| {
        field.reference(|p| (p.x, p.y) = (p.x - 0.01745 * p.y, p.y + 0.01745 * p.x));
    }),
    mistake(
        "reference: east and north exchanged",
        &["reference.placement", "reference.shift", "placement.misfit"],
        |field| {
            field.reference(|p| (p.x, p.y) = (p.y, p.x));
        },
    ),
    mistake(
        "reference in another system",
        &["do not overlap"],
        |field| {
            field.reference(|p| p.x += 5000.0);
        },
    ),
    mistake(
        "a board moved by 10 mm",
        &["reference.region", "joint.refused"],
        |field| {
            field.reference(|p| {
                let on_board = (p.x - 3.6).abs() < 0.6 && (p.y - 1.2).abs() < 0.6 && p.z > 0.1;
                p.z += if on_board { 0.01 } else { 0.0 };
            });
        },
    ),
    mistake("accelerations in g", &["accel_x_g"], |field| {
        field.rows("imu.csv", |row| {
            row[4..7].iter_mut().for_each(|a| *a /= 9.81)
        });
    }),
    mistake("times of the prism in ms", &["do not overlap"], |field| {
        field.rows("prism.csv", |row| row[0] *= 1000.0);
    }),
    mistake("gyro in degrees", &["gyro_x_deg_s"], |field| {
        field.rows("imu.csv", |row| {
            row[1..4].iter_mut().for_each(|w| *w = w.to_degrees())
        });
    }),
    mistake("FLU for FRD", &["frame.body"], |field| {
        field.project("body = \"FRD\"", "body = \"FLU\"");
    }),
    mistake(
        "accelerations with the wrong sign",
        &["negate the accelerations"],
        |field| {
            field.rows("imu.csv", |row| row[4..7].iter_mut().for_each(|a| *a = -*a));
        },
    ),
    mistake("IMU: x and z exchanged", &["frame.body"], |field| {
        field.rows("imu.csv", |row| {
            row.swap(1, 3);
            row.swap(4, 6);
        });
    }),
    mistake("IMU: one gyro not measured", &["imu.held"], |field| {
        field.rows("imu.csv", |row| row[2] = 0.0);
    }),
    mistake(
        "IMU 20 times noisier than its datasheet",
        &["imu.noise_scale", "gyro.noise"],
        |field| {
            field.project(
                "gyro_noise_deg_sqrt_h = 0.15",
                "gyro_noise_deg_sqrt_h = 0.0075",
            );
            field.project(
                "accel_noise_ug_sqrt_hz = 57.0",
                "accel_noise_ug_sqrt_hz = 2.85",
            );
        },
    ),
    mistake(
        "prism: east and north exchanged",
        &["prism.axes"],
        |field| {
            field.rows("prism.csv", |row| row.swap(1, 2));
        },
    ),
    mistake("prism in mm", &["east_mm"], |field| {
        field.rows("prism.csv", |row| {
            row[1..4].iter_mut().for_each(|x| *x *= 1000.0)
        });
    }),
    mistake("prism in single precision", &["prism.rounded"], |field| {
        let zone_m = [363_000.0, 5_600_000.0, 0.0];
        field.rows("prism.csv", |row| {
            for (x, origin_m) in row[1..4].iter_mut().zip(zone_m) {
                *x = f64::from((*x + origin_m) as f32) - origin_m;
            }
        });
    }),
    mistake(
        "prism's sigma ten times too small",
        &["prism.noise"],
        |field| {
            field.project("sigma_m = 0.005", "sigma_m = 0.0005");
        },
    ),
    mistake(
        "convention zyx for bonn",
        &["scanner.convention"],
        |field| {
            field.project(LEFT_ROTATION, "rotation_deg = [-145.0, 0.0, 90.0]");
            field.project(RIGHT_ROTATION, "rotation_deg = [145.0, 0.0, 90.0]");
        },
    ),
    mistake(
        "quaternions as w, x, y, z",
        &["scanner.convention"],
        |field| {
            let left = "quaternion_xyzw = [0.2126311, 0.6743797, 0.6743797, -0.2126311]";
            let right = "quaternion_xyzw = [0.2126311, -0.6743797, -0.6743797, -0.2126311]";
            field.project(LEFT_ROTATION, left);
            field.project(RIGHT_ROTATION, right);
        },
    ),
    mistake(
        "convention zyx for bonn, left only",
        &["scanner.convention"],
        |field| {
            field.project(LEFT_ROTATION, "rotation_deg = [-145.0, 0.0, 90.0]");
        },
    ),
    mistake("left and right exchanged", &["scanner.swapped"], |field| {
        field.project("profiles = \"left.bin\"", "profiles = \"middle.bin\"");
        field.project("profiles = \"right.bin\"", "profiles = \"left.bin\"");
        field.project("profiles = \"middle.bin\"", "profiles = \"right.bin\"");
    }),
    mistake(
        "left profiles for both",
        &["the profiles of both scanner `left`"],
        |field| {
            field.project("profiles = \"right.bin\"", "profiles = \"left.bin\"");
        },
    ),
    mistake(
        "mountings in FLU",
        &["scanner.axes", "scanner.translation", "scanner.rotation"],
        |field| {
            field.project(
                "translation_m = [1.2, -0.5, 0.5]",
                "translation_m = [1.2, 0.5, -0.5]",
            );
            field.project(
                "translation_m = [1.2, 0.65, 0.5]",
                "translation_m = [1.2, -0.65, -0.5]",
            );
        },
    ),
    mistake(
        "left scanner turned by 180° about z",
        &["scanner.rotation"],
        |field| {
            field.project(
                "rotation_deg = [-145.0, 0.0, 90.0]",
                "rotation_deg = [-145.0, 0.0, -90.0]",
            );
        },
    ),
    mistake(
        "both scanners turned by 180° about z",
        &["scanner.rotation"],
        |field| {
            for side in [LEFT_ROTATION, RIGHT_ROTATION] {
                field.project(side, &side.replace("90.0]", "-90.0]"));
            }
        },
    ),
    mistake("a fixed tx 20 mm off", &["joint.refused"], |field| {
        field.project(
            "translation_m = [1.2, -0.5, 0.5]",
            "translation_m = [1.23, -0.5, 0.5]\nfixed = [\"tx\"]",
        );
    }),
    mistake("positions of zero while lock is lost", &[], |field| {
        let is_lost = |time_s: f64| (time_s % 60.0) < 10.0;
        field.rows("prism.csv", |row| {
            if is_lost(row[0]) {
                row[1..].fill(0.0);
            }
        });
    }),
    mistake("rotations 10° off", &[], |field| {
        field.project(
            "rotation_deg = [-145.0, 0.0, 90.0]",
            "rotation_deg = [-135.0, 0.0, 90.0]",
        );
        field.project(
            "rotation_deg = [145.0, 0.0, 90.0]",
            "rotation_deg = [155.0, 0.0, 90.0]",
        );
    }),
    mistake(
        "a position log in the place of the IMU's",
        &["columns"],
        |field| {
            field.project("file = \"imu.csv\"", "file = \"prism.csv\"");
        },
    ),
];

/// Pairs of mistakes by name.
pub const PAIRS: [[&str; 2]; 10] = [
    ["lever arm: sign of z", "heading offset 3°"],
    ["prism 100 ms late", "left scanner 100 ms late"],
    ["heading offset 3°", "prism 100 ms late"],
    ["reference 20 mm too high", "heading 500 ms late"],
    ["reference 50 mm to the side", "scanners 100 ms late"],
    ["left and right exchanged", "lever arm in FLU"],
    ["convention zyx for bonn", "heading from east"],
    [
        "a board moved by 10 mm",
        "prism's sigma ten times too small",
    ],
    [
        "IMU 20 times noisier than its datasheet",
        "antennas exchanged",
    ],
    ["prism 18 s late", "rotations 10° off"],
];
