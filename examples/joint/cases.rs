//! The cases: faults of a drive, and the parameters that are estimated.

use boresight::Result;
use boresight::error::Error;
use boresight::geometry::{BodyFromScanner, Vec3};
use boresight::joint::{JointSettings, MountingMotion, Rung};
use boresight::project::{Motion, Project};
use boresight::simulation::{ScannerKind, ScannerSettings, Scenario};
use boresight::trajectory::{Constant, Nodes, TrajectorySettings};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::joint_drive::{Setup, bend};

/// Further options for experiments.
#[derive(Default)]
pub struct Options {
    /// Keys of the scenario with values, as TOML: `soil.clod_height_m=0.02`.
    pub set: Vec<String>,
    /// A preset or a file instead of the demo or the plain field.
    pub scenario: Option<String>,
    pub nodes: Nodes,
    pub surfel_m: Option<f64>,
    /// The only rung of the ladder.
    pub mounting: Option<Rung>,
    pub from_truth: bool,
}

/// All cases.
pub const NAMES: [&str; 33] = [
    "known",
    "compliance-evaluation",
    "compliance",
    "compliance-3",
    "hysteresis",
    "walk",
    "walk-together",
    "jump",
    "warming",
    "warming-unlogged",
    "reference",
    "shift",
    "no-reference",
    "prism-latency",
    "scanner-latency",
    "lever-arm",
    "no-heading",
    "heading-offset",
    "prism-lost",
    "prism-outliers",
    "clods",
    "start",
    "plain",
    "plain-reference",
    "deformation",
    "board",
    "sideways",
    "up",
    "lidar",
    "three-drives",
    "evaluation",
    "odd",
    "even",
];

/// Density of plants in the drives with clods.
const PLANTS_PER_M2: f64 = 10.0;

/// Standard deviations of mountings after a calibration, metres and radians.
const KNOWN_SIGMAS: [f64; 2] = [2e-4, 1e-4];

/// Directions in a revolution of the lidar: half as many as real lidars have.
const LIDAR_COLUMNS: usize = 720;

/// Length of the pieces that the cases `odd` and `even` keep and leave out in turn, seconds: about a pass.
const HALF_S: f64 = 25.0;

/// Deformation of the frame by the sun's heat, metres and degrees.
const WARMING: (f64, f64) = (0.008, 0.2);

/// Delay of time stamps, seconds.
const LATE_S: f64 = 0.02;

/// The setup of a case for a seed.
pub fn setup(name: &str, seed: u64, options: &Options) -> Result<Setup> {
    let base = match (&options.scenario, name) {
        (Some(scenario), _) => Scenario::load(scenario)?,
        (None, "plain" | "plain-reference" | "known") => Scenario::plain(),
        (None, _) => Scenario::demo(),
    };
    let mut setup = Setup::new(with_keys(Scenario { seed, ..base }, &options.set)?);
    let scenario = &mut setup.scenario;
    let mut change: Box<dyn Fn(&mut Project)> = Box::new(|_| ());
    match name {
        "reference" | "plain-reference" => {}
        "lidar" => {
            scenario.scanners[1] = lidar();
            scenario.lidar.columns = LIDAR_COLUMNS;
        }
        "three-drives" => setup.drives = 3,
        "evaluation" => setup.evaluate = true,
        "compliance-evaluation" => {
            bend(scenario, 0.25);
            setup.evaluate = true;
        }
        "odd" | "even" => setup.keep = Some((HALF_S, name == "even")),
        "shift" => {
            // As large as the sigmas that are assumed if none are given.
            let sigma = JointSettings::default().reference;
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut draw = |sigma: f64| Vec3::from_fn(|_, _| normal(&mut rng) * sigma);
            setup.reference = Some((draw(sigma.shift_m), draw(sigma.tilt_rad)));
            setup.joint = JointSettings::default();
        }
        "no-reference" | "plain" => setup.reference = None,
        "prism-latency" => {
            scenario.prism.latency_s = LATE_S;
            change = estimating(Constant::TimeOffset(0));
        }
        "scanner-latency" => {
            scenario
                .scanners
                .iter_mut()
                .for_each(|s| s.latency_s = LATE_S);
            change = Box::new(|project| {
                let scanners = project.scanners.iter_mut();
                scanners.for_each(|scanner| scanner.estimate_time_offset = true);
            });
        }
        "lever-arm" => {
            change = Box::new(|project| {
                let settings = settings(project);
                settings.positions[0].lever_arm_m += Vec3::new(0.006, -0.005, 0.006);
                settings.estimate.push(Constant::LeverArm(0));
            });
        }
        "no-heading" => {
            change = Box::new(|project| {
                if let Motion::Logs(logs) = &mut project.motion {
                    logs.heading = None;
                }
            });
        }
        "heading-offset" => {
            scenario.heading.mounting_offset_deg = 0.3;
            change = Box::new(|project| {
                let settings = settings(project);
                settings.heading.mounting_offset_rad = 0.0;
                settings.estimate.push(Constant::HeadingOffset);
            });
        }
        "prism-lost" => scenario.prism.lost_s = vec![[100.0, 120.0]],
        "prism-outliers" => {
            (scenario.prism.outlier_share, scenario.prism.outlier_m) = (0.05, 0.3);
        }
        "clods" => {
            (scenario.soil.clod_height_m, scenario.soil.clod_cover) = (0.02, 0.2);
            scenario.plants.count_per_m2 = PLANTS_PER_M2;
        }
        "start" => {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut direction = || Vec3::from_fn(|_, _| normal(&mut rng)).normalize();
            let truth = scenario.true_mountings();
            let starts: Vec<_> = truth
                .iter()
                .map(|truth| {
                    truth.perturbed(&(direction() * 1.3_f64.to_radians()), &(direction() * 0.05))
                })
                .collect();
            change = Box::new(move |project| {
                for (scanner, start) in project.scanners.iter_mut().zip(&starts) {
                    scanner.body_from_scanner = *start;
                }
            });
        }
        "deformation" => scenario.deformation.enabled = true,
        "compliance" => bend(scenario, 0.25),
        "compliance-3" => bend(scenario, 0.75),
        "hysteresis" => {
            bend(scenario, 0.25);
            scenario.deformation.hysteresis = 0.2;
        }
        "walk" => walk(scenario),
        "walk-together" => {
            walk(scenario);
            scenario.deformation.walk_together = true;
        }
        "known" => (setup.reference, setup.known) = (None, Some(KNOWN_SIGMAS)),
        "jump" => {
            bend(scenario, 0.0);
            scenario.deformation.jump_m = 0.003;
        }
        "warming" | "warming-unlogged" => {
            bend(scenario, 0.0);
            (
                scenario.deformation.warming_m,
                scenario.deformation.warming_deg,
            ) = WARMING;
            if name != "warming" {
                change = Box::new(|project| project.bending = None);
            }
        }
        "board" => scenario.boards[1].moved_m = [0.0, 0.0, 0.01],
        "sideways" => scenario.reference.offset_m = [0.005, 0.0, 0.0],
        "up" => {
            scenario.reference.offset_m = [0.0, 0.0, 0.005];
            setup.joint = JointSettings::default();
        }
        _ => {
            let names = NAMES.join(", ");
            return Err(Error::data(format!("no case {name}"), names));
        }
    }
    setup.joint.surfel_m = options.surfel_m;
    if let Some(rung) = options.mounting {
        setup.joint.mounting = MountingMotion {
            least: rung,
            most: rung,
        };
    }
    let Options {
        nodes, from_truth, ..
    } = *options;
    let truth = setup.scenario.true_mountings();
    setup.project = Box::new(move |project| {
        change(project);
        settings(project).nodes = nodes;
        if from_truth {
            start_near(project, &truth);
        }
    });
    Ok(setup)
}

