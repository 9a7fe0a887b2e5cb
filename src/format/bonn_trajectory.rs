//! Trajectories of the Bonn robot, `.trj`: 16 numbers per line, `#` comments.
//!
//! time (s), x y z (m), velocity (m/s, 3), roll pitch yaw (rad; R = Rz(yaw) Ry(pitch) Rx(roll)
//! rotates from the body to the axes of x y z), accelerometer bias (m/s², 3), gyro bias (rad/s, 3).

use std::path::Path;

use super::kind::Kind;
use super::pose_table::read_lines;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3, WorldFromBody};
use crate::sensor::{ImuBias, PoseRecord};

pub(crate) const TRJ: Kind = Kind {
    numbers: &[16],
    extensions: &["trj"],
    poses: Some(read),
    ..Kind::new("bonn-trajectory", "trajectory (Bonn .trj)")
};

/// Reads a `.trj`.
pub(crate) fn read(path: &Path) -> Result<Vec<PoseRecord>> {
    read_lines::<16>(path, |row, _| {
        let vector = |i: usize| Vec3::new(row[i], row[i + 1], row[i + 2]);
        Ok(PoseRecord {
            time_s: row[0],
            world_from_body: WorldFromBody::new(
                Rotation::from_euler_angles(row[7], row[8], row[9]),
                vector(1),
            ),
            velocity_m_s: Some(vector(4)),
            bias: Some(ImuBias {
                accel_m_s2: vector(10),
                gyro_rad_s: vector(13),
            }),
            sigma: None,
        })
    })
}
