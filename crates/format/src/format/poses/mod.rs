//! Trajectories.

pub(super) mod bonn_trajectory;
pub(super) mod sbet;
pub(super) mod sbet_out;
pub(super) mod table;
