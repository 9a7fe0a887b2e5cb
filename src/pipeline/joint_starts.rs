//! Where a joint adjustment starts: at the result of two steps, where these began, or at both.
//!
//! Over ground that hardly determines the mountings, the finest scales of two steps may lead astray, and from there the joint
//! adjustment ends in another dip of the noise than from the initial values.

use super::joint_input::{Drive, surfel_m};
use crate::calibration::{Calibration, INITIAL_SIGMA, Minimum, Mounting, Reach, change, is_within};
use crate::error::{Error, Problem, Result, unless_cancelled};
use crate::joint::{Joint, JointInput, LateScanner, Score, adjust, contradictions, is_weak};
use crate::judgement;
use crate::number;
use crate::progress::Progress;
use crate::statistics::chi_square;

/// A scanner is late if the scans show a latency of more than this many standard deviations and of more than
/// `LEAST_LATENCY_S`, seconds.
const LATE_SIGMAS: f64 = 5.0;
const LEAST_LATENCY_S: f64 = 0.002;

/// Initial values are farther off than this in one of a thousand mountings, standard normal distribution.
const INITIAL_Z: f64 = 3.09;

/// Adjusts from the result of two steps; if it is one of several minima, from where these began too.
///
/// If two steps have no result, the adjustment starts where they began. If it is refused from their result, or determines
/// the mountings weakly, it is repeated from there. Of two adjustments that hold, the second counts if it ends farther from
/// the first than the standard deviations of the first allow.
///
/// # Errors
/// Those of [`adjust`]; two minima from which adjustments end apart ([`Problem::NotDetermined`]).
pub fn adjusted(
    input: &mut JointInput<'_>,
    begin: &[Mounting],
    two_steps: &Calibration,
    calibration_drive: &Drive<'_>,
    progress: &dyn Progress,
) -> Result<(Joint, Vec<LateScanner>)> {
    if is_ambiguous(two_steps) {
        return from_both(input, begin, calibration_drive, progress);
    }
    let finest = two_steps.scales.last();
    if finest.is_some_and(|scale| scale.ending.is_kept()) {
        progress.say("two steps have no result: adjusting from the initial values");
        input.mountings = begin.to_vec();
        return with_late_scanners(input, calibration_drive, progress);
    }
    let initial = input.initial;
    let holds = |joint: &Joint| {
        let beyond = beyond_initial_values(initial, &two_steps.mountings, &joint.mountings);
        !is_doubtful(joint) && beyond.is_none()
    };
    let first = with_late_scanners(input, calibration_drive, progress);
    match &first {
        Err(Error::Cancelled) => return first,
        Ok((joint, _)) if holds(joint) && !is_weak(joint) => return first,
        _ => {}
    }
    progress.say("the result is in doubt: adjusting again from the initial values");
    let start = std::mem::replace(&mut input.mountings, begin.to_vec());
    let second = unless_cancelled(with_late_scanners(input, calibration_drive, progress))?;
    let Some(second) = second.filter(|(joint, _)| holds(joint)) else {
        input.mountings = start;
        return first;
    };
    match first {
        Ok((joint, late)) if holds(&joint) => {
            let apart = change(&joint.mountings, &second.0.mountings);
            if is_within(&apart, &joint.covariance) {
                input.mountings = start;
                return Ok((joint, late));
            }
            Ok(second)
        }
        _ => Ok(second),
    }
}

/// Whether two steps have several minima.
pub fn is_ambiguous(two_steps: &Calibration) -> bool {
    two_steps.minimum.as_ref().is_some_and(Minimum::is_doubtful)
}

/// Why the mountings of a joint adjustment cannot be true: one is farther from its initial value than this is off, and also
/// farther than [`Reach::ROUGH`] from that of two steps, which leave an initial value that is wrong.
pub fn beyond_initial_values(
    initial: &[Mounting],
    two_steps: &[Mounting],
    joint: &[Mounting],
) -> Option<String> {
    let mut all = joint.iter().zip(two_steps).zip(initial);
    all.find_map(|((joint, two_steps), initial)| {
        let from = |other: &Mounting| {
            let other = &other.body_from_scanner;
            joint.body_from_scanner.perturbation_from(other)
        };
        let (turn, shift) = from(initial);
        let [shift_m, turn_rad] = INITIAL_SIGMA;
        let squares = (shift / shift_m).norm_squared() + (turn / turn_rad).norm_squared();
        let is_beyond = squares > chi_square(6.0, INITIAL_Z);
        (is_beyond && Reach::ROUGH.is_exceeded(&from(two_steps))).then(|| {
            format!(
                "it ends {} and {:.1}° away from the initial value of `{}`, farther than the stated uncertainty of \
                 initial values allows",
                number::length(shift.norm()),
                turn.norm().to_degrees(),
                joint.name,
            )
        })
    })
}

/// Whether an adjustment did not converge, or is contradicted.
pub fn is_doubtful(joint: &Joint) -> bool {
    not_converged(joint).is_some() || !contradictions(joint).is_empty()
}

