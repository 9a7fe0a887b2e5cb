//! `result.json`.

use serde_json::{Map, Value, json};

use super::findings::Findings;
use crate::calibration::{Calibration, MountingForms, Variant};
use crate::comparison::{Against, Agreements, MountingKind};
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
    for (variant, found) in &findings.variants {
        let key = match variant {
            Variant::TwoStep => "two_steps",
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
            let value = json!({ "body_from_scanner": MountingForms::from(pose) });
            (mounting.name.clone(), value)
        });
        document["truth"] = truth.collect::<Map<_, _>>().into();
    }
    document
}

/// Number of worst measurements listed.
const WORST: usize = 20;

/// The adjustment of the trajectory: the solution with the test of each sensor, the worst
/// measurements, the number of rejections, and the standard deviations of the poses.
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

/// A calibration: the mountings, and the course of the calibration.
pub fn calibrated(found: &Calibration) -> Value {
    let mut calibration = json!(found);
    if let Some(entries) = calibration.as_object_mut() {
        entries.remove("scanners");
    }
    json!({ "scanners": found.scanners(), "calibration": calibration })
}

/// `evaluation`: comparisons of the final mounting, with those of the initial and the true mounting
/// nested below.
fn evaluation(agreements: &Agreements) -> Value {
    let mut value = comparisons(agreements, MountingKind::Final);
    for (key, kind) in [
        ("initial", MountingKind::Initial),
        ("two_steps", MountingKind::TwoStep),
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
