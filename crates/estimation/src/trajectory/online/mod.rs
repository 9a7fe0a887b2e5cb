//! The trajectory during the drive: one update per position fix, with the factors of the whole-drive
//! adjustment.

mod finish;
mod gate;
mod live;
mod options;
mod overlap;
mod records;
mod rests;
mod running;
mod scatter;
mod smoother;
mod start;
#[cfg(test)]
mod tests;
mod update;

pub use live::Online;
pub use options::{OnlineOptions, Thresholds};
pub use update::{Jump, Update};
