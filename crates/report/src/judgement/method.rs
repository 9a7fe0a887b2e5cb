//! Verdicts on the method whose values are the result, and why.

use crate::calibration::{Calibration, Method};
use crate::diagnostics::is_imu;
use crate::joint::{HeldOut, Joint, JointReport};
use crate::number;
use crate::verdict::Verdict;

/// Names the method of the result; on a fallback, adds a statement for each reason.
pub fn verdicts(result: &Calibration, joint: Option<&JointReport>) -> Vec<Verdict> {
    if let Some(report) = joint.filter(|joint| !joint.refused.is_empty()) {
        return against(report);
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

/// On an adjustment that something speaks against: whose values are the result, and why.
fn against(report: &JointReport) -> Vec<Verdict> {
    match report.predicts_better() {
        Some(held_out) => vec![contradicted(&report.refused, &held_out)],
        None => {
            let refused = refusals(&report.refused, report.result.is_some());
            refused.chain(report.held_out.map(not_better)).collect()
        }
    }
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

/// The joint adjustment is contradicted, but predicts scans better than two steps do.
fn contradicted(reasons: &[String], held_out: &HeldOut) -> Verdict {
    let HeldOut {
        two_steps_m,
        joint_m,
        misfit,
        ..
    } = *held_out;
    let text = format!(
        "These are the values of the joint adjustment, although {}: scans that neither method had seen lie {} apart \
         with it and {} with two steps (root mean square). Standard deviations are multiplied by {misfit:.1}, the \
         factor by which residuals exceed their noise.",
        reasons.join("; "),
        number::length(joint_m),
        number::length(two_steps_m),
    );
    Verdict::care("joint.contradicted", text)
}

/// The comparison after which the values are those of two steps.
fn not_better(held_out: HeldOut) -> Verdict {
    let text = format!(
        "Scans that neither method had seen lie {} apart with two steps and {} with the refused joint adjustment (root \
         mean square): it does not predict them better beyond chance.",
        number::length(held_out.two_steps_m),
        number::length(held_out.joint_m),
    );
    Verdict::note("joint.held_out", text)
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

/// The largest ratio of an IMU, in words; nothing if all poses are from files.
fn imu(joint: &Joint) -> String {
    let drives = joint.drives.iter().filter(|drive| is_imu(&drive.imu));
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
    fn what_predicts_better_is_named() {
        let of = |joint_is_better| {
            let report = JointReport {
                result: None,
                refused: vec!["the IMU contradicts it".into()],
                held_out: Some(HeldOut {
                    two_steps_m: 0.004,
                    joint_m: 0.001,
                    joint_is_better,
                    misfit: 2.0,
                }),
                ..JointReport::default()
            };
            against(&report)
        };
        let codes =
            |verdicts: &[Verdict]| verdicts.iter().map(|v| v.code.clone()).collect::<Vec<_>>();
        let (better, not_better) = (of(true), of(false));
        assert_eq!(codes(&better), ["joint.contradicted"]);
        assert!(better[0].severity.is_marked() && better[0].text.contains("multiplied by 2.0"));
        assert_eq!(codes(&not_better), ["joint.refused", "joint.held_out"]);
    }

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
