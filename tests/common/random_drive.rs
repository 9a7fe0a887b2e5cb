//! Drives that are drawn at random, run as a user would, and compared with the truth.
#![allow(dead_code)] // tests and examples use their parts

use std::path::Path;
use std::time::Instant;

use boresight::calibration::PARAMETER_NAMES;
use boresight::error::Result;
use boresight::geometry::{BodyFromScanner, Vec3};
use boresight::pipeline::{Extras, Findings, Options, analyse};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::simulation::{Extent, Fault, ScannerKind, Scenario, SimulatedDrive, simulate};
use boresight::statistics::{NORMAL_97_5, rms};
use serde::{Deserialize, Serialize};

use super::against_truth::{
    Check, average_over_motion, mounting_errors, true_mountings, true_poses,
};

/// Errors beyond this many standard deviations are not due to chance.
pub const WRONG_SIGMAS: f64 = 4.0;

/// Codes, or their ends, of verdicts on faults that a drive has only if they are drawn for it.
const FAULTS: [&str; 19] = [
    ".step",
    ".lever_arm",
    ".time_offset",
    ".sign",
    ".direction",
    ".mounting_offset",
    ".axes",
    ".held",
    ".rounded",
    ".clock_jump",
    ".convention",
    ".swapped",
    ".rotation",
    ".noise",
    "scanner.translation",
    "frame.body",
    "frame.gravity",
    "reference.height",
    "reference.placement",
];

/// Codes of verdicts on a frame that is not rigid.
const MOVES: [&str; 4] = [
    "mounting.moves",
    "mounting.jump",
    "mounting.constancy",
    "mounting.gap",
];

/// Codes, or their ends, of the verdicts that name a fault.
fn names(fault: Fault) -> &'static [&'static str] {
    match fault {
        Fault::PositionStep | Fault::PositionBlock => &[".step"],
        Fault::PositionClock => &[".time_drift", ".time_offset"],
        Fault::PositionOutliers => &[".rejected"],
        Fault::GyroScale => &["imu.gyro_scale_factor", "imu.noise_scale"],
        Fault::RangeOffset => &["scanner.range"],
        Fault::ScannerLate => &["scanner.time_offset"],
        Fault::BoardMoved => &["reference.region"],
        Fault::ReferenceDisplaced => {
            &["reference.shift", "reference.height", "reference.placement"]
        }
    }
}

/// Draws the scenario of a seed, and a fault that its project does not state.
pub type Draw = dyn Fn(u64) -> (Scenario, Option<Fault>) + Sync;

/// Scenarios without such a fault.
pub fn without_fault(extent: Extent) -> impl Fn(u64) -> (Scenario, Option<Fault>) + Sync {
    move |seed| (Scenario::random(seed, &extent), None)
}

/// Scenarios with one each.
pub fn with_fault(extent: Extent) -> impl Fn(u64) -> (Scenario, Option<Fault>) + Sync {
    move |seed| {
        let (scenario, fault) = Scenario::random_faulty(seed, &extent);
        (scenario, Some(fault))
    }
}

/// The method that gave the result.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Way {
    /// No result: the error.
    Stopped(String),
    /// Two steps, because the joint adjustment was refused for these reasons.
    TwoSteps(Vec<String>),
    /// The joint adjustment with this model of the mountings.
    Joint(String),
}

/// The error of a parameter of a mounting and its standard deviation, metres or radians.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Deviation {
    pub scanner: usize,
    pub parameter: String,
    pub error: f64,
    pub sigma: f64,
}

/// The points for which the adjustment gives standard deviations.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Points {
    /// Root mean squares of their errors and of their standard deviations, metres.
    pub rms_m: [f64; 2],
    /// Share of the coordinates whose error lies in its 95 % interval.
    pub within_95: f64,
    /// Errors of one point east, north and up, in its standard deviations.
    pub one: [f64; 3],
}

/// The result of a random drive.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Ended {
    pub seed: u64,
    /// What was drawn, in a line.
    pub drawn: String,
    pub way: Way,
    /// Of the parameters that have a standard deviation.
    pub deviations: Vec<Deviation>,
    /// Largest error of a position (metres) and of a rotation (radians), whether it has a standard deviation or not: of
    /// the result and of the initial values.
    pub worst: [[f64; 2]; 2],
    /// Not after two steps.
    pub points: Option<Points>,
    /// Codes of the verdicts that need attention.
    pub warnings: Vec<String>,
    /// Those among them that name a fault which the drive does not have.
    pub false_alarms: Vec<String>,
    /// Whether a verdict names the drawn fault; `None` without one.
    pub is_named: Option<bool>,
    pub seconds: f64,
}

