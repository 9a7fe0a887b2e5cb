//! Records sensors while driving.

pub mod geocom;
