//! The data channel of Gocator scanners: messages, damage, speed.

mod codec;
mod common;
mod damage;
mod speed;
