//! Points in voxels, and the surfaces in columns of voxels.

use rayon::prelude::*;

use super::{Assumed, Gates, Grid, MIN_POINTS, ReferencePlane, Surfel};
use crate::cloud::StructureTensor;
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::so3::exp;
use crate::geometry::{Mat3, Vec3};
use crate::joint::layout::REFERENCE;

/// Least standard deviation of the points of a surfel across its narrow side, as a share of its
/// size; points spread over the whole width have 0.29.
const MIN_WIDTH: f64 = 0.12;
/// Largest standard deviation about the plane, as a share of that across the narrow side: thicker sets of
/// points are not a surface.
const MAX_THICKNESS: f64 = 0.4;
/// A surface lies clear of the faces of its voxel if this many standard deviations fit between them.
const CLEAR_SIGMAS: f64 = 3.0;

/// Sums of points about the centre of their voxel.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sums {
    count: f64,
    first: Vec3,
    second: Mat3,
}

impl Sums {
    pub fn add(&mut self, offset: &Vec3) {
        self.count += 1.0;
        self.first += offset;
        self.second += offset * offset.transpose();
    }

    /// Adds sums that are about a centre `shift` away.
    fn combine(&mut self, other: &Self, shift: &Vec3) {
        let cross = other.first * shift.transpose();
        self.count += other.count;
        self.first += other.first + shift * other.count;
        self.second +=
            other.second + cross + cross.transpose() + shift * shift.transpose() * other.count;
    }

    fn tensor(&self, centre: &Vec3) -> StructureTensor {
        let mean = self.first / self.count;
        StructureTensor {
            mean: centre + mean,
            covariance: self.second / self.count - mean * mean.transpose(),
            count: self.count as usize,
        }
    }
}

/// The reference's points in voxels of the surfels' size.
#[derive(Debug, Clone)]
pub struct ReferenceCells {
    cells: VoxelMap<VoxelKey, Sums>,
    /// The voxels.
    pub grid: Grid,
    /// The displacement that was applied to the points.
    pub place: ReferencePlace,
}

/// Displacement of the points of the reference before they were sorted.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReferencePlace {
    /// Centre of the given points, about which they turn, world, metres.
    pub centre_m: Vec3,
    /// Shift (metres) and rotation vector (radians).
    pub moved: [f64; REFERENCE],
}

impl ReferencePlace {
    fn new(points: &[Vec3], moved: [f64; REFERENCE]) -> Self {
        Self {
            centre_m: points.iter().sum::<Vec3>() / points.len().max(1) as f64,
            moved,
        }
    }

    /// The part of a correction of the reference that has not been applied yet.
    pub fn remaining(&self, correction: &[f64; REFERENCE]) -> [f64; REFERENCE] {
        std::array::from_fn(|i| correction[i] - self.moved[i])
    }
}

impl ReferenceCells {
    /// Moves points by the correction of the reference and sorts them into voxels.
    pub fn new(points: &[Vec3], grid: Grid, correction: [f64; REFERENCE]) -> Self {
        let place = ReferencePlace::new(points, correction);
        let [x, y, z, turn @ ..] = correction;
        let shift_m = place.centre_m + Vec3::new(x, y, z);
        let rotation = exp(&Vec3::from(turn)).to_rotation_matrix();
        let mut cells: VoxelMap<VoxelKey, Sums> = VoxelMap::default();
        for point in points {
            let point = shift_m + rotation * (point - place.centre_m);
            add(&mut cells, &grid, &point);
        }
        Self { cells, grid, place }
    }
}

/// Adds a point of the world to its voxel.
pub fn add(cells: &mut VoxelMap<VoxelKey, Sums>, grid: &Grid, world_m: &Vec3) {
    let placed_m = grid.place(world_m);
    let key = voxel_key(&placed_m, grid.size_m);
    let offset = placed_m - grid.centre_m(&key);
    cells.entry(key).or_default().add(&offset);
}

