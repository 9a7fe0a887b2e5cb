//! Contents such as a run on simulated drives would fill.

use boresight::geometry::euler::rotation_from_euler_deg;
use boresight::geometry::{BodyAxes, BodyFromScanner, EulerConvention, Mat3, Vec3, WorldFromBody};
use boresight::report::content::*;
use boresight::sensor::{PoseRecord, PoseSigma};

/// A value in [−1, 1] that looks random and depends on `i` alone.
fn noise(i: usize) -> f64 {
    let mut x = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5bf0_3635;
    x ^= x >> 29;
    x = x.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x ^= x >> 32;
    (x % 2_000_001) as f64 / 1e6 - 1.0
}

/// Roughly normal, standard deviation 1.
pub fn normal(i: usize) -> f64 {
    (0..6).map(|j| noise(7 * i + 131 * j)).sum::<f64>() / 2f64.sqrt()
}

fn mounting(translation: [f64; 3], bonn_deg: [f64; 3]) -> BodyFromScanner {
    BodyFromScanner::new(
        rotation_from_euler_deg(EulerConvention::Bonn, bonn_deg),
        Vec3::from(translation),
    )
}

fn estimate(
    label: &str,
    body_from_scanner: BodyFromScanner,
    sigma: Option<(f64, f64)>,
) -> MountingEstimate {
    let origin = match sigma {
        Some(_) => ParameterOrigin::Estimated,
        None => ParameterOrigin::Given,
    };
    MountingEstimate {
        label: label.into(),
        body_from_scanner,
        translation_sigma_m: [sigma.map(|s| s.0); 3],
        rotation_covariance_rad2: sigma.map(|s| Mat3::identity() * s.1.to_radians().powi(2)),
        origin: [origin; 6],
        is_result: false,
    }
}

fn table(scanner: &str, truth: BodyFromScanner, initial: BodyFromScanner) -> MountingTable {
    let near = |mm: f64, deg: f64| {
        let turn = boresight::geometry::so3::exp(
            &Vec3::new(deg, -0.6 * deg, 0.3 * deg).map(f64::to_radians),
        );
        BodyFromScanner::new(
            truth.rotation * turn,
            truth.translation_m + Vec3::new(mm, -0.4 * mm, 0.2 * mm) * 1e-3,
        )
    };
    let mut without = estimate("without reference", near(2.6, 0.07), Some((2.1e-3, 0.06)));
    without.body_from_scanner.translation_m.z = initial.translation_m.z;
    without.origin[2] = ParameterOrigin::NotObservable;
    without.translation_sigma_m[2] = None;
    let mut with = estimate("with reference", near(1.2, 0.03), Some((0.9e-3, 0.012)));
    with.is_result = true;
    let mut exact = estimate("exact poses", near(0.06, 0.002), Some((0.05e-3, 0.0015)));
    exact.origin[5] = ParameterOrigin::Fixed;
    MountingTable {
        scanner: scanner.into(),
        estimates: vec![estimate("initial", initial, None), without, with, exact],
        truth: Some(truth),
    }
}

fn drive(name: &str, offset: f64) -> DriveTrack {
    let poses = (0..12_000).map(|i| {
        let s = i as f64 / 12_000.0;
        let leg = (s * 6.0).floor();
        let along = (s * 6.0).fract() * 7.0;
        let (east, heading_deg) = if leg as i64 % 2 == 0 {
            (0.4 + along, 90.0)
        } else {
            (7.4 - along, 270.0f64)
        };
        let position = Vec3::new(east, 0.8 + leg * 0.85 + offset, 2.0);
        let pulse = ((i % 14) as f64 / 14.0 - 0.5).abs();
        PoseRecord {
            time_s: 1_000.0 + 0.025 * i as f64,
            world_from_body: WorldFromBody::new(
                BodyAxes::Frd.level_world_from_body(heading_deg.to_radians()),
                position,
            ),
            velocity_m_s: None,
            bias: None,
            sigma: Some(PoseSigma {
                position_m: Vec3::new(1.5, 1.4, 1.1) * 1e-3 * (1.0 + 0.2 * pulse),
                rotation_rad: Vec3::new(0.006, 0.006, 0.03).map(f64::to_radians)
                    * (1.0 + (-s * 30.0).exp()),
            }),
        }
    });
    DriveTrack {
        name: name.into(),
        poses: poses.collect(),
        sigmas: None,
        solution: None,
    }
}

