//! Test whether the residuals of the scans look like a moving mounting.

use std::collections::BTreeMap;

use nalgebra::{SMatrix, SVector};

use super::bend::KNOT_SIGMA;
use super::problem::JointProblem;
use super::state::State;
use crate::statistics::median;

type Six = SVector<f64, 6>;
type SixBySix = SMatrix<f64, 6, 6>;

/// Length of a block, seconds: a few seconds of a passage over a board.
const BLOCK_S: f64 = 5.0;
/// Fewest blocks for the test.
const MIN_BLOCKS: usize = 10;
/// Residuals are limited to this many standard deviations.
const MOST_SIGMAS: f64 = 2.5;

/// Information and score of a mounting's motion from the rows of a scanner during a block of time.
#[derive(Clone, Default)]
struct Block {
    information: SixBySix,
    score: Six,
}

/// The part of the squared residuals of each drive that a motion of the mountings would explain, relative to the
/// part that it explains by chance. It is well below 1 if mountings move no more than the model allows, because poses
/// and surfels adapt to the scans.
///
/// In a block of time, with the rows r = J δ of a scanner and the prior P of a motion δ, the ratio is
/// uᵀ (JᵀJ + P⁻¹)⁻¹ u over tr((JᵀJ + P⁻¹)⁻¹ JᵀJ), u = Jᵀ r: the score test of Rao (1948). The result is the median
/// over all blocks, because a displaced board is in only a few of them; 0 if there are too few blocks.
pub fn motion_left(problem: &JointProblem<'_>, state: &State) -> Vec<f64> {
    let rows = problem.each_mean(state, |drive, row, mean| {
        let sigma_m = problem.noise(state, drive, row).1;
        let residual = (mean.residual_m / sigma_m).clamp(-MOST_SIGMAS, MOST_SIGMAS);
        let by = Six::from_row_slice(&mean.by_mounting) / sigma_m;
        let block = (mean.time_s / BLOCK_S).floor() as i64;
        (drive, row.scanner, block, row.trust, by, residual)
    });
    let [turn, shift] = KNOT_SIGMA.map(|sigma| 1.0 / (sigma * sigma));
    let prior = SixBySix::from_diagonal(&Six::new(turn, turn, turn, shift, shift, shift));
    let mut blocks = BTreeMap::<(usize, u32, i64), Block>::new();
    for (drive, scanner, block, trust, by, residual) in rows {
        let block = blocks.entry((drive, scanner, block)).or_default();
        block.information += by * by.transpose() * trust;
        block.score += by * (trust * residual);
    }
    let mut ratios = vec![Vec::new(); state.motions.len()];
    for ((drive, ..), block) in blocks {
        if let Some(factor) = (block.information + prior).cholesky() {
            let explained = block.score.dot(&factor.solve(&block.score));
            ratios[drive].push(explained / factor.solve(&block.information).trace());
        }
    }
    let of_drive = |ratios: Vec<f64>| {
        if ratios.len() < MIN_BLOCKS {
            0.0
        } else {
            median(ratios).unwrap_or(0.0)
        }
    };
    ratios.into_iter().map(of_drive).collect()
}
