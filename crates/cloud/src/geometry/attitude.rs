//! Roll, pitch and yaw or heading of a body with x forward, y left, z up.

use std::f64::consts::FRAC_PI_2;

use super::Rotation;
use super::heading::wrap;

/// The angles [roll, pitch, yaw] with R = Rz(yaw) Ry(pitch) Rx(roll), radians: rotations about the
/// fixed axes x, y, z in this order. Pitch is within ±π/2.
///
/// The angles reproduce R to rounding error everywhere. At a pitch of ±π/2 only roll − yaw or
/// roll + yaw is determined: formulas that take roll and yaw from the matrix one by one then
/// return angles that do not belong together.
pub fn roll_pitch_yaw(rotation: &Rotation) -> [f64; 3] {
    let r = rotation.to_rotation_matrix();
    let yaw = r[(1, 0)].atan2(r[(0, 0)]);
    // Removing the yaw leaves Ry(pitch) Rx(roll), whichever yaw was chosen.
    let rest = Rotation::from_euler_angles(0.0, 0.0, -yaw).to_rotation_matrix() * r;
    let pitch = (-rest[(2, 0)]).atan2(rest[(0, 0)]);
    let roll = (-rest[(1, 2)]).atan2(rest[(1, 1)]);
    [roll, pitch, yaw]
}

/// world_from_body (east, north, up; x forward, y left, z up) of the angles of navigation, radians:
/// roll is positive with the right side down, pitch with the nose up, heading clockwise from north.
pub fn from_roll_pitch_heading(roll: f64, pitch: f64, heading: f64) -> Rotation {
    Rotation::from_euler_angles(roll, -pitch, FRAC_PI_2 - heading)
}

/// The angles [roll, pitch, heading] of [`from_roll_pitch_heading`], radians; the heading is within
/// (−π, π].
pub fn roll_pitch_heading(world_from_body: &Rotation) -> [f64; 3] {
    let [roll, pitch, yaw] = roll_pitch_yaw(world_from_body);
    [roll, -pitch, wrap(FRAC_PI_2 - yaw)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;

    #[test]
    fn angles_reproduce_the_rotation_also_where_they_are_not_unique() {
        let quarter = FRAC_PI_2;
        for pitch in [
            0.0,
            0.3,
            -1.2,
            quarter,
            -quarter,
            quarter - 1e-9,
            1e-8 - quarter,
        ] {
            for (roll, yaw) in [(0.0, 0.0), (2.5, -1.7), (-quarter, quarter), (-3.0, 3.1)] {
                let rotation = Rotation::from_euler_angles(roll, pitch, yaw);
                let [roll, pitch, yaw] = roll_pitch_yaw(&rotation);
                let back = Rotation::from_euler_angles(roll, pitch, yaw);
                let off =
                    back.to_rotation_matrix().matrix() - rotation.to_rotation_matrix().matrix();
                assert!(off.abs().max() < 1e-15, "{roll} {pitch} {yaw}: {off}");
                let heading = roll_pitch_heading(&rotation);
                let back = from_roll_pitch_heading(heading[0], heading[1], heading[2]);
                assert!(back.angle_to(&rotation) < 1e-7, "{heading:?}");
            }
        }
    }

    /// In north, east, down a body with x forward, y right, z down turns by Rz(heading) Ry(pitch)
    /// Rx(roll).
    #[test]
    fn the_angles_are_those_of_navigation() {
        let (roll, pitch, heading) = (0.2, -0.4, 2.1);
        let ned = Rotation::from_euler_angles(roll, pitch, heading);
        let flu = from_roll_pitch_heading(roll, pitch, heading);
        for x in [Vec3::x(), Vec3::y(), Vec3::z()] {
            let in_ned = ned * Vec3::new(x.x, -x.y, -x.z);
            let in_enu = Vec3::new(in_ned.y, in_ned.x, -in_ned.z);
            assert!((flu * x - in_enu).norm() < 1e-15);
        }
        // Nose up and towards the east; the left side up.
        let ahead = from_roll_pitch_heading(0.0, 0.1, 1.5) * Vec3::x();
        assert!(ahead.z > 0.09 && ahead.x > 0.9);
        assert!((from_roll_pitch_heading(0.1, 0.0, 1.5) * Vec3::y()).z > 0.09);
    }
}
