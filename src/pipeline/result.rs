//! `result.json`.

use serde_json::{Map, Value, json};

use super::findings::Findings;
use crate::calibration::{Calibration, Variant};
use crate::comparison::{Against, Agreements, MountingKind};
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::{BodyFromScanner, EulerConvention};
use crate::progress::StageSeconds;
use crate::report::content::Drive;
use crate::report::diagnostics::{self, PoseSigmas};
use crate::sensor::PoseRecord;
use crate::tiles::peak_memory_bytes;
use crate::trajectory::Solution;

/// The whole `result.json`.
pub fn document(findings: &Findings) -> Value {
    let mut document = calibrated(&findings.calibration);
    document["boresight"] = json!(env!("CARGO_PKG_VERSION"));
    document["drives"] = drives(&findings.drives);
    document["stages"] = stages(&findings.stages);
    document["warnings"] = json!(findings.warnings);
    document["peak_memory_bytes"] = json!(peak_memory_bytes());
    if let Some(drive) = findings.drives.first() {
        document["evaluation"] = evaluation(&drive.agreements);
        if let Some(solution) = &drive.solution {
            document["trajectory"] = trajectory(solution, &drive.poses);
            document["rejected_rows"] = json!(drive.rejected_rows);
        }
    }
    for (variant, found) in &findings.beside {
        let key = match variant {
            Variant::WithoutReference => "without_reference",
            Variant::ExactPoses => "exact_poses",
            Variant::Paper => "paper_method",
        };
        document[key] = calibrated(found);
    }
    let mut mountings = findings.mountings.iter();
    if let Some((_, truth)) = mountings.find(|(kind, _)| *kind == MountingKind::Truth) {
        let scanners = findings.calibration.mountings.iter().zip(truth);
        let truth = scanners.map(|(mounting, pose)| {
            let value = json!({ "body_from_scanner": pose_json(pose) });
            (mounting.name.clone(), value)
        });
        document["truth"] = truth.collect::<Map<_, _>>().into();
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

/// A calibration: the mountings, and how it went.
pub fn calibrated(found: &Calibration) -> Value {
    json!({ "scanners": scanners(found), "calibration": calibration(found) })
}

/// The scanners' mountings with sigmas.
fn scanners(calibration: &Calibration) -> Value {
    let mountings = calibration.mountings.iter().enumerate();
    let entries = mountings.map(|(index, mounting)| {
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
        (mounting.name.clone(), value)
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
fn calibration(calibration: &Calibration) -> Value {
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
fn evaluation(agreements: &Agreements) -> Value {
    let mut value = comparisons(agreements, MountingKind::Final);
    for (key, kind) in [
        ("initial", MountingKind::Initial),
        ("truth", MountingKind::Truth),
    ] {
        let nested = comparisons(agreements, kind);
        if !nested.is_empty() {
            value.insert(key.into(), nested.into());
        }
    }
    value.into()
}

fn comparisons(agreements: &Agreements, kind: MountingKind) -> Map<String, Value> {
    let entries = agreements.under(kind).map(|found| {
        let statistics = json!(found.statistics);
        match &found.against {
            Against::Reference => (found.scanner.clone(), json!({ "reference": statistics })),
            Against::Scanner(other) => (format!("{other}-{}", found.scanner), statistics),
        }
    });
    entries.collect()
}

fn drives(drives: &[Drive]) -> Value {
    let named = drives.iter();
    let named = named.map(|drive| (drive.name.clone(), evaluation(&drive.agreements)));
    named.collect::<Map<_, _>>().into()
}

fn stages(stages: &[StageSeconds]) -> Value {
    stages
        .iter()
        .map(|stage| (stage.name.clone(), json!({"seconds": stage.seconds})))
        .collect::<Map<_, _>>()
        .into()
}
