//! All file formats.

use super::kind::Kind;
use super::{
    bonn, bonn_processed, bonn_rts, bonn_trajectory, cloud_table, e57, euroc, gocator_csv, gsi,
    kitti, las_kind, mounting, native, nmea, npy, pcd, ply, pose_table, positions, profile,
    project_file, pts, ros, sbet, sbg, sbg_text, xyz_table,
};

/// Each is tried in this order: those with signatures that others do not have first, and tables with more
/// columns before those with fewer.
pub(crate) const KINDS: [&Kind; 37] = [
    &las_kind::LAS,
    &las_kind::LAZ,
    &ply::PLY,
    &e57::E57,
    &ros::BAG,
    &npy::NPY,
    &pcd::PCD,
    &mounting::MOUNTING,
    &euroc::IMU_LOG,
    &euroc::POSES,
    &euroc::POSITIONS,
    &sbg::LOG,
    &nmea::LOG,
    &gsi::MEASUREMENTS,
    &kitti::OXTS_TIMES,
    &sbg_text::EXPORT,
    &gocator_csv::EXPORT,
    &bonn::RECORDING,
    &bonn_processed::RECORDING,
    &sbet::SBET,
    &pts::PTS,
    &pts::PTX,
    &bonn_trajectory::TRJ,
    &kitti::POSES,
    &pose_table::TUM,
    &project_file::PROJECT,
    &pose_table::POSE_TABLE,
    &native::IMU_TABLE,
    &positions::TPS_TABLE,
    &bonn_rts::RTS,
    &positions::POLAR_TABLE,
    &positions::POSITION_TABLE,
    &cloud_table::CLOUD_TABLE,
    &profile::PROFILE_TABLE,
    &native::HEADING_TABLE,
    &xyz_table::XYZ_TABLE,
    &cloud_table::XYZ,
];

#[cfg(test)]
mod tests {
    use super::super::kind::Frame;
    use super::*;

    #[test]
    fn every_format_says_its_units_and_frame() {
        for kind in KINDS {
            let says_it = !matches!(kind.frame, Frame::Fixed(""));
            assert!(says_it, "{}", kind.id);
        }
    }
}
