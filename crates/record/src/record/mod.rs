//! Records sensors while driving: total stations, which are polled by GeoCOM, and sensors that send on their own.
//!
//! A recording is a folder with one log per source, in formats that a project reads; `clock.csv`, the state of the
//! system clock once a second; `events.csv`, the log of events; and the project made from `field.toml`.

mod clock;
mod counter;
mod coverage;
mod disk;
mod field;
pub mod geocom;
mod journal;
mod live;
mod place;
mod player;
mod recorder;
mod station;
mod status;
mod stream;
mod tail;
#[cfg(test)]
mod tests;
mod thread;

pub use clock::{Clock, ClockState, Stamp, StepWatch};
pub use coverage::BoardCoverage;
pub use disk::Room;
pub use field::{Board, Field, Kind, Source};
pub use live::{LivePose, LiveView};
pub use place::{Place, Wire};
pub use player::Player;
pub use recorder::{View, folder_for, record};
pub use status::{SourceState, Status};
