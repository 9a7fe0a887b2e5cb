//! Which method's values are reported, and how well scanners are known relative to each other: the
//! same words in the page and in the terminal.

use super::number;
use crate::calibration::{Calibration, Method, RelativeMounting};
use crate::joint::{Joint, JointReport};
use crate::verdict::Verdict;

/// Factors below this are not worth mentioning.
const NOTABLE: f64 = 2.0;

/// Name of a method in tables and figures.
pub fn name(method: Method) -> &'static str {
    match method {
        Method::TwoStep => "two steps",
        Method::Joint => "joint adjustment",
        Method::Paper => "as in the paper",
    }
}

/// Which method's values these are; on a fallback a statement for each reason.
pub fn verdicts(result: &Calibration, joint: Option<&JointReport>) -> Vec<Verdict> {
    let refused: Vec<Verdict> = joint
        .into_iter()
        .flat_map(|joint| refusals(&joint.refused, joint.found.is_some()))
        .collect();
    if !refused.is_empty() {
        return refused;
    }
    vec![
        match (result.method, joint.and_then(JointReport::accepted)) {
            (Method::Joint, Some(joint)) => Verdict::good("method.joint", accepted(joint)),
            (Method::Paper, _) => Verdict::note(
                "method.paper",
                "These are the values of the paper's method: without standard deviations, and with the \
             poses as the trajectory left them.",
            ),
            _ => Verdict::note(
                "method.two_steps",
                "These are the values of two steps: the mountings after the trajectory, whose errors \
             they inherit.",
            ),
        },
    ]
}

/// Why the values are those of two steps, the gravest reason first.
fn refusals(reasons: &[String], was_made: bool) -> impl Iterator<Item = Verdict> {
    let what = match was_made {
        true => "was refused",
        false => "could not be made",
    };
    reasons.iter().enumerate().map(move |(i, reason)| {
        let text = match i {
            0 => format!(
                "These are the values of two steps, as the joint adjustment {what}: {reason}."
            ),
            _ => format!("The joint adjustment was also refused because {reason}."),
        };
        Verdict::care("joint.refused", text)
    })
}

fn accepted(joint: &Joint) -> String {
    let drives = match joint.drives.len() {
        1 => "the trajectory".to_owned(),
        several => format!("the trajectories of {several} drives"),
    };
    format!(
        "These are the values of the joint adjustment of mountings and {drives}: {} iterations, {} \
         rows of scans on {} patches of the surface. No sensor contradicts {} mountings{}.",
        joint.iterations,
        number::count(joint.rows),
        number::count(joint.surfels),
        joint.rung.name(),
        imu(joint),
    )
}

/// The largest ratio of an IMU.
fn imu(joint: &Joint) -> String {
    let drives = joint.drives.iter();
    let ratios = drives.filter_map(|drive| joint.group(&drive.imu)?.ratio);
    match ratios.filter(|ratio| ratio.is_finite()).reduce(f64::max) {
        Some(ratio) => format!(" (χ² of the IMU over its redundancy: {ratio:.2})"),
        None => String::new(),
    }
}

/// Which errors of the whole reference the standard deviations include, where there are any.
pub fn reference(result: &Calibration, joint: Option<&JointReport>) -> Option<String> {
    let joint = joint?
        .accepted()
        .filter(|_| result.method == Method::Joint)?;
    let sigma = joint.reference.as_ref()?.prior;
    let assumed = match sigma.assumed {
        true => " (assumed: give reference.sigma_m and reference.sigma_deg)",
        false => "",
    };
    (sigma.shift_m > 0.0 || sigma.tilt_rad > 0.0).then(|| {
        format!(
            "The standard deviations include a shift of the whole reference by ± {} and a tilt by \
             ± {}°{assumed}: a shift up goes one to one into the heights of the scanners.",
            number::length(sigma.shift_m),
            number::shortest(sigma.tilt_rad.to_degrees())
        )
    })
}

/// How well each scanner is known relative to the first.
pub fn relative(calibration: &Calibration) -> Vec<String> {
    let all = calibration.relative();
    all.iter()
        .enumerate()
        .filter_map(|(i, found)| sentence(calibration, i + 1, found))
        .collect()
}

fn sentence(calibration: &Calibration, scanner: usize, found: &RelativeMounting) -> Option<String> {
    let [length_m, angle_rad] = worst(&found.sigma);
    if length_m == 0.0 || angle_rad == 0.0 {
        return None;
    }
    let own = [0, scanner].map(|i| {
        let convention = calibration.mountings[i].convention;
        worst(&calibration.sigmas(i, convention))
    });
    let times = [(0, length_m), (1, angle_rad)].map(|(k, relative)| {
        // Of the scanner that is known better.
        let least = own[0][k].min(own[1][k]);
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
        found.name,
        found.first,
        number::length(length_m),
        number::sigma(angle_rad.to_degrees())
    ))
}

/// The largest standard deviations of position and rotation; 0 where there are none.
fn worst(sigmas: &[Option<f64>; 6]) -> [f64; 2] {
    let largest = |part: &[Option<f64>]| part.iter().flatten().copied().fold(0.0, f64::max);
    [largest(&sigmas[..3]), largest(&sigmas[3..])]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_of_a_refusal_needs_attention_the_gravest_first() {
        let reasons = [
            "the IMU contradicts it".to_owned(),
            "so does `prism`".to_owned(),
        ];
        let found: Vec<Verdict> = refusals(&reasons, true).collect();
        assert!(found.iter().all(|v| v.severity.is_marked()));
        assert!(
            found[0]
                .text
                .starts_with("These are the values of two steps")
        );
        assert!(found[0].text.contains("the IMU contradicts it"));
        assert!(found[1].text.contains("so does `prism`"));
    }
}
