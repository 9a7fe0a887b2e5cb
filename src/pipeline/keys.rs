//! What the stages of a run follow from, as keys.

use std::fmt::{self, Debug, Display, Write};

use twox_hash::xxhash3_128::Hasher;

use super::inputs::Inputs;
use super::program::PROGRAM;
use crate::comparison::ComparisonSettings;
use crate::error::{Error, Result};
use crate::format::file_of;
use crate::project::{OtherDrive, Project};
use crate::report::Imprint;
use crate::verdict::Acceptance;

/// Digits of a key.
pub const DIGITS: usize = 32;

/// What the result of a stage follows from.
#[derive(Clone, Default)]
pub struct Key(Hasher);

impl Key {
    /// The key with the digits of this value as `Debug` shows them, which drops none.
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
    /// Of the reference.
    pub reference: Key,
    /// Of the poses of the project's own drive.
    pub poses: Key,
    /// Of its calibration in two steps.
    pub calibration: Key,
    /// Of its calibration together with other drives.
    pub joint: Key,
    /// Of the same and each drive that is evaluated.
    pub evaluations: Vec<Key>,
}

impl Keys {
    /// Those of a project.
    ///
    /// # Errors
    /// The project of another drive cannot be read.
    pub fn new(project: &Project, inputs: &Inputs) -> Result<Self> {
        let program = Key(Hasher::new()).with(&PROGRAM);
        let other = |drive: &OtherDrive| -> Result<Key> {
            let project = Project::read(&drive.project)?;
            let key = of(&before_comparison(&project), inputs, &program);
            Ok(key.with(&drive.name))
        };
        let calibration = of(&before_comparison(project), inputs, &program);
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
            reference: program.clone().with(&(reference, project.origin_m)),
            poses: of(&before_scans(project), inputs, &program),
            calibration,
            evaluations: evaluations.collect::<Result<_>>()?,
            joint,
        })
    }
}

/// The key of what follows from everything that a project says and names.
fn of(project: &Project, inputs: &Inputs, program: &Key) -> Key {
    // A projection holds more than its name, which says it all.
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

/// A project without what only later stages use; all else counts, also what is new in a project.
fn before_comparison(project: &Project) -> Project {
    Project {
        // Only clouds are compared.
        comparison: ComparisonSettings::default(),
        // Only the verdicts at the end are held against it.
        acceptance: Acceptance::default(),
        // It names who made the page.
        imprint: Imprint::default(),
        // These have keys of their own.
        drives: Vec::new(),
        evaluations: Vec::new(),
        ..project.clone()
    }
}

/// A project with what poses follow from: that there are scanners, but not what they saw.
fn before_scans(project: &Project) -> Project {
    let mut project = Project {
        reference: None,
        // Only mountings follow these columns.
        bending: None,
        calibration: Default::default(),
        joint: Default::default(),
        ..before_comparison(project)
    };
    for scanner in &mut project.scanners {
        scanner.profiles.clear();
    }
    project
}

#[cfg(test)]
mod tests;
