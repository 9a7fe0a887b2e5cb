//! The project file: as written, then checked.

pub mod settings;

pub use settings::{
    CalibrationSettings, ComparisonSettings, HeadingSettings, ImuNoise, Method, PrismSettings,
    TrajectorySettings,
};
