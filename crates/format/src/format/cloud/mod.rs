//! Clouds: readers, and writers behind one interface.

pub(super) mod core_points;
pub(super) mod create;
pub(super) mod crs;
pub(super) mod e57;
pub(super) mod e57_out;
pub(super) mod fields;
pub(super) mod gathering;
pub(super) mod headerless;
pub(super) mod names;
pub(super) mod npy;
pub(super) mod pcd;
pub(super) mod ply;
pub(super) mod ply_out;
pub(super) mod pts;
pub(super) mod rows;
pub(super) mod sink;
pub(super) mod sink_checks;
#[cfg(test)]
pub(super) mod sink_tests;
pub(super) mod table;
pub(super) mod terrascan;
pub(super) mod velodyne;
pub(super) mod viewpoints;
mod xyz_header;
pub(super) mod xyz_table;
