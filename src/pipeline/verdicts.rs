//! The verdict of a run in words a field crew understands.

use super::evaluate::{Against, Agreement, Drive};
use super::{Findings, page};
use crate::calibration::Calibration;
use crate::geometry::{BodyFromScanner, so3};
use crate::project::Project;
use crate::report::content::{MountingKind, Status, Verdict};

/// A length in words.
pub fn millimetres(metres: f64) -> String {
    if metres >= 0.01 {
        format!("{:.0} mm", metres * 1e3)
    } else {
        format!("{:.1} mm", metres * 1e3)
    }
}

/// The lines of the verdict: what needs attention first, then how well the clouds agree, then how
/// well the mounting is known.
pub fn summary(project: &Project, findings: &Findings) -> Vec<Verdict> {
    let constancy = page::residuals(project, &findings.calibration).map(|figure| figure.verdict);
    let is_constant = constancy.as_ref().is_none_or(|v| v.status == Status::Good);
    let mut lines = Vec::new();
    if !is_constant {
        lines.extend(constancy.clone());
    }
    if let Some(drive) = findings.drives.first() {
        for found in drive
            .agreements
            .iter()
            .filter(|found| found.mounting == MountingKind::Final)
        {
            lines.push(agreement_verdict(project, drive, found));
        }
    }
    for drive in findings.drives.iter().skip(1) {
        let rmse: Vec<String> = drive
            .agreements
            .iter()
            .filter(|found| found.mounting == MountingKind::Final)
            .map(|found| {
                format!(
                    "{}: {}",
                    found.pair(project),
                    millimetres(found.statistics.rmse_m)
                )
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
    if findings.calibration.converged {
        lines.push(Verdict::good("The adjustment converged at every scale."));
    } else {
        lines.push(Verdict::attention(
            "The adjustment did not converge at every scale: treat the result with care.",
        ));
    }
    lines.extend(sigmas(&findings.calibration));
    if let Some(truth) = &findings.truth_mountings {
        lines.extend(errors(&findings.calibration, truth));
    }
    lines.extend(
        page::observability(findings)
            .into_iter()
            .filter(|v| v.status != Status::Good),
    );
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
    0.05 * n + 1.96 * (n * 0.05 * 0.95).sqrt()
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
                outside += usize::from(error.abs() > 1.96 * variance.sqrt());
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

fn agreement_verdict(project: &Project, drive: &Drive, found: &Agreement) -> Verdict {
    let before = drive.find(found.scanner, found.against, MountingKind::Initial);
    let after = found.statistics.rmse_m;
    let name = |index: usize| project.scanners[index].name.as_str();
    let text = match found.against {
        Against::Reference => format!(
            "Scanner {}: points agree with the reference scan to {}",
            name(found.scanner),
            millimetres(after)
        ),
        Against::Scanner(other) => format!(
            "Scanners {} and {} agree with each other to {}",
            name(other),
            name(found.scanner),
            millimetres(after)
        ),
    };
    match before.map(|before| before.statistics.rmse_m) {
        Some(before) if before < after => Verdict::attention(format!(
            "{text}: worse than the {} with the initial mounting.",
            millimetres(before)
        )),
        Some(before) => Verdict::good(format!("{text} (before: {}).", millimetres(before))),
        None => Verdict::good(format!("{text}.")),
    }
}
