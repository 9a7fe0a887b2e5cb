//! Trajectories.

pub(super) mod bonn_trajectory;
pub(super) mod inertial_explorer;
mod layout;
pub(super) mod navigation;
pub(super) mod order;
pub(super) mod pospac;
pub(super) mod sbet;
pub(super) mod sbet_out;
pub(super) mod table;
pub(super) mod tum;
