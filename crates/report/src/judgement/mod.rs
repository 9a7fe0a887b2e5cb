//! Turns results into verdicts: sentences with a severity and a code, each made once. The page and the terminal print
//! them.

mod agreement;
mod constancy;
mod convergence;
mod drift;
mod ended;
mod logs;
mod method;
mod motion;
mod placement;
mod precision;
mod recording;
mod reference;
mod scanners;
mod trajectory;
mod truth;

pub use agreement::verdicts as agreement;
pub use constancy::verdict as constancy;
pub use drift::verdicts as drift;
pub use ended::{early as ended_early, would as would_end};
pub use logs::{contradiction, raw as raw_logs};
pub use method::verdicts as method;
pub use placement::{
    first as first_placement, looked_at, newer_calibration, placed, unusable_calibration,
};
pub use precision::{observability, relative, unobservable};
pub use recording::verdicts as recording;
pub use reference::{disagreements, included as reference_sigmas};
pub use scanners::late as late_scanner;
pub use trajectory::{doubt, position_step, verdicts as trajectory};

use std::cmp::Reverse;

use crate::comparison::MountingKind;
use crate::diagnostics::PoseSigmas;
use crate::joint::{JointReport, Rung};
use crate::results::{Calibrations, Drive, Results};
use crate::verdict::{Acceptance, Severity, Verdict};

/// The verdicts on the results of a run, those that need attention first. The others keep the order in which a user
/// reads them: faults of the logs and of the first placement, constants of the project that the drive contradicts, the
/// calibration, the other drives, the trajectories.
pub fn judge(results: &Results, acceptance: &Acceptance) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    let calibration_drive = results.drives.first();
    if let Some(drive) = calibration_drive {
        verdicts.extend(logs::before_constants(&drive.log_findings));
    }
    verdicts.extend(results.placement.into_iter().flat_map(first_placement));
    if let Some(drive) = calibration_drive {
        verdicts.extend(drive.log_findings.doubts.iter().map(doubt));
    }
    if let Some(calibrations) = results.calibrations {
        let logs_have_a_fault = verdicts.iter().any(|v| v.severity == Severity::Fault);
        let mut on_calibration = calibration(calibrations, results.drives, acceptance);
        if logs_have_a_fault {
            on_calibration.iter_mut().for_each(soften_consequence);
        }
        verdicts.extend(on_calibration);
    }
    for drive in results.drives.iter().skip(1) {
        verdicts.extend(logs::on_other(&drive.name, &drive.log_findings));
    }
    verdicts.extend(trajectories(results));
    let mut distinct = once_each(verdicts);
    attention_first(&mut distinct);
    distinct
}

/// The verdicts without those that an earlier one repeats word for word: a contradiction in the logs of a drive can be
/// found before and in the adjustment.
fn once_each(verdicts: Vec<Verdict>) -> Vec<Verdict> {
    let mut distinct: Vec<Verdict> = Vec::new();
    for verdict in verdicts {
        let is_same = |earlier: &Verdict| {
            (&earlier.code, &earlier.text, &earlier.about)
                == (&verdict.code, &verdict.text, &verdict.about)
        };
        match distinct.iter_mut().find(|earlier| is_same(earlier)) {
            Some(earlier) => earlier.severity = earlier.severity.max(verdict.severity),
            None => distinct.push(verdict),
        }
    }
    distinct
}

/// Moves verdicts that need attention to the front, the gravest first, and keeps the order of the rest.
pub fn attention_first(verdicts: &mut [Verdict]) {
    verdicts.sort_by_key(|v| Reverse(v.severity.is_marked().then_some(v.severity)));
}

