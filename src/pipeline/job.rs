//! The job of a command: staged results, a stopwatch, progress and warnings.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::finished::{Finished, Stage};
use super::keys::Key;
use super::outcome::Options;
use crate::error::{Error, Result};
use crate::output::Staging;
use crate::progress::{EachPoint, Progress, StageSeconds};

/// A running command. Its results appear with [`Job::commit`].
pub struct Job<'a> {
    staging: Staging,
    progress: &'a dyn Progress,
    finished: Option<Finished>,
    stages: Vec<StageSeconds>,
    warnings: Vec<String>,
}

impl<'a> Job<'a> {
    /// Starts a job that reads `inputs` and writes results with these `names` to the folder of the options,
    /// which is created if it is missing.
    ///
    /// # Errors
    /// Those of [`Options::staging`].
    pub fn new(
        options: &Options,
        inputs: &[PathBuf],
        names: &[impl AsRef<Path>],
        progress: &'a dyn Progress,
    ) -> Result<Self> {
        Ok(Self {
            staging: options.staging(inputs, names)?,
            progress,
            finished: None,
            stages: Vec::new(),
            warnings: Vec::new(),
        })
    }

    /// A job whose stages are kept for other runs, if they can be kept.
    pub fn with_finished(mut self, finished: Option<Finished>) -> Self {
        self.finished = finished;
        self
    }

    /// Warns of a file that changed since the job began, because some stages may have read its former content and
    /// others the new one.
    pub fn warn_of_changes(&mut self) {
        let changed = self.finished.as_ref().and_then(Finished::changed_input);
        if let Some(path) = changed {
            let file = path.display();
            self.warn(format!(
                "{file} changed during this run: the results may mix its former and its new content, run again"
            ));
        }
    }

    /// Runs `work` and records its run time, under `name`, and its warnings.
    ///
    /// # Errors
    /// Errors of `work`; [`Error::Cancelled`].
    pub fn timed<T>(
        &mut self,
        name: &str,
        work: impl FnOnce(&dyn Progress) -> Result<T>,
    ) -> Result<T> {
        let stage = run(self.progress, work)?;
        Ok(self.conclude(name, stage))
    }

    /// As [`Self::timed`], unless an earlier run finished this stage from the same inputs: then the kept result and
    /// warnings are used.
    ///
    /// # Errors
    /// As for [`Self::timed`].
    pub fn once<T: Serialize + DeserializeOwned>(
        &mut self,
        name: &str,
        key: &Key,
        work: impl FnOnce(&dyn Progress) -> Result<T>,
    ) -> Result<T> {
        self.once_writing(name, &[], key, work)
    }

    /// As [`Self::once`], for a stage that writes results of these names.
    ///
    /// # Errors
    /// As for [`Self::timed`].
    pub fn once_writing<T: Serialize + DeserializeOwned>(
        &mut self,
        name: &str,
        results: &[String],
        key: &Key,
        work: impl FnOnce(&dyn Progress) -> Result<T>,
    ) -> Result<T> {
        let paths: Vec<PathBuf> = results.iter().map(|result| self.path(result)).collect();
        let progress = self.progress;
        if let Some(finished) = &mut self.finished
            && let Some(stage) = finished.find(name, key, &paths, progress)?
        {
            progress.say(&format!("{name}: finished in an earlier run"));
            stage.warnings.iter().for_each(|text| progress.warn(text));
            return Ok(self.conclude(name, stage));
        }
        let stage = run(progress, work)?;
        if let Some(finished) = &mut self.finished {
            match finished.keep(name, key, &stage, &paths, progress) {
                Ok(()) => {}
                Err(Error::Cancelled) => return Err(Error::Cancelled),
                // The results do not depend on keeping a stage. A smaller one may still find room.
                Err(error) if is_full(&error) => {
                    progress.warn(&format!("the stage `{name}` is not kept: {error}"));
                }
                Err(error) => {
                    progress.warn(&format!("finished stages are no longer kept: {error}"));
                    finished.stop_keeping();
                }
            }
        }
        Ok(self.conclude(name, stage))
    }

