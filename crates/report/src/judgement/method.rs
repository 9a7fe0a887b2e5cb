//! Verdicts on the method whose values are the result, and why.

use crate::calibration::{Calibration, Method};
use crate::joint::{Joint, JointReport};
use crate::number;
use crate::verdict::Verdict;

/// Names the method of the result; on a fallback, adds a statement for each reason.
pub fn verdicts(result: &Calibration, joint: Option<&JointReport>) -> Vec<Verdict> {
    let refused: Vec<Verdict> = joint
        .into_iter()
        .flat_map(|joint| refusals(&joint.refused, joint.result.is_some()))
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

/// The reasons why the values are those of two steps, the gravest first.
fn refusals(reasons: &[String], was_made: bool) -> impl Iterator<Item = Verdict> {
    let outcome = if was_made {
        "was refused"
    } else {
        "could not be made"
    };
    reasons.iter().enumerate().map(move |(i, reason)| {
        let text = match i {
            0 => format!(
                "These are the values of two steps, as the joint adjustment {outcome}: {reason}."
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

/// The largest ratio of an IMU, in words.
fn imu(joint: &Joint) -> String {
    let drives = joint.drives.iter();
    let ratios = drives.filter_map(|drive| joint.group(&drive.imu)?.ratio);
    match ratios.filter(|ratio| ratio.is_finite()).reduce(f64::max) {
        Some(ratio) => format!(" (χ² of the IMU over its redundancy: {ratio:.2})"),
        None => String::new(),
    }
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
        let verdicts: Vec<Verdict> = refusals(&reasons, true).collect();
        assert!(verdicts.iter().all(|v| v.severity.is_marked()));
        assert!(
            verdicts[0]
                .text
                .starts_with("These are the values of two steps")
        );
        assert!(verdicts[0].text.contains("the IMU contradicts it"));
        assert!(verdicts[1].text.contains("so does `prism`"));
    }
}
