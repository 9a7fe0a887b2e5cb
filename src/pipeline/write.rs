//! Writes the results of a run. A file that cannot be written does not keep back the others.

use serde_json::json;

use super::findings::{Extras, Findings};
use super::job::Job;
use super::open_project::OpenProject;
use super::{calibrated, kept_page, page, result, stages};
use crate::error::Result;
use crate::project::Project;
use crate::report::{self, Content, csv};
use crate::results::Drive;

/// Results other than the clouds.
pub const RESULTS: [&str; 7] = [
    "trajectory.csv",
    "mounting.csv",
    "calibration.toml",
    "project.toml",
    "report.html",
    kept_page::NAME,
    "result.json",
];

/// Writes all results except the clouds, which the stage that makes them writes. `ended` is how the stages ended.
///
/// # Errors
/// The first file that cannot be written.
pub fn all(
    project: &OpenProject,
    findings: &Findings,
    extras: &Extras,
    ended: &Result<()>,
    job: &Job<'_>,
) -> Result<()> {
    let mut outcome = calibrated::write(project, findings, job);
    if let Some(drive) = findings.drives.first() {
        outcome = outcome.and(trajectory(project, drive, job));
    }
    let text = project
        .as_used()
        .to_toml_with_scales(&findings.rig.voxel_sizes_m);
    outcome = outcome.and(text.and_then(|text| job.write("project.toml", text)));
    let content = page::content(project, findings, extras);
    outcome = outcome.and(content.and_then(|content| page(content, project, job)));
    let mut document = result::document(findings);
    if let Err(error) = ended {
        document["error"] = json!(error.to_string());
    }
    outcome.and(job.write("result.json", format!("{document:#}\n")))
}

/// Writes the poses of a drive.
///
/// # Errors
/// The file cannot be written.
pub fn trajectory(project: &OpenProject, drive: &Drive, job: &Job<'_>) -> Result<()> {
    const NAME: &str = "trajectory.csv";
    let written = stages::write_trajectory(&job.path(NAME), &drive.poses, &project.origin_m());
    written.inspect_err(|_| job.discard(NAME))
}

/// Writes the page, its tables, and the file from which it is made again.
///
/// # Errors
/// The first file that cannot be written.
pub fn page(mut content: Content<'_>, project: &Project, job: &Job<'_>) -> Result<()> {
    let mut outcome = Ok(());
    for file in &csv::FILES {
        let text = file.text(&content);
        if text.is_empty() {
            continue;
        }
        match job.write(&format!("{}/{}", csv::FOLDER, file.name), text) {
            Ok(()) => content.csv.push(file.name.to_owned()),
            Err(error) => outcome = outcome.and(Err(error)),
        }
    }
    outcome = outcome.and(job.write("report.html", report::render(&content)));
    let bytes = kept_page::bytes_of(&content, &project.path);
    outcome.and(bytes.and_then(|bytes| job.write(kept_page::NAME, bytes)))
}
