//! What a command works with: staged results, a stopwatch, progress and warnings.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::error::{Error, Result};
use crate::output::Staging;
use crate::progress::{Progress, StageSeconds};

/// One command at work. Its results appear with [`Job::commit`], all or none.
pub struct Job<'a> {
    staging: Staging,
    progress: &'a dyn Progress,
    stages: Vec<StageSeconds>,
    warnings: Vec<String>,
}

impl<'a> Job<'a> {
    /// Begins to stage the results `names` of the files `inputs` for the folder `out`, which is
    /// created where it is missing.
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

    /// Runs `work` and notes how long it took under `name`.
    ///
    /// # Errors
    /// Those of `work`; [`Error::Cancelled`].
    pub fn timed<T>(
        &mut self,
        name: &str,
        work: impl FnOnce(&dyn Progress) -> Result<T>,
    ) -> Result<T> {
        self.progress.check()?;
        let started = Instant::now();
        let done = work(self.progress)?;
        self.stages.push(StageSeconds {
            name: name.into(),
            seconds: started.elapsed().as_secs_f64(),
        });
        Ok(done)
    }

    /// As [`Self::timed`], and shown as a stage around those of `work`: for what runs again.
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

    /// Says what somebody should look at, and keeps it.
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

    /// Where to write what shall become `name` in the folder of the results.
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

    /// Makes all results appear.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; a file cannot be flushed or renamed.
    pub fn commit(self) -> Result<()> {
        self.progress.check()?;
        self.staging.commit()
    }
}
