//! The findings of a run as the report shows it.

use super::evaluate::{Against, Agreement, Drive};
use super::stages::Poses;
use super::{Extras, Findings, Track, verdicts};
use crate::calibration::Calibration;
use crate::calibration::Method;
use crate::geometry::{BodyFromScanner, Vec3, so3};
use crate::project::{Motion, Project};
use crate::report::content::{
    Content, CorrelationMatrix, CostMeasure, DistanceMap, DistanceRow, DistanceStatistics,
    DriveTrack, Fact, MapPanel, MapPoint, MethodRun, MountingEstimate, MountingKind, MountingTable,
    ParameterOrigin, ResidualBlock, ResidualFigure, ResidualSeries, ScaleRun, StageTime,
    TrajectoryFigure, Verdict,
};
use crate::report::diagnostics::PoseSigmas;

/// Fills the report.
pub fn content(project: &Project, findings: &Findings, extras: &Extras) -> Content {
    let truth = findings.truth_mountings.as_deref();
    let named = |calibration: &Option<Calibration>, label: &str| {
        calibration
            .as_ref()
            .map(|found| method_run(found, label, truth))
    };
    let label = match findings.calibration.method {
        Method::Reweighted => "reweighted least squares",
        Method::Paper => "as in the paper",
    };
    let main = method_run(&findings.calibration, label, truth);
    let mut methods = vec![main];
    methods.extend(named(&findings.paper, "as in the paper"));
    methods.extend(named(&findings.without_reference, "without reference"));
    methods.extend(named(&findings.exact_poses, "with exact poses"));
    Content {
        title: format!("Calibration of {}", super::name_of(project)),
        version: version(),
        date: String::new(),
        command: extras.command.clone(),
        project: project.path.display().to_string(),
        seed: extras.seed,
        summary: verdicts::summary(project, findings),
        inputs: inputs(project, findings),
        mountings: mounting_tables(project, findings),
        distances: findings
            .drives
            .iter()
            .flat_map(|drive| rows(project, drive))
            .collect(),
        trajectory: Some(trajectory(&findings.tracks, &findings.background)),
        maps: findings
            .drives
            .iter()
            .flat_map(|drive| maps(project, drive))
            .collect(),
        methods,
        correlation: correlation(&findings.calibration),
        observability: observability(findings),
        residuals: residuals(project, &findings.calibration),
        stages: findings
            .stages
            .iter()
            .map(|stage| StageTime {
                name: stage.name.clone(),
                seconds: stage.seconds,
            })
            .collect(),
        peak_memory_bytes: crate::tiles::peak_memory_bytes(),
        warnings: findings.warnings.clone(),
    }
}

fn fact(label: &str, value: String) -> Fact {
    Fact {
        label: label.into(),
        value,
    }
}

/// The files that tell the motion.
fn log_facts(project: &Project) -> Vec<Fact> {
    let mut facts = Vec::new();
    match &project.motion {
        Motion::Logs(logs) => {
            facts.push(fact("IMU", logs.imu.path.display().to_string()));
            for (log, settings) in logs.positions.iter().zip(&logs.settings.positions) {
                facts.push(fact(&settings.name, log.path.display().to_string()));
            }
            if let Some(heading) = &logs.heading {
                facts.push(fact("heading", heading.path.display().to_string()));
            }
        }
        Motion::Poses(file) => facts.push(fact("trajectory", file.path.display().to_string())),
    }
    facts
}

fn inputs(project: &Project, findings: &Findings) -> Vec<Fact> {
    let mut facts = log_facts(project);
    for Track { name, poses, .. } in &findings.tracks {
        if let (Some(first), Some(last)) = (poses.first(), poses.last()) {
            let seconds = last.time_s - first.time_s;
            let value = format!("{} poses over {seconds:.1} s", poses.len());
            facts.push(fact(name, value));
        }
    }
    for scanner in &project.scanners {
        let files: Vec<_> = scanner
            .profiles
            .iter()
            .map(|p| p.display().to_string())
            .collect();
        let label = format!("scanner {}", scanner.name);
        facts.push(fact(&label, files.join(", ")));
    }
    let reference = project
        .reference
        .as_ref()
        .map(|r| r.path.display().to_string());
    facts.push(fact(
        "reference",
        reference.unwrap_or_else(|| "none".into()),
    ));
    facts
}

fn mounting_tables(project: &Project, findings: &Findings) -> Vec<MountingTable> {
    let with = if findings.without_reference.is_some() {
        "with reference"
    } else {
        "found"
    };
    project
        .scanners
        .iter()
        .enumerate()
        .map(|(index, scanner)| {
            let mut estimates = vec![MountingEstimate {
                label: "initial".into(),
                body_from_scanner: scanner.body_from_scanner,
                translation_sigma_m: [None; 3],
                rotation_covariance_rad2: None,
                origin: [ParameterOrigin::Given; 6],
                is_result: false,
            }];
            if let Some(without) = &findings.without_reference {
                estimates.push(estimate(without, index, "without reference", false));
            }
            estimates.push(estimate(&findings.calibration, index, with, true));
            if let Some(exact) = &findings.exact_poses {
                estimates.push(estimate(exact, index, "with exact poses", false));
            }
            MountingTable {
                scanner: scanner.name.clone(),
                estimates,
                truth: findings.truth_mountings.as_ref().map(|truth| truth[index]),
            }
        })
        .collect()
}

