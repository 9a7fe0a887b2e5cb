//! File formats, one per file, reading and writing; format detection.
//!
//! Angles in files are in degrees if the column name says so; records use radians. Every reader
//! returns data or one [`Error`](crate::Error) that names the file, the line or byte, what was
//! found and what was expected.

mod binary;
mod bonn;
mod bonn_processed;
mod bonn_rts;
mod bonn_trajectory;
mod civil;
mod cloud_out;
mod cloud_rows;
mod cloud_sink;
mod cloud_table;
mod cloud_writer;
mod copc;
mod core_points;
mod crs;
mod detect;
mod e57;
mod e57_out;
mod euroc;
mod file;
mod frame_log;
mod gocator_csv;
mod gsi;
mod inspect;
mod kind;
mod kinds;
mod kitti;
mod las;
mod las_columns;
mod las_extra;
mod las_frame;
mod las_kind;
mod las_out;
mod las_points;
mod las_record;
mod las_scan;
mod laz_chunks;
mod lines;
mod mounting;
mod mounting_out;
#[cfg(test)]
mod mutation;
mod native;
mod nmea;
mod npy;
#[cfg_attr(not(feature = "parquet"), path = "parquet_absent.rs")]
#[allow(dead_code)]
mod parquet;
mod pcd;
mod ply;
mod ply_out;
mod pose_table;
mod positions;
mod profile;
mod profile_reader;
mod project_file;
mod pts;
mod read;
mod ros;
mod salvage;
mod sbet;
mod sbet_out;
mod sbg;
mod sbg_text;
mod sink_checks;
#[cfg(test)]
mod sink_tests;
mod table;
mod unit;
mod xyz_table;

pub use bonn::BonnWriter;
pub use cloud_out::{create_cloud, is_cloud_name};
pub use cloud_rows::CloudRows;
pub use cloud_sink::{CloudClock, CloudPoint, CloudShape, CloudSink};
pub use cloud_table::write_cloud_table;
pub use cloud_writer::{CLOUD_STEP_M, CloudWriter};
pub use copc::copc_sink;
pub use core_points::{CorePoints, read_core_points};
pub use detect::detect;
pub use e57_out::e57_sink;
pub use file::{file_of, is_parquet};
pub use frame_log::read_frame_log;
pub use inspect::{Bounds, Gap, Inspection, inspect};
pub use kind::Format;
pub use las_extra::{ExtraDimension, ExtraKind, Row, cloud_to_las, copy_las};
pub use las_points::{las_count, stream_las};
pub use mounting::{read_mounting, write_mounting};
pub use mounting_out::{pdal_pipeline, ros_launch, ros_transforms, urdf};
pub use native::{write_heading, write_imu};
pub use parquet::parquet_sink;
pub use ply_out::ply_sink;
pub use pose_table::{write_trajectory, write_tum};
pub(crate) use positions::read_new_positions;
pub use positions::write_positions;
pub use profile::write_profiles;
pub use profile_reader::ProfileReader;
pub use read::{
    crs_wkt, open_profiles, read_cloud, read_heading, read_imu, read_positions,
    read_projected_positions, read_projected_trajectory, read_trajectory,
};
pub use salvage::{Salvaged, salvage};
pub use sbet::read_sbet;
pub use sbet_out::write_sbet;
