//! Keyframes: where many poses see the same surface, not every step of a scanner has rows.

use super::problem::JointProblem;
use super::surfel::Association;
use crate::error::{Error, Problem, Result};

/// Most entries of the factor of the normal equations, 8 bytes each: those of three drives with two
/// profile scanners.
const MAX_FACTOR_ENTRIES: usize = 350_000_000;
/// Most multiplications of a factorisation, and most for each row. Those three drives take 1.3e11, some ten seconds on two
/// cores, and 3.4e5 a row. Where it is more, most poses see the same surface, and rows between keyframes cost far more than
/// they tell.
const MAX_PRODUCTS: f64 = 1.5e11;
const MAX_PRODUCTS_PER_ROW: f64 = 5e5;
/// Most steps from one keyframe to the next.
const MAX_KEYFRAME_STEPS: usize = 64;

/// Keyframe intervals with half as many keyframes of one scanner, if the factor of the normal equations is too large or
/// takes too long. A profile scanner sees a surfel from a few steps at a time, a lidar from all of a drive, so that nearly
/// all nodes are coupled with each other. The adjustment can do without the rows between keyframes: a surfel that stays in
/// view is seen often enough.
///
/// # Errors
/// A factor that is too large with the fewest keyframes.
pub fn fewer(problem: &JointProblem<'_>, keyframe_steps: &[usize]) -> Result<Option<Vec<usize>>> {
    let is_too_large = problem.factor_entries() > MAX_FACTOR_ENTRIES;
    let rows = problem.association.rows().count();
    let most_products = MAX_PRODUCTS.min(MAX_PRODUCTS_PER_ROW * rows as f64);
    let is_too_slow = problem.factor_products() > most_products;
    if !is_too_large && !is_too_slow {
        return Ok(None);
    }
    match thinned(&problem.association, keyframe_steps) {
        None if is_too_large => Err(too_large(problem)),
        fewer => Ok(fewer),
    }
}

/// Keyframe intervals with half as many keyframes of the scanner that couples the most steps; `None` if all scanners have
/// few already.
pub fn thinned(association: &Association, keyframe_steps: &[usize]) -> Option<Vec<usize>> {
    let dense = (0..keyframe_steps.len()).filter(|s| 2 * keyframe_steps[*s] <= MAX_KEYFRAME_STEPS);
    let scanner = dense.max_by_key(|&scanner| couplings(association, scanner))?;
    let mut fewer = keyframe_steps.to_vec();
    fewer[scanner] *= 2;
    Some(fewer)
}

/// Number of pairs of rows of a scanner that see the same surfel.
fn couplings(association: &Association, scanner: usize) -> usize {
    let mut rows_of = vec![0; association.surfels.len()];
    let rows = association.rows();
    for row in rows.filter(|row| row.scanner as usize == scanner) {
        rows_of[row.surfel as usize] += 1;
    }
    rows_of.iter().map(|rows: &usize| rows * rows).sum()
}

fn too_large(problem: &JointProblem<'_>) -> Error {
    Error::of(
        Problem::TooMany,
        format!(
            "the normal equations of the joint adjustment need {:.0} GB: too many poses see the \
             same surface",
            8e-9 * problem.factor_entries() as f64
        ),
        "shorten the drive, limit the range of the scanner, or choose larger surfels with \
         joint.surfel_m",
    )
}
