//! Results like those of a run on simulated drives.

use std::borrow::Cow;

use boresight::calibration::Block;
use boresight::calibration::{
    Calibration, Constancy, Correlation, Ending, Method, Mounting, Scale, Variant,
};
use boresight::calibration::{Observability, UnobservableDirection};
use boresight::comparison::{
    Against, Agreement, Agreements, CoreDistance, DistanceMap, M3c2, MountingKind, Statistics,
};
use boresight::geometry::euler::rotation_from_euler_deg;
use boresight::geometry::{BodyAxes, BodyFromScanner, EulerConvention, Vec3, WorldFromBody, so3};
use boresight::joint::JointReport;
use boresight::judgement::judge;
use boresight::progress::StageSeconds;
use boresight::report::content::*;
use boresight::results::{Calibrations, Drive, Results};
use boresight::sensor::{PoseRecord, PoseSigma};
use boresight::verdict::Acceptance;
use nalgebra::{DMatrix, DVector};

/// A pseudo-random value in [−1, 1] that depends only on `i`.
fn noise(i: usize) -> f64 {
    let mut x = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5bf0_3635;
    x ^= x >> 29;
    x = x.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x ^= x >> 32;
    (x % 2_000_001) as f64 / 1e6 - 1.0
}

/// Approximately normal, with standard deviation 1.
pub fn normal(i: usize) -> f64 {
    (0..6).map(|j| noise(7 * i + 131 * j)).sum::<f64>() / 2f64.sqrt()
}

/// The parts from which a [`Content`] is made.
pub struct Full {
    pub title: String,
    pub command: String,
    pub inputs: Vec<Fact>,
    pub mountings: Vec<(MountingKind, Vec<BodyFromScanner>)>,
    pub result: Calibration,
    pub joint: Option<JointReport>,
    pub variants: Vec<(Variant, Calibration)>,
    pub drives: Vec<Drive>,
    pub background_m: Vec<Vec3>,
    pub stages: Vec<StageSeconds>,
    pub warnings: Vec<String>,
}

/// The origin of the project.
pub const ORIGIN_M: Vec3 = Vec3::new(1_000.0, 2_000.0, 0.0);

impl Full {
    pub fn calibrations(&self) -> Calibrations {
        Calibrations {
            mountings: self.mountings.clone(),
            result: self.result.clone(),
            joint: self.joint.clone(),
            variants: self.variants.clone(),
            origin_m: ORIGIN_M,
        }
    }

    pub fn content(&self) -> Content<'_> {
        let mut content = Content {
            title: self.title.clone(),
            command: self.command.clone(),
            project: self.command.clone(),
            seed: Some(1),
            inputs: self.inputs.clone(),
            calibrations: Some(Cow::Owned(self.calibrations())),
            drives: Cow::Borrowed(&self.drives),
            background_m: Cow::Borrowed(&self.background_m),
            stages: Cow::Borrowed(&self.stages),
            peak_memory_bytes: Some(1_234_567_890),
            warnings: Cow::Borrowed(&self.warnings),
            ..Content::default()
        };
        let results = Results {
            drives: &content.drives,
            placement: None,
            calibrations: content.calibrations.as_deref(),
        };
        content.verdicts = judge(&results, &Acceptance::default());
        content
    }
}

fn mounting(translation: [f64; 3], bonn_deg: [f64; 3]) -> BodyFromScanner {
    BodyFromScanner::new(
        rotation_from_euler_deg(EulerConvention::Bonn, bonn_deg),
        Vec3::from(translation),
    )
}

/// Mountings at this distance from the truth.
fn near(truth: &[BodyFromScanner], mm: f64, deg: f64) -> Vec<Mounting> {
    let turn = so3::exp(&Vec3::new(deg, -0.6 * deg, 0.3 * deg).map(f64::to_radians));
    let shift = Vec3::new(mm, -0.4 * mm, 0.2 * mm) * 1e-3;
    let scanners = ["left", "right"].iter().zip(truth);
    scanners
        .map(|(name, truth)| Mounting {
            name: (*name).into(),
            body_from_scanner: BodyFromScanner::new(
                truth.rotation * turn,
                truth.translation_m + shift,
            ),
            convention: EulerConvention::Bonn,
            fixed: [false; 6],
        })
        .collect()
}