/// The verdicts on the trajectory of each drive. If there is a calibration, trajectories without a problem appear only
/// in their own section of the page.
fn trajectories(results: &Results) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    for (number, drive) in results.drives.iter().enumerate() {
        let Some(solution) = &drive.solution else {
            continue;
        };
        let sigmas = PoseSigmas::of(&drive.poses);
        let mut on_drive = trajectory(solution, sigmas.as_ref());
        if results.calibrations.is_some() {
            on_drive.retain(|verdict| verdict.severity.is_marked());
        }
        if number > 0 {
            on_drive = on_drive.into_iter().map(|v| v.on(&drive.name)).collect();
        }
        verdicts.extend(on_drive);
    }
    verdicts
}

/// Codes of verdicts that follow from a fault of the logs or of the scans.
const CONSEQUENCES: [&str; 7] = [
    "agreement.",
    "calibration.",
    "mounting.moved",
    "mounting.sigma",
    "mounting.constancy",
    "mounting.gap",
    "reference.",
];

/// Lowers a verdict to information if it is a consequence of a fault of logs or scans.
fn soften_consequence(verdict: &mut Verdict) {
    if CONSEQUENCES
        .iter()
        .any(|code| verdict.code.starts_with(code))
    {
        verdict.severity = verdict.severity.min(Severity::Note);
    }
}

/// The verdicts on the calibration: method, agreement of the clouds, reference, motion, convergence, precision,
/// constancy.
fn calibration(
    calibrations: &Calibrations,
    drives: &[Drive],
    acceptance: &Acceptance,
) -> Vec<Verdict> {
    let result = &calibrations.result;
    let joint = calibrations.joint.as_ref();
    let accepted = joint.and_then(JointReport::accepted);
    let moves = accepted.is_some_and(|joint| joint.rung > Rung::Rigid);

    let mut verdicts = method(result, joint);
    verdicts.extend(agreement(drives, acceptance));
    if let Some(joint) = joint {
        verdicts.extend(joint.late.iter().map(scanners::late));
        for logs in &joint.contradicted {
            verdicts.extend(logs::on_other(&logs.drive, &logs.findings));
        }
        verdicts.extend(joint.fits_alone.then(reference::misplaced));
    }
    verdicts.extend(disagreements(calibrations));
    verdicts.extend(accepted.into_iter().flat_map(scanners::ranges));
    verdicts.extend(accepted.into_iter().flat_map(motion::verdicts));
    verdicts.extend(accepted.and_then(reference::height));
    verdicts.push(convergence::convergence(result));
    verdicts.extend(convergence::uniqueness(result));
    if let Some(initial) = calibrations.mountings(MountingKind::Initial) {
        verdicts.extend(convergence::moved(result, initial));
    }
    verdicts.extend(precision::sigmas(result, acceptance, moves));
    let included = reference_sigmas(result, joint);
    verdicts.extend(included.map(|text| Verdict::note("reference.prior", text)));
    let relative = relative(result).into_iter();
    verdicts.extend(relative.map(|text| Verdict::good("mounting.relative", text)));
    if let Some(truth) = calibrations.mountings(MountingKind::Truth) {
        verdicts.extend(truth::errors(result, truth));
    }
    let left_open = observability(calibrations).into_iter();
    verdicts.extend(left_open.filter(|v| v.severity != Severity::Good));
    // The test assumes rigid mountings, so it does not apply to mountings that were adjusted as moving.
    if !moves {
        verdicts.extend(constancy(result));
    }
    verdicts.extend(constancy::gap(result));
    let solution = drives.first().and_then(|drive| drive.solution.as_ref());
    verdicts.extend(solution.and_then(|s| precision::origin(s, result.origin_sigma_m)));
    verdicts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_is_said_once_and_keeps_its_gravest_severity() {
        let of = |severity, text: &str| Verdict::new(severity, "prism.lever_arm", text);
        let first = of(Severity::Note, "twice");
        let repeated = of(Severity::Care, "twice");
        let elsewhere = of(Severity::Note, "twice").on("drive-2");
        let other = of(Severity::Note, "once");
        let said = once_each(vec![
            first,
            other.clone(),
            repeated.clone(),
            elsewhere.clone(),
        ]);
        assert_eq!(said, [repeated, other, elsewhere]);
    }
}
