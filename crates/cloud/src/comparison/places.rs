//! Places spread evenly over a cloud, and what lies around them, from clouds that are streamed.

use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::cloud::{Stream, StructureTensor};
use crate::error::Result;
use crate::geometry::{Mat3, Vec3, is_finite};

/// Edge of the first voxels, metres: a power of two, so that doubled voxels contain whole ones.
const FIRST_CELL_M: f64 = 1.0 / 1024.0;
/// Largest edge, metres; beyond it coordinates are no longer those of a site.
const LAST_CELL_M: f64 = 1e9;

/// Points of a cloud, one in each voxel of a grid: each stands for the same area, however dense the
/// points are there.
#[derive(Debug, Clone)]
pub(super) struct Places {
    /// Edge of the voxels, metres.
    pub(super) cell_m: f64,
    pub(super) points: Vec<Vec3>,
    /// The places less than a voxel away from any point of a voxel, or a little more.
    near: VoxelMap<VoxelKey, Vec<u32>>,
}

impl Places {
    /// At most `most` places (1 or more): the first point of each voxel, in voxels as small as that allows.
    pub(super) fn of(cloud: &mut Stream<'_>, most: usize) -> Result<Self> {
        let mut cell_m = FIRST_CELL_M;
        let mut first: VoxelMap<VoxelKey, (u64, Vec3)> = VoxelMap::default();
        let mut count = 0u64;
        cloud(&mut |points| {
            for point in points.iter().filter(|point| is_finite(point)) {
                let key = voxel_key(point, cell_m);
                first.entry(key).or_insert((count, *point));
                count += 1;
                while first.len() > most && cell_m < LAST_CELL_M {
                    cell_m *= 2.0;
                    first = merged(&first, cell_m);
                }
            }
            Ok(())
        })?;
        let mut first: Vec<(u64, Vec3)> = first.into_values().collect();
        first.sort_unstable_by_key(|(index, _)| *index);
        let points: Vec<Vec3> = first.into_iter().map(|(_, point)| point).collect();
        let mut near: VoxelMap<VoxelKey, Vec<u32>> = VoxelMap::default();
        for (place, point) in (0..).zip(&points) {
            let [x, y, z] = voxel_key(point, cell_m);
            for beside in 0..27 {
                let key = [
                    x + beside % 3 - 1,
                    y + beside / 3 % 3 - 1,
                    z + beside / 9 - 1,
                ];
                near.entry(key).or_default().push(place);
            }
        }
        Ok(Self {
            cell_m,
            points,
            near,
        })
    }

    /// What the points of `cloud` are like around each place.
    pub(super) fn look(&self, cloud: &mut Stream<'_>, radii_m: &[f64]) -> Result<Vec<Around>> {
        let mut around = vec![Around::new(radii_m.len()); self.points.len()];
        let reach = self.cell_m * self.cell_m;
        cloud(&mut |points| {
            for point in points.iter().filter(|point| is_finite(point)) {
                let near = self.near.get(&voxel_key(point, self.cell_m));
                for &place in near.into_iter().flatten() {
                    let offset = point - self.points[place as usize];
                    let squared = offset.norm_squared();
                    if squared <= reach {
                        around[place as usize].add(&offset, squared, radii_m);
                    }
                }
            }
            Ok(())
        })?;
        Ok(around)
    }
}

/// The first points of voxels in larger voxels, of which each contains whole ones.
fn merged(first: &VoxelMap<VoxelKey, (u64, Vec3)>, cell_m: f64) -> VoxelMap<VoxelKey, (u64, Vec3)> {
    let mut merged: VoxelMap<VoxelKey, (u64, Vec3)> = VoxelMap::default();
    for (index, point) in first.values() {
        let entry = merged
            .entry(voxel_key(point, cell_m))
            .or_insert((*index, *point));
        if *index < entry.0 {
            *entry = (*index, *point);
        }
    }
    merged
}

/// Number of nearest points that are kept.
pub(super) const NEAREST: usize = 20;

/// The points of a cloud around a place, at most a voxel away from it.
#[derive(Debug, Clone)]
pub(super) struct Around {
    /// Squared distances of the nearest points, ascending, metres².
    nearest: Vec<f64>,
    /// Sums over the points that lie within each radius, but not within the one before.
    shells: Vec<Sums>,
}

/// Number, sum and sum of squares of offsets.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: usize,
    sum: Vec3,
    squares: Mat3,
}

impl Around {
    fn new(radii: usize) -> Self {
        Self {
            nearest: Vec::with_capacity(NEAREST + 1),
            shells: vec![Sums::default(); radii],
        }
    }

    fn add(&mut self, offset: &Vec3, squared: f64, radii_m: &[f64]) {
        if self.nearest.len() < NEAREST || self.nearest.last().is_some_and(|last| squared < *last) {
            let at = self.nearest.partition_point(|known| *known <= squared);
            self.nearest.insert(at, squared);
            self.nearest.truncate(NEAREST);
        }
        let shell = radii_m.partition_point(|radius| radius * radius < squared);
        if let Some(sums) = self.shells.get_mut(shell) {
            sums.count += 1;
            sums.sum += offset;
            sums.squares += offset * offset.transpose();
        }
    }

    /// Distance to the nearest point, metres; `None` if there is none within a voxel.
    pub(super) fn nearest_m(&self) -> Option<f64> {
        self.nearest.first().map(|squared| squared.sqrt())
    }

    /// Distance within which [`NEAREST`] points lie, metres; `None` if it is more than a voxel.
    pub(super) fn radius_m(&self) -> Option<f64> {
        self.nearest.get(NEAREST - 1).map(|squared| squared.sqrt())
    }

    /// Standard deviation about the plane of the points within each radius, metres; NaN with fewer
    /// than `least` points.
    pub(super) fn roughness_m(&self, least: usize) -> Vec<f64> {
        let mut all = Sums::default();
        let within = self.shells.iter().map(|shell| {
            all.count += shell.count;
            all.sum += shell.sum;
            all.squares += shell.squares;
            if all.count < least {
                return f64::NAN;
            }
            let n = all.count as f64;
            let mean = all.sum / n;
            let tensor = StructureTensor {
                mean,
                covariance: all.squares / n - mean * mean.transpose(),
                count: all.count,
            };
            tensor.eigen().values.z.sqrt()
        });
        within.collect()
    }
}
