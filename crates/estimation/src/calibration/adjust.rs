//! Levenberg-Marquardt on one scale: steps are accepted or rejected by the true cost.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::cost::{NormalEquations, cost};
use super::observability::Observability;
use super::parameters::{poses, stepped};
use super::scale::{Adjusted, Ending, ScaleProblem, State};
use crate::adjustment::{Damping, DampingRule, Verdict};
use crate::error::Result;
use crate::progress::Progress;

/// Neighbours are searched again when a point has moved by more than this share of the voxel.
const SEARCH_AGAIN_SHARE: f64 = 0.1;

/// A scale has converged when a step moves no point by more than this share of the floor s of the
/// thickness.
const CONVERGED_SHARE: f64 = 0.01;

/// A scale has also converged when a step lowers the mean ln(λ₃ + s²) by less than this. For s of a
/// millimetre, 10⁻⁵ of the variance changes the most weakly determined parameters by hundredths of
/// a millimetre.
const CONVERGED_COST: f64 = 1e-5;

/// A scale has also converged when new neighbourhoods lower the mean by less than this: they
/// alternate.
const MIN_GAIN_OF_SEARCH: f64 = 1e-4;

/// Damping relative to the diagonal of the normal matrix. Steps with more than the largest would move
/// points by less than rounding errors.
const DAMPING: DampingRule = DampingRule {
    initial: 1e-6,
    factor: 10.0,
    least_raised: 1e-4,
    least_lowered: 1e-12,
    floor: 1e-12,
    largest: 1e10,
    rounding: 0.0,
};

/// Minimises the [`cost`](super::cost) from `start` along the directions that `observability` marks
/// as determined.
///
/// # Errors
/// [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn minimise(
    problem: &ScaleProblem,
    start: State,
    observability: &Observability,
    progress: &dyn Progress,
) -> Result<Adjusted> {
    let mut now = start;
    let mut searched_at = poses(&now.mountings);
    let mut best = (now.cost, now.mountings.clone());
    let mut costs = vec![now.cost];
    let mut damping = Damping::new(DAMPING);
    let mut ending = Ending::IterationsExhausted;
    let mut iterations = 0;
    let count = now.surface.planes.len() as f64;
    let centres_m = problem.cloud.centres_m();
    while iterations < problem.max_iterations {
        progress.check()?;
        progress.advance(1);
        iterations += 1;
        let basis = observability.determined(&now.mountings);
        let Some(step) = damped_step(&now.equations, &basis, damping.value()) else {
            ending = Ending::NotDetermined;
            break;
        };
        let mountings = stepped(&now.mountings, &step, &centres_m);
        let there = poses(&mountings);
        let moved_m = problem
            .cloud
            .largest_displacement(&poses(&now.mountings), &there);
        let is_small = moved_m < CONVERGED_SHARE * problem.floor_m;
        let surface = now.surface.moved(&there);
        let cost = cost(&surface.planes, problem.floor_m);
        let lowered = now.cost - cost;
        let verdict = damping.judge(now.cost, cost);
        if verdict != Verdict::Accepted {
            costs.push(now.cost);
            if is_small || verdict == Verdict::GivenUp {
                ending = Ending::CostFloor;
                break;
            }
            continue;
        }
        let searched_m = problem.cloud.largest_displacement(&searched_at, &there);
        if searched_m > SEARCH_AGAIN_SHARE * problem.voxel_m {
            now = problem.state(mountings, surface.search_again());
            searched_at = there;
            costs.push(now.cost.min(best.0));
            if now.cost > best.0 - MIN_GAIN_OF_SEARCH * count {
                ending = Ending::Alternating;
                if now.cost > best.0 {
                    now = problem.at(best.1);
                }
                break;
            }
            best = (now.cost, now.mountings.clone());
            continue;
        }
        now = problem.state(mountings, surface);
        costs.push(now.cost);
        if is_small || lowered < CONVERGED_COST * count {
            ending = Ending::Converged;
            break;
        }
    }
    Ok(Adjusted {
        state: now,
        ending,
        iterations,
        costs: costs.iter().map(|sum| sum / count).collect(),
    })
}

/// −B (BᵀHB + μ diag)⁻¹ Bᵀg, a step in all parameters; `None` if no parameter is free, the gradient
/// is not finite, or the matrix cannot be factorised at any damping.
fn damped_step(
    equations: &NormalEquations,
    basis: &DMatrix<f64>,
    mut damping: f64,
) -> Option<DVector<f64>> {
    let matrix = basis.transpose() * &equations.matrix * basis;
    let gradient = basis.transpose() * &equations.gradient;
    if gradient.is_empty() || gradient.iter().any(|entry| !entry.is_finite()) {
        return None;
    }
    loop {
        let mut damped = matrix.clone();
        for i in 0..damped.nrows() {
            damped[(i, i)] *= 1.0 + damping;
        }
        if let Some(factor) = Cholesky::new(damped) {
            return Some(-(basis * factor.solve(&gradient)));
        }
        damping = (damping * 100.0).max(1e-9);
        if damping > DAMPING.largest {
            return None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::small_case::{case, problem};
    use crate::geometry::Vec3;
    use crate::progress::Silent;

    fn minimised(spoil: bool) -> (State, Adjusted) {
        let (mut cloud, mountings) = case();
        if spoil {
            cloud.movable[7].position_m = Vec3::repeat(1e300);
        }
        let problem = problem(cloud);
        let start = problem.at(mountings);
        let all_free = Observability::new(&start.equations, &start.mountings);
        assert!(all_free.unobservable.is_empty());
        let adjusted = minimise(&problem, start.clone(), &all_free, &Silent).unwrap();
        (start, adjusted)
    }

    #[test]
    fn costs_never_rise() {
        let (start, end) = minimised(false);
        assert!(end.ending.is_converged(), "{}", end.ending);
        assert!(end.costs.is_sorted_by(|a, b| a >= b), "{:?}", end.costs);
        assert!(end.state.cost < start.cost - 1.0);
    }

    #[test]
    fn a_cost_of_nan_does_not_converge() {
        let (start, end) = minimised(true);
        assert!(start.cost.is_nan());
        assert_eq!(end.ending, Ending::NotDetermined);
        assert_eq!(end.state.mountings, start.mountings);
    }
}
