//! The first hours of a new user: data as they come, failures at the end, and what the terminal advises.

mod ended_early;
mod folders;
mod preview;
mod transcript;
mod utm;
