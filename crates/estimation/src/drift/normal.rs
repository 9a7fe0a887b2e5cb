//! Normal equations of the distances on all spots, block by block of the drive, and the covariance of their solution.

use nalgebra::{DMatrix, DVector, SymmetricEigen, Vector6};

use super::cells::{LAG_S, Spot};
use crate::calibration::POSE_CORRELATION_S;
use crate::error::{Error, Problem, Result};
use crate::statistics::{SIGMAS_PER_MAD, median};

/// Standard deviations of the prior of a mounting, metres and radians. A component that the ground does not determine
/// keeps them.
pub const PRIOR: [f64; 2] = [0.1, 0.1];
/// Largest share of the information on a direction that may come from noise that tilts planes; directions with more
/// count as not determined. Otherwise flat ground would seem to determine a lateral shift.
const MAX_NOISE_SHARE: f64 = 0.25;

/// Tuning constant of Huber's loss: distances up to this many standard deviations count fully.
const HUBER: f64 = 2.0;
/// Largest number of blocks of a drive; the covariance has one degree of freedom less.
const BLOCKS: usize = 40;
/// Smallest number of blocks of a drive.
const MIN_BLOCKS: usize = 8;
/// Least length of a block, in times between the passes of the two scanners over a spot: pose errors between the two
/// then stay within a block.
const BLOCK_LAGS: f64 = 4.0;
/// Least length of a block, seconds: the position error of the body changes while one scanner follows the other, and
/// errors of its speed last about as long as those of its position.
const LEAST_BLOCK_S: f64 = POSE_CORRELATION_S;
/// Normal equations of the spots.
pub struct Normal {
    /// JᵀWJ and JᵀWe of each block.
    blocks: Vec<(DMatrix<f64>, DVector<f64>)>,
    /// Sum of JᵀWJ over the blocks.
    matrix: DMatrix<f64>,
    /// Sum of JᵀWe over the blocks.
    gradient: DVector<f64>,
    /// The determined directions as columns, with δᵀ (JᵀWJ + P) δ = 1 for each of them and 0 between two.
    determined: DMatrix<f64>,
    /// The directions that are not determined, normalised in the same way.
    undetermined: DMatrix<f64>,
    /// Diagonal of P, the information of the prior.
    prior: DVector<f64>,
}

impl Normal {
    /// The normal equations of the spots of a drive with `others` scanners besides the first, in `count` blocks.
    pub fn new(spots: &[Spot], others: usize, count: usize) -> Result<Self> {
        let size = 6 * others;
        let ratios = || spots.iter().map(|spot| spot.distance_m / spot.sigma_m);
        let middle = median(ratios()).unwrap_or(0.0);
        let scatter = median(ratios().map(|ratio| (ratio - middle).abs()));
        let scale = (SIGMAS_PER_MAD * scatter.unwrap_or(1.0)).max(1.0);
        let row = |spot: &Spot, by: &[[f64; 6]; 2]| {
            let mut row = DVector::zeros(size);
            for (scanner, by) in spot.scanners.iter().zip(by) {
                if *scanner > 0 {
                    let by = Vector6::from_column_slice(by);
                    row.fixed_rows_mut::<6>(6 * (scanner - 1)).copy_from(&by);
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
        let is_determined = |&i: &usize| eigen.eigenvalues[i] < MAX_NOISE_SHARE;
        let (determined, undetermined): (Vec<usize>, Vec<usize>) =
            (0..size).partition(is_determined);
        let directions = |columns: &[usize]| &back * eigen.eigenvectors.select_columns(columns);
        Ok(Self {
            determined: directions(&determined),
            undetermined: directions(&undetermined),
            blocks,
            matrix,
            gradient,
            prior,
        })
    }

    /// The solution as offset from the mountings in use, linearised at the offset `now`; zero in directions that are not
    /// determined.
    pub fn solved(&self, now: &DVector<f64>) -> DVector<f64> {
        &self.determined
            * self
                .determined
                .tr_mul(&(&self.matrix * now - &self.gradient))
    }

    /// Squared length of a step, in standard deviations for independent spots.
    pub fn information(&self, step: &DVector<f64>) -> f64 {
        (&self.matrix * step).dot(step)
    }

    /// The covariance of the solution, and the number of blocks. It is computed by the jackknife, from the solutions
    /// without each block in turn: neighbouring spots share errors of the poses and of the ground, blocks do not.
    pub fn covariance(&self) -> Result<(DMatrix<f64>, usize)> {
        let count = self.blocks.len() as f64;
        let size = self.determined.ncols();
        let without = |(matrix, gradient): &(DMatrix<f64>, DVector<f64>)| {
            let left = DMatrix::identity(size, size)
                - self.determined.tr_mul(&(matrix * &self.determined));
            let factor = left.cholesky().ok_or_else(singular)?;
            Ok(factor.solve(&self.determined.tr_mul(gradient)))
        };
        let moved: Result<Vec<DVector<f64>>> = self.blocks.iter().map(without).collect();
        let moved = moved?;
        let mean = moved.iter().sum::<DVector<f64>>() / count;
        // The prior's share, in directions of which the ground shows little.
        let prior = DMatrix::from_diagonal(&self.prior);
        let mut within = self.determined.tr_mul(&(&prior * &self.determined));
        for moved in &moved {
            let off = moved - &mean;
            within.ger((count - 1.0) / count, &off, &off, 1.0);
        }
        let mut covariance = &self.determined * within * self.determined.transpose();
        for direction in self.undetermined.column_iter() {
            let variance = 1.0 / direction.dot(&(&prior * direction));
            covariance += direction * direction.transpose() * variance;
        }
        Ok((covariance, self.blocks.len()))
    }
}

fn singular() -> Error {
    Error::of(
        Problem::NotDetermined,
        "the distances between the scanners do not determine their relative mounting",
        "check that the poses and the points of the drive are those of one recording",
    )
}

/// The number of blocks of the drive.
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
                "both scanners saw the same ground for only {seconds:.0} s: {count:.1} independent stretches of {block_s:.1} s, \
                but standard deviations need {MIN_BLOCKS}"
            ),
            "use a longer drive",
        ));
    }
    Ok((count as usize).min(BLOCKS))
}

/// The spots in order of time, in blocks of equal size.
fn split(spots: &[Spot], count: usize) -> Vec<Vec<&Spot>> {
    let mut order: Vec<&Spot> = spots.iter().collect();
    order.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let each = order.len().div_ceil(count).max(1);
    order.chunks(each).map(<[_]>::to_vec).collect()
}