fn estimate(
    calibration: &Calibration,
    scanner: usize,
    label: &str,
    is_result: bool,
) -> MountingEstimate {
    let mounting = &calibration.mountings[scanner];
    let sigmas = calibration.sigmas(scanner, mounting.convention);
    let rotation = calibration.covariance.as_ref().map(|covariance| {
        let body = covariance.fixed_view::<3, 3>(6 * scanner + 3, 6 * scanner + 3);
        // The page perturbs on the scanner's side: φ = R_bsᵀ ψ.
        let turn = mounting.body_from_scanner.rotation.to_rotation_matrix();
        turn.matrix().tr_mul(&body) * turn.matrix()
    });
    MountingEstimate {
        label: label.into(),
        body_from_scanner: mounting.body_from_scanner,
        translation_sigma_m: [sigmas[0], sigmas[1], sigmas[2]],
        rotation_covariance_rad2: rotation,
        origin: std::array::from_fn(|parameter| {
            if mounting.fixed[parameter] {
                ParameterOrigin::Fixed
            } else if calibration.is_observable(scanner, parameter) {
                ParameterOrigin::Estimated
            } else {
                ParameterOrigin::NotObservable
            }
        }),
        is_result,
    }
}

fn rows(project: &Project, drive: &Drive) -> Vec<DistanceRow> {
    let mut found: Vec<&Agreement> = drive.agreements.iter().collect();
    found.sort_by_key(|found| {
        let against = match found.against {
            Against::Reference => (0, 0),
            Against::Scanner(other) => (1, other),
        };
        (against, found.scanner, found.mounting)
    });
    found
        .into_iter()
        .map(|found| DistanceRow {
            pair: found.pair(project),
            drive: drive.name.clone(),
            mounting: found.mounting,
            statistics: DistanceStatistics {
                mean_m: found.statistics.mean_m,
                std_m: found.statistics.std_m,
                rmse_m: found.statistics.rmse_m,
                median_m: found.statistics.median_m,
                n: found.statistics.n,
            },
        })
        .collect()
}

fn maps(project: &Project, drive: &Drive) -> Vec<DistanceMap> {
    drive
        .agreements
        .iter()
        .filter(|found| found.mounting == MountingKind::Final)
        .map(|last| {
            let first = drive.find(last.scanner, last.against, MountingKind::Initial);
            let panels = first.into_iter().chain([last]).map(|found| MapPanel {
                mounting: found.mounting,
                points: found
                    .distances
                    .core
                    .iter()
                    .filter(|core| core.distance_m.is_finite())
                    .map(|core| MapPoint {
                        position_m: [core.point.x, core.point.y],
                        distance_m: core.distance_m,
                    })
                    .collect(),
            });
            DistanceMap {
                pair: last.pair(project),
                drive: drive.name.clone(),
                panels: panels.collect(),
                colour_limit_m: None,
            }
        })
        .collect()
}

/// Poses drawn of one drive: about ten a second say as much as a hundred.
const DRAWN_POSES: usize = 3000;

fn trajectory(tracks: &[Track], background: &[Vec3]) -> TrajectoryFigure {
    TrajectoryFigure {
        drives: tracks.iter().map(drive_track).collect(),
        background_m: background
            .iter()
            .map(|point| [point.x, point.y, point.z])
            .collect(),
        outlines: Vec::new(),
    }
}

fn drive_track(track: &Track) -> DriveTrack {
    let stride = track.poses.len().div_ceil(DRAWN_POSES).max(1);
    DriveTrack {
        name: track.name.clone(),
        poses: track.poses.iter().step_by(stride).copied().collect(),
        sigmas: PoseSigmas::of(&track.poses),
        solution: track.solution.clone(),
    }
}

/// Fills the page of a trajectory alone.
pub fn trajectory_content(project: &Project, poses: &Poses, command: &str) -> Content {
    let track = Track::new(super::name_of(project), poses);
    Content {
        title: format!("Trajectory of {}", track.name),
        version: version(),
        command: command.into(),
        project: project.path.display().to_string(),
        inputs: log_facts(project),
        trajectory: Some(trajectory(&[track], &[])),
        ..Content::default()
    }
}

fn version() -> String {
    format!("boresight {}", env!("CARGO_PKG_VERSION"))
}

