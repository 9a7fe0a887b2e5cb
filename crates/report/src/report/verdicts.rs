//! What a run says about its results, in words that a field crew understands.

use super::content::{Calibrations, Content, Drive};
use super::diagnostics::{self, PoseSigmas};
use super::{agreement, constancy, method, minimum, moving, number};
use crate::calibration::{Calibration, Variant};
use crate::comparison::MountingKind;
use crate::geometry::BodyFromScanner;
use crate::joint::{Joint, JointReport, Rung};
use crate::statistics::NORMAL_97_5_ROUNDED;
use crate::trajectory::{Constant, Doubt, Solution};
use crate::verdict::{Acceptance, Severity, Verdict, capitalised};

/// No error exceeds this many standard deviations by chance: 1 in 16 000 does.
const NEVER_BY_CHANCE: f64 = 4.0;
/// A constant that is off by more than this is a fault: metres, seconds, radians, m/s².
const FAULT_LEVER_ARM_M: f64 = 0.05;
const FAULT_LATENCY_S: f64 = 0.03;
const FAULT_OFFSET_RAD: f64 = 0.02;
const FAULT_GRAVITY_M_S2: f64 = 0.1;

/// All that is said, the gravest first; then constants of the project that the drive contradicts, which
/// method's values these are, the agreement of the clouds, and the quality of the mountings.
pub fn verdicts(content: &Content, acceptance: &Acceptance) -> Vec<Verdict> {
    let (own, others) = match content.drives {
        [own, others @ ..] => (Some(own), others),
        [] => (None, content.drives),
    };
    let mut all: Vec<Verdict> = own
        .into_iter()
        .flat_map(|own| own.preflight.clone())
        .collect();
    all.extend_from_slice(content.placement);
    all.extend(own.into_iter().flat_map(|own| &own.doubts).map(doubt));
    if let Some(calibrations) = &content.calibrations {
        let is_caused = all
            .iter()
            .any(|verdict| verdict.severity == Severity::Fault);
        let found = of_calibration(calibrations, content.drives, acceptance);
        all.extend(found.into_iter().map(|verdict| match is_caused {
            true => as_consequence(verdict),
            false => verdict,
        }));
    }
    for drive in others {
        let found = drive.preflight.iter().cloned();
        let found = found.chain(drive.doubts.iter().map(doubt));
        all.extend(found.map(|verdict| verdict.on(&drive.name)));
    }
    for (number, drive) in content.drives.iter().enumerate() {
        let Some(solution) = &drive.solution else {
            continue;
        };
        let sigmas = PoseSigmas::of(&drive.poses);
        let found = diagnostics::verdicts(solution, sigmas.as_ref());
        // Of a whole run, what is well with the trajectories stands in their own section.
        let is_said = |v: &Verdict| content.calibrations.is_none() || v.severity.is_marked();
        let found = found.into_iter().filter(is_said);
        all.extend(found.map(|verdict| match number {
            0 => verdict,
            _ => verdict.on(&drive.name),
        }));
    }
    all.sort_by_key(|verdict| {
        let marked = verdict.severity.is_marked().then_some(verdict.severity);
        std::cmp::Reverse(marked)
    });
    all
}

/// What follows from faults of logs or scans.
const CONSEQUENCES: [&str; 7] = [
    "agreement.",
    "calibration.",
    "mounting.moved",
    "mounting.sigma",
    "mounting.constancy",
    "mounting.gap",
    "reference.",
];

/// Behind a fault of logs or scans, what it leads to is for information.
fn as_consequence(mut verdict: Verdict) -> Verdict {
    if CONSEQUENCES
        .iter()
        .any(|code| verdict.code.starts_with(code))
    {
        verdict.severity = verdict.severity.min(Severity::Note);
    }
    verdict
}

