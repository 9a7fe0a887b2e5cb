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

use crate::error::Result;
use crate::geometry::Vec3;

/// Streams the points of a cloud (metres) in chunks, in the same order each time.
pub type Stream<'a> = dyn FnMut(&mut dyn FnMut(&[Vec3]) -> Result<()>) -> Result<()> + 'a;

/// Points in the world frame with recorded values; every list that is not empty is as long as
/// `points`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointCloud {
    /// East, north, up, metres.
    pub points: Vec<Vec3>,
    /// Seconds; NaN where a point has none, empty if no point has one.
    pub time_s: Vec<f64>,
    /// As recorded; NaN where a point has none, empty if no point has one.
    pub intensity: Vec<f32>,
}

impl PointCloud {
    /// Removes times and intensities if no point has one.
    pub fn forget_absent(&mut self) {
        if self.time_s.iter().all(|time_s| time_s.is_nan()) {
            self.time_s.clear();
        }
        if self.intensity.iter().all(|value| value.is_nan()) {
            self.intensity.clear();
        }
    }
}
