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

/// Initial values are farther off than this in one of a thousand mountings, standard normal distribution.
const INITIAL_Z: f64 = 3.09;

/// One adjustment of an input, without the search for where it starts.
type Adjust<'a> = dyn Fn(&JointInput<'_>) -> Result<Joint> + 'a;

/// Adjusts from the result of two steps; if it is one of several minima, from where these began too.
///
/// If two steps have no result, the adjustment starts where they began. If it is refused from their result, or determines
/// the mountings weakly, it is repeated from there. Of two adjustments that hold, the second counts if it ends farther from
/// the first than the standard deviations of the first allow. Afterwards the input has the start and the latencies of the
/// adjustment that counts.
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
    let project = calibration_drive.project;
    let surfel_m = surfel_m(calibration_drive);
    let starts = Starts {
        begin,
        two_steps,
        stated_latency: input.estimate_latency.clone(),
        adjust: &|input| adjust(input, &project.joint, surfel_m, progress),
        progress,
    };
    let joint = starts.adjusted(input)?;
    let scanners = project.scanners.iter().zip(&starts.stated_latency);
    let late: Vec<LateScanner> = scanners
        .zip(&joint.late_s)
        .filter(|((_, is_asked_for), _)| !**is_asked_for)
        .filter_map(|((scanner, _), latency)| {
            let (value, sigma) = (*latency)?;
            Some(LateScanner {
                name: scanner.name.clone(),
                late: Score { value, sigma },
                time_offset_s: scanner.time_offset_s,
            })
        })
        .collect();
    late.iter()
        .for_each(|scanner| progress.verdict(&judgement::late_scanner(scanner).text));
    Ok((joint, late))
}

/// The starts of one joint adjustment.
struct Starts<'a> {
    /// Where two steps began.
    begin: &'a [Mounting],
    two_steps: &'a Calibration,
    /// Whether the project asks for the latency of each scanner.
    stated_latency: Vec<bool>,
    adjust: &'a Adjust<'a>,
    progress: &'a dyn Progress,
}

/// An adjustment and where it started.
struct Attempt {
    joint: Joint,
    start: Vec<Mounting>,
}

impl Attempt {
    /// Whether it estimates the latency of each scanner.
    fn estimated_latencies(&self) -> Vec<bool> {
        self.joint.late_s.iter().map(Option::is_some).collect()
    }
}