/// Why an adjustment that did not converge is doubtful: its standard deviations are those of another state.
pub fn not_converged(joint: &Joint) -> Option<String> {
    let iterations = joint.iterations;
    (!joint.stop.is_converged()).then(|| format!("it did not converge in {iterations} iterations"))
}

/// Adjusts; if the scans contradict the latencies of scanners, adjusts again and estimates these latencies. They are
/// held by default, because estimating a latency costs tx a third of its accuracy.
fn with_late_scanners(
    input: &mut JointInput<'_>,
    calibration_drive: &Drive<'_>,
    progress: &dyn Progress,
) -> Result<(Joint, Vec<LateScanner>)> {
    let (settings, surfel_m) = (
        &calibration_drive.project.joint,
        surfel_m(calibration_drive),
    );
    let joint = adjust(input, settings, surfel_m, progress)?;
    let is_late = |score: &Option<Score>| {
        score.is_some_and(|s| s.value.abs() > LEAST_LATENCY_S && s.sigmas() > LATE_SIGMAS)
    };
    let late: Vec<bool> = joint.late_scores.iter().map(is_late).collect();
    if !late.contains(&true) {
        return Ok((joint, Vec::new()));
    }
    let estimated = input.estimate_latency.iter_mut().zip(&late);
    estimated.for_each(|(estimate, late)| *estimate |= late);
    let freed = unless_cancelled(adjust(input, settings, surfel_m, progress))?;
    let Some(joint) = freed else {
        // The adjustment succeeds only with latencies held.
        return Ok((joint, Vec::new()));
    };
    let scanners = calibration_drive
        .project
        .scanners
        .iter()
        .zip(&joint.late_s)
        .zip(&late);
    let named = scanners.filter_map(|((scanner, latency), late)| {
        let (value, sigma) = latency.filter(|_| *late)?;
        Some(LateScanner {
            name: scanner.name.clone(),
            late: Score { value, sigma },
            time_offset_s: scanner.time_offset_s,
        })
    });
    let named: Vec<LateScanner> = named.collect();
    named
        .iter()
        .for_each(|scanner| progress.verdict(&judgement::late_scanner(scanner).text));
    Ok((joint, named))
}

/// Adjusts from where two steps began and, if that holds, from their result, which is one of several minima: only if both
/// end at the same mountings is it known which they are. An adjustment from the first alone that is doubtful is returned
/// as it is.
///
/// # Errors
/// Those of [`adjust`]; the two end apart ([`Problem::NotDetermined`]).
fn from_both(
    input: &mut JointInput<'_>,
    begin: &[Mounting],
    calibration_drive: &Drive<'_>,
    progress: &dyn Progress,
) -> Result<(Joint, Vec<LateScanner>)> {
    progress
        .say("two steps have several minima: adjusting from the initial values and from two steps");
    let two_steps = std::mem::replace(&mut input.mountings, begin.to_vec());
    let (joint, late) = with_late_scanners(input, calibration_drive, progress)?;
    if is_doubtful(&joint) {
        return Ok((joint, late));
    }
    input.mountings = two_steps;
    let other = unless_cancelled(with_late_scanners(input, calibration_drive, progress))?;
    let agrees = |(other, _): &(Joint, _)| {
        let apart = change(&joint.mountings, &other.mountings);
        !is_doubtful(other) && is_within(&apart, &joint.covariance)
    };
    if other.as_ref().is_some_and(agrees) {
        return Ok((joint, late));
    }
    Err(Error::of(
        Problem::NotDetermined,
        "the calibration in two steps has another minimum that fits as well, and from there the joint adjustment does \
         not end at the same mountings as from the initial values",
        "drive over planes in more directions, give a reference, or start nearer",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BodyFromScanner, Vec3};

    #[test]
    fn an_adjustment_that_ends_farther_than_initial_values_are_off_is_named() {
        let at = |turn_rad: f64, shift_m: f64| {
            let (turn, shift) = (Vec3::x() * turn_rad, Vec3::y() * shift_m);
            let pose = BodyFromScanner::identity().perturbed(&turn, &shift);
            [Mounting::new("left", pose)]
        };
        let initial = at(0.0, 0.0);
        let reason = |turn_rad: f64, shift_m: f64| {
            beyond_initial_values(&initial, &initial, &at(turn_rad, shift_m))
        };
        // χ² of 6 degrees exceeds 22.5 once in a thousand: 4.7 standard deviations.
        assert_eq!((reason(0.11, 0.0), reason(0.0, 0.11)), (None, None));
        let far = reason(0.0, 0.25).unwrap();
        assert!(
            far.contains("250 mm and 0.0° away") && far.contains("`left`"),
            "{far}"
        );
        assert!(reason(0.15, 0.0).unwrap().contains("8.6° away"));
        // Two steps agree: the initial value is wrong.
        assert_eq!(
            beyond_initial_values(&initial, &at(0.15, 0.25), &at(0.16, 0.24)),
            None
        );
    }
}
