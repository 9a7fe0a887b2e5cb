//! The GeoCOM client and the simulated instrument, with each other and against geocompy.

mod classes;
mod codec;
mod faults;
mod geocompy;
