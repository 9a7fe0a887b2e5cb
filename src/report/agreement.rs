//! What the distances between clouds say.

use super::content::Drive;
use super::number;
use crate::comparison::{Against, Agreement, Agreements, MountingKind};
use crate::verdict::{Acceptance, Severity, Verdict};

/// Clouds that agree worse than after two steps by more than this factor need attention: other core
/// points alone change the RMSE by a few percent.
const WORSE_THAN_TWO_STEPS: f64 = 1.2;
/// Distances beyond this many times what is accepted are a fault.
const FAULT_FACTOR: f64 = 4.0;

/// The agreement of the clouds of each drive with the final mounting, held against what is accepted; the
/// first drive is that of the calibration.
pub fn verdicts(drives: &[Drive], acceptance: &Acceptance) -> Vec<Verdict> {
    let mut all = Vec::new();
    for (number, drive) in drives.iter().enumerate() {
        let found = drive.agreements.under(MountingKind::Final);
        all.extend(found.map(|found| match number {
            0 => of_own(&drive.agreements, found, acceptance),
            _ => of_other(&drive.name, &drive.agreements, found, acceptance),
        }));
        let missing = drive.agreements.missing.iter();
        all.extend(missing.map(|text| Verdict::fault("agreement.missing", text)));
    }
    all
}

fn code(found: &Agreement) -> &'static str {
    match found.against {
        Against::Reference => "agreement.reference",
        Against::Scanner(_) => "agreement.scanners",
    }
}

/// On the drive of the calibration.
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
    judged(all, found, acceptance, (&clouds, &aside))
}

/// On a drive that was not used in the calibration.
fn of_other(name: &str, all: &Agreements, found: &Agreement, acceptance: &Acceptance) -> Verdict {
    let clouds = format!(
        "On {name}, which was not used in the calibration, {}",
        found.pair()
    );
    judged(all, found, acceptance, (&clouds, ""))
}

fn judged(
    all: &Agreements,
    found: &Agreement,
    acceptance: &Acceptance,
    (clouds, aside): (&str, &str),
) -> Verdict {
    let statistics = &found.statistics;
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let off_m = statistics.median_m.abs().max(statistics.nmad_m);
    let text = format!(
        "{clouds}: RMSE {}{aside}, median {}, NMAD {}, over {} of their common field",
        number::length(statistics.rmse_m),
        number::length(statistics.median_m),
        number::length(statistics.nmad_m),
        percent(found.coverage),
    );
    let limit = number::length(acceptance.distance_m);
    let least = percent(acceptance.coverage);
    let (severity, why) = if found.coverage.is_nan() || found.coverage < acceptance.coverage {
        (
            Severity::Fault,
            format!("too little to compare (accepted: {least})"),
        )
    } else if off_m > FAULT_FACTOR * acceptance.distance_m {
        (
            Severity::Fault,
            format!("far apart (accepted: median and NMAD of {limit})"),
        )
    } else if off_m > acceptance.distance_m {
        (
            Severity::Care,
            format!("more than the {limit} that is accepted of median and NMAD"),
        )
    } else if is_worse_than_two_steps(all, found) {
        (Severity::Care, "worse than after two steps".to_owned())
    } else {
        (
            Severity::Good,
            format!("within the {limit} that is accepted"),
        )
    };
    let verdict = Verdict::new(severity, code(found), format!("{text}: {why}."));
    verdict.with_value(statistics.rmse_m, None)
}

/// Whether the clouds agree notably worse than after two steps.
fn is_worse_than_two_steps(all: &Agreements, found: &Agreement) -> bool {
    let two_steps = all.counterpart(found, MountingKind::TwoStep);
    two_steps.is_some_and(|before| {
        found.statistics.rmse_m > WORSE_THAN_TWO_STEPS * before.statistics.rmse_m
    })
}
