//! The adjustment as the paper describes it, for comparison: one point per voxel of all scanners
//! and passes together, omnivariances as residuals, their Jacobian by numeric differences,
//! Gauss-Newton with steps halved until the cost falls.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use super::observability::Observability;
use super::parameters::{Mounting, moved, poses};
use super::scale::{Adjusted, Ending, ScaleProblem};
use crate::cloud::{StructureTensor, voxel};
use crate::error::Result;
use crate::progress::Progress;
use crate::surface::{Neighbourhoods, Placed, SurfaceCloud};

/// Step of the numeric differences: metres and radians.
const STEP: f64 = 1e-4;

/// A scale has converged when a step moves no point by more than this, metres.
const CONVERGED_M: f64 = 1e-5;

/// New neighbourhoods in every iteration keep the parameters from settling. A scale has also
/// converged when this many iterations have not lowered the cost by [`MIN_RELATIVE_GAIN`].
const PATIENCE: usize = 20;

/// Relative change of the cost that counts as progress.
const MIN_RELATIVE_GAIN: f64 = 1e-3;

/// Largest displacement of a point in one step, in voxels.
const MAX_DISPLACEMENT_VOXELS: f64 = 4.0;

/// Maximum number of times a step is halved to lower the cost: dσ vanishes where surfaces
/// intersect, so undamped steps overshoot by degrees.
const HALVINGS: i32 = 12;

/// One point per voxel of scanners and reference together, and the residuals of the neighbourhoods.
struct Thinned {
    cloud: SurfaceCloud,
    neighbourhoods: Neighbourhoods,
    residuals: DVector<f64>,
}

impl Thinned {
    fn new(problem: &ScaleProblem, mountings: &[Mounting]) -> Self {
        let all = &problem.cloud;
        let indices = voxel::thin(&all.place(&poses(mountings)).world, problem.voxel_m);
        let cloud = all.subset(&indices);
        let placed = cloud.place(&poses(mountings));
        let centres = (0..cloud.movable.len() as u32).step_by(problem.stride);
        let neighbourhoods = Neighbourhoods::search(&placed.world, centres.collect(), problem.k);
        Self {
            residuals: omnivariances(&placed, &neighbourhoods),
            cloud,
            neighbourhoods,
        }
    }

    /// The mean σ².
    fn mean_cost(&self) -> f64 {
        self.residuals.norm_squared() / self.residuals.len() as f64
    }

    /// The residuals of the same neighbourhoods for other mountings.
    fn residuals_at(&self, mountings: &[Mounting]) -> DVector<f64> {
        omnivariances(&self.cloud.place(&poses(mountings)), &self.neighbourhoods)
    }

    /// ∂σ/∂z for a step along each column of `basis`, by central differences over [`STEP`].
    fn jacobian(&self, mountings: &[Mounting], basis: &DMatrix<f64>) -> DMatrix<f64> {
        let at = |direction: DVector<f64>| self.residuals_at(&moved(mountings, &direction));
        let columns: Vec<DVector<f64>> = basis
            .column_iter()
            .map(|column| (at(column * STEP) - at(column * -STEP)) / (2.0 * STEP))
            .collect();
        DMatrix::from_columns(&columns)
    }
}

fn omnivariances(placed: &Placed, neighbourhoods: &Neighbourhoods) -> DVector<f64> {
    let values: Vec<f64> = (0..neighbourhoods.centres().len())
        .into_par_iter()
        .map(|index| {
            StructureTensor::of(&placed.world, neighbourhoods.members(index)).omnivariance()
        })
        .collect();
    DVector::from_vec(values)
}

/// Minimises Σσ² by Gauss-Newton on the residuals σ; the voxel filter and the neighbourhoods are
/// recomputed in every iteration. The cost is the mean σ² over the neighbourhoods of the
/// iteration.
///
/// # Errors
/// [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn minimise(
    problem: &ScaleProblem,
    start: Vec<Mounting>,
    observability: &Observability,
    progress: &dyn Progress,
) -> Result<Adjusted> {
    let mut mountings = start;
    let mut thinned = Thinned::new(problem, &mountings);
    let mut costs = vec![thinned.mean_cost()];
    let mut ending = Ending::IterationsExhausted;
    let mut iterations = 0;
    let (mut lowest, mut lowest_at) = (f64::INFINITY, 0);
    while iterations < problem.max_iterations {
        progress.check()?;
        progress.advance(1);
        iterations += 1;
        let basis = observability.determined(&mountings);
        if basis.ncols() == 0 {
            ending = Ending::NotDetermined;
            break;
        }
        let jacobian = thinned.jacobian(&mountings, &basis);
        let gradient = jacobian.tr_mul(&thinned.residuals);
        let Some(factor) = Cholesky::new(jacobian.tr_mul(&jacobian)) else {
            ending = Ending::NotDetermined;
            break;
        };
        let step = -(basis * factor.solve(&gradient));
        let cost = thinned.residuals.norm_squared();
        let here = poses(&mountings);
        let lowered = (0..HALVINGS).find_map(|halvings| {
            let candidate = moved(&mountings, &(&step * 0.5f64.powi(halvings)));
            let moved_m = thinned
                .cloud
                .largest_displacement(&here, &poses(&candidate));
            // Beyond a few voxels the neighbourhoods are no longer those of a new search.
            let is_near = moved_m < MAX_DISPLACEMENT_VOXELS * problem.voxel_m;
            let is_lower = is_near && thinned.residuals_at(&candidate).norm_squared() < cost;
            is_lower.then_some((candidate, moved_m))
        });
        let Some((candidate, moved_m)) = lowered else {
            ending = Ending::CostFloor;
            break;
        };
        mountings = candidate;
        thinned = Thinned::new(problem, &mountings);
        let mean = thinned.mean_cost();
        costs.push(mean);
        if moved_m < CONVERGED_M {
            ending = Ending::Converged;
            break;
        }
        if mean < lowest * (1.0 - MIN_RELATIVE_GAIN) {
            (lowest, lowest_at) = (mean, iterations);
        } else if iterations - lowest_at > PATIENCE {
            ending = Ending::CostFloor;
            break;
        }
    }
    Ok(Adjusted {
        // The uncertainty is estimated from all points.
        state: problem.at(mountings),
        ending,
        iterations,
        costs,
    })
}
