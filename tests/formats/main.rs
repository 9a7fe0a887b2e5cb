//! Files that others wrote, round trips of all that is written here, and damaged files.

// What all tests share may unwrap as they do.
#![allow(clippy::unwrap_used)]

#[path = "../common/mod.rs"]
mod common;
mod damage;
mod foreign;
mod positions;
mod round_trips;
mod samples;
