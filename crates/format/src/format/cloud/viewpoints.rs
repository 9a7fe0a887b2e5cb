//! The places from which the points of a cloud were seen.

use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::{Vec3, is_finite};

/// Places closer than this are one viewpoint, metres: a scanner that moves has as many as points.
const STEP_M: f64 = 0.1;

/// Places in the order in which they came, by the decimetre that they lie in.
#[derive(Default)]
pub(crate) struct Viewpoints(VoxelMap<VoxelKey, (usize, Vec3)>);

impl Viewpoints {
    /// Keeps a place in metres; of those within a decimetre, the first.
    pub(crate) fn add(&mut self, place: Vec3) {
        if is_finite(&place) {
            let number = self.0.len();
            let key = voxel_key(&place, STEP_M);
            self.0.entry(key).or_insert((number, place));
        }
    }

    /// The places, metres.
    pub(crate) fn into_places(self) -> Vec<Vec3> {
        let mut places: Vec<(usize, Vec3)> = self.0.into_values().collect();
        places.sort_unstable_by_key(|(number, _)| *number);
        places.into_iter().map(|(_, place)| place).collect()
    }
}
