//! Finished stages of a run, kept beside its results: a run that was stopped, or a run with changes that affect only
//! later stages, continues from them.
//!
//! A stage is found by its name and its [`Key`]: a hash of the program, of the contents of the files, and of the
//! settings on which its result depends. A file that does not hold a complete result is ignored. Files that a stage
//! wrote are kept as hard links.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::inputs::{Inputs, hash_of, size};
use super::kept;
use super::keys::{DIGITS, Key};
use crate::error::{Error, Result, unless_cancelled};
use crate::output::Staging;
use crate::progress::Progress;

/// Suffix that turns the name of the folder of results into that of the finished stages.
const SUFFIX: &str = ".finished";
/// Suffix of the names of kept files.
const END: &str = ".kept";

/// A stage that was finished.
#[derive(Serialize, Deserialize)]
pub struct Stage<T> {
    /// Its result.
    pub value: T,
    /// Its warnings.
    pub warnings: Vec<String>,
    /// Its duration.
    pub seconds: f64,
}

/// The folder of finished stages.
pub struct Finished {
    folder: PathBuf,
    /// The inputs on which its stages depend.
    inputs: Inputs,
    /// Whether stages of earlier runs are reused.
    reuses: bool,
    /// Whether stages are kept.
    keeps: bool,
    /// The files in the folder that this run reused or wrote.
    used: Vec<PathBuf>,
    /// The stages of earlier runs that this run reused.
    reused: Vec<String>,
}

impl Finished {
    /// The folder beside the results in `out`, a folder that exists; `None` if the path of `out` has no last name. With
    /// `fresh`, stages of earlier runs are ignored.
    pub fn beside(out: &Path, inputs: Inputs, fresh: bool) -> Option<Self> {
        // All paths to the folder of results give the same folder of stages.
        let mut folder = out.canonicalize().ok()?;
        let mut name = folder.file_name()?.to_owned();
        name.push(SUFFIX);
        folder.set_file_name(name);
        Some(Self {
            folder,
            inputs,
            reuses: !fresh,
            keeps: true,
            used: Vec::new(),
            reused: Vec::new(),
        })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The stages of earlier runs that this run reused.
    pub fn reused(&self) -> &[String] {
        &self.reused
    }

    /// The result of a stage, if it was finished and its files are complete. The files that the stage wrote then appear
    /// under `paths`.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn find<T: DeserializeOwned>(
        &mut self,
        stage: &str,
        key: &Key,
        paths: &[PathBuf],
        progress: &dyn Progress,
    ) -> Result<Option<Stage<T>>> {
        let place = self.place(stage, key, "");
        if !self.reuses {
            return Ok(None);
        }
        let Ok((hashes, finished)) = kept::read::<(Vec<u128>, _)>(&place) else {
            return Ok(None);
        };
        let places = self.places(stage, key, paths);
        if hashes.len() != places.len() {
            return Ok(None);
        }
        for (file, hash) in places.iter().zip(&hashes) {
            if unless_cancelled(hash_with_progress(file, progress))? != Some(*hash) {
                return Ok(None);
            }
        }
        let pairs = places.iter().zip(paths);
        if pairs
            .map(|(from, to)| fs::hard_link(from, to))
            .any(|linked| linked.is_err())
        {
            // The stage must not write through a link that was already made.
            paths.iter().for_each(|path| drop(fs::remove_file(path)));
            return Ok(None);
        }
        self.used.extend(places);
        self.used.push(place);
        self.reused.push(stage.to_owned());
        Ok(Some(finished))
    }