/// A calibration with these mountings and standard deviations, and numbers of iterations on the first
/// scale and on the others.
fn calibration(
    method: Method,
    mountings: Vec<Mounting>,
    sigma_m: f64,
    sigma_deg: f64,
    (first, later): (usize, usize),
) -> Calibration {
    let scales = [0.05, 0.04, 0.03, 0.02, 0.01, 0.005];
    let scale = |(i, voxel_m): (usize, &f64)| {
        let iterations = if i == 0 { first } else { later };
        let floor_m = 1e-3 + 0.05 * voxel_m;
        let start = if i == 0 { 8.0 } else { 1.1 };
        let neighbourhoods = (700.0 / (voxel_m * voxel_m)) as usize / 10;
        let costs: Vec<f64> = (0..=iterations)
            .map(|j| {
                let mean = floor_m * (1.0 + (start - 1.0) * (-1.1 * j as f64).exp());
                neighbourhoods as f64
                    * match method {
                        Method::TwoStep | Method::Joint => 2.0 * mean.ln(),
                        Method::Paper => mean.powi(4),
                    }
            })
            .collect();
        Scale {
            voxel_m: *voxel_m,
            iterations,
            points: (800.0 / (voxel_m * voxel_m)) as usize / 10,
            reference_points: (100.0 / (voxel_m * voxel_m)) as usize / 10,
            neighbourhoods,
            cost: costs[iterations],
            costs,
            ending: match method {
                Method::TwoStep | Method::Joint => Ending::Converged,
                Method::Paper => Ending::IterationsExhausted,
            },
            seconds: 0.4 / voxel_m.sqrt(),
            mountings: mountings.clone(),
        }
    };
    let sigma = |i: usize| match i % 6 {
        0..3 => sigma_m,
        _ => sigma_deg.to_radians(),
    };
    let correlation = |i: usize, j: usize| match (i.min(j), i.max(j)) {
        (a, b) if a == b => 1.0,
        (0, 4) => -0.93,
        (a, b) => 0.05 * noise(17 * a + b),
    };
    let covariance = DMatrix::from_fn(12, 12, |i, j| correlation(i, j) * sigma(i) * sigma(j));
    Calibration {
        method,
        converged: method == Method::TwoStep,
        scales: scales.iter().enumerate().map(scale).collect(),
        covariance: (method == Method::TwoStep).then_some(covariance),
        observability: Observability {
            shares: vec![0.02; 12],
            unobservable: Vec::new(),
        },
        origin_sigma_m: 0.0,
        minimum: None,
        constancy: None,
        gap: None,
        mountings,
    }
}

/// Makes the common height unobservable.
fn without_height(mut calibration: Calibration, initial: &[BodyFromScanner]) -> Calibration {
    let height = 2;
    for (scanner, (mounting, initial)) in calibration.mountings.iter_mut().zip(initial).enumerate()
    {
        let row = 6 * scanner + height;
        if let Some(covariance) = &mut calibration.covariance {
            covariance.row_mut(row).fill(0.0);
            covariance.column_mut(row).fill(0.0);
        }
        mounting.body_from_scanner.translation_m.z = initial.translation_m.z;
    }
    let direction = DVector::from_fn(12, |row, _| f64::from(u8::from(row % 6 == height)));
    calibration.observability.unobservable = vec![UnobservableDirection {
        constraint: direction.normalize(),
        direction,
        is_hidden: false,
        share: 1e-6,
        description: "the common height of all scanners".into(),
        parameters: vec![(0, height), (1, height)],
    }];
    calibration
}

fn constancy() -> Constancy {
    let line = |seed: usize, wave: f64| -> Vec<Block> {
        (0..120)
            .map(|i| Block {
                time_s: 1_000.0 + 2.5 * i as f64,
                median_m: if i == 40 {
                    f64::NAN
                } else {
                    0.5e-3 * normal(seed + i) + wave * (0.12 * i as f64).sin()
                },
                expected_sigma_m: 0.6e-3 + 0.1e-3 * (0.3 * i as f64).cos(),
            })
            .collect()
    };
    Constancy {
        blocks: vec![line(500, 0.0), line(900, 2e-3)],
        ratio: 2.5,
        rms_m: 1.5e-3,
        constant: false,
        jump: None,
        strongest: Some(Correlation {
            with: "roll".into(),
            coefficient: 0.71,
        }),
    }
}

fn drive(name: &str, offset: f64, n: usize) -> Drive {
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
    Drive {
        name: name.into(),
        poses: poses.collect(),
        agreements: agreements(n),
        ..Drive::default()
    }
}

