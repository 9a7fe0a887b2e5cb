//! All file formats.

use super::kind::Kind;
use super::{
    bonn, bonn_trajectory, cloud_table, e57, las_kind, mounting, native, npy, pcd, ply, pose_table,
    positions, profile, project_file, pts, sbet,
};

/// Each is tried in this order: those with signatures that others do not have first, and tables with more
/// columns before those with fewer.
pub(crate) const KINDS: [&Kind; 23] = [
    &las_kind::LAS,
    &las_kind::LAZ,
    &ply::PLY,
    &e57::E57,
    &npy::NPY,
    &pcd::PCD,
    &mounting::MOUNTING,
    &bonn::RECORDING,
    &sbet::SBET,
    &pts::PTS,
    &pts::PTX,
    &bonn_trajectory::TRJ,
    &pose_table::TUM,
    &project_file::PROJECT,
    &pose_table::POSE_TABLE,
    &native::IMU_TABLE,
    &positions::TPS_TABLE,
    &positions::POLAR_TABLE,
    &positions::POSITION_TABLE,
    &cloud_table::CLOUD_TABLE,
    &profile::PROFILE_TABLE,
    &native::HEADING_TABLE,
    &cloud_table::XYZ,
];
