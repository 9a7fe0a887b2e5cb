//! The verdict of a run in words a field crew understands.

use super::content::{Calibrations, Content, Status, Verdict};
use super::number::DASH;
use crate::calibration::{Calibration, Variant};
use crate::comparison::{Against, Agreement, Agreements, MountingKind};
use crate::geometry::{BodyFromScanner, so3};
use crate::statistics::NORMAL_97_5_ROUNDED;

/// A length in words.
fn millimetres(metres: f64) -> String {
    match metres {
        _ if !metres.is_finite() => DASH.into(),
        0.01.. => format!("{:.0} mm", metres * 1e3),
        _ => format!("{:.1} mm", metres * 1e3),
    }
}

/// The lines of the verdict: what needs attention first, then how well the clouds agree, then how
/// well the mounting is known.
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
    for drive in content.drives.iter().skip(1) {
        let rmse: Vec<String> = drive
            .agreements
            .under(MountingKind::Final)
            .map(|found| {
                let rmse = millimetres(found.statistics.rmse_m);
                format!("{}: {rmse}", found.pair())
            })
            .collect();
        if !rmse.is_empty() {
            lines.push(Verdict::good(format!(
                "On {}, which took no part in the calibration: {}.",
                drive.name,
                rmse.join("; ")
            )));
        }
    }
    lines.push(match calibrations.result.converged {
        true => Verdict::good("The adjustment converged at every scale."),
        false => Verdict::attention(
            "The adjustment did not converge at every scale: treat the result with care.",
        ),
    });
    lines.extend(sigmas(calibrations.result));
    if let Some(truth) = calibrations.mountings(MountingKind::Truth) {
        lines.extend(errors(calibrations.result, truth));
    }
    let observability = observability(calibrations).into_iter();
    lines.extend(observability.filter(|v| v.status != Status::Good));
    if is_constant {
        lines.extend(constancy);
    }
    lines.sort_by_key(|line| line.status != Status::Attention);
    lines
}

/// How well the mountings are known, from their standard deviations.
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
        (length_m > 0.0).then(|| format!("positions to ± {}", millimetres(length_m))),
        (angle_rad > 0.0).then(|| format!("rotations to ± {:.3}°", angle_rad.to_degrees())),
    ]
    .into_iter()
    .flatten()
    .collect();
    let known = parts.join(", ");
    let is_constant = calibration.constancy.as_ref().is_none_or(|c| c.constant);
    (!parts.is_empty()).then(|| match is_constant {
        true => Verdict::good(format!(
            "The mounting of the scanners is known: {known} or better (one standard deviation)."
        )),
        false => Verdict::neutral(format!(
            "A constant mounting would be known: {known} or better. This one is not, and its \
             standard deviations are too small."
        )),
    })
}

/// How many of `all` errors may lie beyond 1.96 σ by chance: 1 in 20, and 1.96 binomial standard
/// deviations more, for one drive is one draw.
fn outside_by_chance(all: usize) -> f64 {
    let n = all as f64;
    0.05 * n + NORMAL_97_5_ROUNDED * (n * 0.05 * 0.95).sqrt()
}

/// Errors against a known truth, and whether the standard deviations cover them.
fn errors(calibration: &Calibration, truth: &[BodyFromScanner]) -> Option<Verdict> {
    let covariance = calibration.covariance.as_ref()?;
    let mut worst = [0.0f64; 2];
    let (mut outside, mut all) = (0usize, 0usize);
    for (scanner, (mounting, truth)) in calibration.mountings.iter().zip(truth).enumerate() {
        let found = &mounting.body_from_scanner;
        let shift = found.translation_m - truth.translation_m;
        // The rotation vector ψ of R_found = Exp(ψ) R_true, body axes, as the covariance has it.
        let turn = so3::log(&(found.rotation * truth.rotation.inverse()));
        for (parameter, error) in shift.iter().chain(turn.iter()).enumerate() {
            let row = 6 * scanner + parameter;
            let variance = covariance[(row, row)];
            if variance > 0.0 {
                all += 1;
                outside += usize::from(error.abs() > NORMAL_97_5_ROUNDED * variance.sqrt());
                let worst = &mut worst[parameter / 3];
                *worst = worst.max(error.abs());
            }
        }
    }
    let text = format!(
        "Against the simulated truth the parameters err by at most {} and {:.3}°; {} of {all} errors \
         lie within their 95 % bounds.",
        millimetres(worst[0]),
        worst[1].to_degrees(),
        all - outside
    );
    let covered = outside as f64 <= outside_by_chance(all);
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
            millimetres(after)
        ),
        Against::Scanner(other) => format!(
            "Scanners {other} and {} agree with each other to {}",
            found.scanner,
            millimetres(after)
        ),
    };
    let before = all.find(found, MountingKind::Initial);
    match before.map(|before| before.statistics.rmse_m) {
        Some(before) if before < after => Verdict::attention(format!(
            "{text}: worse than the {} with the initial mounting.",
            millimetres(before)
        )),
        Some(before) => Verdict::good(format!("{text} (before: {}).", millimetres(before))),
        None => Verdict::good(format!("{text}.")),
    }
}

/// What the data could and could not determine.
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

/// What cannot be found, a sentence each.
pub fn statements(calibration: &Calibration, circumstance: &str) -> Vec<String> {
    let free = calibration.observability.free.iter();
    free.map(|free| {
        let mut words = free.words.clone();
        if let Some(first) = words.get_mut(0..1) {
            first.make_ascii_uppercase();
        }
        format!("{words} cannot be found{circumstance}: held at the initial value.")
    })
    .collect()
}

/// Whether the mounting seems constant; `None` where that cannot be judged.
pub fn constancy(calibration: &Calibration) -> Option<Verdict> {
    let found = calibration.constancy.as_ref()?;
    Some(match not_constant(calibration) {
        Some(text) => Verdict::attention(text),
        None => Verdict::good(format!(
            "The mounting seems constant: residuals along the drive ({}) are {:.1} times what the \
             poses' standard deviations explain.",
            millimetres(found.rms_m),
            found.ratio
        )),
    })
}

/// Says that the mounting seems not to be constant, where the residuals along the drive say so.
pub fn not_constant(calibration: &Calibration) -> Option<String> {
    let constancy = calibration
        .constancy
        .as_ref()
        .filter(|found| !found.constant)?;
    let strong = constancy.strongest.filter(|(_, r)| r.abs() > 0.3);
    let with = strong.map_or(String::new(), |(name, r)| {
        format!(" They go most with {name} (correlation {r:.2}).")
    });
    Some(format!(
        "The mounting seems not to be constant: residuals along the drive ({}) are {:.1} times \
         what the poses' standard deviations explain.{with}",
        millimetres(constancy.rms_m),
        constancy.ratio
    ))
}
