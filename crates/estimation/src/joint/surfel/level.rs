//! The surfels of one size and the rows that see them.

use rayon::prelude::*;

use super::cells::{ReferenceCells, Sums, add, columns, surfaces};
use super::{DriveRows, Gates, Grid, RowPoint, ScanRow, Surfel, Tally, keep};
use crate::cloud::voxel::{VoxelKey, VoxelMap};
use crate::geometry::Vec3;
use crate::joint::input::Scans;
use crate::joint::motion::Motion;
use crate::statistics::{SIGMAS_PER_MAD, median};

/// Fewest points of a row: among three, one that does not belong to the surfel weighs little.
const MIN_ROW_POINTS: usize = 3;
/// A scanner that would lose more than this share of its points by that has rows of single points too: a spinning lidar
/// whose rays are as far apart as surfels are wide.
const SPARSE_SHARE: f64 = 0.5;
/// Points farther from a surfel than this many standard deviations do not belong to it.
const GATE_SIGMAS: f64 = 4.0;
/// Points within this many sizes count as near a surfel, even if they are beyond its gate.
const NEAR_SIZES: f64 = 0.6;

/// A point placed in the world.
#[derive(Clone, Copy)]
pub struct Placed {
    pub world_m: Vec3,
    pub step: u32,
    pub point: u32,
}

/// Surfels in voxels of one size.
pub struct Level {
    pub grid: Grid,
    pub surfels: Vec<Surfel>,
    pub tallies: Vec<Tally>,
    /// The rows of each drive.
    pub drives: Vec<DriveRows>,
    by_key: VoxelMap<VoxelKey, u32>,
}

