//! Neighbourhoods in which several clouds form a surface, for the [alignment](super::align).

use nalgebra::{DVector, Vector6};
use rayon::prelude::*;

use super::cost::{NormalEquations, derivative};
use super::scale::ScaleProblem;
use crate::cloud::{NeighbourIndex, StructureTensor};
use crate::geometry::{Mat3, Vec3};
use crate::surface::{Placed, SurfaceCloud};

/// The nearest points among which those of a neighbourhood are chosen, for each of its points.
const CANDIDATES: usize = 4;
/// Fewest points of a cloud for a mean.
const FEWEST: usize = 3;
/// Least ratio of the second to the third eigenvalue of the scatter within clouds: that of a surface, not of a line.
const SURFACE_RATIO: f64 = 4.0;
/// Most neighbourhoods; few are enough for an alignment to a tenth of a voxel.
const MAX_CENTRES: usize = 5_000;
/// Largest square of the distance along the plane between a cloud's mean and the centre, as a share of the mean square
/// of its points' distances: a cloud that ends here lies to one side, where the ground may be higher. Half a disc has
/// 0.36.
const CENTRED_SHARE: f64 = 0.15;

/// The points of one cloud in a neighbourhood.
struct Members {
    /// The scanner; `None` for the reference.
    scanner: Option<usize>,
    points: Vec<u32>,
}

/// A neighbourhood in which several clouds form a surface.
pub struct Patch {
    clouds: Vec<Members>,
    normal: Vec3,
    /// v_w.
    within_m2: f64,
}

/// The neighbourhoods of points evenly spaced in their order.
pub fn patches(problem: &ScaleProblem, placed: &Placed) -> Vec<Patch> {
    let count = problem.cloud.movable.len();
    let stride = count.div_ceil(MAX_CENTRES).max(1);
    let centres: Vec<Vec3> = placed.world[..count]
        .iter()
        .step_by(stride)
        .copied()
        .collect();
    let nearest =
        NeighbourIndex::new(&placed.world).nearest_of_all(&centres, CANDIDATES * problem.k);
    let each = (nearest.len() / centres.len().max(1)).max(1);
    let neighbourhoods = centres.par_iter().zip(nearest.par_chunks_exact(each));
    let patches = neighbourhoods.filter_map(|(centre, nearest)| {
        let mut clouds = clouds(&problem.cloud, nearest, problem.pass_gap_s);
        let share = problem.k.div_ceil(clouds.len().max(1)).max(FEWEST);
        for cloud in &mut clouds {
            let distance = |point: &u32| (placed.world[*point as usize] - centre).norm_squared();
            if share < cloud.points.len() {
                let by_distance = |a: &u32, b: &u32| distance(a).total_cmp(&distance(b));
                cloud.points.select_nth_unstable_by(share, by_distance);
                cloud.points.truncate(share);
            }
        }
        Patch::new(clouds, centre, &placed.world)
    });
    patches.collect()
}

/// Whether there are several clouds.
pub fn has_several_clouds(problem: &ScaleProblem) -> bool {
    let cloud = &problem.cloud;
    let points: Vec<u32> = (0..(cloud.movable.len() + cloud.fixed.len()) as u32).collect();
    clouds(cloud, &points, problem.pass_gap_s).len() >= 2
}

/// The clouds to which points belong: a scanner that comes back after a while begins a new one. Clouds of few points
/// are left out.
fn clouds(cloud: &SurfaceCloud, points: &[u32], pass_gap_s: f64) -> Vec<Members> {
    let mut in_order = points.to_vec();
    in_order.sort_unstable();
    let mut clouds: Vec<Members> = Vec::new();
    let mut last_s = f64::NAN;
    for point in in_order {
        let profile = cloud.movable.get(point as usize).map(|p| cloud.profile(p));
        let scanner = profile.map(|profile| profile.scanner as usize);
        let time_s = profile.map_or(0.0, |profile| profile.time_s);
        match clouds.last_mut() {
            Some(last) if last.scanner == scanner && time_s - last_s <= pass_gap_s => {
                last.points.push(point);
            }
            _ => clouds.push(Members {
                scanner,
                points: vec![point],
            }),
        }
        last_s = time_s;
    }
    clouds.retain(|cloud| cloud.points.len() >= FEWEST);
    clouds
}

