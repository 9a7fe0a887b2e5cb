//! Test whether the minimum is the only one within reach: the mountings are moved away several times, by as much
//! as the coarsest scale can correct and rough initial values are wrong, and must come back.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::align::align;
use super::input::Input;
use super::observability::Observability;
use super::parameters::{Mounting, moved, poses};
use super::scale::{ScaleProblem, State};
use super::settings::{CalibrationSettings, Reach};
use crate::cloud::voxel::occupied;
use crate::error::{Error, Problem, Result};
use crate::progress::{Progress, Steps};
use crate::statistics::drawn_sign;

/// Most neighbourhoods; few are enough to locate minima.
const MAX_CENTRES: usize = 20_000;
/// Number of times that the mountings are moved away.
const STARTS: u64 = 4;
/// Usual number of steps from each start.
const STEPS: u64 = 4;
/// Two solutions of the coarsest scale are the same if no point lies farther apart in them than this share of a
/// voxel.
const SAME_SHARE: f64 = 0.5;
/// A minimum is as low as another if its mean ln(λ₃ + s²) is higher by less than this: a percent of the thickness.
const AS_LOW: f64 = 0.02;
/// Largest ratio of the numbers of voxels that the clouds occupy at the two minima: clouds that have separated
/// are sharp too, but occupy more.
const AS_SMALL: f64 = 1.02;

/// Standard deviations of each parameter within which mountings are not another minimum.
const SAME_SIGMAS: f64 = 3.0;

/// Whether a change (δp, δφ) of mountings is within what their covariance allows.
pub fn is_within(change: &DVector<f64>, covariance: &DMatrix<f64>) -> bool {
    let variances = covariance.diagonal();
    let mut pairs = change.iter().zip(variances.iter());
    pairs.all(|(change, variance)| change.abs() <= SAME_SIGMAS * variance.sqrt())
}

/// Result of moving the mountings away from the minimum.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Minimum {
    /// Shift of each mounting along each axis, metres.
    pub shift_m: f64,
    /// Turn of each mounting about each axis, radians.
    pub turn_rad: f64,
    /// Number of times that the mountings were moved away.
    pub starts: u64,
    /// Number of times that they came back.
    pub back: u64,
    /// Other mountings that fit as well at the coarsest scale and at the scales that follow from there, if there are any
    /// that the initial values allow.
    pub alternative: Option<Vec<Mounting>>,
}

impl Minimum {
    /// Usual number of steps of the test.
    pub(super) const STEPS: u64 = (1 + STARTS) * STEPS;

    /// Whether another minimum fits as well.
    pub fn is_doubtful(&self) -> bool {
        self.alternative.is_some()
    }

    /// Moves the `solution` away and lets the coarsest scale bring it back; also returns where else it ended at mountings
    /// that fit as well at this scale. `None` if the coarsest scale has too few points.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub(super) fn test(
        input: &Input<'_>,
        solution: &[Mounting],
        settings: &CalibrationSettings,
        progress: &dyn Progress,
    ) -> Result<Option<(Self, Vec<Vec<Mounting>>)>> {
        let Some(&voxel_m) = settings.voxel_sizes_m.first() else {
            return Ok(None);
        };
        let problem = ScaleProblem::new(input, solution, voxel_m, MAX_CENTRES, settings);
        let problem = match problem {
            Err(Error::Data {
                kind: Problem::TooFew,
                ..
            }) => return Ok(None),
            problem => problem?,
        };
        let Some(range_m) = problem.range_m() else {
            return Ok(None);
        };
        let progress = &Steps::new(progress, Self::STEPS, Self::STEPS);
        let aligned = |mountings: &[Mounting]| -> Result<Vec<Mounting>> {
            Ok(align(&problem, mountings, mountings, progress)?.mountings)
        };
        let nearest_minimum = problem.at(aligned(solution)?);
        // All axes are moved at once.
        let shift_m = voxel_m.min(Reach::ROUGH.shift_m / 3f64.sqrt());
        let turn_rad = (voxel_m / range_m).min(Reach::ROUGH.turn_rad / 3f64.sqrt());
        let determined = Observability::new(&nearest_minimum.equations, &nearest_minimum.mountings)
            .determined(&nearest_minimum.mountings);
        let mut minimum = Self {
            shift_m,
            turn_rad,
            starts: STARTS,
            back: 0,
            alternative: None,
        };
        let mut others = Vec::new();
        for start in 0..STARTS {
            let entries = 6 * solution.len();
            let away = DVector::from_fn(entries, |i, _| {
                let length = if i % 6 < 3 { shift_m } else { turn_rad };
                length * drawn_sign(start * entries as u64 + i as u64)
            });
            let away = &determined * (determined.transpose() * away);
            let end = aligned(&moved(&nearest_minimum.mountings, &away))?;
            if minimum.ends_elsewhere(&input.mountings, &nearest_minimum, &end, voxel_m) {
                let end = problem.at(end);
                if fits_as_well(&end, &nearest_minimum, voxel_m) {
                    others.push(end.mountings);
                }
            }
        }
        Ok(Some((minimum, others)))
    }

    /// Whether an adjustment on one scale that was started elsewhere ended at other mountings than its `solution`, which
    /// the initial values allow. If it came back, this is counted.
    pub(super) fn ends_elsewhere(
        &mut self,
        initial: &[Mounting],
        solution: &State,
        end: &[Mounting],
        voxel_m: f64,
    ) -> bool {
        let [from, to] = [&solution.mountings[..], end].map(poses);
        let apart_m = solution.surface.cloud.largest_displacement(&from, &to);
        let is_back = apart_m < SAME_SHARE * voxel_m;
        self.back += u64::from(is_back);
        !is_back && is_possible(initial, end)
    }
}

