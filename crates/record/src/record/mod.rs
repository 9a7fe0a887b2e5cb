//! Records sensors while driving: total stations by GeoCOM, and whatever sends bytes by itself.
//!
//! A recording is a folder with one log a source, in the formats that a project reads; `clock.csv`, the state of
//! the system's clock once a second; `events.csv`, all that happened; and the project that is made of `field.toml`.

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
pub use coverage::Seen as SeenBoard;
pub use disk::Room;
pub use field::{Board, Field, Kind, Source};
pub use live::{LivePose, LiveView};
pub use place::{Place, Wire};
pub use player::Player;
pub use recorder::{View, folder_for, record};
pub use status::{Seen, Status};
