//! The contents of the files that a run reads, as hashes.

use std::collections::BTreeMap;
use std::fs::{File, Metadata};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rayon::prelude::*;
use twox_hash::xxhash3_128::Hasher;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::report::content::InputFile;

/// Files, with hashes of their contents when the run began.
#[derive(Default)]
pub struct Inputs(BTreeMap<PathBuf, Option<Content>>);

/// The content of a file, with the properties by which a change is detected.
struct Content {
    hash: u128,
    properties: Properties,
}

/// Size, modification time, and on Unix also the time of the last status change and the inode.
type Properties = (u64, Option<SystemTime>, [i64; 3]);

impl Inputs {
    /// Reads the files once. A file that cannot be read is recorded as such: the stage that needs it reports the error.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn read(files: Vec<PathBuf>, progress: &dyn Progress) -> Result<Self> {
        let sizes = files.iter().map(|path| size(path));
        let stage = progress.stage("comparing inputs with earlier runs", sizes.sum());
        let read = files.into_par_iter().map(|path| {
            // The properties are read first, because the content may change while it is read.
            let before = path.metadata().ok().map(|metadata| properties(&metadata));
            let hash = hash_of(&path, &|bytes| stage.advance(bytes));
            let content = match (before, hash) {
                (_, Err(Error::Cancelled)) => return Err(Error::Cancelled),
                (Some(properties), Ok(hash)) => Some(Content { hash, properties }),
                _ => None,
            };
            Ok((path, content))
        });
        Ok(Self(read.collect::<Result<_>>()?))
    }

    /// The hash of the content of a file; `None` if it could not be read.
    pub fn hash(&self, path: &Path) -> Option<u128> {
        let content = self.0.get(path)?;
        content.as_ref().map(|content| content.hash)
    }

    /// The files in the order of their names.
    pub fn files(&self) -> Vec<InputFile> {
        let files = self.0.iter().map(|(path, content)| InputFile {
            path: path.display().to_string(),
            bytes: content.as_ref().map_or(0, |content| content.properties.0),
            xxh128: content.as_ref().map(|content| content.hash),
        });
        files.collect()
    }

    /// A file that changed since the run began, if there is one.
    pub fn changed(&self) -> Option<&Path> {
        let changed = self.0.iter().find(|(path, content)| {
            let now = path.metadata().ok().map(|metadata| properties(&metadata));
            let before = content.as_ref().map(|content| content.properties);
            before.is_some() && now != before
        });
        changed.map(|(path, _)| path.as_path())
    }
}

fn properties(metadata: &Metadata) -> Properties {
    #[cfg(unix)]
    let more = {
        use std::os::unix::fs::MetadataExt;
        [
            metadata.ctime(),
            metadata.ctime_nsec(),
            metadata.ino().cast_signed(),
        ]
    };
    #[cfg(not(unix))]
    let more = [0; 3];
    (metadata.len(), metadata.modified().ok(), more)
}

/// Size of a file, 0 if it cannot be determined.
pub fn size(path: &Path) -> u64 {
    path.metadata().map_or(0, |metadata| metadata.len())
}

/// Hash of the content of a file; `advance` gets the number of bytes of each step.
///
/// # Errors
/// The file cannot be read; errors of `advance`.
pub fn hash_of(path: &Path, advance: &dyn Fn(u64) -> Result<()>) -> Result<u128> {
    const CHUNK: usize = 1 << 20;
    let failed = |error| Error::io(path, error);
    // Opening a pipe would block until another process writes to it.
    if !path.metadata().map_err(failed)?.is_file() {
        return Err(failed(std::io::ErrorKind::InvalidInput.into()));
    }
    let mut file = File::open(path).map_err(failed)?;
    let (mut hasher, mut chunk) = (Hasher::new(), vec![0; CHUNK]);
    loop {
        let count = file.read(&mut chunk).map_err(failed)?;
        if count == 0 {
            return Ok(hasher.finish_128());
        }
        hasher.write(&chunk[..count]);
        advance(count as u64)?;
    }
}
