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

use std::path::{Path, PathBuf};

use crate::error::Result;

impl Project {
    /// Reads and checks a project file. Referenced files are not opened;
    /// [`Project::check_files`] looks for them.
    ///
    /// # Errors
    /// Names the file, the line, what stands there and what should: unknown keys with the nearest
    /// known one, missing keys, values out of range, sections that exclude each other.
    pub fn read(path: &Path) -> Result<Self> {
        resolve::read(path)
    }

    /// Checks that every referenced file is there, and that the evaluation projects can be read,
    /// have their files, and hold only scanners of this project on the same body axes.
    ///
    /// # Errors
    /// Names the first file that is missing, the key that asks for it, and its line.
    pub fn check_files(&self) -> Result<()> {
        files::check(self)
    }

    /// Every file that is read for the project: its own, and those of its evaluation drives.
    pub fn inputs(&self) -> Vec<PathBuf> {
        files::inputs(self)
    }

    /// The project as a project file with every value as used: it reads back to the same project.
    ///
    /// # Errors
    /// A path that is not valid UTF-8 cannot be written as TOML.
    pub fn to_toml(&self) -> Result<String> {
        print::project(self)
    }

    /// The `[[scanner]]` tables alone, to be pasted into a project.
    ///
    /// # Errors
    /// A path that is not valid UTF-8 cannot be written as TOML.
    pub fn scanners_to_toml(&self) -> Result<String> {
        print::scanners(self)
    }
}
