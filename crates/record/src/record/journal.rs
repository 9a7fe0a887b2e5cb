//! Files of a recording: they only grow, and all data older than a second or two are on the disk.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::clock::Stamp;
use crate::error::{Error, Result};

/// Longest time for which data stay in the program before they are written: a kill loses no more than that.
const WRITE: Duration = Duration::from_millis(200);
/// Bytes that are written at once, even before that time.
const PENDING: usize = 1 << 16;
/// Time between two syncs: a power cut loses no more than that.
const SYNC: Duration = Duration::from_secs(1);

/// Syncs files to the disk on a separate thread: a disk that is busy for a while must not keep a sensor waiting.
#[derive(Debug, Default)]
pub struct Disk {
    files: Mutex<Vec<(PathBuf, Arc<File>)>>,
    failed: Mutex<Option<String>>,
}

impl Disk {
    /// Syncs all files once a second until `stop` is set.
    pub fn sync_until(&self, stop: &AtomicBool) {
        let mut last = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20));
            if last.elapsed() < SYNC {
                continue;
            }
            last = Instant::now();
            let files = locked(&self.files).clone();
            for (path, file) in files {
                if let Err(error) = file.sync_data() {
                    let problem = format!("{}: {error}", path.display());
                    locked(&self.failed).get_or_insert(problem);
                }
            }
        }
    }

    /// Returns the first failure to sync a file.
    fn check(&self) -> Result<()> {
        match locked(&self.failed).clone() {
            Some(problem) => Err(Error::data(
                problem,
                "check the disk: the recording has ended",
            )),
            None => Ok(()),
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file that grows by whole records: bytes appended in one call are written in one call.
#[derive(Debug)]
pub struct Journal<'a> {
    disk: &'a Disk,
    path: PathBuf,
    file: Arc<File>,
    pending: Vec<u8>,
    written: Instant,
    bytes: u64,
}

impl<'a> Journal<'a> {
    /// Creates a new file.
    ///
    /// # Errors
    /// A file that exists already or cannot be written.
    pub fn create(path: &Path, disk: &'a Disk) -> Result<Self> {
        let file = File::create_new(path).map_err(|error| Error::io(path, error))?;
        let file = Arc::new(file);
        locked(&disk.files).push((path.to_owned(), Arc::clone(&file)));
        Ok(Self {
            disk,
            path: path.to_owned(),
            file,
            pending: Vec::new(),
            written: Instant::now(),
            bytes: 0,
        })
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// The file cannot be written, or some file of the recording could not be synced.
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.add(bytes);
        self.write_if_due()
    }

    /// Writes pending bytes if that is due; must also be called regularly while nothing arrives.
    ///
    /// # Errors
    /// See [`Self::append`].
    pub fn write_if_due(&mut self) -> Result<()> {
        if !self.is_due() {
            return Ok(());
        }
        self.disk.check()?;
        self.write()
    }

    fn add(&mut self, bytes: &[u8]) {
        self.pending.extend_from_slice(bytes);
        self.bytes += bytes.len() as u64;
    }

    fn is_due(&self) -> bool {
        self.pending.len() >= PENDING || self.written.elapsed() >= WRITE
    }

    /// Writes pending bytes, and syncs the file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        self.write()?;
        let synced = self.file.sync_data();
        synced.map_err(|error| Error::io(&self.path, error))
    }

    fn write(&mut self) -> Result<()> {
        self.written = Instant::now();
        let written = (&*self.file).write_all(&self.pending);
        self.pending.clear();
        written.map_err(|error| Error::io(&self.path, error))
    }

    /// Length of the file with pending bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// The bytes that a sensor sent, and a second file with their times of arrival.
#[derive(Debug)]
pub struct StampedJournal<'a> {
    data: Journal<'a>,
    stamps: Journal<'a>,
}

impl<'a> StampedJournal<'a> {
    /// Creates `name.extension` and `name.stamps.csv` in a folder.
    ///
    /// # Errors
    /// One of them exists already or cannot be written.
    pub fn create(folder: &Path, name: &str, extension: &str, disk: &'a Disk) -> Result<Self> {
        let mut stamps = Journal::create(&folder.join(format!("{name}.stamps.csv")), disk)?;
        stamps.append(b"bytes_before,monotonic_s,unix_s\n")?;
        Ok(Self {
            data: Journal::create(&folder.join(format!("{name}.{extension}")), disk)?,
            stamps,
        })
    }

    /// Appends bytes that arrived.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn append(&mut self, bytes: &[u8], at: Stamp) -> Result<()> {
        let (before, monotonic_s, unix_s) = (self.data.bytes(), at.monotonic_s(), at.unix_s());
        let row = format!("{before},{monotonic_s:.6},{unix_s:.6}\n");
        self.stamps.add(row.as_bytes());
        self.data.add(bytes);
        self.write_if_due()
    }

    /// See [`Journal::write_if_due`]. Times of arrival are written before their bytes, so that a kill leaves no bytes
    /// without a time.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write_if_due(&mut self) -> Result<()> {
        if !(self.stamps.is_due() || self.data.is_due()) {
            return Ok(());
        }
        self.data.disk.check()?;
        self.stamps.write()?;
        self.data.write()
    }

    /// See [`Journal::flush`].
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        self.stamps.flush()?;
        self.data.flush()
    }
}
