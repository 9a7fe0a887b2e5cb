//! Thinning on a voxel grid that is fixed in space.
//!
//! Voxel i along an axis is the half-open interval [i v, (i + 1) v) of the edge length v, so the
//! same point falls into the same voxel whatever cloud it belongs to. Of the points in a voxel the
//! one nearest to its centre is kept, of equals the first: whatever order and pieces a cloud comes
//! in, what is kept of the parts holds what is kept of the whole.

mod keys;
mod numbering;
mod pieces;
#[cfg(test)]
mod tests;
mod thinning;

pub use keys::{VoxelHasher, VoxelKey, VoxelMap, squared_distance_to_centre, voxel_key};
pub use pieces::Thinner;
pub use thinning::{thin, thin_by};
