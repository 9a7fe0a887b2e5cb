//! Trajectories of the Bonn robot, `.trj`: 16 numbers per line, or only the first 10 of them; `#` begins a comment.
//!
//! time (s), x y z (m), velocity (m/s, 3), roll pitch yaw (rad; R = Rz(yaw) Ry(pitch) Rx(roll)
//! rotates from the body to the axes of x y z), accelerometer bias (m/s², 3), gyro bias (rad/s, 3).

use crate::error::Result;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::poses::table::read_lines;
use crate::format::text::lines::Lines;
use crate::geometry::{Rotation, Vec3, WorldFromBody};
use crate::sensor::{ImuBias, PoseRecord};

pub(crate) const TRJ: Kind = Kind {
    numbers: Some(|line| line.len() == 16),
    extensions: &["trj"],
    poses: Some(read),
    frame: Frame::Fixed(
        "metres, radians, seconds (the format); axes of the file, taken for the world; body as in the file",
    ),
    ..Kind::new("bonn-trajectory", "trajectory (Bonn .trj)")
};

/// Numbers in a line, with biases and without.
const LONG: usize = 16;
const SHORT: usize = 10;

/// Reads a `.trj`; all lines must have as many numbers as the first.
pub(crate) fn read(input: &Input) -> Result<Vec<PoseRecord>> {
    match first_width(input)? {
        SHORT => read_lines::<SHORT>(input, |row, _| Ok(pose(row))),
        _ => read_lines::<LONG>(input, |row, _| {
            let vector = |i: usize| Vec3::new(row[i], row[i + 1], row[i + 2]);
            Ok(PoseRecord {
                bias: Some(ImuBias {
                    accel_m_s2: vector(10),
                    gyro_rad_s: vector(13),
                }),
                ..pose(row)
            })
        }),
    }
}

/// The number of numbers in the first line.
fn first_width(input: &Input) -> Result<usize> {
    let (mut lines, mut cells) = (Lines::open(input)?, Vec::new());
    lines.next_numbers(
        &mut cells,
        |_| true,
        || format!("{SHORT} or {LONG} numbers"),
    )?;
    Ok(cells.len())
}

fn pose(row: &[f64]) -> PoseRecord {
    let vector = |i: usize| Vec3::new(row[i], row[i + 1], row[i + 2]);
    let rotation = Rotation::from_euler_angles(row[7], row[8], row[9]);
    PoseRecord {
        velocity_m_s: Some(vector(4)),
        ..PoseRecord::new(row[0], WorldFromBody::new(rotation, vector(1)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_ten_or_sixteen_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.trj");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read(&Input::from(&path))
        };
        let short = "# time x y z\n1 2 3 4 0.1 0.2 0.3 0.4 -0.5 0.6\n";
        let found = read(short).unwrap()[0];
        let rotation = Rotation::from_euler_angles(0.4, -0.5, 0.6);
        assert_eq!(
            found.world_from_body,
            WorldFromBody::new(rotation, Vec3::new(2.0, 3.0, 4.0))
        );
        assert_eq!(found.velocity_m_s, Some(Vec3::new(0.1, 0.2, 0.3)));
        assert!(found.bias.is_none());
        let long = format!("{} 1 2 3 4 5 6\n", short.trim_end());
        assert_eq!(
            read(&long).unwrap()[0].bias.unwrap().gyro_rad_s,
            Vec3::new(4.0, 5.0, 6.0)
        );
        let mixed = read(&format!("{short}{}", long.lines().nth(1).unwrap()));
        assert!(
            mixed
                .unwrap_err()
                .to_string()
                .contains("expected 10 finite numbers")
        );
        let other = read("1 2 3\n").unwrap_err().to_string();
        assert!(other.contains("expected 16 finite numbers"), "{other}");
    }
}
