//! Distances between passes over the same ground: what can be compared where there is one scanner and no reference.
//!
//! Points are sorted into cells once, with one placement. In each cell, those of an earlier and of a later pass are set
//! against each other under every placement, along the normal of both: all placements are measured at the same
//! places, with the same points.

use serde::{Deserialize, Serialize};

use crate::cloud::StructureTensor;
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::Vec3;
use crate::statistics::{mean, median, rms};

/// Passes lie farther apart than this, seconds: within it, poses err alike.
const APART_S: f64 = 5.0;
/// Fewest points of a pass in a cell.
const MIN_POINTS: usize = 5;
/// Least extent of a pass across its longest direction, as a share of the cell: that of a single profile has no normal.
const LEAST_WIDTH: f64 = 0.1;
/// Edge of a region, in cells. Cells of a region see the same errors of the poses and count as one observation.
const REGION_CELLS: f64 = 8.0;
/// Fewest regions for a test.
const MIN_REGIONS: usize = 5;
/// One placement is worse than another if its squared distances exceed the other's by more than this many standard
/// errors over the regions.
const WORSE_SIGMAS: f64 = 3.0;

/// A laser point with a placement: its scanner and time, and where it lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedPoint {
    /// Index of the scanner.
    pub scanner: usize,
    /// Seconds.
    pub time_s: f64,
    /// World, metres; `None` without a pose.
    pub position_m: Option<Vec3>,
}

/// Cells that two passes of a scanner saw.
#[derive(Debug, Clone)]
pub struct PassCells {
    edge_m: f64,
    cells: Vec<Cell>,
}

#[derive(Debug, Clone)]
struct Cell {
    region: VoxelKey,
    /// Points of the earlier and of the later pass.
    passes: [Vec<u32>; 2],
}

/// How far passes lie apart under one placement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassDistances {
    /// Median of the absolute distances, metres.
    pub median_m: f64,
    /// Root mean square of the distances, metres.
    pub rms_m: f64,
    /// Number of cells with a distance.
    pub cells: usize,
    /// Mean squared distance of each region, in the order of the regions' keys, square metres.
    regions: Vec<(VoxelKey, f64)>,
}

impl PassCells {
    /// Sorts points into cubes of this edge (metres) and separates the passes in each at the longest time between two
    /// points.
    pub fn new(points: &[TimedPoint], cell_m: f64) -> Self {
        let mut members: VoxelMap<(VoxelKey, usize), Vec<u32>> = VoxelMap::default();
        for (index, point) in (0..).zip(points) {
            if let Some(position_m) = &point.position_m {
                let key = (voxel_key(position_m, cell_m), point.scanner);
                members.entry(key).or_default().push(index);
            }
        }
        let mut members: Vec<_> = members.into_iter().collect();
        members.sort_unstable_by_key(|(key, _)| *key);
        let cells = members.into_iter().filter_map(|((key, _), mut inside)| {
            let time_s = |index: &u32| points[*index as usize].time_s;
            inside.sort_by(|a, b| time_s(a).total_cmp(&time_s(b)));
            let gap_s = |pair: &[u32]| time_s(&pair[1]) - time_s(&pair[0]);
            let gaps = inside.windows(2).map(gap_s).enumerate();
            let (longest, gap_s) = gaps.max_by(|a, b| a.1.total_cmp(&b.1))?;
            let later = inside.split_off(longest + 1);
            let is_seen_twice = gap_s > APART_S && inside.len().min(later.len()) >= MIN_POINTS;
            is_seen_twice.then(|| Cell {
                region: key.map(|k| k.div_euclid(REGION_CELLS as i64)),
                passes: [inside, later],
            })
        });
        Self {
            edge_m: cell_m,
            cells: cells.collect(),
        }
    }

    /// The distances under a placement of the same points; `None` if no cell has one.
    pub fn distances(&self, points: &[TimedPoint]) -> Option<PassDistances> {
        let in_cells = self.cells.iter().filter_map(|cell| {
            let distance_m = cell.distance_m(points, self.edge_m)?;
            Some((cell.region, distance_m))
        });
        let mut in_cells: Vec<(VoxelKey, f64)> = in_cells.collect();
        let median_m = median(in_cells.iter().map(|(_, d)| d.abs()))?;
        in_cells.sort_by_key(|(region, _)| *region);
        let regions = in_cells.chunk_by(|a, b| a.0 == b.0).map(|cells| {
            let squares: Vec<f64> = cells.iter().map(|(_, d)| d * d).collect();
            (cells[0].0, mean(&squares))
        });
        Some(PassDistances {
            median_m,
            rms_m: rms(in_cells.iter().map(|(_, d)| *d)),
            cells: in_cells.len(),
            regions: regions.collect(),
        })
    }
}