    /// Whether another run with the same inputs and settings goes on from a stage of this one.
    pub fn can_go_on(&self) -> bool {
        self.finished.as_ref().is_some_and(Finished::has_stages)
    }

    /// Records a stage's time and warnings.
    fn conclude<T>(&mut self, name: &str, stage: Stage<T>) -> T {
        for warning in stage.warnings {
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
        self.stages.push(StageSeconds {
            name: name.into(),
            seconds: stage.seconds,
        });
        stage.value
    }

    /// Shows a warning and keeps it.
    pub fn warn(&mut self, message: String) {
        self.progress.warn(&message);
        self.warnings.push(message);
    }

    /// Run times so far, in order.
    pub fn stages(&self) -> &[StageSeconds] {
        &self.stages
    }

    /// Warnings so far, in order.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The path for writing the result `name`, until it is committed.
    pub fn path(&self, name: &str) -> PathBuf {
        self.staging.path(name)
    }

    /// Writes the file `name`.
    ///
    /// # Errors
    /// The file cannot be written; there is then no such result.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<()> {
        let path = self.path(name);
        let written = std::fs::write(&path, bytes).map_err(|error| Error::io(&path, error));
        written.inspect_err(|_| self.discard(name))
    }

    /// Removes a result that is not complete, so that it does not appear.
    pub fn discard(&self, name: &str) {
        // Nothing more can be done for a file that cannot be removed.
        let _ = std::fs::remove_file(self.path(name));
    }

    /// The names of those of these results that are written.
    pub fn written<'n>(&self, names: &'n [String]) -> Vec<&'n str> {
        let names = names.iter().map(String::as_str);
        names.filter(|name| self.path(name).is_file()).collect()
    }

    /// Moves the results of a run that failed to their folder. All kept stages remain, as the run did not come to all of
    /// them.
    ///
    /// # Errors
    /// As for [`Self::commit`].
    pub fn commit_unfinished(self) -> Result<()> {
        self.progress.check()?;
        self.staging.commit()
    }

    /// Moves all results to their folder, removes unused kept stages, and returns the kept stages.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; a file cannot be flushed or renamed, and the others are in place.
    pub fn commit(self) -> Result<Option<Finished>> {
        self.progress.check()?;
        self.staging.commit()?;
        if let Some(finished) = &self.finished {
            finished.remove_unused();
        }
        Ok(self.finished)
    }
}

/// Whether there was no room for a file.
fn is_full(error: &Error) -> bool {
    use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull, WriteZero};
    let Error::Io { source, .. } = error else {
        return false;
    };
    [StorageFull, FileTooLarge, QuotaExceeded, WriteZero].contains(&source.kind())
}

/// Runs the work of a stage.
fn run<T>(
    progress: &dyn Progress,
    work: impl FnOnce(&dyn Progress) -> Result<T>,
) -> Result<Stage<T>> {
    progress.check()?;
    let started = Instant::now();
    let listener = Listener {
        progress,
        warnings: Mutex::default(),
    };
    let value = work(&listener)?;
    Ok(Stage {
        value,
        warnings: listener.warnings.into_inner().unwrap_or_default(),
        seconds: started.elapsed().as_secs_f64(),
    })
}

/// Forwards all progress and keeps the warnings.
struct Listener<'a> {
    progress: &'a dyn Progress,
    warnings: Mutex<Vec<String>>,
}

impl Progress for Listener<'_> {
    fn begin(&self, stage: &str, total: u64) {
        self.progress.begin(stage, total);
    }

    fn advance(&self, units: u64) {
        self.progress.advance(units);
    }

    fn end(&self) {
        self.progress.end();
    }

    fn say(&self, message: &str) {
        self.progress.say(message);
    }

    fn warn(&self, message: &str) {
        self.progress.warn(message);
        if let Ok(mut warnings) = self.warnings.lock() {
            warnings.push(message.to_owned());
        }
    }

    fn verdict(&self, text: &str) {
        self.progress.verdict(text);
    }

    fn clouds(&self, moment: &str, names: &[&str], points: &EachPoint<'_>) {
        self.progress.clouds(moment, names, points);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}

#[cfg(test)]
mod tests;