fn of_calibration(
    calibrations: &Calibrations,
    drives: &[Drive],
    acceptance: &Acceptance,
) -> Vec<Verdict> {
    let result = calibrations.result;
    let mut all = method::verdicts(result, calibrations.joint);
    all.extend(agreement::verdicts(drives, acceptance));
    let late = calibrations.joint.into_iter().flat_map(|joint| &joint.late);
    all.extend(late.map(|scanner| {
        let text = capitalised(&scanner.describe()) + ".";
        let verdict = Verdict::care("scanner.time_offset", text);
        verdict.with_value(scanner.late.value, Some(scanner.late.sigma))
    }));
    let others = calibrations.joint.into_iter().flat_map(|joint| &joint.said);
    all.extend(others.cloned());
    all.extend(disagreements(calibrations));
    let accepted = calibrations.joint.and_then(JointReport::accepted);
    all.extend(accepted.into_iter().flat_map(moving::verdicts));
    all.extend(accepted.and_then(height));
    all.push(minimum::convergence(result));
    all.extend(minimum::uniqueness(result));
    if let Some(initial) = calibrations.mountings(MountingKind::Initial) {
        all.extend(minimum::moved(result, initial));
    }
    let moves = accepted.is_some_and(|joint| joint.rung > Rung::Rigid);
    all.extend(sigmas(result, acceptance, moves));
    let reference = method::reference(result, calibrations.joint);
    all.extend(reference.map(|text| Verdict::note("reference.prior", text)));
    let relative = method::relative(result).into_iter();
    all.extend(relative.map(|text| Verdict::good("mounting.relative", text)));
    if let Some(truth) = calibrations.mountings(MountingKind::Truth) {
        all.extend(errors(result, truth));
    }
    all.extend(
        observability(calibrations)
            .into_iter()
            .filter(|v| v.severity != Severity::Good),
    );
    // Of two rigid steps, whatever the mountings do that are adjusted since.
    all.extend(constancy::verdict(result).filter(|_| !moves));
    all.extend(constancy::gap(result));
    let solution = drives.first().and_then(|drive| drive.solution.as_ref());
    all.extend(solution.and_then(|solution| origin(solution, result.origin_sigma_m)));
    all
}

/// What the positions of the mountings rest on where no lever arm is estimated.
fn origin(solution: &Solution, sigma_m: f64) -> Option<Verdict> {
    let mut constants = solution.constants.iter();
    let is_estimated = constants.any(|constant| constant.name.contains(".lever_arm"));
    (sigma_m > 0.0 || !is_estimated).then(|| {
        let text = match sigma_m > 0.0 {
            true => format!(
                "The standard deviations of positions include that of the lever arm, {} \
                 (sigma_lever_arm_m): an error of it shifts all mountings alike, and no point in the world.",
                number::length(sigma_m)
            ),
            false => "Positions of the mountings rest on a lever arm that is taken as exact: an error of it shifts \
                      all of them alike, and no point in the world."
                .to_owned(),
        };
        Verdict::note("mounting.origin", text).with_value(sigma_m, None)
    })
}

/// A constant of the project that the drive contradicts.
pub fn doubt(doubt: &Doubt) -> Verdict {
    let fault = match doubt.constant {
        Constant::LeverArm(_) => FAULT_LEVER_ARM_M,
        Constant::TimeOffset(_) | Constant::HeadingTimeOffset => FAULT_LATENCY_S,
        Constant::HeadingOffset => FAULT_OFFSET_RAD,
        _ => FAULT_GRAVITY_M_S2,
    };
    let severity = match doubt.off() > fault && !doubt.is_used {
        true => Severity::Fault,
        false => Severity::Care,
    };
    let verdict = Verdict::new(severity, &doubt.name, capitalised(&doubt.describe()));
    match doubt.values.as_slice() {
        [only] => verdict.with_value(only.value, only.sigma),
        _ => verdict,
    }
}

/// Where scans and reference disagree, in the world's coordinates.
pub fn disagreements(calibrations: &Calibrations) -> Vec<Verdict> {
    let Some(joint) = calibrations.joint_found() else {
        return Vec::new();
    };
    let regions = joint.regions.iter().map(|region| {
        let text = capitalised(&region.describe(&calibrations.origin_m));
        Verdict::care("reference.region", text).with_value(region.offset_m, None)
    });
    let shift = joint.reference.and_then(|reference| reference.describe());
    let shift = shift.map(|text| Verdict::care("reference.shift", capitalised(&text)));
    regions.chain(shift).collect()
}

/// A reference that lies higher or lower than the drive says.
fn height(joint: &Joint) -> Option<Verdict> {
    joint.reference_height().map(|found| {
        let text = format!(
            "The reference lies {:.1} mm {} where the drive puts it (± {:.1} mm, by the slopes of boards): \
             check the height of the total station, the lever arm of the prism, and the registration. All \
             of it is in tz.",
            1e3 * found.value.abs(),
            if found.value > 0.0 { "above" } else { "below" },
            1e3 * found.sigma
        );
        Verdict::fault("reference.height", text).with_value(found.value, Some(found.sigma))
    })
}

