//! Normal equations of the distances on all spots, block by block of the drive, and the covariance of their solution.

use nalgebra::{DMatrix, DVector, SymmetricEigen, Vector6};

use super::cells::{LAG_S, Spot};
use crate::calibration::POSE_CORRELATION_S;
use crate::error::{Error, Problem, Result};
use crate::statistics::{SIGMAS_PER_MAD, median};

/// What may be wrong with a mounting at most, metres and radians: a prior, which a component that the ground does
/// not show keeps.
pub const PRIOR: [f64; 2] = [0.1, 0.1];
/// Directions in which more than this share of the information is what noise makes by tilting planes are not
/// determined: flat ground would show a shift to the side.
const MAX_NOISE_SHARE: f64 = 0.25;

/// Distances count in full up to this many standard deviations (Huber).
const HUBER: f64 = 2.0;
/// Blocks of the drive at most and at least: as many degrees of freedom has the covariance, and one more.
const BLOCKS: usize = 40;
const MIN_BLOCKS: usize = 8;
/// A block lasts so many times as long as one scanner comes after the other, so that errors of poses between the two
/// stay within it.
const BLOCK_LAGS: f64 = 4.0;
/// A block lasts at least this long, seconds: positions of the body drift against themselves while one scanner follows
/// the other, and errors of its speed last about as long as those of its positions.
const LEAST_BLOCK_S: f64 = POSE_CORRELATION_S;
/// Normal equations of the spots.
pub struct Normal {
    /// JᵀWJ and JᵀWe of each block.
    blocks: Vec<(DMatrix<f64>, DVector<f64>)>,
    /// Their sum.
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Directions that are determined, δᵀ (JᵀWJ + P) δ = 1 for each and 0 between two, and those that are not.
    known: DMatrix<f64>,
    open: DMatrix<f64>,
    prior: DVector<f64>,
}

impl Normal {
    /// Of the spots of a drive with so many scanners beside the first, in so many blocks.
    pub fn of(spots: &[Spot], others: usize, count: usize) -> Result<Self> {
        let size = 6 * others;
        let ratios = || spots.iter().map(|spot| spot.distance_m / spot.sigma_m);
        let middle = median(ratios()).unwrap_or(0.0);
        let scatter = median(ratios().map(|ratio| (ratio - middle).abs()));
        let scale = (SIGMAS_PER_MAD * scatter.unwrap_or(1.0)).max(1.0);
        let row = |spot: &Spot, by: &[[f64; 6]; 2]| {
            let mut row = DVector::zeros(size);
            for (scanner, by) in spot.scanners.iter().zip(by) {
                if *scanner > 0 {
                    let own = Vector6::from_column_slice(by);
                    row.fixed_rows_mut::<6>(6 * (scanner - 1)).copy_from(&own);
                }
            }
            row
        };
        let zeros = || (DMatrix::zeros(size, size), DVector::zeros(size));
        let (mut all, mut blocks) = (zeros(), Vec::new());
        let mut noise = DMatrix::zeros(size, size);
        for range in split(spots, count) {
            let (mut matrix, mut gradient) = zeros();
            for spot in range {
                let sigma_m = scale * spot.sigma_m;
                let ratio = (spot.distance_m / sigma_m).abs();
                let weight = (HUBER / ratio).min(1.0) / (sigma_m * sigma_m);
                let by = row(spot, &spot.by);
                matrix.ger(weight, &by, &by, 1.0);
                gradient.axpy(weight * spot.distance_m, &by, 1.0);
                for by in &spot.by_noise {
                    let by = row(spot, by);
                    noise.ger(weight, &by, &by, 1.0);
                }
            }
            all.0 += &matrix;
            all.1 += &gradient;
            blocks.push((matrix, gradient));
        }
        let (matrix, gradient) = all;
        let prior = DVector::from_fn(size, |i, _| PRIOR[i % 6 / 3].powi(-2));
        let factor = (&matrix + DMatrix::from_diagonal(&prior)).cholesky();
        let back = factor.and_then(|factor| factor.l().try_inverse());
        let back = back.ok_or_else(singular)?.transpose();
        let eigen = SymmetricEigen::new(back.tr_mul(&noise) * &back);
        let is_known = |&i: &usize| eigen.eigenvalues[i] < MAX_NOISE_SHARE;
        let (known, open): (Vec<usize>, Vec<usize>) = (0..size).partition(is_known);
        let directions = |of: &[usize]| &back * eigen.eigenvectors.select_columns(of);
        Ok(Self {
            known: directions(&known),
            open: directions(&open),
            blocks,
            matrix,
            gradient,
            prior,
        })
    }

