//! The voxels of the surfels.

use nalgebra::Rotation3;

use crate::calibration::{Mounting, ScannerSample};
use crate::cloud::voxel::{VoxelKey, voxel_key};
use crate::geometry::Vec3;
use crate::joint::input::{JointDrive, JointInput};

/// Number of orientations among which [`Grid::across`] chooses.
const TURNS: u32 = 32;
/// Tilt of the voxels about two horizontal axes, radians, so that walls and floors are cut obliquely too: about 10°.
/// Surfaces stay within a few voxels of their column.
const TILT: [f64; 2] = [0.15, 0.2];
/// Edge of the regions in which the ground is alike, in voxels.
const REGION_SIZES: f64 = 8.0;

/// Cubic voxels, turned against the world.
///
/// How far a plane is off from curved ground depends on the place within the surfel. A profile along the faces of the
/// voxels sees all surfels at the same place: the deviations of a whole step are then equal, and look like a motion of
/// the body, which contradicts the IMU. In voxels that profiles cross obliquely they average out.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    grid_from_world: Rotation3<f64>,
    /// Edge of a voxel, metres.
    pub size_m: f64,
}

impl Grid {
    /// Voxels whose faces are oblique to these profiles, given as vectors from end to end in the world, metres.
    pub fn across(profiles: &[Vec3], size_m: f64) -> Self {
        let candidates = (0..TURNS).map(|turn| {
            let [roll, pitch] = TILT;
            let yaw = f64::from(turn) / f64::from(TURNS) * std::f64::consts::FRAC_PI_2;
            Rotation3::from_euler_angles(roll, pitch, 0.0)
                * Rotation3::from_axis_angle(&Vec3::z_axis(), yaw)
        });
        let costs = candidates.map(|turn| (in_common(profiles, &turn, size_m), turn));
        let best = costs.min_by(|a, b| a.0.total_cmp(&b.0));
        Self {
            grid_from_world: best.map_or_else(Rotation3::identity, |(_, turn)| turn),
            size_m,
        }
    }

    /// Voxels along the axes of the world.
    #[cfg(test)]
    pub fn aligned(size_m: f64) -> Self {
        Self {
            grid_from_world: Rotation3::identity(),
            size_m,
        }
    }

    /// The same orientation with voxels of another size.
    pub fn with_size(self, size_m: f64) -> Self {
        Self { size_m, ..self }
    }

    /// The regions in which the ground is alike.
    pub fn regions(self) -> Self {
        self.with_size(REGION_SIZES * self.size_m)
    }

    /// The voxel of a point of the world.
    pub fn key(&self, world_m: &Vec3) -> VoxelKey {
        voxel_key(&self.place(world_m), self.size_m)
    }

    /// A point or a direction of the world in the axes of the voxels.
    pub fn place(&self, world: &Vec3) -> Vec3 {
        self.grid_from_world * world
    }

    /// A point or a direction in the axes of the voxels in those of the world.
    pub fn world(&self, placed: &Vec3) -> Vec3 {
        self.grid_from_world.inverse_transform_vector(placed)
    }

    /// Centre of a voxel in the axes of the voxels, metres.
    pub fn centre_m(&self, key: &VoxelKey) -> Vec3 {
        Vec3::from_fn(|i, _| (key[i] as f64 + 0.5) * self.size_m)
    }
}

/// How much of its deviations from planes a profile has in common: a profile that crosses n layers of voxels sees each
/// at another place, and 1/n² of the variance remain. Any of the three axes may lie in the surface.
fn in_common(profiles: &[Vec3], grid_from_world: &Rotation3<f64>, size_m: f64) -> f64 {
    let of_profile = |profile: &Vec3| {
        let layers = grid_from_world * profile / size_m;
        layers.iter().map(|n| 1.0 / (1.0 + n * n)).sum::<f64>()
    };
    profiles.iter().map(of_profile).sum()
}

/// The first and last points of profiles, as vectors from one to the other in the world, metres.
pub fn profiles(input: &JointInput<'_>) -> Vec<Vec3> {
    let of_drive = |drive: &JointDrive| {
        let of_scanner = |(sample, mounting): (&&ScannerSample, &Mounting)| {
            let each = sample.points.chunk_by(|a, b| a.profile == b.profile);
            let across = each.map(|points| {
                let body = sample.profiles[points[0].profile as usize]
                    .world_from_body
                    .rotation;
                let vector = points[points.len() - 1].position_m - points[0].position_m;
                body * mounting.body_from_scanner.rotation * vector
            });
            across.collect::<Vec<_>>()
        };
        let scanners = drive.scans.samples.iter().zip(&input.mountings);
        scanners.flat_map(of_scanner).collect::<Vec<_>>()
    };
    input.drives.iter().flat_map(of_drive).collect()
}