/// The largest standard deviations of the mountings, against what is accepted; `moves`: they include that
/// mountings move.
fn sigmas(calibration: &Calibration, acceptance: &Acceptance, moves: bool) -> Option<Verdict> {
    const CODE: &str = "mounting.sigma";
    let mut worst = [0.0f64; 2];
    for (scanner, mounting) in calibration.mountings.iter().enumerate() {
        let sigmas = calibration.sigmas(scanner, mounting.convention);
        for (parameter, sigma) in sigmas.into_iter().enumerate() {
            let worst = &mut worst[parameter / 3];
            *worst = worst.max(sigma.unwrap_or(0.0));
        }
    }
    let [length_m, angle_rad] = worst;
    let parts: Vec<String> = [
        (length_m > 0.0).then(|| format!("± {} in position", number::length(length_m))),
        (angle_rad > 0.0).then(|| format!("± {:.3}° in rotation", angle_rad.to_degrees())),
    ]
    .into_iter()
    .flatten()
    .collect();
    if parts.is_empty() {
        return None;
    }
    let sigmas = parts.join(" and ");
    let limits = format!(
        "{} and {}°",
        number::length(acceptance.sigma_translation_m),
        number::shortest(acceptance.sigma_rotation_rad.to_degrees())
    );
    let is_constant = moves
        || calibration.constancy.as_ref().is_none_or(|c| c.constant)
            && constancy::moving_gap(calibration).is_none();
    let is_accepted =
        length_m <= acceptance.sigma_translation_m && angle_rad <= acceptance.sigma_rotation_rad;
    Some(match (is_constant, is_accepted) {
        (true, true) => Verdict::good(
            CODE,
            format!(
                "The mountings of the scanners are known to {sigmas} or better (one standard \
                 deviation; accepted: {limits})."
            ),
        ),
        (true, false) => Verdict::care(
            CODE,
            format!(
                "The mountings of the scanners are known to {sigmas} only, and {limits} would be \
                 accepted: drive over planes in more directions, or accept more with [acceptance]."
            ),
        ),
        (false, _) => Verdict::note(
            CODE,
            format!(
                "Constant mountings would be known to {sigmas} or better. These are not constant, so \
                 their standard deviations are too small."
            ),
        ),
    })
}

/// Number of `all` errors that may exceed 1.96 σ by chance: 1 in 20, plus 1.96 binomial standard
/// deviations.
fn outside_by_chance(all: usize) -> f64 {
    let n = all as f64;
    0.05 * n + NORMAL_97_5_ROUNDED * (n * 0.05 * 0.95).sqrt()
}

/// Errors against a known truth, and whether the standard deviations cover them.
fn errors(calibration: &Calibration, truth: &[BodyFromScanner]) -> Option<Verdict> {
    let covariance = calibration.covariance.as_ref()?;
    let mut worst = [0.0f64; 2];
    let (mut outside, mut all, mut largest) = (0usize, 0usize, 0.0f64);
    for (scanner, (mounting, truth)) in calibration.mountings.iter().zip(truth).enumerate() {
        // In body axes like the covariance.
        let (turn, shift) = mounting.body_from_scanner.perturbation_from(truth);
        for (parameter, error) in shift.iter().chain(turn.iter()).enumerate() {
            let row = 6 * scanner + parameter;
            let variance = covariance[(row, row)];
            if variance > 0.0 {
                all += 1;
                let normalised = error.abs() / variance.sqrt();
                outside += usize::from(normalised > NORMAL_97_5_ROUNDED);
                largest = largest.max(normalised);
                let worst = &mut worst[parameter / 3];
                *worst = worst.max(error.abs());
            }
        }
    }
    let text = format!(
        "The largest errors against the simulated truth are {} and {:.3}°; {} of {all} errors \
         lie within their 95 % bounds, and all within {largest:.1} standard deviations.",
        number::length(worst[0]),
        worst[1].to_degrees(),
        all - outside
    );
    let covered = outside as f64 <= outside_by_chance(all) && largest < NEVER_BY_CHANCE;
    const CODE: &str = "truth.errors";
    (all > 0).then(|| match covered {
        true => Verdict::good(CODE, text),
        false => Verdict::fault(CODE, text),
    })
}

/// The observability of the parameters.
pub fn observability(calibrations: &Calibrations) -> Vec<Verdict> {
    const CODE: &str = "mounting.unobservable";
    let found = statements(calibrations.result, "").into_iter();
    let mut lines: Vec<Verdict> = found.map(|text| Verdict::care(CODE, text)).collect();
    if lines.is_empty() {
        lines.push(Verdict::good(
            CODE,
            "Every free parameter is determined by the data.",
        ));
    }
    if let Some(without) = calibrations.variant(Variant::WithoutReference) {
        let found = statements(without, " without a reference").into_iter();
        lines.extend(found.map(|text| Verdict::note(CODE, text).about("without a reference")));
    }
    lines
}

/// A sentence for each unobservable direction.
pub fn statements(calibration: &Calibration, circumstance: &str) -> Vec<String> {
    let directions = calibration.observability.unobservable.iter();
    directions
        .map(|direction| {
            let text = capitalised(&direction.description);
            format!("{text} is unobservable{circumstance}: held at the initial value.")
        })
        .collect()
}
