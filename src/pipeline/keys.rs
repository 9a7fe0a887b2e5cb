//! What the stages of a run follow from.

use super::finished::{Contents, Key};
use crate::comparison::ComparisonSettings;
use crate::error::Result;
use crate::progress::Progress;
use crate::project::{OtherDrive, Project};
use crate::verdict::Acceptance;

/// The keys of a run.
pub struct Keys {
    contents: Contents,
    /// Of the poses of the project's own drive.
    pub poses: Key,
    /// Of its calibration in two steps.
    pub calibration: Key,
    /// Of its calibration together with other drives.
    pub joint: Key,
}

impl Keys {
    /// Those of a project, all of whose files are read once.
    ///
    /// # Errors
    /// The project of another drive cannot be read; [`Error::Cancelled`](crate::Error::Cancelled).
    pub fn new(project: &Project, progress: &dyn Progress) -> Result<Self> {
        let contents = Contents::read(project.inputs(), progress)?;
        let calibration = of(&before_comparison(project), &contents);
        let mut joint = calibration.clone();
        for drive in &project.drives {
            joint = joint.with(&of_other(drive, &contents)?);
        }
        Ok(Self {
            poses: of(&before_scans(project), &contents),
            calibration,
            joint,
            contents,
        })
    }

    /// That of what follows from another drive as well.
    ///
    /// # Errors
    /// Its project cannot be read.
    pub fn with_drive(&self, drive: &OtherDrive) -> Result<Key> {
        Ok(self.joint.clone().with(&of_other(drive, &self.contents)?))
    }
}

/// The key of what follows from everything that a project says and names.
fn of(project: &Project, contents: &Contents) -> Key {
    // A projection holds more than its name, which says it all.
    let crs = project.crs.as_ref().map(|crs| crs.name().to_owned());
    let mut key = Key::of_program().with(&crs);
    for path in project.files() {
        key = key.with(&contents.of(&path));
    }
    key.with(&Project {
        crs: None,
        ..project.clone()
    })
}

fn of_other(drive: &OtherDrive, contents: &Contents) -> Result<Key> {
    let project = Project::read(&drive.project)?;
    Ok(of(&before_comparison(&project), contents).with(&drive.name))
}

/// A project without what only stages after the calibration use, and without other drives.
fn before_comparison(project: &Project) -> Project {
    Project {
        comparison: ComparisonSettings::default(),
        acceptance: Acceptance::default(),
        drives: Vec::new(),
        evaluations: Vec::new(),
        ..project.clone()
    }
}

/// A project with what poses follow from: that there are scanners, but not what they saw.
fn before_scans(project: &Project) -> Project {
    let mut project = Project {
        reference: None,
        bending: None,
        calibration: Default::default(),
        joint: Default::default(),
        ..before_comparison(project)
    };
    project
        .scanners
        .iter_mut()
        .for_each(|scanner| scanner.profiles.clear());
    project
}
