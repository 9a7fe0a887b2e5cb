//! Verdicts on the precision of the mountings: standard deviations, relative mountings, unobservable directions.

use super::constancy;
use crate::calibration::{Calibration, Method, RelativeMounting, Variant};
use crate::number;
use crate::results::Calibrations;
use crate::trajectory::Solution;
use crate::verdict::{Acceptance, Verdict, capitalised};

/// Factors below this are not worth mentioning.
const NOTABLE: f64 = 2.0;

/// The verdict on the lever arm on which the positions of the mountings rest; `None` if it is estimated.
pub fn origin(solution: &Solution, sigma_m: f64) -> Option<Verdict> {
    let mut constants = solution.constants.iter();
    let is_estimated = constants.any(|constant| constant.name.contains(".lever_arm"));
    (sigma_m > 0.0 || !is_estimated).then(|| {
        let text = if sigma_m > 0.0 {
format!(
                "The standard deviations of positions include that of the lever arm, {} \
                 (sigma_lever_arm_m): an error of it shifts all mountings alike, and no point in the world.",
                number::length(sigma_m)
            )
} else {
"Positions of the mountings rest on a lever arm that is taken as exact: an error of it shifts \
                      all of them alike, and no point in the world."
                .to_owned()
};
        Verdict::note("mounting.origin", text).with_value(sigma_m, None)
    })
}

/// The verdict on the largest standard deviations of the mountings, compared with the accepted ones; `moves`: they
/// include the motion of the mountings.
pub fn sigmas(calibration: &Calibration, acceptance: &Acceptance, moves: bool) -> Option<Verdict> {
    const CODE: &str = "mounting.sigma";
    if calibration.is_noise() {
        return Some(Verdict::fault(
            CODE,
            "The mountings have no standard deviations, and may be wrong: the ground is so flat that what the scans say \
             about them is no more than noise. Drive over boards or rougher ground, or give a reference.",
        ));
    }
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
    Some(if !is_constant {
        Verdict::note(
            CODE,
            format!(
                "Constant mountings would be known to {sigmas} or better. These are not constant, so \
                 their standard deviations are too small."
            ),
        )
    } else if is_accepted {
        Verdict::good(
            CODE,
            format!(
                "The mountings of the scanners are known to {sigmas} or better (one standard \
                 deviation; accepted: {limits})."
            ),
        )
    } else {
        Verdict::care(
            CODE,
            format!(
                "The mountings of the scanners are known to {sigmas} only, and {limits} would be \
                 accepted: drive over planes in more directions, or accept more with [acceptance]."
            ),
        )
    })
}

/// The verdicts on the observability of the parameters.
pub fn observability(calibrations: &Calibrations) -> Vec<Verdict> {
    const CODE: &str = "mounting.unobservable";
    let directions = unobservable(&calibrations.result, "").into_iter();
    let mut lines: Vec<Verdict> = directions.map(|text| Verdict::care(CODE, text)).collect();
    if lines.is_empty() {
        lines.push(Verdict::good(
            CODE,
            "Every free parameter is determined by the data.",
        ));
    }
    if let Some(without) = calibrations.variant(Variant::WithoutReference) {
        let directions = unobservable(without, " without a reference").into_iter();
        lines.extend(directions.map(|text| Verdict::note(CODE, text).about("without a reference")));
    }
    lines
}

/// A sentence for each unobservable direction.
pub fn unobservable(calibration: &Calibration, circumstance: &str) -> Vec<String> {
    let directions = calibration.observability.unobservable.iter();
    directions
        .map(|direction| {
            let text = capitalised(&direction.description);
            let what = match calibration.method {
                Method::Joint => "the initial value says more about it than the drive",
                Method::TwoStep | Method::Paper => "held at the initial value",
            };
            format!("{text} is unobservable{circumstance}: {what}.")
        })
        .collect()
}

/// The precision of each scanner relative to the first.
pub fn relative(calibration: &Calibration) -> Vec<String> {
    let all = calibration.relative();
    all.iter()
        .enumerate()
        .filter_map(|(i, relative)| sentence(calibration, i + 1, relative))
        .collect()
}

fn sentence(
    calibration: &Calibration,
    scanner: usize,
    relative: &RelativeMounting,
) -> Option<String> {
    let [length_m, angle_rad] = worst(&relative.sigma);
    if length_m == 0.0 || angle_rad == 0.0 {
        return None;
    }
    let sigmas = [0, scanner].map(|i| {
        let convention = calibration.mountings[i].convention;
        worst(&calibration.sigmas(i, convention))
    });
    let times = [(0, length_m), (1, angle_rad)].map(|(k, relative)| {
        // The smaller sigma, that of the scanner that is known better.
        let least = sigmas[0][k].min(sigmas[1][k]);
        least / relative
    });
    let better = match times {
        [length, angle] if length >= NOTABLE && angle >= NOTABLE => format!(
            ", {} and {} times better than either scanner on the body",
            number::significant(length, 2),
            number::significant(angle, 2)
        ),
        _ => String::new(),
    };
    Some(format!(
        "Scanner {} relative to scanner {}: known to ± {} and ± {}° or better{better}.",
        relative.name,
        relative.first,
        number::length(length_m),
        number::sigma(angle_rad.to_degrees())
    ))
}

/// The largest standard deviations of position and rotation; 0 if there are none.
fn worst(sigmas: &[Option<f64>; 6]) -> [f64; 2] {
    let largest = |part: &[Option<f64>]| part.iter().flatten().copied().fold(0.0, f64::max);
    [largest(&sigmas[..3]), largest(&sigmas[3..])]
}
