//! The project file: as written, and checked.

mod calibrated;
mod checked;
mod files;
mod other;
mod print;
mod quality;
mod resolve;
mod shapes;
mod source;
mod units;
mod written;

pub use checked::{
    FrameLogFile, LogFile, Logs, Motion, OtherDrive, PosesFile, PositionLog, Project, Reference,
    Scanner,
};
pub use quality::QualityNoise;
pub use resolve::comparison;
pub use source::{Source, Step};
pub use units::{AccelUnit, GyroUnit, ImuUnits, TimeUnit};
pub use written::Comparison as WrittenComparison;

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use crate::calibration::{CalibrationSettings, Method};
use crate::error::Result;
use crate::geometry::{BodyAxes, BodyFromScanner};

/// The mountings in a project or in a `calibration.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct Mountings {
    /// Name and mounting of each scanner.
    pub scanners: Vec<(String, BodyFromScanner)>,
    /// Axes of the body; `None` for a calibration, which does not contain them.
    pub axes: Option<BodyAxes>,
    /// Whether the calibration is marked as not usable.
    pub is_unusable: bool,
}

/// Reads the mountings in a project or in a `calibration.toml`.
///
/// # Errors
/// A file that cannot be read, a mistake in it, no scanner.
pub fn mountings(path: &Path) -> Result<Mountings> {
    calibrated::mountings(path)
}

impl Project {
    /// Reads and checks a project file. Referenced files are not opened; [`Project::check_files`]
    /// checks that they exist.
    ///
    /// # Errors
    /// Unknown keys, with the nearest known key; missing keys; values out of range; sections that exclude
    /// each other. Errors name the file, the line, the content found and the content expected.
    pub fn read(path: &Path) -> Result<Self> {
        resolve::read(path)
    }

    /// Checks the text of a project file as if it were in the file at `path`, which need not exist.
    ///
    /// # Errors
    /// Those of [`Project::read`].
    pub fn parse(text: String, path: &Path) -> Result<Self> {
        resolve::project(&Source::of(text, path)?)
    }

    /// Checks that every referenced file exists. Also checks that the projects of the other drives can be
    /// read, that their files exist, that they contain only scanners of this project with the same body
    /// axes, and that no drive is adjusted twice or both adjusted and evaluated.
    ///
    /// # Errors
    /// Names the first missing file, its key and the line.
    pub fn check_files(&self) -> Result<()> {
        files::check(self)
    }

    /// Every file that is read for the project itself, without the files of its other drives.
    pub fn files(&self) -> Vec<PathBuf> {
        files::files(self)
    }

    /// Every file that is read for the project, including the project files and the files of its other drives.
    pub fn inputs(&self) -> Vec<PathBuf> {
        files::inputs(self)
    }

    /// The scanners of the project with mountings, time offsets and compliance from a `calibration.toml`, as
    /// [`scanners_to_toml`] prints it. Scanners are matched by name. Tables of other scanners and
    /// the profiles in the file are ignored, as the calibration may be of another drive.
    ///
    /// # Errors
    /// The file cannot be read, a mistake in it, a scanner of the project that it does not have.
    pub fn calibrated_scanners(&self, path: &Path) -> Result<Vec<Scanner>> {
        calibrated::scanners(self, path)
    }

    /// The project with the poses of this file instead of its logs or poses, as if `[trajectory]` had
    /// only this `file`. The file is not opened.
    ///
    /// # Errors
    /// A relative path without a current folder.
    pub fn with_trajectory(&self, path: &Path) -> Result<Self> {
        calibrated::with_trajectory(self, path)
    }

    /// The project with this method of calibration.
    pub fn with_method(self, method: Method) -> Self {
        let two_steps = match method {
            Method::Joint | Method::TwoStep => Method::TwoStep,
            Method::Paper => Method::Paper,
        };
        Self {
            is_joint: method == Method::Joint,
            calibration: CalibrationSettings {
                method: two_steps,
                ..self.calibration
            },
            ..self
        }
    }

    /// The project with this file as its reference, or without a reference.
    pub fn with_reference(self, path: Option<PathBuf>) -> Self {
        Self {
            reference: path.map(|path| Reference { path }),
            ..self
        }
    }

    /// The project without its other drives.
    pub fn alone(self) -> Self {
        Self {
            drives: Vec::new(),
            evaluations: Vec::new(),
            ..self
        }
    }

    /// The project as a project file with all values in use, which reads back as the same project.
    ///
    /// # Errors
    /// A path that is not valid UTF-8.
    pub fn to_toml(&self) -> Result<String> {
        print::project(self, None)
    }

    /// As [`Self::to_toml`], with these scales of the calibration from coarse to fine, metres, in place of automatic ones.
    ///
    /// # Errors
    /// A path that is not valid UTF-8.
    pub fn to_toml_with_scales(&self, voxel_sizes_m: &[f64]) -> Result<String> {
        print::project(self, Some(voxel_sizes_m))
    }
}

/// Only the `[[scanner]]` tables, for pasting into a project.
///
/// # Errors
/// A path that is not valid UTF-8.
pub fn scanners_to_toml(scanners: &[Scanner]) -> Result<String> {
    print::scanners(scanners)
}

impl OtherDrive {
    /// The project of this drive, with the order of scanners, the settings and the origin of the main project. The
    /// values of its scanners remain.
    ///
    /// # Errors
    /// The project cannot be read, or lacks a scanner of the main project.
    pub fn read(&self, main: &Project) -> Result<Project> {
        other::read(self, main)
    }
}
