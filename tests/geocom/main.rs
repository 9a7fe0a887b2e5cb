//! The GeoCOM client and the simulated instrument, with each other and against geocompy.
#![allow(clippy::unwrap_used)] // helpers fail as tests do

mod classes;
mod codec;
mod faults;
mod geocompy;
mod instrument;
mod rate;