/// `n` core points for each pair and mounting.
fn agreements(n: usize) -> Agreements {
    let other = || Against::Scanner("left".into());
    let pairs = [
        ("left", Against::Reference),
        ("right", Against::Reference),
        ("right", other()),
    ];
    let kinds = [
        (MountingKind::Initial, 0.041, 0.012, 0.004),
        (MountingKind::Final, 0.0001, 0.0005, 0.00125),
        (MountingKind::Truth, 0.00004, 0.0004, 0.00122),
    ];
    let found = pairs.iter().flat_map(|(scanner, against)| {
        kinds.map(|(mounting, mean, wave, sigma)| {
            let distances = distances(n, mean, wave, sigma);
            Agreement {
                coverage: 0.9,
                scanner: (*scanner).into(),
                against: against.clone(),
                mounting,
                statistics: Statistics::of(&distances).expect("finite distances"),
                distances: DistanceMap::of(&distances),
            }
        })
    });
    Agreements {
        comparisons: found.collect(),
        missing: Vec::new(),
        passes: Vec::new(),
    }
}

fn distances(n: usize, mean: f64, wave: f64, sigma: f64) -> M3c2 {
    let core = (0..n).map(|i| {
        let (east, north) = (3.75 + 3.75 * noise(2 * i), 3.0 + 3.0 * noise(2 * i + 1));
        let pattern = mean + wave * (east * 1.3).sin();
        CoreDistance {
            point: Vec3::new(east, north, 0.0),
            normal: Vec3::z(),
            normal_radius_m: 0.04,
            distance_m: if i % 97 == 0 {
                f64::NAN
            } else {
                pattern + sigma * normal(i)
            },
            level_of_detection_m: 2e-3,
            reference_spread_m: 1e-3,
            compared_spread_m: 1e-3,
            reference_count: 20,
            compared_count: 20,
        }
    });
    M3c2 {
        core: core.collect(),
    }
}

/// All results that a run on simulated drives can have, with `n` core points for each pair and mounting
/// of the first drive.
pub fn full(n: usize) -> Full {
    let truth = vec![
        mounting([1.254, -0.545, 0.587], [-143.769, -0.369, 89.833]),
        mounting([1.259, 0.656, 0.585], [144.396, -0.346, 91.705]),
    ];
    let initial = vec![
        mounting([1.2, -0.5, 0.5], [-145.0, 0.0, 90.0]),
        mounting([1.2, 0.65, 0.5], [145.0, 0.0, 90.0]),
    ];
    let ours = |mm, deg, sigma_m, sigma_deg| {
        let mountings = near(&truth, mm, deg);
        calibration(Method::TwoStep, mountings, sigma_m, sigma_deg, (7, 2))
    };
    let mut result = ours(1.2, 0.03, 0.9e-3, 0.012);
    result.constancy = Some(constancy());
    let mut exact = ours(0.06, 0.002, 0.05e-3, 0.0015);
    exact.mountings[0].fixed[5] = true;
    let without = without_height(ours(2.6, 0.07, 2.1e-3, 0.06), &initial);
    let paper = calibration(Method::Paper, near(&truth, 4.0, 0.2), 1.0, 1.0, (50, 31));
    let stages = [
        ("reference", 1.2),
        ("trajectory", 0.9),
        ("georeference", 4.3),
        ("calibrate", 31.0),
        ("compare", 12.5),
    ];
    Full {
        title: "Calibration of drive-1".into(),
        command: "boresight run demo/drive-1/project.toml --out out".into(),
        inputs: vec![
            Fact {
                label: "IMU".into(),
                value: "imu.csv, 30 000 samples at 100 Hz, 300 s".into(),
            },
            Fact {
                label: "scanner left".into(),
                value: "left.bin, 60 000 profiles at 200 Hz".into(),
            },
        ],
        mountings: vec![
            (MountingKind::Initial, initial),
            (MountingKind::Final, result.poses()),
            (MountingKind::Truth, truth),
        ],
        result,
        joint: None,
        variants: vec![
            (Variant::WithoutReference, without),
            (Variant::ExactPoses, exact),
            (Variant::Paper, paper),
        ],
        drives: vec![
            drive("drive-1", 0.0, n),
            drive("drive-2", 0.2, 50),
            drive("drive-3", 0.45, 50),
        ],
        background_m: (0..20_000)
            .map(|i| {
                let [x, y] = [4.0 + 4.2 * noise(3 * i), 3.0 + 3.4 * noise(3 * i + 1)];
                Vec3::new(x, y, 0.3 * (x * 0.9).sin().max(0.0))
            })
            .collect(),
        stages: stages
            .map(|(name, seconds)| StageSeconds {
                name: name.into(),
                seconds,
            })
            .into(),
        warnings: vec!["left.bin: 12 profiles lie outside the trajectory and are left out".into()],
    }
}
