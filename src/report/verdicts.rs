//! The summary of a run, in words that a field crew understands.

use super::content::{Calibrations, Content, Drive, Status, Verdict};
use super::{method, number};
use crate::calibration::{Calibration, Method, Variant};
use crate::comparison::{Against, Agreement, Agreements, MountingKind};
use crate::geometry::{BodyFromScanner, Vec3, so3};
use crate::joint::Joint;
use crate::statistics::NORMAL_97_5_ROUNDED;
use crate::trajectory::Doubt;

/// Clouds that agree worse than after two steps by more than this factor need attention: other core
/// points alone change the RMSE by a few percent.
const WORSE_THAN_TWO_STEPS: f64 = 1.2;
/// No error exceeds this many standard deviations by chance: 1 in 16 000 does.
const NEVER_BY_CHANCE: f64 = 4.0;

/// The summary: constants of the project that the drive contradicts, which method's values these are,
/// then points that need attention, then the agreement of the clouds, then the quality of the
/// mountings.
pub fn summary(content: &Content) -> Vec<Verdict> {
    let Some(calibrations) = &content.calibrations else {
        return Vec::new();
    };
    let constancy = constancy(calibrations.result);
    let is_constant = constancy.as_ref().is_none_or(|v| v.status == Status::Good);
    let mut lines = Vec::new();
    if !is_constant {
        lines.extend(constancy.clone());
    }
    if let Some(drive) = content.drives.first() {
        let last = drive.agreements.under(MountingKind::Final);
        lines.extend(last.map(|found| agreement(&drive.agreements, found)));
    }
    lines.extend(content.drives.iter().skip(1).filter_map(evaluation));
    lines.extend(
        calibrations
            .joint_found()
            .into_iter()
            .flat_map(disagreements),
    );
    lines.push(convergence(calibrations.result));
    lines.extend(sigmas(calibrations.result));
    let reference = method::reference(calibrations.result, calibrations.joint);
    lines.extend(reference.map(Verdict::neutral));
    let relative = method::relative(calibrations.result).into_iter();
    lines.extend(relative.map(Verdict::good));
    if let Some(truth) = calibrations.mountings(MountingKind::Truth) {
        lines.extend(errors(calibrations.result, truth));
    }
    let observability = observability(calibrations).into_iter();
    lines.extend(observability.filter(|v| v.status != Status::Good));
    if is_constant {
        lines.extend(constancy);
    }
    lines.sort_by_key(|line| line.status != Status::Attention);
    let mut all: Vec<Verdict> = content.doubts.iter().map(doubt).collect();
    all.extend(method::verdicts(calibrations.result, calibrations.joint));
    all.extend(lines);
    all
}

/// A constant of the project that the drive contradicts.
pub fn doubt(doubt: &Doubt) -> Verdict {
    Verdict::attention(capitalised(&doubt.describe()))
}

/// The agreement of the clouds of a drive that was not used in the calibration.
fn evaluation(drive: &Drive) -> Option<Verdict> {
    let all = &drive.agreements;
    let mut is_worse = false;
    let parts = all.under(MountingKind::Final).map(|found| {
        let rmse_m = found.statistics.rmse_m;
        let rmse = number::length(rmse_m);
        let worse = worse_than_two_steps(all, found);
        is_worse |= worse.is_some();
        let aside = worse.map_or(String::new(), |two_steps| {
            format!(
                " (worse than after two steps: {})",
                number::length(two_steps)
            )
        });
        format!("{}: {rmse}{aside}", found.pair())
    });
    let parts: Vec<String> = parts.collect();
    let text = format!(
        "On {}, which was not used in the calibration: {}.",
        drive.name,
        parts.join("; ")
    );
    (!parts.is_empty()).then(|| match is_worse {
        true => Verdict::attention(text),
        false => Verdict::good(text),
    })
}

/// The RMSE after two steps where the clouds agree notably worse than then.
fn worse_than_two_steps(all: &Agreements, found: &Agreement) -> Option<f64> {
    let two_steps = all.counterpart(found, MountingKind::TwoStep)?;
    let (before, after) = (two_steps.statistics.rmse_m, found.statistics.rmse_m);
    (after > WORSE_THAN_TWO_STEPS * before).then_some(before)
}

fn convergence(result: &Calibration) -> Verdict {
    match (result.converged, result.method) {
        (true, Method::Joint) => Verdict::good("The joint adjustment converged."),
        (true, _) => Verdict::good("The adjustment converged at every scale."),
        (false, Method::Joint) => {
            Verdict::attention("The joint adjustment did not converge: the result may be wrong.")
        }
        (false, _) => Verdict::attention(
            "The adjustment did not converge at every scale: the result may be wrong.",
        ),
    }
}