    /// Keeps the result of a stage and the files that it wrote. If hard links are not possible, nothing is kept: a copy
    /// of the clouds would take as much space.
    ///
    /// # Errors
    /// The folder cannot be written; [`Error::Cancelled`].
    pub fn keep<T: Serialize>(
        &mut self,
        stage: &str,
        key: &Key,
        finished: &Stage<T>,
        paths: &[PathBuf],
        progress: &dyn Progress,
    ) -> Result<()> {
        // A result of changed inputs must not be kept under the hash of their former content.
        if !self.keeps || self.inputs.changed().is_some() {
            return Ok(());
        }
        let staging = Staging::new(&self.folder, &[], &[] as &[&str])?;
        let staged = |place: &Path| {
            let name = place.file_name().unwrap_or_default();
            staging.path(&name.to_string_lossy())
        };
        let places = self.places(stage, key, paths);
        for (path, place) in paths.iter().zip(&places) {
            if fs::hard_link(path, staged(place)).is_err() {
                return Ok(());
            }
        }
        let hashes = paths.iter().map(|path| hash_with_progress(path, progress));
        let hashes: Vec<u128> = hashes.collect::<Result<_>>()?;
        let bytes = kept::bytes_of(&(hashes, finished))?;
        let place = self.place(stage, key, "");
        let path = staged(&place);
        fs::write(&path, bytes).map_err(|error| Error::io(&path, error))?;
        staging.commit()?;
        self.used.extend(places);
        self.used.push(place);
        Ok(())
    }

    /// Whether this run kept or reused a stage.
    pub fn has_stages(&self) -> bool {
        !self.used.is_empty()
    }

    /// Stops keeping stages.
    pub fn stop_keeping(&mut self) {
        self.keeps = false;
    }

    /// A file that changed since the run began, if there is one.
    pub fn changed_input(&self) -> Option<&Path> {
        self.inputs.changed()
    }

    /// Removes kept files that this run neither reused nor wrote, and no others. Files that cannot be removed stay.
    pub fn remove_unused(&self) {
        let unused = self.entries().into_iter();
        for path in unused.filter(|path| !self.used.contains(path)) {
            drop(fs::remove_file(path));
        }
    }

    /// Total size of the kept files, bytes.
    pub fn bytes(&self) -> u64 {
        let files = self.entries().into_iter();
        files.map(|path| size(&path)).sum()
    }

    /// The path of the kept result of a stage, or of a file of this name that it wrote.
    fn place(&self, stage: &str, key: &Key, file: &str) -> PathBuf {
        let stage = stage.replace(' ', "-");
        let dot = if file.is_empty() { "" } else { "." };
        self.folder.join(format!("{stage}-{key}{dot}{file}{END}"))
    }

    fn places(&self, stage: &str, key: &Key, paths: &[PathBuf]) -> Vec<PathBuf> {
        let names = paths
            .iter()
            .map(|path| path.file_name().unwrap_or_default());
        names
            .map(|name| self.place(stage, key, &name.to_string_lossy()))
            .collect()
    }

    /// The files of kept stages in the folder.
    fn entries(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let kept = entries.filter(|entry| is_kept(&entry.file_name()));
        kept.map(|entry| entry.path()).collect()
    }
}

/// Hash of the content of a file, with progress.
fn hash_with_progress(path: &Path, progress: &dyn Progress) -> Result<u128> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let stage = progress.stage(&format!("checking {name}"), size(path));
    hash_of(path, &|bytes| stage.advance(bytes))
}

/// Whether a name is that of a kept file: `stage-0123…cdef.kept` or `stage-0123…cdef.cloud.laz.kept`.
fn is_kept(name: &OsStr) -> bool {
    let name = name.to_string_lossy();
    let Some(stem) = name
        .strip_suffix(END)
        .and_then(|name| name.split('.').next())
    else {
        return false;
    };
    let key = stem.rsplit_once('-').map_or("", |(_, key)| key);
    let is_digit = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
    key.len() == DIGITS && key.bytes().all(is_digit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_kept_files_are_recognised() {
        let key = "0123456789abcdef0123456789abcdef";
        let is_kept = |name: &str| is_kept(OsStr::new(name));
        assert!(is_kept(&format!("calibrate-{key}.kept")));
        assert!(is_kept(&format!("georeference-{key}.cloud-a.laz.kept")));
        for name in [
            format!("scan-{key}.laz"),
            format!("scan-{}.kept", key.to_uppercase()),
            format!("scan-{}.kept", &key[1..]),
            format!("{key}.kept"),
            "notes.kept".to_owned(),
            ".kept".to_owned(),
        ] {
            assert!(!is_kept(&name), "{name}");
        }
    }
}