/// Columns of adjacent voxels that one surface may cross, along the axis nearest to its normal. A single
/// voxel would cut the noise of a surface close to its face in two, and each half would keep its points
/// regardless of the mountings.
pub fn columns(cells: &VoxelMap<VoxelKey, Sums>, reference: &ReferenceCells) -> Vec<Vec<VoxelKey>> {
    let grid = &reference.grid;
    let mut keys: Vec<VoxelKey> = cells.keys().copied().collect();
    keys.par_sort_unstable();
    let axes: Vec<Option<usize>> = keys
        .par_iter()
        .map(|key| {
            let mut sums = cells[key];
            if let Some(known) = reference.cells.get(key) {
                sums.combine(known, &Vec3::zeros());
            }
            let tensor = (sums.count >= MIN_POINTS).then(|| sums.tensor(&grid.centre_m(key)));
            Some(tensor?.normal()?.iamax())
        })
        .collect();
    let known: VoxelMap<VoxelKey, usize> = keys
        .iter()
        .zip(&axes)
        .filter_map(|(key, axis)| Some((*key, (*axis)?)))
        .collect();
    // A slice with few points belongs to the surface of the neighbour across its face.
    let adopted = |key: &VoxelKey| {
        (0..3).rev().find(|&axis| {
            [-1, 1].into_iter().any(|side| {
                let mut next = *key;
                next[axis] += side;
                known.get(&next) == Some(&axis)
            })
        })
    };
    let mut sorted: Vec<(usize, i64, i64, i64)> = keys
        .iter()
        .zip(&axes)
        .filter_map(|(key, axis)| {
            let axis = axis.or_else(|| adopted(key))?;
            Some((axis, key[(axis + 1) % 3], key[(axis + 2) % 3], key[axis]))
        })
        .collect();
    sorted.par_sort_unstable();
    let next_to = |a: &(usize, i64, i64, i64), b: &(usize, i64, i64, i64)| {
        (a.0, a.1, a.2, a.3 + 1) == (b.0, b.1, b.2, b.3)
    };
    sorted
        .chunk_by(next_to)
        .map(|run| {
            let key = |&(axis, u, v, layer): &(usize, i64, i64, i64)| {
                let mut key = [0; 3];
                (key[axis], key[(axis + 1) % 3], key[(axis + 2) % 3]) = (layer, u, v);
                key
            };
            run.iter().map(key).collect()
        })
        .collect()
}

/// The sums of all voxels of a column about the centre of its first.
fn sums_of(column: &[VoxelKey], cells: &VoxelMap<VoxelKey, Sums>, grid: &Grid) -> Sums {
    let centre = grid.centre_m(&column[0]);
    let mut sums = Sums::default();
    for key in column {
        if let Some(voxel) = cells.get(key) {
            sums.combine(voxel, &(grid.centre_m(key) - centre));
        }
    }
    sums
}

/// The surfaces in a column of voxels: a single one or, if there is no single one, as at the edge of a
/// board above soil, those that lie within one voxel and clear of its faces.
pub fn surfaces<'a>(
    column: &'a [VoxelKey],
    scanned: &VoxelMap<VoxelKey, Sums>,
    reference: &ReferenceCells,
    gates: &Gates,
) -> Vec<(&'a [VoxelKey], Surfel)> {
    if let Some(surfel) = fit(column, scanned, reference, gates) {
        return vec![(column, surfel)];
    }
    if column.len() == 1 {
        return Vec::new();
    }
    let axis = (0..3).find(|&i| column[0][i] != column[1][i]).unwrap_or(2);
    let clear = |key: &&'a [VoxelKey]| {
        let is_clear = |cells: &VoxelMap<VoxelKey, Sums>| {
            let sums = sums_of(key, cells, &reference.grid);
            let mean = sums.first[axis] / sums.count;
            let variance = sums.second[(axis, axis)] / sums.count - mean * mean;
            let reach_m = mean.abs() + CLEAR_SIGMAS * variance.max(0.0).sqrt();
            sums.count == 0.0 || reach_m < 0.5 * reference.grid.size_m
        };
        is_clear(scanned) && is_clear(&reference.cells)
    };
    let single = column.chunks(1).filter(clear);
    single
        .filter_map(|key| Some((key, fit(key, scanned, reference, gates)?)))
        .collect()
}

/// The surfel of a run of voxels; `None` if its points do not form a surface.
fn fit(
    column: &[VoxelKey],
    scanned: &VoxelMap<VoxelKey, Sums>,
    reference: &ReferenceCells,
    gates: &Gates,
) -> Option<Surfel> {
    let grid = &reference.grid;
    let reference = sums_of(column, &reference.cells, grid);
    let scanned = sums_of(column, scanned, grid);
    let reference = Some(&reference);
    let reference = reference.filter(|sums| sums.count >= MIN_POINTS);
    let sums = reference.unwrap_or(&scanned);
    if sums.count < MIN_POINTS {
        return None;
    }
    let tensor = sums.tensor(&grid.centre_m(&column[0]));
    let eigen = tensor.eigen();
    let width_m = eigen.values.y.sqrt();
    let roughness_m = eigen.values.z.sqrt();
    let allowed_m = MAX_THICKNESS * width_m
        + if reference.is_some() {
            0.0
        } else {
            gates.misfit_m
        };
    if width_m < MIN_WIDTH * grid.size_m || roughness_m > allowed_m {
        return None;
    }
    let axis = |i: usize| grid.world(&eigen.vectors.column(i).into_owned());
    let slope = |value: f64| roughness_m / (sums.count * value).sqrt();
    Some(Surfel {
        centre_m: grid.world(&tensor.mean),
        axes: [axis(2), axis(0), axis(1)],
        size_m: grid.size_m,
        roughness_m,
        scatter_m: roughness_m,
        class: 0,
        is_checked: reference.is_some(),
        plane_sigma: [
            roughness_m / sums.count.sqrt(),
            slope(eigen.values.x),
            slope(eigen.values.y),
        ],
        assumed: Assumed::default(),
        prior: reference.map(|_| ReferencePlane { patch: 0 }),
    })
}
