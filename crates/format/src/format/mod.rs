//! File formats, one per file, reading and writing; format detection.
//!
//! `kinds.rs` lists the formats, one line each. Readers are grouped by the data that they return: clouds, logs,
//! poses, profiles, mountings; LAS, ROS and Parquet hold several of these.
//!
//! Angles in files are in degrees if the column name says so; records use radians. Every reader
//! returns data or one [`Error`](crate::error::Error) that names the file, the line or byte, the content
//! found and the content expected.

mod binary;
mod cloud;
mod compressed;
mod detect;
mod extents;
mod file;
mod files;
mod input;
mod inspect;
mod kind;
mod kinds;
mod las;
mod left_out;
mod log;
pub(crate) mod memory;
mod mountings;
#[cfg(test)]
mod mutation;
#[cfg_attr(not(feature = "parquet"), path = "parquet_absent.rs")]
mod parquet;
mod plausible;
mod poses;
mod profiles;
mod project_file;
mod read;
mod recorded;
mod ros;
mod salvage;
mod text;

pub use cloud::core_points::{CorePoints, read_core_points};
pub use cloud::create::{create_cloud, is_cloud_name};
pub use cloud::e57_out::e57_sink;
pub use cloud::ply_out::ply_sink;
pub use cloud::rows::CloudRows;
pub use cloud::sink::{CLOUD_STEP_M, CloudClock, CloudPoint, CloudShape, CloudSink};
pub use cloud::table::write_cloud_table;
pub use detect::detect;
pub use extents::Extent;
pub use file::{file_of, is_in_recording};
pub use files::files_of;
pub use input::{Input, PointTimes};
pub use inspect::{Bounds, Gap, Inspection, inspect};
pub use kind::Format;
pub use las::copc::copc_sink;
pub use las::extra::{ExtraDimension, ExtraKind, Row, cloud_to_las, copy_las};
pub use las::losses::LasLosses;
pub use las::points::{las_count, las_remarks, las_viewpoints, stream_las};
pub use las::value::ExtraValue;
pub use las::writer::CloudWriter;
pub use log::euroc::noise::{DescribedNoise, read_imu_noise};
pub use log::frame_log::read_frame_log;
pub use log::positions::write_positions;
pub use log::sbg::Arriving as ArrivingSbg;
pub use log::tables::{write_heading, write_imu};
pub use mountings::bonn_xml::{read_mounting, write_mounting};
pub use mountings::others::{pdal_pipeline, ros_launch, ros_transforms, urdf};
pub use parquet::{parquet_sink, write_extents};
pub use plausible::{MOST_COORDINATE_M, MOST_TIME_S};
pub use poses::sbet_out::write_sbet;
pub use poses::table::{write_trajectory, write_tum};
pub use profiles::bonn::BonnWriter;
pub use profiles::gocator_stream;
pub use profiles::reader::ProfileReader;
pub use profiles::table::write_profiles;
pub use read::{
    crs_wkt, describe_frame, open_profiles, open_profiles_on, read_cloud, read_geographic,
    read_geographic_poses, read_heading, read_imu, read_positions, read_projected_positions,
    read_projected_trajectory, read_trajectory, unit_m,
};
pub use recorded::{
    ClockStep, Pieces, RecordingClock, RecordingClocks, SensorClock, StationRow, recording_clock,
    sensor_clock, station_rows,
};
pub use salvage::{Salvaged, salvage};
pub use text::civil::{civil_time, day_number, utc};
pub use text::growing::{GrowingTable, has_grown};
pub use text::whole_lines::WholeLines;