impl Level {
    /// Sorts the placed points of each drive and scanner into the voxels of the reference.
    pub fn new(
        placed: &[Vec<Vec<Placed>>],
        scans: &[Scans<'_>],
        motions: &[Box<dyn Motion>],
        reference: &ReferenceCells,
        gates: &Gates,
    ) -> Self {
        let grid = reference.grid;
        let mut cells: VoxelMap<VoxelKey, Sums> = VoxelMap::default();
        for point in placed.iter().flatten().flatten() {
            add(&mut cells, &grid, &point.world_m);
        }
        let columns = columns(&cells, reference);
        let mut surfels: Vec<Surfel> = Vec::new();
        let mut by_key: VoxelMap<VoxelKey, u32> = VoxelMap::default();
        let fitted: Vec<Vec<(&[VoxelKey], Surfel)>> = columns
            .par_iter()
            .map(|column| surfaces(column, &cells, reference, gates))
            .collect();
        for (keys, surfel) in fitted.into_iter().flatten() {
            for key in keys {
                by_key.insert(*key, surfels.len() as u32);
            }
            surfels.push(surfel);
        }
        let mut level = Self {
            tallies: vec![Tally::default(); surfels.len()],
            drives: Vec::new(),
            grid,
            surfels,
            by_key,
        };
        for ((placed, scans), motion) in placed.iter().zip(scans).zip(motions) {
            let rows = level.rows_of(placed, scans, motion.steps(), gates);
            level.drives.push(rows);
        }
        for (surfel, tally) in level.surfels.iter_mut().zip(&level.tallies) {
            if tally.free > 0.0 {
                surfel.scatter_m = (tally.squares_m2 / tally.free).sqrt();
            }
        }
        for row in level.drives.iter_mut().flat_map(|drive| &mut drive.rows) {
            let surfel = &level.surfels[row.surfel as usize];
            row.scatter_m = row.scatter_m.max(surfel.scatter_m);
        }
        level
    }

    /// Its surfels and rows, with those of a finer level in the place of surfels of which `is_rougher` is true.
    pub fn refined(
        mut self,
        mut finer: Self,
        is_rougher: &[bool],
    ) -> (Vec<Surfel>, Vec<DriveRows>) {
        let is_wanted = |surfel: &Surfel| {
            let coarser = self.by_key.get(&self.grid.key(&surfel.centre_m));
            coarser.is_none_or(|&coarser| is_rougher[coarser as usize])
        };
        let kept: Vec<bool> = finer.surfels.iter().map(is_wanted).collect();
        keep(&mut finer.surfels, &mut finer.drives, &kept);
        let kept: Vec<bool> = is_rougher.iter().map(|is_rougher| !is_rougher).collect();
        keep(&mut self.surfels, &mut self.drives, &kept);
        for (rows, finer) in self.drives.iter_mut().zip(&finer.drives) {
            rows.append(finer, self.surfels.len() as u32);
        }
        self.surfels.append(&mut finer.surfels);
        (self.surfels, self.drives)
    }

    /// The rows of a drive: its points sorted by step, scanner and surfel. Adds the points to the tallies of
    /// the surfels.
    fn rows_of(
        &mut self,
        placed: &[Vec<Placed>],
        scans: &Scans<'_>,
        steps: usize,
        gates: &Gates,
    ) -> DriveRows {
        let (grid, surfels, by_key) = (&self.grid, &self.surfels, &self.by_key);
        // Step, scanner, surfel, point, and the bits of its distance from the surfel.
        let mut seen: Vec<(u32, u32, u32, u32, u32)> = Vec::new();
        for (scanner, points) in placed.iter().enumerate() {
            let near = points.par_iter().filter_map(|point| {
                let surfel = *by_key.get(&grid.key(&point.world_m))?;
                let plane = &surfels[surfel as usize];
                let distance_m = plane.axes[0].dot(&(point.world_m - plane.centre_m));
                (distance_m.abs() < NEAR_SIZES * grid.size_m).then_some((
                    point.step,
                    scanner as u32,
                    surfel,
                    point.point,
                    (distance_m as f32).to_bits(),
                ))
            });
            seen.par_extend(near);
        }
        seen.par_sort_unstable();
        let mut rows = DriveRows {
            step_start: vec![0; steps + 1],
            ..DriveRows::default()
        };
        let scanners = 0..placed.len() as u32;
        let excess_m: Vec<f64> = scanners
            .clone()
            .map(|scanner| excess_m(&seen, surfels, scanner))
            .collect();
        let fewest: Vec<usize> = scanners.map(|scanner| fewest(&seen, scanner)).collect();
        let mut group: Vec<(u32, u32, u32, u32, u32)> = Vec::new();
        for near in seen.chunk_by(is_same_row) {
            let (step, scanner, surfel, ..) = near[0];
            let tally = &mut self.tallies[surfel as usize];
            tally.near += near.len() as f64;
            tally.distance_m += near.iter().map(|seen| distance_m(seen.4)).sum::<f64>();
            let roughness_m = surfels[surfel as usize].roughness_m;
            let excess_m = excess_m[scanner as usize];
            let sigma_m = roughness_m.hypot(gates.misfit_m).hypot(excess_m);
            group.clear();
            let within = |bits: u32| distance_m(bits).abs() < GATE_SIGMAS * sigma_m;
            group.extend(near.iter().filter(|seen| within(seen.4)).copied());
            let fewest = fewest[scanner as usize];
            if group.len() < fewest {
                continue;
            }
            let is_sparse = fewest < MIN_ROW_POINTS;
            let sample = scans.samples[scanner as usize];
            let distances = || group.iter().map(|seen| distance_m(seen.4));
            let weights = || {
                let point = |place: u32| &sample.points[place as usize];
                group
                    .iter()
                    .map(move |(.., place, _)| f64::from(point(*place).count))
            };
            let count = group.len() as f64;
            let mean = distances().sum::<f64>() / count;
            tally.squares_m2 += distances().map(|d| (d - mean).powi(2)).sum::<f64>();
            tally.free += count - 1.0;
            rows.step_start[step as usize + 1] += 1;
            rows.rows.push(ScanRow {
                surfel,
                scanner,
                first: rows.points.len() as u32,
                count: group.len() as u32,
                effective: weights().sum::<f64>().powi(2) / weights().map(|w| w * w).sum::<f64>(),
                coverage: 0,
                scatter_m: if is_sparse {
                    roughness_m.hypot(excess_m)
                } else {
                    0.0
                },
                distance_m: mean,
                depth_m: 0.0,
                by_motion: [0.0; 2],
                rows_in_step: 1,
                trust: 1.0,
            });
            rows.points.extend(group.iter().map(|(.., point, _)| {
                let point = &sample.points[*point as usize];
                RowPoint {
                    profile: point.profile,
                    position_m: point.position_m,
                    weight: f64::from(point.count),
                }
            }));
        }
        for step in 0..steps {
            rows.step_start[step + 1] += rows.step_start[step];
        }
        rows
    }
}

fn distance_m(bits: u32) -> f64 {
    f64::from(f32::from_bits(bits))
}

/// Whether two points belong to the same row: step, scanner and surfel.
fn is_same_row(a: &(u32, u32, u32, u32, u32), b: &(u32, u32, u32, u32, u32)) -> bool {
    (a.0, a.1, a.2) == (b.0, b.1, b.2)
}

/// Fewest points of a scanner's rows.
fn fewest(seen: &[(u32, u32, u32, u32, u32)], scanner: u32) -> usize {
    let rows = seen.chunk_by(is_same_row);
    let counts = rows.filter(|row| row[0].1 == scanner).map(<[_]>::len);
    let (all, few) = counts.fold((0, 0), |(all, few), count| {
        let few_more = if count < MIN_ROW_POINTS { count } else { 0 };
        (all + count, few + few_more)
    });
    if few as f64 > SPARSE_SHARE * all as f64 {
        1
    } else {
        MIN_ROW_POINTS
    }
}

/// Excess of the scatter of a scanner's points over the roughness of the surfels they lie on, metres: its
/// own noise, if that is larger.
fn excess_m(seen: &[(u32, u32, u32, u32, u32)], surfels: &[Surfel], scanner: u32) -> f64 {
    let points = || seen.iter().filter(|seen| seen.1 == scanner);
    let distance_m = median(points().map(|seen| distance_m(seen.4).abs()));
    let roughness_m = median(points().map(|seen| surfels[seen.2 as usize].roughness_m));
    let square = |value: Option<f64>| value.unwrap_or(0.0).powi(2);
    let excess_m2 = SIGMAS_PER_MAD.powi(2) * square(distance_m) - square(roughness_m);
    excess_m2.max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_sparse_scanner_has_rows_of_single_points() {
        // Step, scanner, surfel; the first scanner has rows of five points and one of two, the second rows of one or two.
        let rows = [
            (0, 0, 0, 5),
            (0, 0, 1, 2),
            (0, 1, 0, 1),
            (0, 1, 1, 2),
            (1, 0, 0, 5),
            (1, 1, 3, 1),
        ];
        let seen: Vec<_> = rows
            .into_iter()
            .flat_map(|(step, scanner, surfel, count)| {
                (0..count).map(move |point| (step, scanner, surfel, point, 0))
            })
            .collect();
        assert_eq!(fewest(&seen, 0), MIN_ROW_POINTS);
        assert_eq!(fewest(&seen, 1), 1);
    }
}