impl Ended {
    /// Simulates the scenario of a seed into a folder, and runs its project.
    pub fn of_seed(seed: u64, draw: &Draw, folder: &Path) -> Result<Self> {
        let (scenario, fault) = draw(seed);
        let files = simulate(&scenario, folder, &Silent)?;
        let drive = &files.drives[0];
        let begun = Instant::now();
        let project = Project::read(&drive.project)?;
        let options = Options {
            out: drive.folder.join("out"),
            seed: None,
            fresh: false,
            kept: Vec::new(),
        };
        let mut ended = match analyse(&project, &options, &Extras::default(), &Silent) {
            Err(error) => Self {
                seed,
                drawn: drawn(&scenario, fault),
                way: Way::Stopped(error.to_string()),
                deviations: Vec::new(),
                worst: [[0.0; 2]; 2],
                points: None,
                warnings: Vec::new(),
                false_alarms: Vec::new(),
                is_named: fault.map(|_| true),
                seconds: 0.0,
            },
            Ok(findings) => Self::compared(&scenario, fault, drive, &findings)?,
        };
        ended.seconds = begun.elapsed().as_secs_f64();
        Ok(ended)
    }

    fn compared(
        scenario: &Scenario,
        fault: Option<Fault>,
        drive: &SimulatedDrive,
        findings: &Findings,
    ) -> Result<Self> {
        let calibration = &findings.calibrations.result;
        let mut truth = scenario.true_mountings();
        let mut mountings = calibration.poses();
        let joint = findings.calibrations.accepted();
        let moving = true_mountings(scenario, drive)?;
        let bending = joint.map_or(&[][..], |joint| &joint.drives[0].bending);
        average_over_motion(&mut truth, &mut mountings, &moving, bending);
        let deviations = match &calibration.determined_covariance() {
            None => Vec::new(),
            Some(all) => deviations(&mountings, &truth, |place| all[(place, place)].sqrt()),
        };
        let check = Check {
            scenario,
            samples: &[],
            exact: &true_poses(drive)?,
            truth: &scenario.true_mountings(),
            moving,
            reference: &[],
        };
        let points = joint.and_then(|joint| {
            let late = |l: &Option<(f64, f64)>| l.map_or(0.0, |l| l.0);
            let late_s: Vec<f64> = joint.late_s.iter().map(late).collect();
            Points::of(&check.point_errors(joint, &late_s), scenario.seed)
        });
        let refused = findings.calibrations.joint.iter();
        let refused = refused.flat_map(|report| report.refused.clone());
        let way = joint.map_or_else(
            || Way::TwoSteps(refused.collect()),
            |joint| Way::Joint(format!("{:?}", joint.rung)),
        );
        let marked = findings.verdicts.iter().filter(|v| v.severity.is_marked());
        let warnings: Vec<String> = marked.map(|verdict| verdict.code.clone()).collect();
        Ok(Self {
            seed: scenario.seed,
            drawn: drawn(scenario, fault),
            way,
            worst: [&mountings, &scenario.initial_mountings()].map(|values| worst(values, &truth)),
            deviations,
            points,
            false_alarms: false_alarms(scenario, fault, &warnings),
            is_named: fault.map(|fault| {
                let mut all = findings.verdicts.iter();
                all.any(|verdict| names(fault).iter().any(|end| verdict.code.ends_with(end)))
            }),
            warnings,
            seconds: 0.0,
        })
    }

    /// The largest error of a parameter in units of its standard deviation; 0 without any.
    pub fn worst_sigmas(&self) -> f64 {
        let ratios = self.deviations.iter().map(|d| (d.error / d.sigma).abs());
        ratios.fold(0.0, f64::max)
    }

    /// Whether values are wrong and nothing says so.
    pub fn is_quietly_wrong(&self) -> bool {
        self.warnings.is_empty() && self.worst_sigmas() > WRONG_SIGMAS
    }

    /// How it ended, in a line.
    pub fn line(&self) -> String {
        let way = match &self.way {
            Way::Stopped(error) => return format!("stopped: {error}"),
            Way::TwoSteps(reasons) => format!("two steps ({})", reasons.join("; ")),
            Way::Joint(rung) => rung.clone(),
        };
        let [[shift_m, turn_rad], [start_m, start_rad]] = self.worst;
        let points = self.points.as_ref().map_or(String::new(), |points| {
            let [error_mm, sigma_mm] = points.rms_m.map(|m| 1e3 * m);
            let within = 100.0 * points.within_95;
            format!("points {error_mm:.2} mm ({sigma_mm:.2}, {within:.0} %), ")
        });
        let alarms = self.false_alarms.iter().map(|code| format!("!{code}"));
        let others = self
            .warnings
            .iter()
            .filter(|code| !self.false_alarms.contains(code));
        let codes: Vec<String> = alarms.chain(others.cloned()).collect();
        let named = match self.is_named {
            Some(true) => "named; ",
            Some(false) => "not named; ",
            None => "",
        };
        format!(
            "{way}: {:.1} sigma, {:.2} mm, {:.4}° (start {:.0} mm, {:.1}°), {points}{:.0} s; {named}{}",
            self.worst_sigmas(),
            1e3 * shift_m,
            turn_rad.to_degrees(),
            1e3 * start_m,
            start_rad.to_degrees(),
            self.seconds,
            codes.join(" "),
        )
    }
}

