//! Thinning on a voxel grid that is fixed in space.
//!
//! Voxel i along an axis is the half-open interval [i v, (i + 1) v) of the edge length v, so the
//! same point falls into the same voxel in every cloud. Of the points in a voxel the one nearest to
//! its centre is kept, at equal distances the first. Whatever the order and the parts of a cloud,
//! thinning the parts keeps every point that thinning the whole keeps.

mod keys;
mod numbering;
mod pieces;
#[cfg(test)]
mod tests;
mod thinning;

pub use keys::{VoxelHasher, VoxelKey, VoxelMap, occupied, squared_distance_to_centre, voxel_key};
pub use pieces::Thinner;
pub use thinning::{thin, thin_by};
