//! The job of a command: staged results, a stopwatch, progress and warnings.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::output::Staging;
use crate::progress::{Progress, StageSeconds};

/// A running command. Its results appear with [`Job::commit`], all or none.
pub struct Job<'a> {
    staging: Staging,
    progress: &'a dyn Progress,
    stages: Vec<StageSeconds>,
    warnings: Vec<String>,
}

impl<'a> Job<'a> {
    /// Starts a job that reads `inputs` and writes results with these `names` to the folder `out`,
    /// which is created if it is missing.
    ///
    /// # Errors
    /// The folder cannot be created or written; a result would replace an input.
    pub fn new(
        out: &Path,
        inputs: &[PathBuf],
        names: &[impl AsRef<Path>],
        progress: &'a dyn Progress,
    ) -> Result<Self> {
        Ok(Self {
            staging: Staging::new(out, inputs, names)?,
            progress,
            stages: Vec::new(),
            warnings: Vec::new(),
        })
    }

    /// Runs `work` and records its run time under `name`, and its warnings.
    ///
    /// # Errors
    /// Errors of `work`; [`Error::Cancelled`].
    pub fn timed<T>(
        &mut self,
        name: &str,
        work: impl FnOnce(&dyn Progress) -> Result<T>,
    ) -> Result<T> {
        self.progress.check()?;
        let started = Instant::now();
        let listener = Listener {
            progress: self.progress,
            heard: Mutex::default(),
        };
        let done = work(&listener)?;
        for warning in listener.heard.into_inner().unwrap_or_default() {
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
        self.stages.push(StageSeconds {
            name: name.into(),
            seconds: started.elapsed().as_secs_f64(),
        });
        Ok(done)
    }

    /// As [`Self::timed`], and shown as a stage around those of `work`, for work that runs again.
    ///
    /// # Errors
    /// As for [`Self::timed`].
    pub fn shown<T>(
        &mut self,
        name: &str,
        work: impl FnOnce(&dyn Progress) -> Result<T>,
    ) -> Result<T> {
        let _stage = self.progress.stage(name, 0);
        self.timed(name, work)
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

    /// Writes the text file `name`.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, name: &str, text: &str) -> Result<()> {
        let path = self.path(name);
        std::fs::write(&path, text).map_err(|error| Error::io(&path, error))
    }

    /// Moves all results to their folder.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; a file cannot be flushed or renamed.
    pub fn commit(self) -> Result<()> {
        self.progress.check()?;
        self.staging.commit()
    }
}

/// Passes everything on and keeps the warnings.
struct Listener<'a> {
    progress: &'a dyn Progress,
    heard: Mutex<Vec<String>>,
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
        if let Ok(mut heard) = self.heard.lock() {
            heard.push(message.to_owned());
        }
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}