impl Starts<'_> {
    /// See [`adjusted`].
    fn adjusted(&self, input: &mut JointInput<'_>) -> Result<Joint> {
        let counting = if is_ambiguous(self.two_steps) {
            self.agreed_attempt(input)
        } else {
            self.best_attempt(input)
        };
        (input.mountings, input.estimate_latency) = match &counting {
            Ok(attempt) => (attempt.start.clone(), attempt.estimated_latencies()),
            Err(_) => (
                self.two_steps.mountings.clone(),
                self.stated_latency.clone(),
            ),
        };
        Ok(counting?.joint)
    }

    /// Adjusts from the result of two steps and, where that is in doubt, from where they began.
    fn best_attempt(&self, input: &mut JointInput<'_>) -> Result<Attempt> {
        let finest = self.two_steps.scales.last();
        if finest.is_some_and(|scale| scale.ending.is_kept()) {
            self.progress
                .say("two steps have no result: adjusting from the initial values");
            return self.attempt(self.begin, input);
        }
        let initial = input.initial;
        let holds = |joint: &Joint| {
            let two_steps = &self.two_steps.mountings;
            let beyond = beyond_initial_values(initial, two_steps, &joint.mountings);
            !is_doubtful(joint) && beyond.is_none()
        };
        let first = self.attempt(&self.two_steps.mountings, input);
        match &first {
            Err(Error::Cancelled) => return first,
            Ok(Attempt { joint, .. }) if holds(joint) && !is_weak(joint) => return first,
            _ => {}
        }
        self.progress
            .say("the result is in doubt: adjusting again from the initial values");
        let second = unless_cancelled(self.attempt(self.begin, input))?;
        let Some(second) = second.filter(|attempt| holds(&attempt.joint)) else {
            return first;
        };
        match first {
            Ok(first) if holds(&first.joint) => {
                let apart = change(&first.joint.mountings, &second.joint.mountings);
                let agree = is_within(&apart, &first.joint.covariance);
                Ok(if agree { first } else { second })
            }
            _ => Ok(second),
        }
    }

    /// Adjusts from these mountings; if the scans contradict the latencies of scanners, adjusts again and estimates these
    /// latencies.
    fn attempt(&self, start: &[Mounting], input: &mut JointInput<'_>) -> Result<Attempt> {
        input.mountings = start.to_vec();
        input.estimate_latency.clone_from(&self.stated_latency);
        let joint = (self.adjust)(input)?;
        let late = |score: &Option<Score>| score.is_some_and(|score| score.is_late());
        let late: Vec<bool> = joint.late_scores.iter().map(late).collect();
        let attempt = |joint| Attempt {
            joint,
            start: start.to_vec(),
        };
        let held = attempt(joint);
        if !late.contains(&true) {
            return Ok(held);
        }
        let estimated = held.estimated_latencies().into_iter().zip(late);
        input.estimate_latency = estimated
            .map(|(estimated, late)| estimated || late)
            .collect();
        // Some adjustments succeed only with latencies held.
        let freed = unless_cancelled((self.adjust)(input))?;
        Ok(freed.map_or(held, attempt))
    }

    /// Adjusts from where two steps began and, if that holds, from their result, which is one of several minima: only if
    /// both end at the same mountings is it known which they are. An adjustment from the first alone that is doubtful is
    /// returned as it is.
    ///
    /// # Errors
    /// Those of [`adjust`]; the two end apart ([`Problem::NotDetermined`]).
    fn agreed_attempt(&self, input: &mut JointInput<'_>) -> Result<Attempt> {
        self.progress.say(
            "two steps have several minima: adjusting from the initial values and from two steps",
        );
        let first = self.attempt(self.begin, input)?;
        if is_doubtful(&first.joint) {
            return Ok(first);
        }
        let other = unless_cancelled(self.attempt(&self.two_steps.mountings, input))?;
        let agrees = |other: &Attempt| {
            let apart = change(&first.joint.mountings, &other.joint.mountings);
            !is_doubtful(&other.joint) && is_within(&apart, &first.joint.covariance)
        };
        if other.as_ref().is_some_and(agrees) {
            return Ok(first);
        }
        Err(Error::of(
            Problem::NotDetermined,
            "the calibration in two steps has another minimum that fits as well, and from there the joint adjustment does \
             not end at the same mountings as from the initial values",
            "drive over planes in more directions, give a reference, or start nearer",
        ))
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

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;
    use crate::adjustment::StopReason;
    use crate::calibration::{Method, Observability};
    use crate::geometry::{BodyFromScanner, Vec3};
    use crate::joint::Rung;
    use crate::progress::Silent;
    use nalgebra::DMatrix;

    /// A scanner at this height above the body.
    fn at(z_m: f64) -> Vec<Mounting> {
        let pose = BodyFromScanner::identity().perturbed(&Vec3::zeros(), &(Vec3::z() * z_m));
        vec![Mounting::new("left", pose)]
    }

    fn two_steps(z_m: f64) -> Calibration {
        Calibration {
            method: Method::TwoStep,
            mountings: at(z_m),
            converged: true,
            scales: Vec::new(),
            covariance: None,
            origin_sigma_m: 0.0,
            observability: Observability {
                shares: vec![1.0; 6],
                unobservable: Vec::new(),
            },
            minimum: None,
            constancy: None,
            gap: None,
        }
    }

    /// An adjustment that ends where it starts, with standard deviations that are this share of those of initial values.
    fn joint(input: &JointInput<'_>, share: f64) -> Joint {
        let [shift_m, turn_rad] = INITIAL_SIGMA;
        let sigma = [shift_m, shift_m, shift_m, turn_rad, turn_rad, turn_rad];
        let variances = sigma.map(|sigma| (share * sigma).powi(2));
        Joint {
            mountings: input.mountings.clone(),
            covariance: DMatrix::from_diagonal(&variances.to_vec().into()),
            late_s: input
                .estimate_latency
                .iter()
                .map(|freed| freed.then_some((0.1, 1e-3)))
                .collect(),
            late_scores: vec![None],
            range_scores: vec![None],
            height_score: None,
            rung: Rung::Rigid,
            ladder: Vec::new(),
            prior_shares: Vec::new(),
            compliance: Vec::new(),
            drives: Vec::new(),
            constants: Vec::new(),
            reference: None,
            surface_m: 0.0,
            regions: Vec::new(),
            undetermined: Vec::new(),
            groups: Vec::new(),
            stop: StopReason::Converged,
            iterations: 1,
            rows: 1,
            surfels: 1,
            planes: Vec::new(),
            unknowns: 6,
        }
    }

    /// Adjusts from initial values (0 m) and from two steps (0.05 m), which determine the mounting weakly and contradict
    /// its latency; `initially_late` if the initial values do so too. Returns the joint, the input's start and latency
    /// afterwards, and those of each adjustment.
    fn search(initially_late: bool) -> (Joint, Start, Vec<Start>) {
        let (initial, two_steps) = (at(0.0), two_steps(0.05));
        let mut input = JointInput {
            mountings: two_steps.mountings.clone(),
            initial: &initial,
            held: &[],
            known: None,
            compliance: &[],
            estimate_latency: vec![false],
            drives: Vec::new(),
            reference: &[],
        };
        let tried = RefCell::new(Vec::new());
        let adjust = |input: &JointInput<'_>| {
            tried.borrow_mut().push(start(input));
            let from_two_steps = input.mountings[0].body_from_scanner.translation_m.z > 0.0;
            let mut joint = joint(input, if from_two_steps { 0.2 } else { 0.05 });
            let is_late = from_two_steps || initially_late;
            joint.late_scores[0] = (is_late && !input.estimate_latency[0]).then_some(Score {
                value: 0.1,
                sigma: 1e-3,
            });
            Ok(joint)
        };
        let starts = Starts {
            begin: &initial,
            two_steps: &two_steps,
            stated_latency: vec![false],
            adjust: &adjust,
            progress: &Silent,
        };
        let joint = starts.adjusted(&mut input).unwrap();
        (joint, start(&input), tried.into_inner())
    }

    /// Height of the mounting, metres, and whether its latency is estimated.
    type Start = (f64, bool);

    fn start(input: &JointInput<'_>) -> Start {
        let pose = &input.mountings[0].body_from_scanner;
        (pose.translation_m.z, input.estimate_latency[0])
    }

    #[test]
    fn a_latency_found_from_one_start_is_not_estimated_from_another() {
        let (joint, after, tried) = search(false);
        assert_eq!(tried, [(0.05, false), (0.05, true), (0.0, false)]);
        // They end 50 mm apart, where three standard deviations of the first are 30 mm: the second counts, without a latency.
        assert_eq!(joint.late_s, [None]);
        assert_eq!(after, (0.0, false));
    }

    #[test]
    fn a_latency_found_from_the_start_that_counts_stays_in_the_input() {
        let (joint, after, tried) = search(true);
        assert_eq!(tried.last(), Some(&(0.0, true)));
        assert!(joint.late_s[0].is_some());
        assert_eq!(after, (0.0, true));
    }

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