impl Patch {
    /// Without clouds that end here and lie to one side; `None` if fewer than two remain, or if they form no surface.
    fn new(clouds: Vec<Members>, centre: &Vec3, world: &[Vec3]) -> Option<Self> {
        if clouds.len() < 2 {
            return None;
        }
        let tensors: Vec<StructureTensor> = clouds
            .iter()
            .map(|cloud| StructureTensor::of(world, &cloud.points))
            .collect();
        let within = StructureTensor {
            mean: *centre,
            covariance: pooled(&tensors),
            count: tensors.iter().map(|tensor| tensor.count).sum(),
        };
        let eigen = within.eigen();
        let is_surface = eigen.values.y > SURFACE_RATIO * eigen.values.z;
        if !is_surface {
            return None;
        }
        let normal: Vec3 = eigen.vectors.column(2).into();
        let is_around = |tensor: &StructureTensor| {
            let off = tensor.mean - centre;
            let aside = off - normal * normal.dot(&off);
            let spread = tensor.covariance.trace() - normal.dot(&(tensor.covariance * normal));
            aside.norm_squared() < CENTRED_SHARE * spread
        };
        let (clouds, tensors): (Vec<Members>, Vec<StructureTensor>) = clouds
            .into_iter()
            .zip(tensors)
            .filter(|(_, tensor)| is_around(tensor))
            .unzip();
        (clouds.len() >= 2).then(|| Self {
            clouds,
            normal,
            within_m2: normal.dot(&(pooled(&tensors) * normal)),
        })
    }

    /// The share of each cloud in the points, n_c/k, and its distance from the common plane, n·(x̄_c − x̄).
    pub fn offsets(&self, world: &[Vec3]) -> Vec<(f64, f64)> {
        let count: f64 = self.clouds.iter().map(|c| c.points.len() as f64).sum();
        let heights = self.clouds.iter().map(|cloud| {
            let points = cloud.points.iter();
            let sum: f64 = points.map(|&p| self.normal.dot(&world[p as usize])).sum();
            (
                cloud.points.len() as f64 / count,
                sum / cloud.points.len() as f64,
            )
        });
        let heights: Vec<(f64, f64)> = heights.collect();
        let mean: f64 = heights.iter().map(|(share, height)| share * height).sum();
        let offsets = heights.into_iter();
        offsets
            .map(|(share, height)| (share, height - mean))
            .collect()
    }

    /// v_w + s² and v_b + v_w + s².
    pub fn variances(&self, offsets: &[(f64, f64)], floor_m: f64) -> [f64; 2] {
        let between = offsets
            .iter()
            .map(|(share, offset)| share * offset * offset);
        let within = self.within_m2 + floor_m * floor_m;
        [within, between.sum::<f64>() + within]
    }

    /// Adds its reweighted squares.
    pub fn add_to(
        &self,
        equations: &mut NormalEquations,
        cloud: &SurfaceCloud,
        placed: &Placed,
        floor_m: f64,
    ) {
        let offsets = self.offsets(&placed.world);
        let [within, all] = self.variances(&offsets, floor_m);
        let weight = 1.0 / (within * all).sqrt();
        let mut mean = DVector::zeros(equations.gradient.len());
        let mut rows = Vec::with_capacity(offsets.len());
        for (members, (share, _)) in self.clouds.iter().zip(&offsets) {
            let mut row = DVector::zeros(mean.len());
            if let Some(scanner) = members.scanner {
                let points = members.points.iter();
                let rows = points.map(|&p| cloud.mounting_row(placed, p as usize, &self.normal));
                let sum: Vector6<f64> = rows.map(|row| derivative(&row)).sum();
                row.fixed_rows_mut::<6>(6 * scanner)
                    .copy_from(&(sum / members.points.len() as f64));
            }
            mean.axpy(*share, &row, 1.0);
            rows.push(row);
        }
        for (row, (share, offset)) in rows.iter().zip(&offsets) {
            let weight = weight * share;
            equations.uncentred += row.component_mul(row) * weight;
            let row = row - &mean;
            equations.matrix.ger(weight, &row, &row, 1.0);
            equations.gradient.axpy(weight * offset, &row, 1.0);
        }
    }
}

/// Covariance of points about the means of their clouds, m².
fn pooled(tensors: &[StructureTensor]) -> Mat3 {
    let count: usize = tensors.iter().map(|tensor| tensor.count).sum();
    let scatter = tensors.iter().map(|t| t.covariance * t.count as f64);
    scatter.sum::<Mat3>() / count as f64
}
