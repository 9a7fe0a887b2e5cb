//! `result.json` and `calibration.toml`.

use serde_json::{Map, Value, json};

use super::evaluate::{Against, Drive};
use super::{Findings, StageSeconds};
use crate::calibration::Calibration;
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::{BodyFromScanner, EulerConvention};
use crate::project::Project;
use crate::report::content::MountingKind;
use crate::report::diagnostics::{self, PoseSigmas};
use crate::sensor::PoseRecord;
use crate::trajectory::Solution;

/// The whole `result.json`.
pub fn document(project: &Project, findings: &Findings) -> Value {
    let mut document = json!({
        "boresight": env!("CARGO_PKG_VERSION"),
        "scanners": scanners(project, &findings.calibration),
        "calibration": calibration(&findings.calibration),
        "evaluation": findings.drives.first().map_or(Value::Null, |drive| evaluation(project, drive)),
        "drives": drives(project, &findings.drives),
        "stages": stages(&findings.stages),
        "warnings": findings.warnings,
        "peak_memory_bytes": crate::tiles::peak_memory_bytes(),
    });
    if let Some(track) = findings.tracks.first()
        && let Some(solution) = &track.solution
    {
        document["trajectory"] = trajectory(solution, &track.poses);
        document["rejected_rows"] = json!(findings.rejected_rows);
    }
    if let Some(without) = &findings.without_reference {
        document["without_reference"] = json!({
            "scanners": scanners(project, without),
            "calibration": calibration(without),
        });
    }
    if let Some(exact) = &findings.exact_poses {
        document["exact_poses"] = json!({
            "scanners": scanners(project, exact),
            "calibration": calibration(exact),
        });
    }
    if let Some(paper) = &findings.paper {
        document["paper_method"] = json!({
            "scanners": scanners(project, paper),
            "calibration": calibration(paper),
        });
    }
    if let Some(truth) = &findings.truth_mountings {
        let poses = project.scanners.iter().zip(truth);
        document["truth"] = poses
            .map(|(scanner, pose)| {
                (
                    scanner.name.clone(),
                    json!({"body_from_scanner": pose_json(pose)}),
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
pub fn scanners(project: &Project, calibration: &Calibration) -> Value {
    let entries = project.scanners.iter().enumerate().map(|(index, scanner)| {
        let mounting = &calibration.mountings[index];
        let own = calibration.sigmas(index, mounting.convention);
        let degrees = |sigmas: [Option<f64>; 6]| -> Vec<Option<f64>> {
            sigmas[3..]
                .iter()
                .map(|sigma| sigma.map(f64::to_degrees))
                .collect()
        };
        let value = json!({
            "body_from_scanner": pose_json(&mounting.body_from_scanner),
            "sigma": {
                "translation_m": &own[..3],
                "rotation_deg": degrees(own),
                "euler_deg": {
                    "zyx": degrees(calibration.sigmas(index, EulerConvention::Zyx)),
                    "bonn": degrees(calibration.sigmas(index, EulerConvention::Bonn)),
                },
            },
            "rotation_convention": mounting.convention,
            "unobservable": calibration.unobservable(index),
        });
        (scanner.name.clone(), value)
    });
    entries.collect::<Map<_, _>>().into()
}

fn pose_json(pose: &BodyFromScanner) -> Value {
    json!({
        "translation_m": pose.translation_m.as_slice(),
        "quaternion_xyzw": pose.rotation.coords.as_slice(),
        "euler_deg": {
            "zyx": euler_deg_from_rotation(EulerConvention::Zyx, &pose.rotation),
            "bonn": euler_deg_from_rotation(EulerConvention::Bonn, &pose.rotation),
        },
    })
}

/// How the adjustment went and what it could determine.
pub fn calibration(calibration: &Calibration) -> Value {
    let scales: Vec<Value> = calibration
        .scales
        .iter()
        .map(|scale| {
            json!({
                "voxel_m": scale.voxel_m,
                "iterations": scale.iterations,
                "points": scale.points,
                "reference_points": scale.reference_points,
                "neighbourhoods": scale.neighbourhoods,
                "cost": scale.costs.last(),
                "costs": scale.costs,
                "ending": scale.ending.to_string(),
                "seconds": scale.seconds,
            })
        })
        .collect();
    let free: Vec<Value> = calibration
        .observability
        .free
        .iter()
        .map(|free| json!({"what": free.words, "eigenvalue_share": free.share}))
        .collect();
    let constancy = calibration.constancy.as_ref().map(|constancy| {
        json!({
            "constant": constancy.constant,
            "ratio_to_expected": constancy.ratio,
            "block_rms_m": constancy.rms_m,
            "strongest_correlation": constancy
                .strongest
                .map(|(with, r)| json!({"with": with, "coefficient": r})),
        })
    });
    json!({
        "method": calibration.method,
        "converged": calibration.converged,
        "scales": scales,
        "eigenvalue_shares": calibration.observability.shares,
        "undetermined": free,
        "mounting_constant": constancy,
    })
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
