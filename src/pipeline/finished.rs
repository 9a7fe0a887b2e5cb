//! Stages that a run has finished, kept beside its results: a run that was stopped, or one that changes only
//! what comes later, goes on from there.
//!
//! A stage is found by its name and its [`Key`]: a hash of the program, of the content of the files and of the
//! settings that its result follows from. What is kept appears whole and ends with a hash of itself; anything
//! else is not read.

use std::fmt::{self, Debug, Write};
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use twox_hash::xxhash3_128::Hasher;

use crate::error::{Error, Result};
use crate::output::Staging;
use crate::progress::Progress;
use crate::stored::Stored;

/// What the folder of finished stages adds to the name of that of the results.
const SUFFIX: &str = ".finished";
/// End of the name of a stage's value; that of a file that it wrote ends in the name of the file.
const VALUE: &str = "stage";
/// Digits of a key.
const DIGITS: usize = 32;

/// What the result of a stage follows from.
#[derive(Clone)]
pub struct Key(Hasher);

impl Key {
    /// That of this very program.
    pub fn of_program() -> Self {
        let mut hasher = Hasher::new();
        hasher.write(env!("BORESIGHT_SOURCES").as_bytes());
        Self(hasher)
    }

    /// And of this value, of which every digit counts.
    pub fn with(mut self, value: &impl Debug) -> Self {
        // Writing to a hasher cannot fail.
        let _ = writeln!(self, "{value:?}");
        self
    }
}

/// A key can be part of another.
impl Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:0DIGITS$x}", self.0.finish_128())
    }
}

impl Write for Key {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write(text.as_bytes());
        Ok(())
    }
}

/// The content of files, as one hash each.
pub struct Contents(Vec<(PathBuf, Option<u128>)>);

impl Contents {
    /// Reads the files once. One that cannot be read is that: the stage that needs it says so.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn read(mut files: Vec<PathBuf>, progress: &dyn Progress) -> Result<Self> {
        files.sort();
        files.dedup();
        let sizes = files
            .iter()
            .map(|path| path.metadata().map_or(0, |m| m.len()));
        let stage = progress.stage("comparing inputs with earlier runs", sizes.sum());
        let read = files.into_par_iter().map(|path| {
            let hash = match hash_of(&path, &|bytes| stage.advance(bytes)) {
                Err(Error::Cancelled) => return Err(Error::Cancelled),
                found => found.ok(),
            };
            Ok((path, hash))
        });
        Ok(Self(read.collect::<Result<_>>()?))
    }

    /// That of a file; `None` where it could not be read.
    pub fn of(&self, path: &Path) -> Option<u128> {
        let found = self.0.iter().find(|(own, _)| own == path);
        found.and_then(|(_, hash)| *hash)
    }
}

/// Hash of the content of a file.
fn hash_of(path: &Path, advance: &dyn Fn(u64) -> Result<()>) -> Result<u128> {
    const CHUNK: usize = 1 << 20;
    let mut file = File::open(path).map_err(|error| Error::io(path, error))?;
    let (mut hasher, mut chunk) = (Hasher::new(), vec![0; CHUNK]);
    loop {
        let count = file
            .read(&mut chunk)
            .map_err(|error| Error::io(path, error))?;
        if count == 0 {
            return Ok(hasher.finish_128());
        }
        hasher.write(&chunk[..count]);
        advance(count as u64)?;
    }
}

/// A stage that was finished.
pub struct Stage<T> {
    /// What it found.
    pub value: T,
    /// What it warned of.
    pub warnings: Vec<String>,
    /// How long it took.
    pub seconds: f64,
}

impl<T: Stored> Stored for Stage<T> {
    fn store(&self, bytes: &mut Vec<u8>) {
        self.value.store(bytes);
        self.warnings.store(bytes);
        self.seconds.store(bytes);
    }

    fn restore(bytes: &mut &[u8]) -> Option<Self> {
        Some(Self {
            value: T::restore(bytes)?,
            warnings: Stored::restore(bytes)?,
            seconds: Stored::restore(bytes)?,
        })
    }
}

/// The folder of finished stages.
pub struct Finished {
    folder: PathBuf,
    /// What this run found or wrote there.
    used: Vec<PathBuf>,
    /// The stages that it found.
    found: Vec<String>,
}

