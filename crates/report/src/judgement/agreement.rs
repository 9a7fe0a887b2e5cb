//! Verdicts on the distances between clouds.

use crate::comparison::{Against, Agreement, Agreements, MountingKind};
use crate::number;
use crate::results::Drive;
use crate::verdict::{Acceptance, Severity, Verdict};

/// Clouds whose RMSE exceeds that after two steps by more than this factor need attention: other core points alone
/// change the RMSE by a few percent.
const WORSE_THAN_TWO_STEPS: f64 = 1.2;
/// Distances larger than the accepted distance by more than this factor are a fault.
const FAULT_FACTOR: f64 = 4.0;

/// Compares the agreement of the clouds of each drive, with the final mounting, to the accepted agreement: one line for
/// each pair of the first drive, which is that of the calibration or the only one, and one line for each further drive.
pub fn verdicts(drives: &[Drive], acceptance: &Acceptance) -> Vec<Verdict> {
    let mut all = Vec::new();
    for (number, drive) in drives.iter().enumerate() {
        let agreements = &drive.agreements;
        let found = agreements.under(MountingKind::Final);
        match number {
            0 => all.extend(found.map(|found| of_own(agreements, found, acceptance))),
            _ => all.extend(of_other(drive, acceptance)),
        }
        let missing = agreements.missing.iter();
        all.extend(missing.map(|(against, text)| match against {
            Against::Reference => Verdict::fault("agreement.missing", text),
            Against::Scanner(_) => Verdict::care("agreement.missing", text),
        }));
    }
    all
}

fn code(found: &Agreement) -> &'static str {
    match found.against {
        Against::Reference => "agreement.reference",
        Against::Scanner(_) => "agreement.scanners",
    }
}

/// A pair of clouds of the calibration drive.
fn of_own(all: &Agreements, found: &Agreement, acceptance: &Acceptance) -> Verdict {
    let clouds = match &found.against {
        Against::Reference => format!("Scanner {} and the reference scan", found.scanner),
        Against::Scanner(other) => format!("Scanners {other} and {}", found.scanner),
    };
    let rmse = |kind| {
        let other = all.counterpart(found, kind);
        other.map(|other| number::length(other.statistics.rmse_m))
    };
    let before = rmse(MountingKind::Initial).map(|rmse| format!("before: {rmse}"));
    let two_steps = rmse(MountingKind::TwoStep).map(|rmse| format!("after two steps: {rmse}"));
    let others: Vec<String> = before.into_iter().chain(two_steps).collect();
    let aside = match others.is_empty() {
        true => String::new(),
        false => format!(" ({})", others.join(", ")),
    };
    let statistics = &found.statistics;
    let (severity, why) = judged(all, found, acceptance);
    let text = format!(
        "{clouds}: RMSE {}{aside}, NMAD {}, over {} of their common field: {why}.",
        number::length(statistics.rmse_m),
        number::length(statistics.nmad_m),
        percent(found.coverage),
    );
    let verdict = Verdict::new(severity, code(found), text);
    verdict.with_value(statistics.rmse_m, None)
}

/// The clouds of a drive that was not used in the calibration; `None` without distances.
fn of_other(drive: &Drive, acceptance: &Acceptance) -> Option<Verdict> {
    let all = &drive.agreements;
    let found = || all.under(MountingKind::Final);
    let parts = found().map(|found| {
        let statistics = &found.statistics;
        let [rmse, nmad] = [statistics.rmse_m, statistics.nmad_m].map(number::length);
        format!("{} {rmse} (NMAD {nmad})", found.pair())
    });
    let parts: Vec<String> = parts.collect();
    let judged = found().map(|found| judged(all, found, acceptance));
    let (severity, why) = judged.max_by_key(|(severity, _)| *severity)?;
    let text = format!(
        "On {}, which was not used in the calibration, RMSE of {}: {why}.",
        drive.name,
        parts.join(", ")
    );
    Some(Verdict::new(severity, "agreement.evaluation", text).about(&drive.name))
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

/// The severity of the distances between two clouds, with its reason.
fn judged(all: &Agreements, found: &Agreement, acceptance: &Acceptance) -> (Severity, String) {
    let statistics = &found.statistics;
    let off_m = statistics.median_m.abs().max(statistics.nmad_m);
    let limit = number::length(acceptance.distance_m);
    if found.coverage.is_nan() {
        (Severity::Fault, "nothing in common".to_owned())
    } else if found.coverage < acceptance.coverage {
        let why = format!(
            "{} of the common field are too little to compare (accepted: {})",
            percent(found.coverage),
            percent(acceptance.coverage)
        );
        match found.against {
            Against::Reference => (Severity::Fault, why),
            Against::Scanner(_) => (Severity::Care, why),
        }
    } else if off_m > FAULT_FACTOR * acceptance.distance_m {
        let off = number::length(off_m);
        let why = format!("far apart, by {off} in median or NMAD (accepted: {limit})");
        (Severity::Fault, why)
    } else if off_m > acceptance.distance_m {
        let off = number::length(off_m);
        let why = format!("{off} in median or NMAD are more than the {limit} that is accepted");
        (Severity::Care, why)
    } else if is_worse_than_two_steps(all, found) {
        (Severity::Care, "worse than after two steps".to_owned())
    } else {
        (
            Severity::Good,
            format!("within the {limit} that is accepted"),
        )
    }
}

/// Whether the clouds agree notably worse than after two steps.
fn is_worse_than_two_steps(all: &Agreements, found: &Agreement) -> bool {
    let two_steps = all.counterpart(found, MountingKind::TwoStep);
    two_steps.is_some_and(|before| {
        found.statistics.rmse_m > WORSE_THAN_TWO_STEPS * before.statistics.rmse_m
    })
}
