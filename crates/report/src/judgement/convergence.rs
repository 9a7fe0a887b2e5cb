//! Verdicts on convergence: whether the calibration converged, how far from its start, and whether the minimum is
//! unique.

use crate::calibration::{Calibration, Ending, Method, Reach};
use crate::geometry::BodyFromScanner;
use crate::number;
use crate::verdict::Verdict;

/// A displacement that is a fault: no scanner on a robot of this size is a metre from its drawing, and half a right
/// angle lies nearer to another convention of angles than to an error.
const FAULT: Reach = Reach {
    shift_m: 1.0,
    turn_rad: 0.8,
};

/// Verdicts on mountings that ended far from where they started.
pub fn moved(result: &Calibration, initial: &[BodyFromScanner]) -> Vec<Verdict> {
    let pairs = result.mountings.iter().zip(initial);
    let far = pairs.filter_map(|(mounting, initial)| {
        let moved = mounting.body_from_scanner.perturbation_from(initial);
        let (turn, shift) = &moved;
        Reach::WRONG.is_exceeded(&moved).then(|| {
            let text = format!(
                "Scanner {} ended {} and {:.0}° from its start: is the start really that far off, or is this \
                 another minimum?",
                mounting.name,
                number::length(shift.norm()),
                turn.norm().to_degrees()
            );
            let verdict = if FAULT.is_exceeded(&moved) {
                Verdict::fault("mounting.moved", text)
            } else {
                Verdict::care("mounting.moved", text)
            };
            verdict.with_value(shift.norm(), None)
        })
    });
    far.collect()
}

/// The verdict on convergence.
pub fn convergence(result: &Calibration) -> Verdict {
    const CODE: &str = "calibration.convergence";
    match (result.converged, result.method) {
        (true, Method::Joint) => Verdict::good(CODE, "The joint adjustment converged."),
        (true, _) => Verdict::good(CODE, "The adjustment converged at every scale."),
        (false, Method::Joint) => Verdict::fault(
            CODE,
            "The joint adjustment did not converge: the result may be wrong.",
        ),
        (false, _) if ends(result, Ending::Apart) => Verdict::fault(
            CODE,
            "The clouds lie apart: nowhere do two passes, scanners or the reference share a neighbourhood, so that \
             nothing holds the mountings. Start nearer, or drive over the same ground again.",
        ),
        (false, _) if ends(result, Ending::Kept) => Verdict::fault(
            CODE,
            "The finest scale fits better only far from where it began: the mountings are those of the scale before, \
             and may be wrong.",
        ),
        (false, _) => Verdict::fault(
            CODE,
            "The adjustment did not converge at every scale: the result may be wrong.",
        ),
    }
}

/// Whether the finest scale ended so.
fn ends(result: &Calibration, ending: Ending) -> bool {
    result
        .scales
        .last()
        .is_some_and(|scale| scale.ending == ending)
}

/// The verdict on uniqueness: whether the mountings came back after they were moved away.
pub fn uniqueness(result: &Calibration) -> Option<Verdict> {
    const CODE: &str = "calibration.minimum";
    let minimum = result.minimum.as_ref()?;
    let away = format!(
        "moved away by {} and {:.1}° along and about each axis",
        number::length(minimum.shift_m),
        minimum.turn_rad.to_degrees()
    );
    Some(match &minimum.alternative {
        Some(other) => {
            let pairs = result.mountings.iter().zip(other);
            let places = pairs.map(|(own, other)| {
                let (turn, shift) = other
                    .body_from_scanner
                    .perturbation_from(&own.body_from_scanner);
                let (shift, turn_deg) = (number::length(shift.norm()), turn.norm().to_degrees());
                format!("{} {shift} and {turn_deg:.1}°", own.name)
            });
            let places: Vec<String> = places.collect();
            let places = places.join(", ");
            if result.method == Method::Joint {
                // It is the result only if it is the same from both starts, which rules out a minimum of two steps but
                // not an error that both share.
                Verdict::care(
                    CODE,
                    format!(
                        "In two steps, another minimum fits as well ({places}). From the initial values and from two \
                         steps, the joint adjustment ends at the same mountings: check them on another drive."
                    ),
                )
            } else {
                Verdict::fault(
                    CODE,
                    format!(
                        "Another minimum fits as well: {away}, the mountings ended elsewhere ({places}). Nothing says \
                         which is right, and standard deviations are not valid: drive over planes in more directions, \
                         give a reference, or start nearer."
                    ),
                )
            }
        }
        None if minimum.back == minimum.starts => Verdict::good(
            CODE,
            format!(
                "The minimum is the only one near: {away}, the mountings came back {} times of {}.",
                minimum.back, minimum.starts
            ),
        ),
        None => Verdict::note(
            CODE,
            format!(
                "The mountings came back {} times of {} when {away}, and ended where the clouds fit worse \
                 otherwise: start at least that close.",
                minimum.back, minimum.starts
            ),
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Minimum, Mounting, Observability};
    use crate::verdict::Severity;

    #[test]
    fn another_minimum_is_a_fault_unless_the_joint_adjustment_ends_at_the_same_mountings() {
        let mountings = vec![Mounting::new("left", BodyFromScanner::identity())];
        let verdict = |method, alternative: Option<Vec<Mounting>>| {
            let result = Calibration {
                method,
                mountings: mountings.clone(),
                converged: true,
                scales: Vec::new(),
                covariance: None,
                origin_sigma_m: 0.0,
                observability: Observability {
                    shares: Vec::new(),
                    unobservable: Vec::new(),
                },
                minimum: Some(Minimum {
                    shift_m: 0.05,
                    turn_rad: 0.02,
                    starts: 4,
                    back: 3,
                    alternative,
                }),
                constancy: None,
                gap: None,
            };
            uniqueness(&result).unwrap().severity
        };
        let other = Some(mountings.clone());
        assert_eq!(verdict(Method::TwoStep, other.clone()), Severity::Fault);
        assert_eq!(verdict(Method::Joint, other), Severity::Care);
        assert_eq!(verdict(Method::TwoStep, None), Severity::Note);
    }
}