    /// The offset from the mountings in use, from this one on; that of the mountings in use in directions that are
    /// not determined.
    pub fn solved(&self, now: &DVector<f64>) -> DVector<f64> {
        &self.known * self.known.tr_mul(&(&self.matrix * now - &self.gradient))
    }

    /// Square of a step in standard deviations of spots that are independent.
    pub fn information(&self, step: &DVector<f64>) -> f64 {
        (&self.matrix * step).dot(step)
    }

    /// From what the drive without each of its blocks says (the jackknife): whatever errors neighbouring spots have in
    /// common, of poses or of the ground, blocks do not. And the number of blocks.
    pub fn covariance(&self) -> Result<(DMatrix<f64>, usize)> {
        let count = self.blocks.len() as f64;
        let size = self.known.ncols();
        let without = |(of_block, own): &(DMatrix<f64>, DVector<f64>)| {
            let left = DMatrix::identity(size, size) - self.known.tr_mul(&(of_block * &self.known));
            let factor = left.cholesky().ok_or_else(singular)?;
            Ok(factor.solve(&self.known.tr_mul(own)))
        };
        let moved: Result<Vec<DVector<f64>>> = self.blocks.iter().map(without).collect();
        let moved = moved?;
        let mean = moved.iter().sum::<DVector<f64>>() / count;
        // What the prior holds, where the ground says little.
        let held = DMatrix::from_diagonal(&self.prior);
        let mut within = self.known.tr_mul(&(&held * &self.known));
        for moved in &moved {
            let off = moved - &mean;
            within.ger((count - 1.0) / count, &off, &off, 1.0);
        }
        let mut covariance = &self.known * within * self.known.transpose();
        for open in self.open.column_iter() {
            let variance = 1.0 / open.dot(&(&held * open));
            covariance += open * open.transpose() * variance;
        }
        Ok((covariance, self.blocks.len()))
    }
}

fn singular() -> Error {
    Error::of(
        Problem::NotDetermined,
        "the distances between the scanners do not determine how one sits on the other",
        "check that the poses and the points of the drive are those of one recording",
    )
}

/// How many blocks the drive has.
pub fn blocks(spots: &[Spot]) -> Result<usize> {
    let lag_s = median(spots.iter().map(|spot| spot.lag_s)).unwrap_or(0.0);
    let mut times_s: Vec<f64> = spots.iter().map(|spot| spot.time_s).collect();
    times_s.sort_by(f64::total_cmp);
    let gaps = times_s.windows(2).map(|pair| pair[1] - pair[0]);
    let seconds: f64 = gaps.filter(|gap_s| *gap_s < LAG_S).sum();
    let block_s = (BLOCK_LAGS * lag_s).max(LEAST_BLOCK_S);
    let count = seconds / block_s;
    if count < MIN_BLOCKS as f64 {
        return Err(Error::of(
            Problem::TooFew,
            format!(
                "both scanners saw the same ground for {seconds:.0} s only: {count:.1} stretches of {block_s:.1} s, which are \
                 independent, of {MIN_BLOCKS} that standard deviations need"
            ),
            "use a longer drive",
        ));
    }
    Ok((count as usize).min(BLOCKS))
}

/// Spots in blocks of equally many, in the order of time.
fn split(spots: &[Spot], count: usize) -> Vec<Vec<&Spot>> {
    let mut order: Vec<&Spot> = spots.iter().collect();
    order.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let each = order.len().div_ceil(count).max(1);
    order.chunks(each).map(<[_]>::to_vec).collect()
}
