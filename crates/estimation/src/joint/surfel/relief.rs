//! What planes of different sizes leave of the ground.

use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::level::Level;
use super::{DriveRows, LEAST_SIGMA_M, ScanRow, Surfel};
use crate::cloud::voxel::{VoxelKey, VoxelMap};
use crate::geometry::Vec3;
use crate::statistics::{SIGMAS_PER_MAD, median};

/// A scanner moves in six directions within a step, and a plane has three unknowns.
const MOTION: usize = 6;
const PLANE: f64 = 3.0;
/// Fewest rows that tell the motion of a step from the ground.
const MIN_ROWS: usize = 2 * MOTION;
/// Directions of the motion with less than this share of the information are held, so that the equations can be solved.
const LEAST_SHARE: f64 = 1e-9;
/// Rows that determine a motion nearly alone say nothing about the ground: fewest degrees of freedom of a row.
const LEAST_FREE: f64 = 0.1;
/// Smaller surfels have four times the unknowns. They are worth it if they hold twice the information.
const LEAST_GAIN: f64 = 2.0;

/// What rows of a region say about the motion.
#[derive(Debug, Clone, Default)]
struct Ground {
    /// Deviations of rows that neither their surfel nor the motion of their step explains, metres.
    left_m: Vec<f64>,
    /// Number of rows beyond those that determine the planes.
    rows: f64,
}

impl Ground {
    /// Information about a common displacement, 1/m².
    fn information(&self) -> f64 {
        let sigma_m =
            median(self.left_m.iter().map(|left| left.abs())).map_or(0.0, |m| SIGMAS_PER_MAD * m);
        if sigma_m > 0.0 {
            self.rows / (sigma_m * sigma_m)
        } else {
            0.0
        }
    }
}

/// For each surfel of the coarser level whether rows of the finer one hold more information about the motion there.
pub fn rougher(coarse: &Level, fine: &Level) -> Vec<bool> {
    let regions = coarse.grid.regions();
    let region = |surfel: &Surfel| regions.key(&surfel.centre_m);
    let [before, after] = [coarse, fine].map(|level| grounds(level, &region));
    let information = |grounds: &VoxelMap<VoxelKey, Ground>, key| {
        grounds.get(&key).map_or(0.0, Ground::information)
    };
    let is_rougher = |surfel: &Surfel| {
        let key = region(surfel);
        information(&after, key) > LEAST_GAIN * information(&before, key)
    };
    coarse.surfels.iter().map(is_rougher).collect()
}

/// The ground in each region.
fn grounds(
    level: &Level,
    region: &(impl Fn(&Surfel) -> VoxelKey + Sync),
) -> VoxelMap<VoxelKey, Ground> {
    let mut rows = vec![0.0_f64; level.surfels.len()];
    for row in level.drives.iter().flat_map(|drive| &drive.rows) {
        rows[row.surfel as usize] += 1.0;
    }
    // The share of a row's information that its surfel's own unknowns leave.
    let shares: Vec<f64> = level
        .surfels
        .iter()
        .zip(&rows)
        .map(|(surfel, rows)| match surfel.prior {
            Some(_) => 1.0,
            None => (1.0 - PLANE / rows).max(0.0),
        })
        .collect();
    let mut grounds: VoxelMap<VoxelKey, Ground> = VoxelMap::default();
    for drive in &level.drives {
        for (surfel, left_m) in deviations(drive, &level.surfels) {
            let share = shares[surfel as usize];
            if share > 0.0 {
                let ground = grounds
                    .entry(region(&level.surfels[surfel as usize]))
                    .or_default();
                ground.left_m.push(left_m / share.sqrt());
                ground.rows += share;
            }
        }
    }
    grounds
}

/// The deviation of each row that no motion of its scanner within the step explains, metres, with its surfel.
fn deviations(drive: &DriveRows, surfels: &[Surfel]) -> Vec<(u32, f64)> {
    let steps = (0..drive.step_start.len() - 1).into_par_iter();
    let of_step = |step: usize| {
        let scanners = drive.of_step(step).chunk_by(|a, b| a.scanner == b.scanner);
        scanners
            .flat_map(|rows| unexplained(rows, surfels))
            .collect::<Vec<_>>()
    };
    steps.map(of_step).collect::<Vec<_>>().concat()
}

/// As [`deviations`], for the rows of one scanner within a step: residuals of d = n·δp + (r × n)·δφ by least squares,
/// divided by √(1 − h) with their leverage h. Rough ground gets less weight than flat ground beside it.
fn unexplained(rows: &[ScanRow], surfels: &[Surfel]) -> Vec<(u32, f64)> {
    if rows.len() < MIN_ROWS {
        return Vec::new();
    }
    let surfel = |row: &ScanRow| &surfels[row.surfel as usize];
    let centre_m = rows.iter().map(|row| surfel(row).centre_m).sum::<Vec3>() / rows.len() as f64;
    let sigma_m = |row: &ScanRow| row.scatter_m.max(LEAST_SIGMA_M);
    // A row in its standard deviations.
    let design = |row: &ScanRow| {
        let normal = surfel(row).axes[0];
        let turn = (surfel(row).centre_m - centre_m).cross(&normal);
        let by = |i: usize| if i < 3 { normal[i] } else { turn[i - 3] };
        SVector::<f64, MOTION>::from_fn(|i, _| by(i) / sigma_m(row))
    };
    let mut matrix = SMatrix::<f64, MOTION, MOTION>::zeros();
    let mut side = SVector::<f64, MOTION>::zeros();
    for row in rows {
        let by = design(row);
        matrix += by * by.transpose();
        side += by * row.distance_m / sigma_m(row);
    }
    // Level ground does not show all six.
    let least = LEAST_SHARE * matrix.trace();
    let Some(factor) = (matrix + SMatrix::identity() * least).cholesky() else {
        return Vec::new();
    };
    let motion = factor.solve(&side);
    let left = |row: &ScanRow| {
        let by = design(row);
        let free = 1.0 - by.dot(&factor.solve(&by));
        let left_m = row.distance_m - sigma_m(row) * by.dot(&motion);
        (free > LEAST_FREE).then(|| (row.surfel, left_m / free.sqrt()))
    };
    rows.iter().filter_map(left).collect()
}
