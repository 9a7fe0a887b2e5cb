//! Trajectories from all formats that hold poses.

use std::path::Path;

use super::detect::{Format, detect};
use super::{bonn_trajectory, las_scan, pose_table, sbet};
use crate::error::{Error, Location, Result};
use crate::sensor::PoseRecord;

/// Reads a trajectory: the native table, Bonn `.trj`, TUM (`time x y z qx qy qz qw`), or LAS and
/// LAZ that carry the sensor's pose with every point (one pose per distinct time).
///
/// # Errors
/// What the format's own reader finds; SBET, whose positions are geographic; times that do not
/// increase; no poses.
pub fn read_trajectory(path: &Path) -> Result<Vec<PoseRecord>> {
    // Unknown tables are handed on as well: their reader names the column that is missing.
    match detect(path).unwrap_or(Format::TrajectoryCsv) {
        Format::Las | Format::Laz => las_scan::read_poses(path),
        Format::BonnTrajectory => bonn_trajectory::read(path),
        Format::Tum => pose_table::read_tum(path),
        Format::Sbet => {
            // A damaged file is told first.
            sbet::for_each(path, |_| ())?;
            Err(Error::data(
                format!(
                    "{}: SBET holds latitude, longitude and a wander azimuth, no local frame",
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
