//! The project file: as written, then checked.

mod checked;
mod files;
mod print;
mod resolve;
mod shapes;
mod source;
mod written;

pub use checked::{
    Evaluation, LogFile, Logs, Motion, PosesFile, PositionLog, Project, Reference, Scanner,
};

#[cfg(test)]
mod tests;
