//! Keys of results that are kept on disk: hashes of everything on which they depend.

use std::fmt::{self, Debug, Display, Write};

use twox_hash::xxhash3_128::Hasher;

use super::inputs::Inputs;
use super::open_project::OpenProject;
use super::program::PROGRAM;
use super::recorded::is_recorded;
use crate::comparison::ComparisonSettings;
use crate::error::{Error, Result};
use crate::format::file_of;
use crate::project::{OtherDrive, Project};
use crate::report::Imprint;
use crate::verdict::Acceptance;

/// Digits of a key.
pub const DIGITS: usize = 32;

/// A hash of everything on which a result depends: the program, and what the key is extended by.
#[derive(Clone)]
pub struct Key(Hasher);

impl Default for Key {
    /// The key of a result that depends on the program alone.
    fn default() -> Self {
        Self(Hasher::new()).with(&PROGRAM)
    }
}

impl Key {
    /// The key extended by a value, with its digits as `Debug` prints them, which is exact.
    pub fn with(mut self, value: &impl Debug) -> Self {
        // Writing to a hasher cannot fail.
        let _ = writeln!(self, "{value:?}");
        self
    }
}

impl Write for Key {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write(text.as_bytes());
        Ok(())
    }
}

impl Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:0DIGITS$x}", self.0.finish_128())
    }
}

impl Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Display::fmt(self, f)
    }
}

/// The keys of a run.
pub struct Keys {
    /// Key of the reference.
    pub reference: Key,
    /// Key of the poses of the project's own drive.
    pub poses: Key,
    /// Key of its calibration in two steps.
    pub calibration: Key,
    /// Key of its calibration together with other drives.
    pub joint: Key,
    /// Key of the joint calibration with each drive that is evaluated.
    pub evaluations: Vec<Key>,
}

impl Keys {
    /// The keys of a project.
    ///
    /// # Errors
    /// The project of another drive cannot be read.
    pub fn new(project: &OpenProject, inputs: &Inputs) -> Result<Self> {
        let program = Key::default();
        let other = |drive: &OtherDrive| -> Result<Key> {
            let project = Project::read(&drive.project)?;
            let key = key_of(&before_comparison(&project), inputs, &program);
            Ok(key.with(&drive.name))
        };
        let origin_m = project.origin_m();
        let calibration = key_of(&before_comparison(project), inputs, &program).with(&origin_m);
        let mut joint = calibration.clone();
        for drive in &project.drives {
            joint = joint.with(&other(drive)?);
        }
        let evaluations = project.evaluations.iter();
        let evaluations =
            evaluations.map(|drive| Ok::<_, Error>(joint.clone().with(&other(drive)?)));
        let reference = project.reference.as_ref();
        let reference = reference.map(|file| inputs.hash(&file_of(&file.path)));
        Ok(Self {
            reference: program.clone().with(&(reference, origin_m)),
            poses: key_of(&before_scans(project), inputs, &program).with(&origin_m),
            calibration,
            evaluations: evaluations.collect::<Result<_>>()?,
            joint,
        })
    }
}

/// The key of a result that depends on everything in a project and its files.
fn key_of(project: &Project, inputs: &Inputs, program: &Key) -> Key {
    // The name of a projection identifies it completely.
    let crs = project.crs.as_ref().map(|crs| crs.name().to_owned());
    let mut key = program.clone().with(&crs);
    for path in project.files() {
        key = key.with(&inputs.hash(&path));
    }
    key.with(&Project {
        crs: None,
        ..project.clone()
    })
}

/// A project without the settings that only later stages use; all others count, including new ones.
fn before_comparison(project: &Project) -> Project {
    Project {
        // The settings of the comparison affect only clouds.
        comparison: ComparisonSettings::default(),
        // The acceptance limits affect only the verdicts at the end.
        acceptance: Acceptance::default(),
        // The imprint only names the author of the page.
        imprint: Imprint::default(),
        // Drives have keys of their own.
        drives: Vec::new(),
        evaluations: Vec::new(),
        ..project.clone()
    }
}

/// A project with only the inputs of the poses: these depend on the existence of scanners, but not on their data, unless
/// these were recorded, since the clocks of all logs of a recording are judged together with the poses.
fn before_scans(project: &Project) -> Project {
    let mut scanners = project.scanners.clone();
    if !is_recorded(project) {
        scanners.iter_mut().for_each(|scanner| {
            scanner.profiles.clear();
            scanner.point_times = Default::default();
        });
    }
    Project {
        reference: None,
        // Only mountings follow these columns.
        bending: None,
        calibration: Default::default(),
        joint: Default::default(),
        scanners,
        ..before_comparison(project)
    }
}

#[cfg(test)]
mod tests;
