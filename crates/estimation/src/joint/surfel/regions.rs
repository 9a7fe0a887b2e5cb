//! Regions in which scans and reference disagree.

use super::{MIN_POINTS, Region, Surfel, Tally};
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::Vec3;
use crate::statistics::{SIGMAS_PER_MAD, median};

/// Edge of a region, in sizes of a surfel.
const REGION_SIZES: f64 = 10.0;
/// Fewest surfels of a region.
const MIN_REGION: usize = 12;
/// A region is off if its median exceeds this many robust standard deviations of all regions' medians.
const REGION_SIGMAS: f64 = 6.0;
/// The median must also exceed this many sizes of a surfel.
const LEAST_REGION_SIZES: f64 = 0.03;

/// The regions in which the scans are farther from the reference than in the others.
pub fn regions(surfels: &[Surfel], tallies: &[Tally], size_m: f64) -> Vec<Region> {
    let mut cells: VoxelMap<VoxelKey, Vec<(Vec3, f64)>> = VoxelMap::default();
    for (surfel, tally) in surfels.iter().zip(tallies) {
        if surfel.prior.is_some() && tally.near >= MIN_POINTS {
            let up = if surfel.axes[0].z < 0.0 { -1.0 } else { 1.0 };
            let key = voxel_key(&surfel.centre_m, REGION_SIZES * size_m);
            let offset_m = up * tally.distance_m / tally.near;
            cells
                .entry(key)
                .or_default()
                .push((surfel.centre_m, offset_m));
        }
    }
    let mut keys: Vec<&VoxelKey> = cells.keys().collect();
    keys.sort_unstable();
    let medians: Vec<Region> = keys
        .into_iter()
        .map(|key| &cells[key])
        .filter(|members| members.len() >= MIN_REGION)
        .filter_map(|members| {
            let count = members.len() as f64;
            Some(Region {
                centre_m: members.iter().map(|member| member.0).sum::<Vec3>() / count,
                offset_m: median(members.iter().map(|member| member.1))?,
                surfels: members.len(),
            })
        })
        .collect();
    let spread = median(medians.iter().map(|region| region.offset_m.abs()));
    let limit_m = spread.map_or(f64::INFINITY, |m| REGION_SIGMAS * SIGMAS_PER_MAD * m);
    let limit_m = limit_m.max(LEAST_REGION_SIZES * size_m);
    let off = |region: &Region| region.offset_m.abs() > limit_m;
    medians.into_iter().filter(off).collect()
}