/// A frame whose mountings move at random, each scanner independently.
fn walk(scenario: &mut Scenario) {
    bend(scenario, 0.0);
    let deformation = &mut scenario.deformation;
    (deformation.walk_m, deformation.walk_deg) = (0.0015, 0.08);
}

/// A spinning lidar that looks ahead and down, which replaces the right scanner.
fn lidar() -> ScannerSettings {
    ScannerSettings {
        name: "lidar".into(),
        kind: ScannerKind::Lidar,
        translation_m: [0.4, 0.0, -0.3],
        rotation_deg: [180.0, -35.0, 0.0],
        initial_translation_m: [0.42, -0.01, -0.29],
        initial_rotation_deg: [180.6, -34.5, 0.7],
        latency_s: 0.0,
        range_offset_m: 0.0,
    }
}

/// Saves most of the time of the two steps: they start a few millimetres from the truth, with only the finest voxels.
fn start_near(project: &mut Project, truth: &[BodyFromScanner]) {
    let off = Vec3::new(0.001, -0.0005, 0.0003);
    for (scanner, truth) in project.scanners.iter_mut().zip(truth) {
        scanner.body_from_scanner = truth.perturbed(&off, &off);
    }
    let sizes = &mut project.calibration.voxel_sizes_m;
    sizes.drain(..sizes.len() - 1);
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

fn estimating(constant: Constant) -> Box<dyn Fn(&mut Project)> {
    Box::new(move |project| settings(project).estimate.push(constant))
}

/// The settings of a simulated project, which has logs.
fn settings(project: &mut Project) -> &mut TrajectorySettings {
    match &mut project.motion {
        Motion::Logs(logs) => &mut logs.settings,
        Motion::Poses(_) => unreachable!("simulated projects have logs"),
    }
}

/// The scenario with new values of some keys.
fn with_keys(scenario: Scenario, keys: &[String]) -> Result<Scenario> {
    if keys.is_empty() {
        return Ok(scenario);
    }
    let wrong =
        |key: &str, reason: String| Error::data(format!("--set {key}: {reason}"), "KEY=VALUE");
    let text = toml::to_string(&scenario).map_err(|e| wrong("", e.to_string()))?;
    let mut all: toml::Table = text
        .parse()
        .map_err(|e: toml::de::Error| wrong("", e.to_string()))?;
    for line in keys {
        let table: toml::Table = line
            .parse()
            .map_err(|e: toml::de::Error| wrong(line, e.to_string()))?;
        merge(&mut all, table);
    }
    let text = toml::to_string(&all).map_err(|e| wrong("", e.to_string()))?;
    toml::from_str(&text).map_err(|e| wrong(&keys.join(" "), e.to_string()))
}

fn merge(into: &mut toml::Table, from: toml::Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(old)), toml::Value::Table(new)) => merge(old, new),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}