impl Points {
    /// Of errors and standard deviations, metres; `None` without any.
    fn of(errors: &[[Vec3; 2]], seed: u64) -> Option<Self> {
        if errors.is_empty() {
            return None;
        }
        let ratio = |[error, sigma]: &[Vec3; 2]| error.component_div(sigma);
        let all = errors.iter().map(ratio);
        let within: usize = all
            .map(|ratio| ratio.iter().filter(|r| r.abs() < NORMAL_97_5).count())
            .sum();
        // Spread over the points of different drives.
        let one = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) % errors.len() as u64;
        Some(Self {
            rms_m: [0, 1].map(|k| rms(errors.iter().map(|point| point[k].norm()))),
            within_95: within as f64 / (3 * errors.len()) as f64,
            one: ratio(&errors[one as usize]).into(),
        })
    }
}

/// Codes of the verdicts that name a fault which the drive does not have.
fn false_alarms(scenario: &Scenario, fault: Option<Fault>, warnings: &[String]) -> Vec<String> {
    let named = fault.map_or(&[][..], names);
    let is_named = |code: &&String| named.iter().any(|end| code.ends_with(end));
    let is_false = |code: &&String| {
        FAULTS.iter().any(|end| code.ends_with(end))
            || !scenario.deformation.enabled && MOVES.contains(&code.as_str())
            || scenario.imu.vibration_m_s2 == 0.0 && code.as_str() == "imu.noise_scale"
            || scenario.plants.count_per_m2 == 0.0 && code.as_str() == "reference.region"
    };
    let others = warnings.iter().filter(|code| !is_named(code));
    others.filter(is_false).cloned().collect()
}

/// What was drawn, in a line.
fn drawn(s: &Scenario, fault: Option<Fault>) -> String {
    let lidars = s.scanners_of(ScannerKind::Lidar).len();
    let fans = s.scanners.len() - lidars;
    let frame = &s.deformation;
    let frame = if !frame.enabled {
        "rigid"
    } else if frame.jump_m > 0.0 {
        "jumps"
    } else if frame.walk_m > 0.0 {
        "walks"
    } else if frame.drift_m > 0.0 {
        "drifts"
    } else {
        "bends"
    };
    let fault = fault.map_or(String::new(), |fault| format!("; {fault:?}"));
    let mark = |is_there: bool, text| if is_there { text } else { "" };
    format!(
        "{fans} fans {:.0} Hz x {} at {:.1} mm, {lidars} lidars; {:.1} m high, {:.2} m/s, {} passes; {} boards{}{}; \
         IMU {:.0} Hz {:.2} °/√h{}; positions {:.0} Hz {:.0} mm{}{}{}{}{}; {frame}{fault}",
        s.profiles.rate_hz,
        s.profiles.width,
        1e3 * s.profiles.sigma_m[0],
        s.motion.imu_height_m,
        s.motion.scan_speed_m_s,
        s.drives[0].passes.len(),
        s.boards.len(),
        mark(s.soil.clod_height_m > 0.0, ", clods"),
        mark(s.plants.count_per_m2 > 0.0, ", plants"),
        s.imu.rate_hz,
        s.imu.gyro_noise_deg_sqrt_h,
        mark(s.imu.vibration_m_s2 > 0.0, ", vibration"),
        s.prism.rate_hz,
        1e3 * s.prism.sigma_m,
        mark(s.prism.sigma_correlated_m > 0.0, " lasting"),
        mark(s.prism.latency_s > 0.0, ", late"),
        mark(!s.prism.lost_s.is_empty(), ", gaps"),
        mark(!s.heading.enabled, ", no heading"),
        mark(!s.reference.enabled, ", no reference"),
    )
}

/// The largest error of a position (metres) and of a rotation (radians).
fn worst(mountings: &[BodyFromScanner], truth: &[BodyFromScanner]) -> [f64; 2] {
    let all = deviations(mountings, truth, |_| 1.0);
    ["t", "r"].map(|kind| {
        let of_kind = all.iter().filter(|d| d.parameter.starts_with(kind));
        of_kind.map(|d| d.error.abs()).fold(0.0, f64::max)
    })
}

/// Deviations of the parameters that have a standard deviation.
fn deviations(
    mountings: &[BodyFromScanner],
    truth: &[BodyFromScanner],
    sigma: impl Fn(usize) -> f64,
) -> Vec<Deviation> {
    let errors = mounting_errors(mountings, truth).into_iter();
    let named = PARAMETER_NAMES.into_iter().cycle().zip(errors);
    let all = named
        .enumerate()
        .map(|(place, (parameter, error))| Deviation {
            scanner: place / PARAMETER_NAMES.len(),
            parameter: parameter.to_owned(),
            error,
            sigma: sigma(place),
        });
    all.filter(|deviation| deviation.sigma > 0.0).collect()
}
