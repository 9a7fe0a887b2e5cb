//! The data channel of Gocator scanners: messages, damage, speed.
#![allow(clippy::unwrap_used)] // helpers fail as tests do

mod codec;
mod common;
mod damage;
mod speed;
