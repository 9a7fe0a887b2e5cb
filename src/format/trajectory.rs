//! Trajectories from all formats that contain poses.

use std::path::Path;

use super::detect::{Format, detect};
use super::{bonn_trajectory, las_scan, pose_table, sbet};
use crate::error::{Error, Location, Result};
use crate::sensor::PoseRecord;

/// Reads a trajectory: the native table, Bonn `.trj`, TUM (`time x y z qx qy qz qw`), or LAS and
/// LAZ with the sensor's pose for every point (one pose per distinct time).
///
/// # Errors
/// Errors of the format's reader; SBET, which has geographic positions; times that do not increase;
/// no poses.
pub fn read_trajectory(path: &Path) -> Result<Vec<PoseRecord>> {
    // Unknown tables are read as well: the reader names the missing column.
    match detect(path).unwrap_or(Format::TrajectoryCsv) {
        Format::Las | Format::Laz => las_scan::read_poses(path),
        Format::BonnTrajectory => bonn_trajectory::read(path),
        Format::Tum => pose_table::read_tum(path),
        Format::Sbet => {
            // Damage is reported first.
            sbet::for_each(path, |_| ())?;
            Err(Error::data(
                format!(
                    "{}: SBET contains latitude, longitude and a wander azimuth, not a local frame",
                    path.display()
                ),
                "export the trajectory in projected coordinates as time_s, east_m, north_m, \
                 up_m, qx, qy, qz, qw, with the grid convergence in its attitude",
            ))
        }
        Format::TrajectoryCsv
        | Format::ImuCsv
        | Format::PrismCsv
        | Format::HeadingCsv
        | Format::ProfileCsv
        | Format::CloudCsv => pose_table::read_native(path),
        other => Err(Error::format(
            path,
            Location::Whole,
            other.to_string(),
            format!(
                "a trajectory: a table with the columns {}, Bonn .trj, TUM, or LAS and LAZ with \
                 the sensor's pose at every point",
                pose_table::TRAJECTORY.needed.join(", ")
            ),
        )),
    }
}