impl Cell {
    /// Height of the later pass above the earlier one along their common normal, metres; `None` where they have none.
    fn distance_m(&self, points: &[TimedPoint], cell_m: f64) -> Option<f64> {
        let tensors = self.passes.each_ref().map(|pass| {
            let positions = pass.iter().filter_map(|i| points[*i as usize].position_m);
            let positions: Vec<Vec3> = positions.collect();
            StructureTensor::from_points(positions.iter())
        });
        let [earlier, later] = &tensors;
        let count = (earlier.count + later.count) as f64;
        // The distance between the passes does not tilt the normal.
        let within = [earlier, later].map(|pass| pass.covariance * (pass.count as f64 / count));
        let eigen = StructureTensor {
            mean: earlier.mean,
            covariance: within.into_iter().sum(),
            count: earlier.count + later.count,
        }
        .eigen();
        let is_wide = eigen.values.y.sqrt() > LEAST_WIDTH * cell_m;
        let normal: Vec3 = eigen.vectors.column(2).into();
        let upward = normal * normal.z.signum();
        is_wide.then(|| upward.dot(&(later.mean - earlier.mean)))
    }
}

impl PassDistances {
    /// Whether passes lie farther apart than under another placement, beyond chance; `None` with too few regions to tell.
    pub fn is_worse_than(&self, other: &Self) -> Option<bool> {
        let mut differences_m2 = Vec::new();
        for (region, square) in &self.regions {
            if let Ok(place) = other.regions.binary_search_by_key(region, |(key, _)| *key) {
                differences_m2.push(square - other.regions[place].1);
            }
        }
        let count = differences_m2.len();
        let mean_m2 = mean(&differences_m2);
        let squares = differences_m2.iter().map(|d| (d - mean_m2).powi(2));
        let variance = squares.sum::<f64>() / (count as f64 - 1.0);
        let standard_error = (variance / count as f64).sqrt();
        (count >= MIN_REGIONS).then_some(mean_m2 > WORSE_SIGMAS * standard_error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELL_M: f64 = 0.2;

    /// Two passes over a slope, the second higher by `offset_m` along its normal times a wave of the given amplitude.
    fn passes(offset_m: f64, wave: f64) -> Vec<TimedPoint> {
        let normal = Vec3::new(-0.2, 0.0, 1.0).normalize();
        let each = (0..2).flat_map(|pass| (0..10_000).map(move |i| (pass, i)));
        let points = each.map(|(pass, i)| {
            let (x, y) = (f64::from(i % 100) * 0.05, f64::from(i / 100) * 0.05);
            let up_m = f64::from(pass) * offset_m * (1.0 + wave * (2.0 * x).sin());
            TimedPoint {
                scanner: 0,
                time_s: f64::from(pass) * 60.0 + 0.1 * x,
                position_m: Some(Vec3::new(x, y, 0.2 * x) + normal * up_m),
            }
        });
        points.collect()
    }

    #[test]
    fn passes_are_as_far_apart_as_they_were_made() {
        for offset_m in [0.02, -0.005] {
            let points = passes(offset_m, 0.0);
            let cells = PassCells::new(&points, CELL_M);
            let found = cells.distances(&points).expect("two passes");
            // Rounding of the sums alone.
            assert!((found.median_m - offset_m.abs()).abs() < 1e-9, "{found:?}");
            assert!((found.rms_m - offset_m.abs()).abs() < 1e-9);
            assert!(found.cells > 500);
        }
    }

    #[test]
    fn a_placement_is_worse_where_passes_lie_farther_apart() {
        let good = passes(0.002, 0.5);
        let cells = PassCells::new(&good, CELL_M);
        let of = |points: &[TimedPoint]| cells.distances(points).expect("two passes");
        let (good, bad) = (of(&good), of(&passes(0.02, 0.5)));
        assert_eq!(bad.is_worse_than(&good), Some(true));
        assert_eq!(good.is_worse_than(&bad), Some(false));
        assert_eq!(good.is_worse_than(&good), Some(false));
    }

    #[test]
    fn one_pass_and_single_profiles_have_no_distance() {
        let mut points = passes(0.01, 0.0);
        points.truncate(10_000);
        assert!(PassCells::new(&points, CELL_M).distances(&points).is_none());
        let mut lines = passes(0.01, 0.0);
        lines.retain(|point| point.position_m.is_some_and(|p| p.y == 0.05));
        assert!(PassCells::new(&lines, CELL_M).distances(&lines).is_none());
    }
}
