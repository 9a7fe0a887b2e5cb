//! Logs of sensors: IMU, headings, positions.

pub(super) mod bonn_rts;
pub(super) mod euroc;
pub(super) mod frame_log;
pub(super) mod gpx;
pub(super) mod gsi;
pub(super) mod kitti;
pub(super) mod nmea;
pub(super) mod novatel;
mod old_distance;
pub(super) mod positions;
pub(super) mod rtklib;
pub(super) mod sbg;
pub(super) mod sbg_text;
pub(super) mod tables;
