//! `result.json` and `calibration.toml`.

use serde_json::{Map, Value, json};

use super::evaluate::{Against, Drive};
use super::{Findings, StageSeconds};
use crate::calibration::{Calibration, MountingForms};
use crate::project::Project;
use crate::report::content::MountingKind;
use crate::report::diagnostics::{self, PoseSigmas};
use crate::sensor::PoseRecord;
use crate::trajectory::Solution;

/// The whole `result.json`.
pub fn document(project: &Project, findings: &Findings) -> Value {
    let mut document = json!({
        "boresight": env!("CARGO_PKG_VERSION"),
        "scanners": scanners(&findings.calibration),
        "calibration": calibration(&findings.calibration),
        "evaluation": findings.drives.first().map_or(Value::Null, |drive| evaluation(project, drive)),
        "drives": drives(project, &findings.drives),
        "stages": stages(&findings.stages),
        "warnings": findings.warnings,
        "peak_memory_bytes": super::peak_memory_bytes(),
    });
    if let Some(track) = findings.tracks.first()
        && let Some(solution) = &track.solution
    {
        document["trajectory"] = trajectory(solution, &track.poses);
        document["rejected_rows"] = json!(findings.rejected_rows);
    }
    if let Some(without) = &findings.without_reference {
        document["without_reference"] = json!({
            "scanners": scanners(without),
            "calibration": calibration(without),
        });
    }
    if let Some(exact) = &findings.exact_poses {
        document["exact_poses"] = json!({
            "scanners": scanners(exact),
            "calibration": calibration(exact),
        });
    }
    if let Some(paper) = &findings.paper {
        document["paper_method"] = json!({
            "scanners": scanners(paper),
            "calibration": calibration(paper),
        });
    }
    if let Some(truth) = &findings.truth_mountings {
        let poses = project.scanners.iter().zip(truth);
        document["truth"] = poses
            .map(|(scanner, pose)| {
                (
                    scanner.name.clone(),
                    json!({"body_from_scanner": MountingForms::from(pose)}),
                )
            })
            .collect::<Map<_, _>>()
            .into();
    }
    document
}

/// Worst measurements listed.
const WORST: usize = 20;

/// The trajectory's adjustment: the solution with the test of each sensor, the worst measurements,
/// the rejections counted, and how well the poses are known.
pub fn trajectory(solution: &Solution, poses: &[PoseRecord]) -> Value {
    let mut value = json!(solution);
    for (i, sensor) in solution.sensors.iter().enumerate() {
        value["sensors"][i]["chi_square_passed"] = json!(diagnostics::passes(sensor));
    }
    for (i, constant) in solution.constants.iter().enumerate() {
        value["constants"][i]["determined"] = json!(constant.sigma.is_some());
    }
    value["worst"] = json!(diagnostics::worst(solution, WORST));
    value["rejection_counts"] = json!(diagnostics::rejection_counts(solution));
    value["pose_sigma"] = json!(PoseSigmas::of(poses));
    value
}

/// The scanners' mountings with sigmas.
pub fn scanners(calibration: &Calibration) -> Value {
    json!(calibration.scanners())
}

/// How the adjustment went and what it could determine.
pub fn calibration(calibration: &Calibration) -> Value {
    let mut value = json!(calibration);
    // They stand beside it.
    value
        .as_object_mut()
        .map(|entries| entries.remove("scanners"));
    value
}

/// `evaluation`: final comparisons at the top, those of the initial and the true mounting below.
fn evaluation(project: &Project, drive: &Drive) -> Value {
    let mut value = comparisons(project, drive, MountingKind::Final);
    for (key, kind) in [
        ("initial", MountingKind::Initial),
        ("truth", MountingKind::Truth),
    ] {
        let nested = comparisons(project, drive, kind);
        if nested
            .as_object()
            .is_some_and(|entries| !entries.is_empty())
        {
            value[key] = nested;
        }
    }
    value
}

fn comparisons(project: &Project, drive: &Drive, kind: MountingKind) -> Value {
    let mut entries = Map::new();
    for found in drive
        .agreements
        .iter()
        .filter(|found| found.mounting == kind)
    {
        let name = |index: usize| project.scanners[index].name.clone();
        let statistics = json!(found.statistics);
        match found.against {
            Against::Reference => {
                entries.insert(name(found.scanner), json!({"reference": statistics}));
            }
            Against::Scanner(other) => {
                entries.insert(
                    format!("{}-{}", name(other), name(found.scanner)),
                    statistics,
                );
            }
        }
    }
    entries.into()
}

fn drives(project: &Project, drives: &[Drive]) -> Value {
    drives
        .iter()
        .map(|drive| (drive.name.clone(), evaluation(project, drive)))
        .collect::<Map<_, _>>()
        .into()
}

fn stages(stages: &[StageSeconds]) -> Value {
    stages
        .iter()
        .map(|stage| (stage.name.clone(), json!({"seconds": stage.seconds})))
        .collect::<Map<_, _>>()
        .into()
}
