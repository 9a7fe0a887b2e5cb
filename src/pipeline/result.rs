//! `result.json`.

use nalgebra::DMatrix;
use serde_json::{Map, Value, json};

use super::findings::Findings;
use crate::calibration::{Calibration, Mounting, MountingForms, PARAMETER_NAMES, Variant};
use crate::comparison::{Against, Agreements, MountingKind, PassComparison, PassDistances};
use crate::diagnostics::{self, PoseSigmas};
use crate::geometry::Vec3;
use crate::joint::{AdjustedDrive, Joint, JointReport, known_m};
use crate::progress::StageSeconds;
use crate::results::{Calibrations, Drive};
use crate::sensor::PoseRecord;
use crate::tiles::peak_memory_bytes;
use crate::trajectory::Solution;
use crate::verdict::{Headline, Verdict};

/// The complete `result.json`.
pub fn document(findings: &Findings) -> Value {
    let Calibrations {
        result, origin_m, ..
    } = &findings.calibrations;
    let mut document = calibrated(result);
    if let Some(report) = &findings.calibrations.joint {
        document["calibration"]["joint"] = joint(report, result, origin_m);
    }
    document["origin_m"] = json!(origin_m);
    document["boresight"] = json!(env!("CARGO_PKG_VERSION"));
    document["drives"] = drives(&findings.drives);
    document["stages"] = stages(&findings.stages);
    document["warnings"] = json!(findings.warnings);
    judge(&mut document, &findings.verdicts);
    document["peak_memory_bytes"] = json!(peak_memory_bytes());
    if let Some(drive) = findings.drives.first() {
        document["evaluation"] = evaluation(&drive.agreements);
        if let Some(solution) = &drive.solution {
            document["trajectory"] = trajectory(solution, &drive.poses);
            document["rejected_rows"] = json!(drive.rejected_rows);
        }
    }
    for (variant, calibration) in &findings.calibrations.variants {
        let key = match variant {
            Variant::TwoStep => "two_steps",
            Variant::WithoutReference => "without_reference",
            Variant::ExactPoses => "exact_poses",
            Variant::Paper => "paper_method",
        };
        document[key] = calibrated(calibration);
    }
    if let Some(truth) = findings.calibrations.mountings(MountingKind::Truth) {
        let scanners = result.mountings.iter().zip(truth);
        let truth = scanners.map(|(mounting, pose)| {
            let value = json!({ "body_from_scanner": MountingForms::from(pose) });
            (mounting.name.clone(), value)
        });
        document["truth"] = truth.collect::<Map<_, _>>().into();
    }
    document
}

/// Adds `headline` and `verdicts` to a document.
pub fn judge(document: &mut Value, verdicts: &[Verdict]) {
    document["headline"] = json!(Headline::of(verdicts));
    document["verdicts"] = json!(verdicts);
}

/// Number of worst measurements listed.
const WORST: usize = 20;

/// How an adjustment of the trajectory ended: its sensors, constants and rejections, without the residual of each record.
pub fn solution(solution: &Solution) -> Value {
    json!({
        "iterations": solution.iterations,
        "converged": solution.converged,
        "stop": solution.stop,
        "cost_initial": solution.cost_initial,
        "cost_final": solution.cost_final,
        "nodes": solution.nodes,
        "sensors": solution.sensors,
        "constants": solution.constants,
        "rejections": solution.rejections,
        "clock_jumps": solution.clock_jumps,
        "imu_gaps_s": solution.imu_gaps_s,
        "rests_s": solution.rests_s,
    })
}

