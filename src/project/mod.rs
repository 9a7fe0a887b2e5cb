//! The project file: as written, then checked.

mod checked;
mod files;
mod print;
mod resolve;
pub mod settings;
mod shapes;
mod source;
mod written;

pub use checked::{
    Evaluation, LogFile, Logs, Motion, PARAMETER_NAMES, PosesFile, PositionLog, Project, Reference,
    Scanner,
};
pub use settings::{
    Aggregation, CalibrationSettings, ComparisonSettings, Constant, Detection, HeadingSettings,
    ImuNoise, Loss, Method, Nodes, PoseLimits, PositionKind, PositionSettings, TrajectorySettings,
};

#[cfg(test)]
mod tests;
