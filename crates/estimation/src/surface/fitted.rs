//! A cloud placed for given mountings, and the planes of its neighbourhoods.

use std::sync::Arc;

use super::cloud::{Placed, SurfaceCloud};
use super::neighbourhoods::Neighbourhoods;
use super::plane::Plane;
use super::rows::Row;
use crate::geometry::{BodyFromScanner, Vec3};

/// The planes of neighbourhoods for given mountings. Points and neighbourhoods are shared between
/// this surface and those derived from it.
#[derive(Debug, Clone)]
pub struct Surface {
    /// The points.
    pub cloud: Arc<SurfaceCloud>,
    /// Their positions.
    pub placed: Placed,
    /// The neighbourhoods.
    pub neighbourhoods: Arc<Neighbourhoods>,
    /// The plane of every neighbourhood.
    pub planes: Vec<Plane>,
}

impl Surface {
    /// Places the points of `cloud` and searches the `k` points nearest to every `stride`-th
    /// movable point.
    pub fn new(
        cloud: Arc<SurfaceCloud>,
        mountings: &[BodyFromScanner],
        k: usize,
        stride: usize,
    ) -> Self {
        let placed = cloud.place(mountings);
        let centres = (0..cloud.movable.len() as u32).step_by(stride.max(1));
        let neighbourhoods = Neighbourhoods::search(&placed.world, centres.collect(), k);
        Self {
            planes: neighbourhoods.planes(&placed.world),
            neighbourhoods: Arc::new(neighbourhoods),
            placed,
            cloud,
        }
    }

    /// The same neighbourhoods for other mountings.
    pub fn moved(&self, mountings: &[BodyFromScanner]) -> Self {
        let placed = self.cloud.place(mountings);
        Self {
            cloud: Arc::clone(&self.cloud),
            planes: self.neighbourhoods.planes(&placed.world),
            neighbourhoods: Arc::clone(&self.neighbourhoods),
            placed,
        }
    }

    /// The same points, with the neighbours searched again at their current positions.
    pub fn search_again(self) -> Self {
        let neighbourhoods = self.neighbourhoods.search_again(&self.placed.world);
        Self {
            planes: neighbourhoods.planes(&self.placed.world),
            neighbourhoods: Arc::new(neighbourhoods),
            ..self
        }
    }

    /// Derivatives of the coordinate of movable point `index` along `direction` (world axes) by its pose.
    pub fn pose_row(&self, index: usize, direction: &Vec3) -> Row {
        self.cloud.pose_row(&self.placed, index, direction)
    }

    /// Those by its mounting.
    #[inline]
    pub fn mounting_row(&self, index: usize, direction: &Vec3) -> Row {
        self.cloud.mounting_row(&self.placed, index, direction)
    }
}
