//! Compares records with the median of their neighbours.

use crate::geometry::Vec3;
use crate::statistics::median;

/// A value must be near the median of this many neighbours on either side.
const MEDIAN_REACH: usize = 4;
/// How near: this many times the median distance, plus [`ALIKE_SIGMAS`].
const ALIKE_MEDIANS: f64 = 6.0;
/// And this many standard deviations.
pub const ALIKE_SIGMAS: f64 = 10.0;

/// Indices from `reach` before to `reach` after.
fn around(i: usize, reach: usize, count: usize) -> std::ops::Range<usize> {
    i.saturating_sub(reach)..(i + reach + 1).min(count)
}

/// The distance of each value from the median of its neighbours on either side.
pub fn distances_from_neighbours(values: &[Vec3], reach: usize) -> Vec<f64> {
    (0..values.len())
        .map(|i| {
            let near = &values[around(i, reach, values.len())];
            let centre = Vec3::from_fn(|axis, _| {
                median(near.iter().map(|value| value[axis])).unwrap_or(f64::NAN)
            });
            (values[i] - centre).norm()
        })
        .collect()
}

/// Which values lie near the median of their neighbours: as near as the values around them do, or
/// within ten standard deviations. That suffices for start values, whatever the size of the outliers.
pub fn agrees_with_neighbours(values: &[Vec3], sigma: f64) -> Vec<bool> {
    let distances = distances_from_neighbours(values, MEDIAN_REACH);
    (0..values.len())
        .map(|i| {
            let near = &distances[around(i, 4 * MEDIAN_REACH, distances.len())];
            let usual = median(near.iter().copied()).unwrap_or(f64::NAN);
            distances[i] <= ALIKE_MEDIANS * usual + ALIKE_SIGMAS * sigma
        })
        .collect()
}
