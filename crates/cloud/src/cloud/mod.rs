//! Point clouds, neighbour search, structure tensors and voxel grids.

pub(crate) mod bounds;
mod candidates;
mod curve;
mod lanes;
mod nearest;
pub mod neighbourhoods;
pub mod neighbours;
pub mod shape;
pub mod tensor;
pub(crate) mod vectors;
pub mod voxel;

pub use neighbourhoods::{Neighbourhood, Surroundings};
pub use neighbours::NeighbourIndex;
pub use tensor::{Eigen, StructureTensor};

use crate::geometry::Vec3;

/// Points in the world frame with recorded values; every list that is not empty is as long as
/// `points`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointCloud {
    /// East, north, up, metres.
    pub points: Vec<Vec3>,
    /// Seconds.
    pub time_s: Vec<f64>,
    /// As recorded.
    pub intensity: Vec<f32>,
}

impl PointCloud {
    /// Removes times and intensities if some points have none.
    pub fn forget_incomplete(&mut self) {
        if !self.time_s.iter().all(|time_s| time_s.is_finite()) {
            self.time_s.clear();
        }
        if !self.intensity.iter().all(|value| value.is_finite()) {
            self.intensity.clear();
        }
    }
}
