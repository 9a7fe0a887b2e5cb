//! Writer of SBET, for programs that read trajectories in that format.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::error::{Error, Result};
use crate::geometry::attitude::roll_pitch_heading;
use crate::geometry::{GridPoint, Projection, Rotation, Vec3, so3};
use crate::sensor::PoseRecord;

/// Smaller numbers are rounding errors. Readers that detect SBET by its numbers reject them.
const LEAST: f64 = 1e-12;

/// A pose relative to true north, at a geographic position.
struct Level {
    time_s: f64,
    latitude_rad: f64,
    longitude_rad: f64,
    height_m: f64,
    /// Rotation to true east, north, up from the body (x forward, y left, z up).
    attitude: Rotation,
    /// True east, north, up, m/s.
    velocity_m_s: Vec3,
}

/// Writes poses in the projected coordinates of `system`, for a body with x forward, y left, z up.
/// [`read_projected_trajectory`](crate::format::read_projected_trajectory) reads them back to 0.1 mm and 1e-7 rad. The third coordinate is
/// written as ellipsoidal height, times as they are.
///
/// The wander angle is 0: platform headings are true headings, velocities are to the north, west and
/// up. Velocities and angular rates are central differences of the poses, one-sided at both ends;
/// velocities of the poses themselves are not used. Accelerations are the same differences of these
/// velocities, along the axes of the body, without gravity. Accelerations and rates have the axes x
/// forward, y right, z down, and are relative to the ground, without the rotation of the earth.
///
/// # Errors
/// The file cannot be written; numbers that are not finite, times that do not increase, or positions
/// outside `system`, which are found before anything is written.
pub fn write_sbet(path: &Path, poses: &[PoseRecord], system: &Projection) -> Result<()> {
    let levels = levels(poses, system)?;
    let file = File::create(path).map_err(|e| Error::io(path, e))?;
    let mut out = BufWriter::with_capacity(1 << 18, file);
    let mut write = || {
        for i in 0..levels.len() {
            for value in record(&levels, i) {
                let value = if value.abs() < LEAST { 0.0 } else { value };
                out.write_all(&value.to_le_bytes())?;
            }
        }
        out.flush()
    };
    write().map_err(|e| Error::io(path, e))
}

/// The indices of the neighbours of pose `i` of `count`, between which differences are taken.
fn around(i: usize, count: usize) -> (usize, usize) {
    (i.saturating_sub(1), (i + 1).min(count.saturating_sub(1)))
}

fn levels(poses: &[PoseRecord], system: &Projection) -> Result<Vec<Level>> {
    let refused = |time_s: f64, reason: String| {
        Error::data(
            format!("pose at {time_s} s: {reason}"),
            "write poses in the projected coordinates of the system",
        )
    };
    let mut last_s = f64::NEG_INFINITY;
    let mut levels = Vec::with_capacity(poses.len());
    for (i, pose) in poses.iter().enumerate() {
        let (time_s, t) = (pose.time_s, pose.world_from_body.translation_m);
        // NaN must fail.
        if !(time_s > last_s && time_s.is_finite()) {
            return Err(refused(time_s, format!("it follows {last_s} s")));
        }
        last_s = time_s;
        let rotation = pose.world_from_body.rotation;
        if !(t.z.is_finite() && rotation.coords.iter().all(|q| q.is_finite())) {
            return Err(refused(
                time_s,
                "it has numbers that are not finite".to_owned(),
            ));
        }
        let (latitude_rad, longitude_rad) = system
            .unproject(t.x, t.y)
            .map_err(|_| refused(time_s, outside(&t, system)))?;
        let point = system
            .try_project(latitude_rad, longitude_rad)
            .map_err(|misfit| refused(time_s, misfit.found))?;
        let true_from_grid = point.grid_from_true().inverse();
        levels.push(Level {
            time_s,
            latitude_rad,
            longitude_rad,
            height_m: t.z,
            attitude: true_from_grid * rotation,
            velocity_m_s: true_from_grid * true_size(&grid_velocity_m_s(poses, i), &point),
        });
    }
    Ok(levels)
}

fn outside(t: &Vec3, system: &Projection) -> String {
    format!(
        "east {} m, north {} m is outside {}",
        t.x,
        t.y,
        system.name()
    )
}

fn grid_velocity_m_s(poses: &[PoseRecord], i: usize) -> Vec3 {
    let (before, after) = around(i, poses.len());
    let (a, b) = (&poses[before], &poses[after]);
    match b.time_s - a.time_s {
        dt if dt > 0.0 => (b.world_from_body.translation_m - a.world_from_body.translation_m) / dt,
        _ => Vec3::zeros(),
    }
}

/// A velocity without the scale of the projection.
fn true_size(v: &Vec3, point: &GridPoint) -> Vec3 {
    Vec3::new(v.x / point.scale, v.y / point.scale, v.z)
}

fn record(levels: &[Level], i: usize) -> [f64; 17] {
    let level = &levels[i];
    let (before, after) = around(i, levels.len());
    let (a, b) = (&levels[before], &levels[after]);
    let dt = b.time_s - a.time_s;
    let (rate, acceleration) = if dt > 0.0 {
        (
            so3::log(&(a.attitude.inverse() * b.attitude)) / dt,
            level.attitude.inverse() * ((b.velocity_m_s - a.velocity_m_s) / dt),
        )
    } else {
        (Vec3::zeros(), Vec3::zeros())
    };
    let [roll, pitch, heading] = roll_pitch_heading(&level.attitude);
    let v = level.velocity_m_s;
    [
        level.time_s,
        level.latitude_rad,
        level.longitude_rad,
        level.height_m,
        v.y,
        -v.x,
        v.z,
        roll,
        pitch,
        heading,
        0.0,
        acceleration.x,
        -acceleration.y,
        -acceleration.z,
        rate.x,
        -rate.y,
        -rate.z,
    ]
}