/// Whether the initial values can be as far off as they would be if these mountings were true.
fn is_possible(initial: &[Mounting], mountings: &[Mounting]) -> bool {
    let mut pairs = mountings.iter().zip(initial);
    pairs.all(|(end, initial)| {
        let (end, initial) = (&end.body_from_scanner, &initial.body_from_scanner);
        !Reach::WRONG.is_exceeded(&end.perturbation_from(initial))
    })
}

/// Whether a state fits as well as another, and takes up as little space.
pub(super) fn fits_as_well(state: &State, nearest: &State, voxel_m: f64) -> bool {
    let mean_cost = |state: &State| state.cost / state.surface.planes.len() as f64;
    let space = |state: &State| {
        let points = state.surface.placed.world.iter().copied();
        occupied(points, voxel_m).len() as f64
    };
    mean_cost(state) < mean_cost(nearest) + AS_LOW && space(state) < AS_SMALL * space(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::small_case::{case, problem};

    /// Whether an adjustment ends elsewhere, this many metres along x from the solution and at a cost that is higher by
    /// `cost` for each neighbourhood; and the number that came back, of three before.
    fn ended(shift_m: f64, cost: f64) -> (bool, u64) {
        let (cloud, mountings) = case();
        let problem = problem(cloud);
        let solution = problem.at(mountings.clone());
        let step = DVector::from_fn(12, |i, _| if i % 6 == 0 { shift_m } else { 0.0 });
        let planes = solution.surface.planes.len() as f64;
        let end = State {
            mountings: moved(&mountings, &step),
            cost: solution.cost + cost * planes,
            ..solution.clone()
        };
        let mut minimum = Minimum {
            shift_m: 0.5,
            turn_rad: 0.1,
            starts: 4,
            back: 3,
            alternative: None,
        };
        let voxel_m = problem.voxel_m;
        let is_elsewhere = minimum.ends_elsewhere(&mountings, &solution, &end.mountings, voxel_m)
            && fits_as_well(&end, &solution, voxel_m);
        (is_elsewhere, minimum.back)
    }

    #[test]
    fn what_standard_deviations_allow_is_not_another_minimum() {
        let covariance = DMatrix::from_diagonal(&DVector::from_vec(vec![4.0, 0.0]));
        let within = |change: [f64; 2]| is_within(&DVector::from_row_slice(&change), &covariance);
        assert!(within([-5.9, 0.0]) && !within([6.1, 0.0]) && !within([0.0, 0.1]));
    }

    #[test]
    fn another_minimum_is_apart_and_fits_as_well() {
        assert_eq!(ended(0.2, 0.0), (false, 4));
        assert_eq!(ended(0.3, 2.0 * AS_LOW), (false, 3));
        assert_eq!(ended(0.3, 0.5 * AS_LOW), (true, 3));
        // Farther than wrong initial values.
        assert_eq!(ended(3.0, 0.0), (false, 3));
    }
}
