//! One adjustment of trajectory and mountings.

mod settings;

pub use settings::{JointSettings, ReferenceSigma};