fn method_run(
    calibration: &Calibration,
    label: &str,
    truth: Option<&[BodyFromScanner]>,
) -> MethodRun {
    let scales = calibration.scales.iter().map(|scale| {
        let errors = truth.map(|truth| {
            let mut worst = (0.0f64, 0.0f64);
            for (scanner, (mounting, truth)) in scale.mountings.iter().zip(truth).enumerate() {
                let found = &mounting.body_from_scanner;
                let shift = found.translation_m - truth.translation_m;
                let turn = so3::log(&(found.rotation * truth.rotation.inverse()));
                for axis in (0..3).filter(|&axis| calibration.is_observable(scanner, axis)) {
                    worst.0 = worst.0.max(shift[axis].abs());
                }
                worst.1 = worst.1.max(turn.amax());
            }
            worst
        });
        ScaleRun {
            voxel_m: scale.voxel_m,
            points: scale.points + scale.reference_points,
            neighbourhoods: scale.neighbourhoods,
            iterations: scale.iterations,
            cost: scale
                .costs
                .iter()
                .map(|cost| mean_cost(calibration.method, cost / scale.neighbourhoods as f64))
                .collect(),
            seconds: scale.seconds,
            max_translation_error_m: errors.map(|worst| worst.0),
            max_rotation_error_rad: errors.map(|worst| worst.1),
        }
    });
    MethodRun {
        method: label.into(),
        measure: match calibration.method {
            Method::Reweighted => CostMeasure::Thickness,
            Method::Paper => CostMeasure::Omnivariance,
        },
        converged: calibration.converged,
        ending: calibration
            .scales
            .last()
            .map_or(String::new(), |scale| scale.ending.to_string()),
        scales: scales.collect(),
    }
}

/// What the page shows of a method's cost over the number of neighbourhoods.
fn mean_cost(method: Method, mean: f64) -> f64 {
    match method {
        // exp(½ mean ln(λ₃ + s²)): the geometric mean of √(λ₃ + s²).
        Method::Reweighted => (0.5 * mean).exp(),
        Method::Paper => mean.sqrt(),
    }
}

fn correlation(calibration: &Calibration) -> Option<CorrelationMatrix> {
    let covariance = calibration.covariance.as_ref()?;
    let size = covariance.nrows();
    let labels = calibration
        .mountings
        .iter()
        .flat_map(|mounting| {
            // Rotations here are about the body's axes, whatever the Euler convention.
            ["tx", "ty", "tz", "ωx", "ωy", "ωz"].map(|name| format!("{} {name}", mounting.name))
        })
        .collect();
    let values = (0..size)
        .map(|i| {
            (0..size)
                .map(|j| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt())
                .collect()
        })
        .collect();
    Some(CorrelationMatrix { labels, values })
}

pub(super) fn observability(findings: &Findings) -> Vec<Verdict> {
    let mut lines = statements(&findings.calibration, "")
        .into_iter()
        .map(Verdict::attention)
        .collect::<Vec<_>>();
    if lines.is_empty() {
        lines.push(Verdict::good(
            "Every free parameter is determined by the data.",
        ));
    }
    if let Some(without) = &findings.without_reference {
        let said = statements(without, " without a reference");
        lines.extend(said.into_iter().map(Verdict::neutral));
    }
    lines
}

/// What cannot be found, a sentence each.
pub fn statements(calibration: &Calibration, circumstance: &str) -> Vec<String> {
    calibration
        .observability
        .free
        .iter()
        .map(|free| {
            let mut words = free.words.clone();
            if let Some(first) = words.get_mut(0..1) {
                first.make_ascii_uppercase();
            }
            format!("{words} cannot be found{circumstance}: held at the initial value.")
        })
        .collect()
}

pub(super) fn residuals(project: &Project, calibration: &Calibration) -> Option<ResidualFigure> {
    let constancy = calibration.constancy.as_ref()?;
    let verdict = match not_constant(calibration) {
        Some(text) => Verdict::attention(text),
        None => Verdict::good(format!(
            "The mounting seems constant: residuals along the drive ({}) are {:.1} times what the \
             poses' standard deviations explain.",
            verdicts::millimetres(constancy.rms_m),
            constancy.ratio
        )),
    };
    let series = project
        .scanners
        .iter()
        .zip(&constancy.blocks)
        .map(|(scanner, blocks)| ResidualSeries {
            label: scanner.name.clone(),
            blocks: blocks
                .iter()
                .map(|block| ResidualBlock {
                    time_s: block.time_s,
                    mean_m: block.mean_m,
                    expected_sigma_m: block.expected_sigma_m,
                })
                .collect(),
        })
        .collect();
    Some(ResidualFigure { verdict, series })
}

/// Says that the mounting seems not to be constant, where the residuals along the drive say so.
pub(super) fn not_constant(calibration: &Calibration) -> Option<String> {
    let constancy = calibration
        .constancy
        .as_ref()
        .filter(|found| !found.constant)?;
    let strong = constancy.strongest.filter(|(_, r)| r.abs() > 0.3);
    let with = strong.map_or(String::new(), |(name, r)| {
        format!(" They go most with {name} (correlation {r:.2}).")
    });
    Some(format!(
        "The mounting seems not to be constant: residuals along the drive ({}) are {:.1} times \
         what the poses' standard deviations explain.{with}",
        verdicts::millimetres(constancy.rms_m),
        constancy.ratio
    ))
}
