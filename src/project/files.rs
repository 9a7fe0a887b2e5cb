//! Are the files there that a project refers to?

use std::path::{Path, PathBuf};

use super::checked::{Evaluation, Motion, Project};
use super::resolve;
use super::source::{Source, Step};
use crate::error::{Error, Location, Result};
use crate::trajectory::PositionKind;

/// See [`Project::check_files`].
pub(super) fn check(project: &Project) -> Result<()> {
    own_files(project)?;
    project
        .evaluations
        .iter()
        .enumerate()
        .try_for_each(|(index, evaluation)| check_evaluation(project, index, evaluation))
}

/// Every file that the project reads itself, with the key that names it.
fn named(project: &Project) -> Vec<(Vec<Step<'static>>, &Path)> {
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
            let mut seen = [0; 2];
            for (log, settings) in logs.positions.iter().zip(&logs.settings.positions) {
                let (table, which) = match settings.kind {
                    PositionKind::Prism => ("prism", 0),
                    PositionKind::Gnss => ("gnss", 1),
                };
                let index = (count(settings.kind) > 1).then_some(Step::Index(seen[which]));
                seen[which] += 1;
                let mut steps = vec![Step::Key(table)];
                steps.extend(index);
                steps.push(Step::Key("file"));
                files.push((steps, &log.path));
            }
            if let Some(heading) = &logs.heading {
                files.push((file("heading"), &heading.path));
            }
        }
        Motion::Poses(poses) => files.push((file("trajectory"), &poses.path)),
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
    files
}

fn own_files(project: &Project) -> Result<()> {
    named(project)
        .iter()
        .try_for_each(|(steps, path)| present(project, steps, path))
}

/// See [`Project::inputs`].
pub(super) fn inputs(project: &Project) -> Vec<PathBuf> {
    let mut inputs = vec![project.path.clone()];
    inputs.extend(named(project).into_iter().map(|(_, path)| path.to_owned()));
    for evaluation in &project.evaluations {
        inputs.push(evaluation.project.clone());
        // What cannot be read is told where it is needed.
        if let Ok(drive) = resolve::read(&evaluation.project) {
            inputs.extend(named(&drive).into_iter().map(|(_, path)| path.to_owned()));
        }
    }
    inputs
}

fn check_evaluation(project: &Project, index: usize, evaluation: &Evaluation) -> Result<()> {
    let key = Step::Key("evaluation");
    let steps = [key, Step::Index(index), Step::Key("project")];
    present(project, &steps, &evaluation.project)?;
    let drive = resolve::read(&evaluation.project)?;
    own_files(&drive)?;
    let stranger = drive
        .scanners
        .iter()
        .find(|theirs| project.scanners.iter().all(|ours| ours.name != theirs.name));
    let problem = if let Some(scanner) = stranger {
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
    Err(Error::format(
        &project.path,
        line(project, &steps),
        format!("an evaluation with {problem}"),
        "a drive of the same platform",
    ))
}

fn present(project: &Project, steps: &[Step<'_>], path: &Path) -> Result<()> {
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

/// The line of a key, where the project's file is still there to tell.
fn line(project: &Project, steps: &[Step<'_>]) -> Location {
    Source::read(&project.path).map_or(Location::Whole, |source| source.locate(steps))
}
