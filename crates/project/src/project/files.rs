//! Checks that the files of a project exist.

use std::path::{Path, PathBuf};

use super::checked::{Motion, OtherDrive, Project};
use super::resolve;
use super::source::{Source, Step};
use crate::error::{Error, Location, Result};
use crate::format::{file_of, files_of};
use crate::trajectory::PositionKind;

/// See [`Project::check_files`].
pub(super) fn check(project: &Project) -> Result<()> {
    check_own_files(project)?;
    other_drives(project).try_for_each(|other| check_other(project, &other))?;
    check_distinct(project)
}

/// Another drive and its position in the project file.
struct Other<'a> {
    /// `drive` or `evaluation`.
    array: &'static str,
    index: usize,
    drive: &'a OtherDrive,
}

impl Other<'_> {
    fn steps(&self) -> [Step<'static>; 3] {
        [
            Step::Key(self.array),
            Step::Index(self.index),
            Step::Key("project"),
        ]
    }

    fn error(&self, project: &Project, found: impl Into<String>, expected: &str) -> Error {
        Error::format(&project.path, line(project, &self.steps()), found, expected)
    }
}

/// The drives that are adjusted together with the project's own drive, then the drives that are evaluated.
fn other_drives(project: &Project) -> impl Iterator<Item = Other<'_>> {
    let arrays = [
        ("drive", &project.drives),
        ("evaluation", &project.evaluations),
    ];
    arrays.into_iter().flat_map(|(array, drives)| {
        let drives = drives.iter().enumerate();
        drives.map(move |(index, drive)| Other {
            array,
            index,
            drive,
        })
    })
}

/// Every file that the project itself names, with its key.
fn named_files(project: &Project) -> Vec<(Vec<Step<'static>>, &Path)> {
    let mut files: Vec<(Vec<Step<'static>>, &Path)> = Vec::new();
    let file = |table| vec![Step::Key(table), Step::Key("file")];
    match &project.motion {
        Motion::Logs(logs) => {
            files.push((file("imu"), &logs.imu.path));
            let count = |kind| {
                let of_kind = logs
                    .settings
                    .positions
                    .iter()
                    .filter(move |p| p.kind == kind);
                of_kind.count()
            };
            let mut numbered = [0; 2];
            for (log, settings) in logs.positions.iter().zip(&logs.settings.positions) {
                let (table, which) = match settings.kind {
                    PositionKind::Prism => ("prism", 0),
                    PositionKind::Gnss => ("gnss", 1),
                };
                let index = (count(settings.kind) > 1).then_some(Step::Index(numbered[which]));
                numbered[which] += 1;
                let mut steps = vec![Step::Key(table)];
                steps.extend(index);
                steps.push(Step::Key("file"));
                files.push((steps, &log.path));
            }
            if let Some(heading) = &logs.heading {
                files.push((file("heading"), &heading.path));
            }
        }
        Motion::Poses(poses) => {
            files.extend(
                poses
                    .paths()
                    .map(|path| (file("trajectory"), path.as_path())),
            );
        }
    }
    if let Some(bending) = &project.bending {
        files.push((file("bending"), &bending.log.path));
    }
    for (index, scanner) in project.scanners.iter().enumerate() {
        for (number, path) in scanner.profiles.iter().enumerate() {
            let steps = vec![
                Step::Key("scanner"),
                Step::Index(index),
                Step::Key("profiles"),
                Step::Index(number),
            ];
            files.push((steps, path));
        }
    }
    if let Some(reference) = &project.reference {
        files.push((file("reference"), &reference.path));
    }
    if let Some(logo) = &project.imprint.logo {
        files.push((vec![Step::Key("report"), Step::Key("logo")], logo));
    }
    files
}

fn check_own_files(project: &Project) -> Result<()> {
    named_files(project)
        .iter()
        .try_for_each(|(steps, path)| check_exists(project, steps, path))
}

/// See [`Project::files`].
pub(super) fn files(project: &Project) -> Vec<PathBuf> {
    let named = named_files(project).into_iter();
    named.flat_map(|(_, path)| files_of(path)).collect()
}

/// See [`Project::inputs`].
pub(super) fn inputs(project: &Project) -> Vec<PathBuf> {
    let mut inputs = vec![project.path.clone()];
    inputs.extend(files(project));
    for other in other_drives(project) {
        inputs.push(other.drive.project.clone());
        // An unreadable file is reported when it is needed.
        if let Ok(drive) = resolve::read(&other.drive.project) {
            inputs.extend(files(&drive));
        }
    }
    inputs
}

fn check_other(project: &Project, other: &Other<'_>) -> Result<()> {
    check_exists(project, &other.steps(), &other.drive.project)?;
    let drive = resolve::read(&other.drive.project)?;
    check_own_files(&drive)?;
    let unknown = drive
        .scanners
        .iter()
        .find(|theirs| project.scanners.iter().all(|ours| ours.name != theirs.name));
    let problem = if let Some(scanner) = unknown {
        format!(
            "the scanner {:?}, which this project does not calibrate",
            scanner.name
        )
    } else if drive.axes != project.axes {
        format!(
            "other body axes ({:?} instead of {:?})",
            drive.axes, project.axes
        )
    } else {
        return Ok(());
    };
    let what = match other.array {
        "drive" => "a drive",
        _ => "an evaluation",
    };
    let found = format!("{what} with {problem}");
    Err(other.error(project, found, "a drive of the same platform"))
}

/// Checks that no drive is adjusted twice, which would count its measurements twice, and that no
/// evaluated drive is also adjusted, which would test nothing.
fn check_distinct(project: &Project) -> Result<()> {
    // Every path has been read, so it has a canonical form.
    let canonical = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let mut adjusted = vec![canonical(&project.path)];
    for other in other_drives(project) {
        let path = canonical(&other.drive.project);
        let is_adjusted = adjusted.contains(&path);
        match other.array {
            "drive" if is_adjusted => {
                let found = format!("the drive {:?} twice", path.display().to_string());
                return Err(other.error(
                    project,
                    found,
                    "each drive once, including the project's own",
                ));
            }
            "drive" => adjusted.push(path),
            _ if is_adjusted => {
                let found = format!(
                    "an evaluation with {:?}, which is adjusted",
                    path.display().to_string()
                );
                return Err(other.error(project, found, "a drive that tests the result"));
            }
            _ => {}
        }
    }
    Ok(())
}

fn check_exists(project: &Project, steps: &[Step<'_>], path: &Path) -> Result<()> {
    let path = &file_of(path);
    if path.is_file() {
        return Ok(());
    }
    let mut key = String::new();
    for step in steps {
        match step {
            Step::Key(name) if key.is_empty() => key.push_str(name),
            Step::Key(name) => key = format!("{key}.{name}"),
            Step::Index(index) => key = format!("{key}[{index}]"),
        }
    }
    let what = if path.is_dir() {
        "a folder"
    } else {
        "no such file"
    };
    Err(Error::format(
        &project.path,
        line(project, steps),
        format!("{key} = {:?}: {what}", path.display().to_string()),
        "a file that exists (paths are relative to the project file)",
    ))
}

/// The line of a key, if the project file can still be read.
fn line(project: &Project, steps: &[Step<'_>]) -> Location {
    Source::read(&project.path).map_or(Location::Whole, |source| source.locate(steps))
}
