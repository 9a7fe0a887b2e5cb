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
        let pairs = agreements.under(MountingKind::Final);
        match number {
            0 => {
                all.extend(pairs.map(|pair| calibration_pair(agreements, pair, acceptance)));
                all.extend(passes(agreements));
            }
            _ => all.extend(other_drive(drive, acceptance)),
        }
        let missing = agreements.missing.iter();
        all.extend(missing.map(|(against, text)| match against {
            Against::Reference => Verdict::fault("agreement.missing", text),
            Against::Scanner(_) => Verdict::care("agreement.missing", text),
        }));
    }
    all
}

/// How far passes of the calibration drive over the same ground lie apart, and whether the mounting of a joint
/// adjustment also suits the poses as they were given.
fn passes(agreements: &Agreements) -> Vec<Verdict> {
    let Some(last) = agreements.final_passes() else {
        return Vec::new();
    };
    let aside = earlier(|kind| {
        let passes = agreements.passes_of(kind, false);
        passes.map(|passes| number::length(passes.median_m))
    });
    let text = format!(
        "Passes over the same ground lie {} apart in the median{aside}, noise and relief of the ground included.",
        number::length(last.median_m),
    );
    let found = Verdict::note("passes.distance", text).with_value(last.median_m, None);
    std::iter::once(found)
        .chain(unsuitable_for_given_poses(agreements))
        .collect()
}

/// The values with earlier mountings, in brackets; empty without any.
fn earlier(value: impl Fn(MountingKind) -> Option<String>) -> String {
    let before = value(MountingKind::Initial).map(|value| format!("before: {value}"));
    let two_steps = value(MountingKind::TwoStep).map(|value| format!("after two steps: {value}"));
    let values: Vec<String> = before.into_iter().chain(two_steps).collect();
    if values.is_empty() {
        String::new()
    } else {
        format!(" ({})", values.join(", "))
    }
}

/// A mounting with which passes lie farther apart on the poses as they were given than with that of two steps.
fn unsuitable_for_given_poses(agreements: &Agreements) -> Option<Verdict> {
    let on_given = agreements.passes_of(MountingKind::Final, true)?;
    let two_steps = agreements.passes_of(MountingKind::TwoStep, false)?;
    let is_worse = on_given.is_worse_than(two_steps)?;
    let text = format!(
        "On the poses as they were given, passes lie {} apart with this mounting (root mean square), and {} with that \
         of two steps: use it with the adjusted poses only, or calibrate with --method two-step.",
        number::length(on_given.rms_m),
        number::length(two_steps.rms_m),
    );
    is_worse.then(|| Verdict::care("passes.given_poses", text).with_value(on_given.rms_m, None))
}

fn code(agreement: &Agreement) -> &'static str {
    match agreement.against {
        Against::Reference => "agreement.reference",
        Against::Scanner(_) => "agreement.scanners",
    }
}

/// A pair of clouds of the calibration drive.
fn calibration_pair(all: &Agreements, agreement: &Agreement, acceptance: &Acceptance) -> Verdict {
    let clouds = match &agreement.against {
        Against::Reference => format!("Scanner {} and the reference scan", agreement.scanner),
        Against::Scanner(other) => format!("Scanners {other} and {}", agreement.scanner),
    };
    let rmse = |kind| {
        let other = all.counterpart(agreement, kind);
        other.map(|other| number::length(other.statistics.rmse_m))
    };
    let aside = earlier(rmse);
    let statistics = &agreement.statistics;
    let (severity, why) = severity_of(all, agreement, acceptance);
    let text = format!(
        "{clouds}: RMSE {}{aside}, NMAD {}, over {} of their common field: {why}.",
        number::length(statistics.rmse_m),
        number::length(statistics.nmad_m),
        percent(agreement.coverage),
    );
    let verdict = Verdict::new(severity, code(agreement), text);
    verdict.with_value(statistics.rmse_m, None)
}

/// The clouds of a drive that was not used in the calibration; `None` without distances.
fn other_drive(drive: &Drive, acceptance: &Acceptance) -> Option<Verdict> {
    let all = &drive.agreements;
    let agreements = || all.under(MountingKind::Final);
    let parts = agreements().map(|agreement| {
        let statistics = &agreement.statistics;
        let [rmse, nmad] = [statistics.rmse_m, statistics.nmad_m].map(number::length);
        format!("{} {rmse} (NMAD {nmad})", agreement.pair())
    });
    let parts: Vec<String> = parts.collect();
    let severities = agreements().map(|agreement| severity_of(all, agreement, acceptance));
    let (severity, why) = severities.max_by_key(|(severity, _)| *severity)?;
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
fn severity_of(
    all: &Agreements,
    agreement: &Agreement,
    acceptance: &Acceptance,
) -> (Severity, String) {
    let statistics = &agreement.statistics;
    let off_m = statistics.median_m.abs().max(statistics.nmad_m);
    let limit = number::length(acceptance.distance_m);
    if agreement.coverage.is_nan() {
        (Severity::Fault, "nothing in common".to_owned())
    } else if agreement.coverage < acceptance.coverage {
        let why = format!(
            "{} of the common field are too little to compare (accepted: {})",
            percent(agreement.coverage),
            percent(acceptance.coverage)
        );
        match agreement.against {
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
    } else if is_worse_than_two_steps(all, agreement) {
        (Severity::Care, "worse than after two steps".to_owned())
    } else {
        (
            Severity::Good,
            format!("within the {limit} that is accepted"),
        )
    }
}

/// Whether the clouds agree notably worse than after two steps.
fn is_worse_than_two_steps(all: &Agreements, agreement: &Agreement) -> bool {
    let two_steps = all.counterpart(agreement, MountingKind::TwoStep);
    two_steps.is_some_and(|before| {
        agreement.statistics.rmse_m > WORSE_THAN_TWO_STEPS * before.statistics.rmse_m
    })
}
