//! Levenberg-Marquardt on one scale: every step is accepted or refused on the true cost.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::cost::{NormalEquations, cost, normal_equations};
use super::neighbourhoods::{Neighbourhoods, Placed, ScaleCloud, farthest_move, find};
use super::parameters::{self, Mounting};
use crate::error::Result;
use crate::progress::Progress;

/// Neighbours are sought again when a point has moved by more than this share of the voxel.
const SEARCH_AGAIN_SHARE: f64 = 0.1;

/// A scale has converged when a step moves no point by more than this share of the thickness s
/// below which flatness says nothing.
const CONVERGED_SHARE: f64 = 0.01;

/// A scale has also converged when a step lowers the mean ln(λ₃ + s²) by less than this: one part in
/// 10⁵ of the variance, which s of a millimetre turns into hundredths of a millimetre in the
/// parameters that are determined least.
const CONVERGED_COST: f64 = 1e-5;

/// And when neighbourhoods found anew have not lowered it by more than this: they alternate.
const WORTH_SEARCHING: f64 = 1e-4;

/// Damping at the start, relative to the diagonal of the normal matrix.
const INITIAL_DAMPING: f64 = 1e-6;

/// Damping above which no step is worth trying: it would move points by less than rounding.
const LARGEST_DAMPING: f64 = 1e10;

/// How a scale ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The last step was below the threshold.
    Converged,
    /// No damping lowers the cost further: the cost is at its floor.
    CostFloor,
    /// New neighbourhoods no longer lower the cost; the best mountings so far are kept.
    Alternating,
    /// The data determine no direction in which to step.
    NotDetermined,
    /// The allowed number of iterations ran out.
    IterationsExhausted,
}

/// The adjustment of one scale.
#[derive(Debug, Clone)]
pub struct ScaleResult {
    /// Mountings found.
    pub mountings: Vec<Mounting>,
    /// How it ended.
    pub ending: Ending,
    /// Accepted and refused steps.
    pub iterations: usize,
    /// The method's own cost before the first step and after every iteration.
    pub costs: Vec<f64>,
    /// Points placed with the mountings found.
    pub placed: Placed,
    /// Neighbourhoods of the last search.
    pub neighbourhoods: Neighbourhoods,
}

/// Settings of one scale.
#[derive(Debug, Clone, Copy)]
pub struct ScaleSettings {
    /// Metres.
    pub voxel_m: f64,
    /// Neighbours.
    pub k: usize,
    /// Every how many-th scanner point is a centre.
    pub stride: usize,
    /// Most iterations.
    pub max_iterations: usize,
}

/// Minimises the [`cost`](super::cost) over the directions that `basis_of` gives at the current
/// mountings (6 s × f).
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled).
pub fn adjust_scale(
    cloud: &ScaleCloud,
    start: &[Mounting],
    basis_of: &dyn Fn(&[Mounting]) -> DMatrix<f64>,
    settings: ScaleSettings,
    progress: &dyn Progress,
) -> Result<ScaleResult> {
    let mut mountings = start.to_vec();
    let mut placed = cloud.place(&mountings);
    let mut neighbourhoods = find(cloud, &placed, settings.k, settings.stride);
    let mut searched = placed.clone();
    let mut equations = normal_equations(cloud, &placed, &neighbourhoods);
    let mut costs = vec![equations.cost];
    let mut best = (equations.cost, mountings.clone());
    let mut damping = INITIAL_DAMPING;
    let mut ending = Ending::IterationsExhausted;
    let mut iterations = 0;
    let count = neighbourhoods.len() as f64;
    while iterations < settings.max_iterations {
        progress.check()?;
        iterations += 1;
        let basis = basis_of(&mountings);
        let Some(step) = damped_step(&equations, &basis, damping) else {
            ending = Ending::NotDetermined;
            break;
        };
        let candidate = parameters::moved(&mountings, &step);
        let candidate_placed = cloud.place(&candidate);
        let moved_m = farthest_move(&placed, &candidate_placed);
        let candidate_cost = cost(cloud, &candidate_placed, &neighbourhoods);
        let lowered = equations.cost - candidate_cost;
        let small = moved_m < CONVERGED_SHARE * cloud.floor_m || lowered < CONVERGED_COST * count;
        if lowered < 0.0 {
            costs.push(equations.cost);
            if moved_m < CONVERGED_SHARE * cloud.floor_m || damping > LARGEST_DAMPING {
                ending = Ending::CostFloor;
                break;
            }
            damping = (damping * 10.0).max(1e-4);
            continue;
        }
        mountings = candidate;
        placed = candidate_placed;
        damping = (damping * 0.1).max(1e-12);
        if farthest_move(&searched, &placed) > SEARCH_AGAIN_SHARE * settings.voxel_m {
            neighbourhoods = find(cloud, &placed, settings.k, settings.stride);
            searched = placed.clone();
            equations = normal_equations(cloud, &placed, &neighbourhoods);
            costs.push(equations.cost.min(best.0));
            if equations.cost > best.0 - WORTH_SEARCHING * count {
                ending = Ending::Alternating;
                if equations.cost > best.0 {
                    mountings = best.1;
                    placed = cloud.place(&mountings);
                    neighbourhoods = find(cloud, &placed, settings.k, settings.stride);
                }
                break;
            }
            best = (equations.cost, mountings.clone());
            continue;
        }
        if small {
            costs.push(candidate_cost);
            ending = Ending::Converged;
            break;
        }
        equations = normal_equations(cloud, &placed, &neighbourhoods);
        costs.push(equations.cost);
    }
    Ok(ScaleResult {
        mountings,
        ending,
        iterations,
        costs,
        placed,
        neighbourhoods,
    })
}

/// −(BᵀHB + μ diag)⁻¹ Bᵀg, back in all parameters; `None` where nothing is free or the matrix
/// cannot be factorised at any sensible damping.
fn damped_step(
    equations: &NormalEquations,
    basis: &DMatrix<f64>,
    damping: f64,
) -> Option<DVector<f64>> {
    if basis.ncols() == 0 {
        return None;
    }
    let matrix = basis.transpose() * &equations.matrix * basis;
    let gradient = basis.transpose() * &equations.gradient;
    let mut damping = damping;
    loop {
        let mut damped = matrix.clone();
        for i in 0..damped.nrows() {
            damped[(i, i)] *= 1.0 + damping;
        }
        if let Some(factor) = Cholesky::new(damped) {
            return Some(-(basis * factor.solve(&gradient)));
        }
        damping = (damping * 100.0).max(1e-9);
        if damping > LARGEST_DAMPING {
            return None;
        }
    }
}

impl Ending {
    /// Whether more iterations would not have changed the result.
    pub fn is_converged(self) -> bool {
        matches!(self, Self::Converged | Self::CostFloor | Self::Alternating)
    }
}

impl std::fmt::Display for Ending {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::CostFloor => "at the floor of the cost",
            Self::Alternating => "converged as far as its neighbourhoods tell",
            Self::NotDetermined => "not determined by the data",
            Self::IterationsExhausted => "stopped at the allowed number of iterations",
        })
    }
}