/// Where scans and reference disagree.
pub fn disagreements(joint: &Joint) -> impl Iterator<Item = Verdict> {
    let regions = joint.regions.iter().map(|r| r.describe(&Vec3::zeros()));
    let all = regions.chain(joint.reference.and_then(|reference| reference.describe()));
    all.map(|text| Verdict::attention(capitalised(&text)))
}

fn capitalised(text: &str) -> String {
    let mut text = text.to_owned();
    if let Some(first) = text.get_mut(0..1) {
        first.make_ascii_uppercase();
    }
    text
}

/// The largest standard deviations of the mountings.
fn sigmas(calibration: &Calibration) -> Option<Verdict> {
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
    let sigmas = parts.join(" and ");
    let is_constant = calibration.constancy.as_ref().is_none_or(|c| c.constant);
    (!parts.is_empty()).then(|| match is_constant {
        true => Verdict::good(format!(
            "The mountings of the scanners are known to {sigmas} or better (one standard deviation)."
        )),
        false => Verdict::neutral(format!(
            "Constant mountings would be known to {sigmas} or better. These are not constant, so their \
             standard deviations are too small."
        )),
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
        let found = &mounting.body_from_scanner;
        let shift = found.translation_m - truth.translation_m;
        // The rotation vector ψ of R_found = Exp(ψ) R_true, in body axes like the covariance.
        let turn = so3::log(&(found.rotation * truth.rotation.inverse()));
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
    (all > 0).then(|| match covered {
        true => Verdict::good(text),
        false => Verdict::attention(text),
    })
}

fn agreement(all: &Agreements, found: &Agreement) -> Verdict {
    let after = found.statistics.rmse_m;
    let text = match &found.against {
        Against::Reference => format!(
            "Scanner {}: points agree with the reference scan to {}",
            found.scanner,
            number::length(after)
        ),
        Against::Scanner(other) => format!(
            "Scanners {other} and {} agree with each other to {}",
            found.scanner,
            number::length(after)
        ),
    };
    let rmse = |kind| {
        let other = all.counterpart(found, kind);
        other.map(|other| other.statistics.rmse_m)
    };
    let two_steps = rmse(MountingKind::TwoStep);
    if let Some(two_steps) = worse_than_two_steps(all, found) {
        return Verdict::attention(format!(
            "{text}, worse than after two steps ({}).",
            number::length(two_steps)
        ));
    }
    let two_steps = two_steps.map_or(String::new(), |two_steps| {
        format!(", after two steps: {}", number::length(two_steps))
    });
    match rmse(MountingKind::Initial) {
        Some(before) if before < after => Verdict::attention(format!(
            "{text}, worse than with the initial mounting ({}).",
            number::length(before)
        )),
        Some(before) => Verdict::good(format!(
            "{text} (before: {}{two_steps}).",
            number::length(before)
        )),
        None => Verdict::good(format!("{text}.")),
    }
}

/// The observability of the parameters.
pub fn observability(calibrations: &Calibrations) -> Vec<Verdict> {
    let found = statements(calibrations.result, "").into_iter();
    let mut lines: Vec<Verdict> = found.map(Verdict::attention).collect();
    if lines.is_empty() {
        lines.push(Verdict::good(
            "Every free parameter is determined by the data.",
        ));
    }
    if let Some(without) = calibrations.variant(Variant::WithoutReference) {
        let found = statements(without, " without a reference").into_iter();
        lines.extend(found.map(Verdict::neutral));
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

/// The test of a constant mounting; `None` if it is not possible.
pub fn constancy(calibration: &Calibration) -> Option<Verdict> {
    let found = calibration.constancy.as_ref()?;
    Some(match constancy_warning(calibration) {
        Some(text) => Verdict::attention(text),
        None => Verdict::good(format!(
            "The mounting appears constant{}: residuals along the drive ({}) are {:.1} times as large \
             as the standard deviations of the poses explain.",
            of_two_steps(calibration),
            number::length(found.rms_m),
            found.ratio
        )),
    })
}

/// A warning if the residuals along the drive show that the mounting is not constant.
pub fn constancy_warning(calibration: &Calibration) -> Option<String> {
    let constancy = calibration
        .constancy
        .as_ref()
        .filter(|found| !found.constant)?;
    let strong = constancy.strongest.filter(|(_, r)| r.abs() > 0.3);
    let with = strong.map_or(String::new(), |(name, r)| {
        format!(" They correlate most with {name} (correlation {r:.2}).")
    });
    Some(format!(
        "The mounting does not appear constant{}: residuals along the drive ({}) are {:.1} times as \
         large as the standard deviations of the poses explain.{with}",
        of_two_steps(calibration),
        number::length(constancy.rms_m),
        constancy.ratio
    ))
}

/// The test of a constant mounting uses the residuals of two steps.
fn of_two_steps(calibration: &Calibration) -> &'static str {
    match calibration.method {
        Method::Joint => " after two steps",
        Method::TwoStep | Method::Paper => "",
    }
}
