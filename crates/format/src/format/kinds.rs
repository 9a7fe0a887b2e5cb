//! All file formats.

use super::kind::Kind;
use super::{cloud, las, log, mountings, poses, profiles, project_file, ros};

/// All formats in the order in which detection tries them: first those with unique signatures; tables with
/// more columns before tables with fewer.
pub(crate) const KINDS: [&Kind; 49] = [
    &las::kind::LAS,
    &las::kind::LAZ,
    &cloud::ply::PLY,
    &cloud::e57::E57,
    &ros::BAG,
    &cloud::npy::NPY,
    &cloud::pcd::PCD,
    &cloud::terrascan::FILE,
    &mountings::bonn_xml::MOUNTING,
    &log::euroc::IMU_LOG,
    &log::euroc::POSES,
    &log::euroc::POSITIONS,
    &log::euroc::noise::DESCRIPTION,
    &log::sbg::LOG,
    &log::nmea::LOG,
    &log::gsi::MEASUREMENTS,
    &log::rtklib::POSITIONS,
    &log::novatel::LOG,
    &log::gpx::TRACK,
    &poses::pospac::EXPORT,
    &poses::inertial_explorer::EXPORT,
    &log::kitti::OXTS_TIMES,
    &log::sbg_text::EXPORT,
    &profiles::gocator_csv::EXPORT,
    &profiles::gocator_stream::STREAM,
    &profiles::bonn::RECORDING,
    &profiles::bonn_processed::RECORDING,
    &cloud::velodyne::SCAN,
    &poses::sbet::SBET,
    &cloud::pts::PTS,
    &cloud::pts::PTX,
    &poses::bonn_trajectory::TRJ,
    &log::kitti::POSES,
    &poses::tum::TUM,
    &project_file::PROJECT,
    &mountings::table::MOUNTING_TABLE,
    &poses::table::POSE_TABLE,
    &poses::navigation::NAVIGATION_TABLE,
    &log::tables::IMU_TABLE,
    &log::positions::TPS_TABLE,
    &log::bonn_rts::RTS,
    &log::positions::POLAR_TABLE,
    &log::positions::POSITION_TABLE,
    &cloud::table::CLOUD_TABLE,
    &profiles::table::PROFILE_TABLE,
    &log::tables::HEADING_TABLE,
    &cloud::xyz_table::XYZ_TABLE,
    &cloud::xyz_table::TIMED_TABLE,
    &cloud::table::XYZ,
];

#[cfg(test)]
mod tests {
    use super::super::kind::Frame;
    use super::*;

    #[test]
    fn every_format_states_its_units_and_frame() {
        for kind in KINDS {
            let states_frame = !matches!(kind.frame, Frame::Fixed(""));
            assert!(states_frame, "{}", kind.id);
        }
    }
}