fn map(pair: &str, drive: &str, n: usize) -> DistanceMap {
    let panel = |kind, mean: f64, wave: f64, sigma: f64| MapPanel {
        mounting: kind,
        points: (0..n)
            .map(|i| {
                let position_m = [3.75 + 3.75 * noise(2 * i), 3.0 + 3.0 * noise(2 * i + 1)];
                let pattern = mean + wave * (position_m[0] * 1.3).sin();
                MapPoint {
                    position_m,
                    distance_m: if i % 97 == 0 {
                        f64::NAN
                    } else {
                        pattern + sigma * normal(i)
                    },
                }
            })
            .collect(),
    };
    DistanceMap {
        pair: pair.into(),
        drive: drive.into(),
        panels: vec![
            panel(MountingKind::Initial, 0.041, 0.012, 0.004),
            panel(MountingKind::Final, 0.0001, 0.0005, 0.0012),
        ],
        colour_limit_m: None,
    }
}

fn distances() -> Vec<DistanceRow> {
    let mut rows = Vec::new();
    for pair in [
        "left to reference",
        "right to reference",
        "left against right",
    ] {
        for drive in ["drive-1", "drive-2", "drive-3"] {
            for (mounting, mean_m, std_m) in [
                (MountingKind::Initial, 0.0412, 0.0138),
                (MountingKind::Final, -0.00012, 0.00131),
                (MountingKind::Truth, 0.00004, 0.00129),
            ] {
                rows.push(DistanceRow {
                    pair: pair.into(),
                    drive: drive.into(),
                    mounting,
                    statistics: DistanceStatistics {
                        mean_m,
                        std_m,
                        rmse_m: f64::hypot(mean_m, std_m),
                        median_m: 0.9 * mean_m,
                        n: 74_312,
                    },
                });
            }
        }
    }
    rows
}

fn method(name: &str, first: usize, later: usize) -> MethodRun {
    let scales = [0.05, 0.04, 0.03, 0.02, 0.01, 0.005];
    let run = |(i, voxel_m): (usize, &f64)| {
        let iterations = if i == 0 { first } else { later };
        let floor = 1e-3 + 0.05 * voxel_m;
        let start = if i == 0 { 8.0 } else { 1.1 };
        ScaleRun {
            voxel_m: *voxel_m,
            points: (900.0 / (voxel_m * voxel_m)) as usize / 10,
            neighbourhoods: (700.0 / (voxel_m * voxel_m)) as usize / 10,
            iterations,
            cost: (0..=iterations)
                .map(|j| floor * (1.0 + (start - 1.0) * (-1.1 * j as f64).exp()))
                .collect(),
            seconds: 0.4 / voxel_m.sqrt(),
            max_translation_error_m: Some(1.9e-3 - 1e-4 * i as f64),
            max_rotation_error_rad: Some(5e-4),
        }
    };
    MethodRun {
        method: name.into(),
        converged: name != "paper",
        ending: if name == "paper" {
            "stopped at 50 iterations at 50 mm".into()
        } else {
            "every scale ended below 0.01 mm and 0.001°".into()
        },
        measure: CostMeasure::default(),
        scales: scales.iter().enumerate().map(run).collect(),
    }
}

fn correlation() -> CorrelationMatrix {
    let names = ["tx", "ty", "tz", "rx", "ry", "rz"];
    let labels: Vec<String> = ["left", "right"]
        .iter()
        .flat_map(|s| names.map(|n| format!("{s} {n}")))
        .collect();
    let n = labels.len();
    let value = |i: usize, j: usize| match (i, j) {
        _ if i == j => 1.0,
        (2, _) | (_, 2) => f64::NAN,
        _ => {
            let (a, b) = (i.min(j), i.max(j));
            let size: f64 = if (a, b) == (0, 4) { -0.93 } else { 0.0 };
            (size + 0.5 * noise(17 * a + b)).clamp(-1.0, 1.0)
        }
    };
    CorrelationMatrix {
        labels,
        values: (0..n)
            .map(|i| (0..n).map(|j| value(i, j)).collect())
            .collect(),
    }
}

