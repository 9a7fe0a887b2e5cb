//! Leica total stations by the GeoCOM ASCII protocol, over TCP or a serial port.
//!
//! Written from Leica's *GeoCOM Reference Manual* (TPS1100, version 1.05; TPS1200/TS30/TM30,
//! version 1.50). Neither manual describes the checksum of ASCII messages; its position and polynomial
//! are those of `geocompy` 1.0.0, whose authors found them on instruments.

mod channel;
mod codec;
mod codes;
mod event;
mod identity;
mod instrument;
mod lines;
mod lock;
mod measurement;
mod modes;
mod procedure;
mod settings;
pub mod simulated;

pub use channel::{Counters, Link};
pub use codec::{Fields, Malformed, Reply, Request, Value, checksum};
pub use codes::ReturnCode;
pub use event::Event;
pub use identity::Identity;
pub use instrument::Instrument;
pub use lines::{LONGEST_LINE, Lines};
pub use measurement::{Angles, Class, Measurement};
pub use modes::Modes;
pub use procedure::Procedure;
pub use settings::TrackingSettings;