/// The adjustment of the trajectory: its [`solution`] with the test of each sensor, the worst
/// measurements, the number of rejections, and the standard deviations of the poses.
pub fn trajectory(solution: &Solution, poses: &[PoseRecord]) -> Value {
    let mut value = self::solution(solution);
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
pub fn calibrated(result: &Calibration) -> Value {
    let directions = result.observability.unobservable.iter();
    let directions = directions.map(
        |direction| json!({ "eigenvalue_share": direction.share, "what": direction.description }),
    );
    let minimum = result.minimum.as_ref().map(|minimum| {
        json!({
            "shift_m": minimum.shift_m,
            "turn_rad": minimum.turn_rad,
            "starts": minimum.starts,
            "back": minimum.back,
        })
    });
    let constancy = result.constancy.as_ref().map(|constancy| {
        json!({
            "ratio_to_expected": constancy.ratio,
            "block_rms_m": constancy.rms_m,
            "constant": constancy.constant,
            "strongest_correlation": constancy.strongest,
            "jump": constancy.jump,
        })
    });
    let parameters = result.mountings.iter().flat_map(|mounting| {
        let names = PARAMETER_NAMES.iter().enumerate();
        names.map(|(index, name)| {
            let unit = if index < 3 { "m" } else { "rad" };
            json!({ "name": format!("{}.{name}", mounting.name), "unit": unit })
        })
    });
    let rows = |matrix: &DMatrix<f64>| -> Value {
        let rows = matrix.row_iter();
        rows.map(|row| row.iter().copied().collect::<Value>())
            .collect()
    };
    let relative = result.relative().into_iter();
    let relative = relative.map(|relative| (relative.name.clone(), json!(relative)));
    json!({
        "scanners": result.scanners(),
        "calibration": {
            "method": result.method,
            "converged": result.converged,
            "scales": result.scales,
            "eigenvalue_shares": result.observability.shares,
            "undetermined": directions.collect::<Value>(),
            "origin_sigma_m": result.origin_sigma_m,
            "minimum": minimum,
            "mounting_constant": constancy,
            "gap": result.gap,
            "parameters": parameters.collect::<Value>(),
            // Null where a parameter is fixed or unobservable.
            "covariance": result.determined_covariance().as_ref().map(rows),
            "correlation": result.correlation().as_ref().map(rows),
            "relative": relative.collect::<Map<_, _>>(),
        },
    })
}

/// `calibration.joint`: course and tests of the joint adjustment, and the reasons if it was refused.
fn joint(report: &JointReport, result: &Calibration, origin_m: &Vec3) -> Value {
    let against = (!report.refused.is_empty()).then(|| report.refused.join("; "));
    let (refused, contradicted) = match report.accepted() {
        Some(_) => (None, against),
        None => (against, None),
    };
    let mut value = json!({
        "refused": refused,
        "contradicted": contradicted,
        "held_out": report.held_out,
        "seconds": report.seconds,
    });
    let Some(joint) = &report.result else {
        value["decided"] = Value::Null;
        value["reason"] = json!(refused);
        return value;
    };
    value["decided"] = json!(refused.is_none().then_some(joint.rung));
    let predicts = contradicted
        .map(|_| "it predicts scans that neither method had seen better than two steps");
    let reason = refused.as_deref().or(predicts);
    value["reason"] = json!(reason.unwrap_or("no sensor contradicts it"));
    value["ladder"] = json!(joint.ladder);
    if refused.is_some() {
        value["scanners"] = json!(joint.calibration(result).scanners());
    }
    let shares = result.mountings.iter().zip(joint.prior_shares.chunks(6));
    let shares = shares.map(|(mounting, shares)| (mounting.name.clone(), json!(shares)));
    value["prior_share"] = shares.collect::<Map<_, _>>().into();
    value["converged"] = json!(joint.stop.is_converged());
    for (key, count) in [
        ("iterations", joint.iterations),
        ("rows", joint.rows),
        ("surfels", joint.surfels),
        ("unknowns", joint.unknowns),
    ] {
        value[key] = json!(count);
    }
    let groups = joint.groups.iter();
    let groups = groups.map(|group| {
        let mut entry = json!(group);
        if let Some(entries) = entry.as_object_mut() {
            entries.remove("name");
        }
        (group.name.clone(), entry)
    });
    value["chi_square"] = groups.collect::<Map<_, _>>().into();
    value["drives"] = joint
        .drives
        .iter()
        .map(|drive| moved(drive, &result.mountings))
        .collect();
    let blocks = joint.drives.iter().flat_map(|drive| {
        drive.positions.iter().map(|blocks| {
            let mut entry = json!(blocks);
            entry["drive"] = json!(drive.name);
            entry
        })
    });
    value["position_blocks"] = blocks.collect();
    let regions = joint.regions.iter();
    let regions = regions.map(|region| {
        let centre_m = region.centre_m + origin_m;
        json!({ "centre_m": centre_m, "offset_m": region.offset_m, "surfels": region.surfels })
    });
    value["regions"] = regions.collect();
    value["reference"] = reference(joint);
    value["scanner_latency_s"] = latencies(joint, &result.mountings);
    value["constants"] = json!(joint.constants);
    for (i, constant) in joint.constants.iter().enumerate() {
        value["constants"][i]["determined"] = json!(constant.sigma.is_some());
    }
    value
}

/// The displacements of the poses of a drive by the adjustment, the precision of points, and the jumps of mountings.
fn moved(drive: &AdjustedDrive, mountings: &[Mounting]) -> Value {
    let rms = |displacement: &dyn Fn(usize) -> Vec3| {
        let displacements = (0..drive.moved.len()).map(displacement);
        let sum = displacements.map(|v| v.component_mul(&v));
        (sum.sum::<Vec3>() / drive.moved.len().max(1) as f64).map(f64::sqrt)
    };
    let jumps = drive.jumps.iter().map(|jump| {
        let [turn, shift] = [&jump.step[..3], &jump.step[3..]].map(Vec3::from_column_slice);
        json!({
            "scanner": mountings[jump.scanner].name,
            "between_s": jump.between_s,
            "shift_m": shift,
            "rotation_deg": turn.map(f64::to_degrees),
        })
    });
    let points = mountings.iter().zip(&drive.points);
    let points = points.filter_map(|(mounting, points)| {
        Some((
            mounting.name.clone(),
            json!({ "sigma_m": known_m(points)? }),
        ))
    });
    json!({
        "name": drive.name,
        "moved_rms": {
            "shift_m": rms(&|i| drive.moved[i].shift_m),
            "rotation_deg": rms(&|i| drive.moved[i].turn_rad.map(f64::to_degrees)),
        },
        "points": points.collect::<Map<_, _>>(),
        "pose_errors": drive.pose_errors,
        "jumps": jumps.collect::<Vec<_>>(),
    })
}

/// Errors of the whole reference; null without one.
fn reference(joint: &Joint) -> Value {
    let Some(reference) = &joint.reference else {
        return Value::Null;
    };
    let prior = &reference.prior;
    let deg = |v: &Vec3| v.map(f64::to_degrees);
    json!({
        "sigma_m": prior.shift_m,
        "sigma_deg": prior.tilt_rad.to_degrees(),
        "assumed": prior.assumed,
        "sigma_surface_m": joint.surface_m,
        "shift_m": reference.shift_m,
        "shift_sigma_m": reference.shift_sigma_m,
        "rotation_deg": deg(&reference.turn_rad),
        "rotation_sigma_deg": deg(&reference.turn_sigma_rad),
    })
}

/// Latencies by the names of the scanners, if they were estimated.
fn latencies(joint: &Joint, mountings: &[Mounting]) -> Value {
    let all = mountings.iter().zip(&joint.late_s);
    let estimated = all.filter_map(|(mounting, late)| {
        let (value, sigma) = (*late)?;
        Some((
            mounting.name.clone(),
            json!({ "value": value, "sigma": sigma }),
        ))
    });
    estimated.collect::<Map<_, _>>().into()
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
    if !agreements.passes.is_empty() {
        value.insert("passes".into(), passes(&agreements.passes));
    }
    value.into()
}

/// How far passes over the same ground lie apart, by mounting.
fn passes(all: &[PassComparison]) -> Value {
    let entries = all.iter().map(|comparison| {
        let key = match (comparison.mounting, comparison.on_given_poses) {
            (MountingKind::Initial, _) => "initial",
            (MountingKind::TwoStep, _) => "two_steps",
            (MountingKind::Truth, _) => "truth",
            (MountingKind::Final, false) => "final",
            (MountingKind::Final, true) => "final_on_given_poses",
        };
        let PassDistances {
            median_m,
            rms_m,
            cells,
            ..
        } = comparison.distances;
        (
            key.to_owned(),
            json!({ "median_m": median_m, "rms_m": rms_m, "cells": cells }),
        )
    });
    entries.collect::<Map<_, _>>().into()
}

fn comparisons(agreements: &Agreements, kind: MountingKind) -> Map<String, Value> {
    let entries = agreements.under(kind).map(|agreement| {
        let mut statistics = json!(agreement.statistics);
        statistics["coverage"] = json!(agreement.coverage);
        match &agreement.against {
            Against::Reference => (
                agreement.scanner.clone(),
                json!({ "reference": statistics }),
            ),
            Against::Scanner(other) => (format!("{other}-{}", agreement.scanner), statistics),
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
