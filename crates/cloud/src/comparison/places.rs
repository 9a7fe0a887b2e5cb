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
        self.for_each(cloud, |place, offset| {
            around[place].add(offset, radii_m);
        })?;
        Ok(around)
    }

    /// Smallest distance along each place's axis of the points of `cloud` that lie within
    /// `radius_m` of that axis, metres; `None` if there is no such point, or no axis.
    pub(super) fn along(
        &self,
        cloud: &mut Stream<'_>,
        axes: &[Option<Vec3>],
        radius_m: f64,
    ) -> Result<Vec<Option<f64>>> {
        let mut nearest_m: Vec<Option<f64>> = vec![None; self.points.len()];
        self.for_each(cloud, |place, offset| {
            let Some(axis) = axes[place] else { return };
            let along_m = axis.dot(offset);
            if (offset - along_m * axis).norm_squared() <= radius_m * radius_m {
                let known_m = nearest_m[place].unwrap_or(f64::INFINITY);
                nearest_m[place] = Some(known_m.min(along_m.abs()));
            }
        })?;
        Ok(nearest_m)
    }

    /// Calls `each` with the number of each place and the offset of each point at most a voxel away.
    fn for_each(&self, cloud: &mut Stream<'_>, mut each: impl FnMut(usize, &Vec3)) -> Result<()> {
        let reach = self.cell_m * self.cell_m;
        cloud(&mut |points| {
            for point in points.iter().filter(|point| is_finite(point)) {
                let near = self.near.get(&voxel_key(point, self.cell_m));
                for &place in near.into_iter().flatten() {
                    let offset = point - self.points[place as usize];
                    if offset.norm_squared() <= reach {
                        each(place as usize, &offset);
                    }
                }
            }
            Ok(())
        })
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

    fn add(&mut self, offset: &Vec3, radii_m: &[f64]) {
        let squared = offset.norm_squared();
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

    /// Distance within which [`NEAREST`] points lie, metres; `None` if it is more than a voxel.
    pub(super) fn radius_m(&self) -> Option<f64> {
        self.nearest.get(NEAREST - 1).map(|squared| squared.sqrt())
    }

    /// Standard deviation about the plane of the points within each radius, metres; NaN with fewer
    /// than `least` points.
    pub(super) fn roughness_m(&self, least: usize) -> Vec<f64> {
        let within = self.tensors().map(|tensor| {
            if tensor.count < least {
                return f64::NAN;
            }
            tensor.eigen().values.z.sqrt()
        });
        within.collect()
    }

    /// Normal of the points within the radius with this index; `None` if they have none.
    pub(super) fn normal(&self, radius: usize) -> Option<Vec3> {
        self.tensors().nth(radius)?.normal()
    }

    /// Structure tensors of the points within each radius, about the place.
    fn tensors(&self) -> impl Iterator<Item = StructureTensor> {
        self.shells.iter().scan(Sums::default(), |all, shell| {
            all.count += shell.count;
            all.sum += shell.sum;
            all.squares += shell.squares;
            let n = all.count.max(1) as f64;
            let mean = all.sum / n;
            Some(StructureTensor {
                mean,
                covariance: all.squares / n - mean * mean.transpose(),
                count: all.count,
            })
        })
    }
}