fn residuals() -> ResidualFigure {
    let line = |label: &str, seed: usize, wave: f64| ResidualSeries {
        label: label.into(),
        blocks: (0..120)
            .map(|i| ResidualBlock {
                time_s: 1_000.0 + 2.5 * i as f64,
                mean_m: if i == 40 {
                    f64::NAN
                } else {
                    0.5e-3 * normal(seed + i) + wave * (0.12 * i as f64).sin()
                },
                expected_sigma_m: 0.6e-3 + 0.1e-3 * (0.3 * i as f64).cos(),
            })
            .collect(),
    };
    ResidualFigure {
        verdict: Verdict::attention(
            "The mounting of the right scanner seems not to be constant: its residuals swing by 3 mm along the drive, poses and noise explain 1.2 mm.",
        ),
        series: vec![line("left", 500, 0.0), line("right", 900, 2e-3)],
    }
}

/// Everything a run on simulated drives can fill, with `n` core points in each of six panels.
pub fn full(n: usize) -> Content {
    let left = mounting([1.254, -0.545, 0.587], [-143.769, -0.369, 89.833]);
    let right = mounting([1.259, 0.656, 0.585], [144.396, -0.346, 91.705]);
    let square = |x: f64, y: f64, label: &str| Outline {
        label: label.into(),
        corners_m: vec![
            [x, y],
            [x + 1.0, y + 0.2],
            [x + 0.8, y + 1.2],
            [x - 0.2, y + 1.0],
        ],
    };
    Content {
        title: "Calibration of drive-1".into(),
        version: "boresight 0.1.0".into(),
        date: "2026-01-01".into(),
        command: "boresight run demo/drive-1/project.toml --out out".into(),
        project: "demo/drive-1/project.toml".into(),
        seed: Some(1),
        summary: vec![
            Verdict::good(
                "Left scanner: points agree with the reference scan to 1.3 mm (before: 43 mm).",
            ),
            Verdict::good(
                "Right scanner: points agree with the reference scan to 1.4 mm (before: 39 mm).",
            ),
            Verdict::attention(
                "Residuals of the right scanner follow a pattern along the drive: the mounting seems not to be constant.",
            ),
            Verdict::neutral(
                "Two other drives, judged with the same mounting, agree to 1.5 mm and 1.6 mm.",
            ),
        ],
        inputs: vec![
            Fact {
                label: "IMU".into(),
                value: "imu.csv, 30 000 samples at 100 Hz, 300 s".into(),
            },
            Fact {
                label: "Prism".into(),
                value: "prism.csv, 2 100 positions at 7 Hz, σ 5 mm".into(),
            },
            Fact {
                label: "Scanner left".into(),
                value: "left.bin, 60 000 profiles at 200 Hz".into(),
            },
        ],
        mountings: vec![
            table(
                "left",
                left,
                mounting([1.2, -0.5, 0.5], [-145.0, 0.0, 90.0]),
            ),
            table(
                "right",
                right,
                mounting([1.2, 0.65, 0.5], [145.0, 0.0, 90.0]),
            ),
        ],
        distances: distances(),
        trajectory: Some(TrajectoryFigure {
            drives: vec![
                drive("drive-1", 0.0),
                drive("drive-2", 0.2),
                drive("drive-3", 0.45),
            ],
            background_m: (0..20_000)
                .map(|i| {
                    let [x, y] = [4.0 + 4.2 * noise(3 * i), 3.0 + 3.4 * noise(3 * i + 1)];
                    [x, y, 0.3 * (x * 0.9).sin().max(0.0)]
                })
                .collect(),
            outlines: vec![
                square(1.2, 1.2, "0°"),
                square(3.2, 3.6, "15°"),
                square(5.6, 1.4, "30°"),
                square(1.4, 4.0, "45°"),
                square(6.0, 4.2, "55°"),
            ],
        }),
        maps: vec![
            map("left to reference", "drive-1", n),
            map("right to reference", "drive-1", n),
            map("left against right", "drive-1", n),
        ],
        methods: vec![method("reweighted", 7, 2), method("paper", 50, 31)],
        correlation: Some(correlation()),
        observability: vec![
            Verdict::good("All twelve parameters can be found with the reference."),
            Verdict::attention(
                "Without a reference the common height of all scanners cannot be found: held at its initial value.",
            ),
        ],
        residuals: Some(residuals()),
        stages: [
            ("read", 1.2),
            ("trajectory", 0.9),
            ("georeference", 4.3),
            ("calibrate", 31.0),
            ("compare", 12.5),
        ]
        .map(|(name, seconds)| StageTime {
            name: name.into(),
            seconds,
        })
        .into(),
        peak_memory_bytes: Some(1_234_567_890),
        warnings: vec!["left.bin: 12 profiles lie outside the trajectory and are left out".into()],
    }
}
