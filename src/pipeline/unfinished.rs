//! A run that ends early keeps and shows what it has computed.

use std::path::Path;

use super::findings::{Extras, Findings};
use super::job::Job;
use super::open_project::OpenProject;
use super::{page, summary, write};
use crate::error::{Error, Result};
use crate::judgement;
use crate::progress::Progress;
use crate::results;

/// The results that a run was to write.
pub struct Results<'a> {
    /// Their folder.
    pub out: &'a Path,
    /// Their names.
    pub names: &'a [String],
    /// Where messages appear.
    pub progress: &'a dyn Progress,
}

impl Results<'_> {
    /// Keeps the trajectory of a run whose calibration failed, without a `result.json`, which has a calibration; returns
    /// the error with which it failed.
    pub fn of_trajectory(
        &self,
        project: &OpenProject,
        extras: &Extras,
        drive: &results::Drive,
        error: Error,
        job: Job<'_>,
    ) -> Error {
        if matches!(error, Error::Cancelled) {
            return error;
        }
        let drives = std::slice::from_ref(drive);
        let mut verdicts = judgement::judge(
            &results::Results {
                drives,
                ..results::Results::default()
            },
            &project.acceptance,
        );
        verdicts.push(judgement::ended_early(&error));
        judgement::attention_first(&mut verdicts);
        let content = page::trajectory(project, drives, extras.command.clone());
        let written = content.and_then(|mut content| {
            content.verdicts = verdicts;
            write::page(content, project, &job)
        });
        let written = written.and(write::trajectory(project, drive, &job));
        let solution = drive.solution.as_ref();
        show(&summary::trajectory(solution, &drive.poses), self.progress);
        self.keep(written, error, job)
    }

    /// Keeps the results of a run of which a stage after the calibration failed; returns the error with which it failed.
    pub fn of_calibration(&self, findings: &Findings, error: Error, job: Job<'_>) -> Error {
        let error = self.keep(Ok(()), error, job);
        shown(findings, error, self.progress)
    }

    /// Keeps the clouds of a placement that failed for one of several scanners; returns the error with which it failed.
    pub fn of_clouds(&self, error: Error, job: Job<'_>) -> Error {
        if matches!(error, Error::Cancelled) {
            return error;
        }
        self.keep_with(Ok(()), error, job, "")
    }

    fn keep(&self, written: Result<()>, error: Error, job: Job<'_>) -> Error {
        let next = if job.can_go_on() {
            "; the same command goes on from there"
        } else {
            ""
        };
        self.keep_with(written, error, job, next)
    }

    /// Keeps what is written, and names it together with what happens `next`.
    fn keep_with(&self, written: Result<()>, error: Error, job: Job<'_>, next: &str) -> Error {
        let written_names = job.written(self.names);
        let kept = written.and(job.commit_unfinished());
        let folder = self.out.display();
        let is_there = |name: &&&str| self.out.join(name).is_file();
        let names: Vec<&str> = written_names.iter().filter(is_there).copied().collect();
        if !names.is_empty() {
            self.progress.warn(&format!(
                "what the run computed before is in {folder}: {}{next}",
                names.join(", ")
            ));
        }
        let others = self.names.iter().map(String::as_str);
        let others = others.filter(|name| !names.contains(name));
        let earlier: Vec<&str> = others.filter(|name| is_there(&name)).collect();
        if !earlier.is_empty() {
            self.progress.warn(&format!(
                "left in {folder} by an earlier run: {}",
                earlier.join(", ")
            ));
        }
        if let Err(error) = kept {
            self.progress
                .warn(&format!("not everything could be kept: {error}"));
        }
        error
    }
}

/// Shows the values of a run that failed; returns the error with which it failed.
pub fn shown(findings: &Findings, error: Error, progress: &dyn Progress) -> Error {
    if !matches!(error, Error::Cancelled) {
        show(&summary::calibration(findings), progress);
    }
    error
}

/// A message would appear only in the log, and what a run could not write is nowhere else.
fn show(values: &str, progress: &dyn Progress) {
    progress.warn(&format!("the run ends early, with these values:\n{values}"));
}