impl Finished {
    /// That of the results in `out`. With `fresh`, what it holds is removed.
    ///
    /// # Errors
    /// What it holds cannot be removed.
    pub fn beside(out: &Path, fresh: bool) -> Result<Self> {
        let mut folder = std::path::absolute(out).map_err(|error| Error::io(out, error))?;
        let mut name = folder.file_name().unwrap_or_default().to_owned();
        name.push(SUFFIX);
        folder.set_file_name(name);
        let own = Self {
            folder,
            used: Vec::new(),
            found: Vec::new(),
        };
        if fresh {
            own.remove_unused()?;
        }
        Ok(own)
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The stages that this run found.
    pub fn found(&self) -> &[String] {
        &self.found
    }

    fn name(stage: &str, key: &Key, end: &str) -> String {
        let hash = key.clone().with(&stage).0.finish_128();
        format!("{}-{hash:0DIGITS$x}.{end}", stage.replace(' ', "-"))
    }

    /// The result of a stage, if it was finished and every bit of it is there. The files that it wrote then
    /// appear under `paths`.
    pub fn find<T: Stored>(
        &mut self,
        stage: &str,
        key: &Key,
        paths: &[PathBuf],
    ) -> Option<Stage<T>> {
        let name = Self::name(stage, key, VALUE);
        let bytes = fs::read(self.folder.join(&name)).ok()?;
        let (mut content, hash) = bytes.split_last_chunk()?;
        if Hasher::oneshot(content).to_le_bytes() != *hash {
            return None;
        }
        let files: Vec<[u64; 2]> = Stored::restore(&mut content)?;
        let found = Stored::restore(&mut content)?;
        let kept = self.kept(stage, key, paths);
        let is_whole = content.is_empty() && files.len() == kept.len();
        let are = |(path, hash): (&PathBuf, &[u64; 2])| halves(path).is_ok_and(|own| own == *hash);
        if !is_whole || !kept.iter().zip(&files).all(are) {
            return None;
        }
        let linked = kept
            .iter()
            .zip(paths)
            .try_for_each(|(from, to)| link(from, to));
        if linked.is_err() {
            // What was linked must not be written through.
            paths.iter().for_each(|path| drop(fs::remove_file(path)));
            return None;
        }
        self.used.extend(kept);
        self.used.push(self.folder.join(name));
        self.found.push(stage.to_owned());
        Some(found)
    }

    /// Keeps the result of a stage and the files that it wrote.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn keep<T: Stored>(
        &mut self,
        stage: &str,
        key: &Key,
        found: &Stage<T>,
        paths: &[PathBuf],
    ) -> Result<()> {
        let staging = Staging::new(&self.folder, &[], &[] as &[&str])?;
        let kept = self.kept(stage, key, paths);
        let staged =
            |name: &Path| staging.path(&name.file_name().unwrap_or_default().to_string_lossy());
        for (path, kept) in paths.iter().zip(&kept) {
            let target = staged(kept);
            link(path, &target).map_err(|error| Error::io(&target, error))?;
        }
        let mut bytes = Vec::new();
        let files = paths.iter().map(|path| halves(path));
        files.collect::<Result<Vec<_>>>()?.store(&mut bytes);
        found.store(&mut bytes);
        bytes.extend_from_slice(&Hasher::oneshot(&bytes).to_le_bytes());
        let own = self.folder.join(Self::name(stage, key, VALUE));
        let path = staged(&own);
        fs::write(&path, &bytes).map_err(|error| Error::io(&path, error))?;
        staging.commit()?;
        self.used.extend(kept);
        self.used.push(own);
        Ok(())
    }

    /// Where files of a stage are kept.
    fn kept(&self, stage: &str, key: &Key, paths: &[PathBuf]) -> Vec<PathBuf> {
        let ends = paths
            .iter()
            .map(|path| path.file_name().unwrap_or_default().to_string_lossy());
        ends.map(|end| self.folder.join(Self::name(stage, key, &end)))
            .collect()
    }

    /// Removes what this run neither found nor wrote, and nothing that is not of its kind.
    ///
    /// # Errors
    /// A file cannot be removed.
    pub fn remove_unused(&self) -> Result<()> {
        for path in self.entries() {
            if !self.used.contains(&path) {
                fs::remove_file(&path).map_err(|error| Error::io(&path, error))?;
            }
        }
        Ok(())
    }

    /// Size of what is kept.
    pub fn bytes(&self) -> u64 {
        let files = self.entries().into_iter();
        files
            .map(|path| path.metadata().map_or(0, |m| m.len()))
            .sum()
    }

    /// What stages have left in the folder.
    fn entries(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let own = entries.filter(|entry| is_own(&entry.file_name().to_string_lossy()));
        own.map(|entry| entry.path()).collect()
    }
}

/// Whether a name is that of what a stage left: `stage-0123…cdef.end`.
fn is_own(name: &str) -> bool {
    let key = name
        .split_once('.')
        .and_then(|(stem, _)| stem.rsplit_once('-'));
    key.is_some_and(|(_, key)| key.len() == DIGITS && key.bytes().all(|b| b.is_ascii_hexdigit()))
}

/// Hash of the content of a file, in halves.
fn halves(path: &Path) -> Result<[u64; 2]> {
    let hash = hash_of(path, &|_| Ok(()))?;
    Ok([(hash >> 64) as u64, hash as u64])
}

/// The same file under another name; a copy where the file system has no such thing.
fn link(from: &Path, to: &Path) -> std::io::Result<()> {
    if fs::hard_link(from, to).is_ok() {
        return Ok(());
    }
    fs::copy(from, to).map(|_| ())
}
