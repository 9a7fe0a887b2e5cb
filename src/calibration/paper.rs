//! The adjustment as the paper describes it, to compare with: one point a voxel whatever scanner
//! and pass it comes from, the omnivariances themselves as residuals, their Jacobian by numeric
//! differences, Gauss-Newton with steps halved until the cost falls.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use super::adjust::{Ending, ScaleResult, ScaleSettings};
use super::neighbourhoods::{Neighbourhoods, Placed, ScaleCloud, farthest_move, find};
use super::parameters::{self, Mounting};
use crate::cloud::{StructureTensor, voxel};
use crate::error::Result;
use crate::progress::Progress;

/// Step of the numeric differences: metres and radians.
const STEP: f64 = 1e-4;

/// A scale has converged when a step moves no point by more than this, metres.
const CONVERGED_M: f64 = 1e-5;

/// New neighbourhoods in every iteration keep the parameters from coming to rest. A scale has also
/// ended when this many iterations have not lowered the cost by [`WORTHWHILE`].
const PATIENCE: usize = 20;

/// Relative change of the cost that counts as progress.
const WORTHWHILE: f64 = 1e-3;

/// The farthest that a step may move a point, in voxels.
const FARTHEST_VOXELS: f64 = 4.0;

/// A step is halved up to this many times until it lowers the cost: dσ vanishes where surfaces
/// meet, so that undamped steps overshoot by degrees.
const HALVINGS: i32 = 12;

/// Keeps one point a voxel of scanners and reference together, with the mountings as now known.
fn thin(cloud: &ScaleCloud, mountings: &[Mounting], voxel_m: f64) -> ScaleCloud {
    let placed = cloud.place(mountings);
    let kept = voxel::thin(&placed.world, voxel_m);
    let movable = cloud.movable.len();
    let split = kept.partition_point(|&index| (index as usize) < movable);
    ScaleCloud {
        movable: kept[..split]
            .iter()
            .map(|&index| cloud.movable[index as usize])
            .collect(),
        fixed: kept[split..]
            .iter()
            .map(|&index| placed.world[index as usize])
            .collect(),
        scanners: cloud.scanners,
        floor_m: cloud.floor_m,
    }
}

/// Minimises Σσ² by Gauss-Newton on the residuals σ; the voxel filter and the neighbourhoods are
/// made anew in every iteration. The cost is Σσ² over the neighbourhoods of the iteration.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled).
pub fn adjust_scale(
    all: &ScaleCloud,
    start: &[Mounting],
    basis_of: &dyn Fn(&[Mounting]) -> DMatrix<f64>,
    settings: ScaleSettings,
    progress: &dyn Progress,
) -> Result<ScaleResult> {
    let mut mountings = start.to_vec();
    let mut costs = Vec::new();
    let mut ending = Ending::IterationsExhausted;
    let mut iterations = 0;
    let (mut lowest, mut lowest_at) = (f64::INFINITY, 0);
    let found = |mountings: &[Mounting]| {
        let cloud = thin(all, mountings, settings.voxel_m);
        let placed = cloud.place(mountings);
        let neighbourhoods = find(&cloud, &placed, settings.k, settings.stride);
        let residuals = omnivariances(&placed, &neighbourhoods);
        (cloud, placed, neighbourhoods, residuals)
    };
    let (mut cloud, mut placed, mut neighbourhoods, mut residuals) = found(&mountings);
    costs.push(residuals.norm_squared());
    while iterations < settings.max_iterations {
        progress.check()?;
        iterations += 1;
        let basis = basis_of(&mountings);
        if basis.ncols() == 0 {
            ending = Ending::NotDetermined;
            break;
        }
        let jacobian = jacobian(&cloud, &neighbourhoods, &mountings, &basis);
        let gradient = jacobian.tr_mul(&residuals);
        let Some(factor) = Cholesky::new(jacobian.tr_mul(&jacobian)) else {
            ending = Ending::NotDetermined;
            break;
        };
        let step = -(basis * factor.solve(&gradient));
        let cost = residuals.norm_squared();
        let lowered = (0..HALVINGS).find_map(|halvings| {
            let candidate = parameters::moved(&mountings, &(&step * 0.5f64.powi(halvings)));
            let moved = cloud.place(&candidate);
            // Beyond a few voxels the neighbourhoods say nothing of what would be found there.
            let near = farthest_move(&placed, &moved) < FARTHEST_VOXELS * settings.voxel_m;
            let lower = near && omnivariances(&moved, &neighbourhoods).norm_squared() < cost;
            lower.then_some((candidate, moved))
        });
        let Some((candidate, moved)) = lowered else {
            ending = Ending::CostFloor;
            break;
        };
        let moved_m = farthest_move(&placed, &moved);
        mountings = candidate;
        (cloud, placed, neighbourhoods, residuals) = found(&mountings);
        let cost = residuals.norm_squared();
        costs.push(cost);
        let mean = cost / residuals.len() as f64;
        if moved_m < CONVERGED_M {
            ending = Ending::Converged;
            break;
        }
        if mean < lowest * (1.0 - WORTHWHILE) {
            (lowest, lowest_at) = (mean, iterations);
        } else if iterations - lowest_at > PATIENCE {
            ending = Ending::CostFloor;
            break;
        }
    }
    // What judges the result afterwards works on all points.
    let placed = all.place(&mountings);
    let neighbourhoods = find(all, &placed, settings.k, settings.stride);
    Ok(ScaleResult {
        mountings,
        ending,
        iterations,
        costs,
        placed,
        neighbourhoods,
    })
}

fn omnivariances(placed: &Placed, neighbourhoods: &Neighbourhoods) -> DVector<f64> {
    let values: Vec<f64> = (0..neighbourhoods.len())
        .into_par_iter()
        .map(|index| StructureTensor::of(&placed.world, neighbourhoods.of(index)).omnivariance())
        .collect();
    DVector::from_vec(values)
}

/// ∂σ/∂z for a step along each column of `basis`, by central differences over [`STEP`].
fn jacobian(
    cloud: &ScaleCloud,
    neighbourhoods: &Neighbourhoods,
    mountings: &[Mounting],
    basis: &DMatrix<f64>,
) -> DMatrix<f64> {
    let at = |column: usize, step: f64| {
        let delta = basis.column(column) * step;
        omnivariances(
            &cloud.place(&parameters::moved(mountings, &delta)),
            neighbourhoods,
        )
    };
    let columns: Vec<DVector<f64>> = (0..basis.ncols())
        .map(|column| (at(column, STEP) - at(column, -STEP)) / (2.0 * STEP))
        .collect();
    DMatrix::from_columns(&columns)
}
