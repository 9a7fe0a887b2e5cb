//! Files of a recording: they only grow, and what is older than a second or two is on the disk.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::clock::Stamp;
use crate::error::{Error, Result};

/// Longest time before what arrived is handed to the system, so that a kill loses no more.
const WRITE: Duration = Duration::from_millis(200);
/// Bytes that are handed to it before that.
const PENDING: usize = 1 << 16;
/// Time between two syncs, so that a power cut loses no more.
const SYNC: Duration = Duration::from_secs(1);

/// The disk, on which files are brought by a thread of its own: a disk that is busy for a while must not keep a sensor
/// waiting.
#[derive(Debug, Default)]
pub struct Disk {
    files: Mutex<Vec<(PathBuf, Arc<File>)>>,
    failed: Mutex<Option<String>>,
}

impl Disk {
    /// Brings all files to the disk once a second until `stop`.
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

    /// The first file that could not be brought to the disk.
    fn check(&self) -> Result<()> {
        match locked(&self.failed).clone() {
            Some(problem) => Err(Error::data(
                problem,
                "look at the disk: the recording has ended",
            )),
            None => Ok(()),
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file that grows by whole records: what is appended at once is written at once.
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
    /// Begins a file that is not there yet.
    ///
    /// # Errors
    /// It is there, or cannot be written.
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
    /// The file cannot be written, or some file of the recording cannot be brought to the disk.
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.add(bytes);
        self.write_if_due()
    }

    /// Hands to the system what was appended, if that is due; to be called also where nothing arrives.
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

    /// Brings to the disk what was appended.
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

    /// Its length, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// What a sensor sent, byte by byte, and beside it when it arrived.
#[derive(Debug)]
pub struct StampedJournal<'a> {
    sent: Journal<'a>,
    stamps: Journal<'a>,
}

impl<'a> StampedJournal<'a> {
    /// Begins `name.extension` and `name.stamps.csv` in a folder.
    ///
    /// # Errors
    /// One of them is there, or cannot be written.
    pub fn create(folder: &Path, name: &str, extension: &str, disk: &'a Disk) -> Result<Self> {
        let mut stamps = Journal::create(&folder.join(format!("{name}.stamps.csv")), disk)?;
        stamps.append(b"bytes_before,monotonic_s,unix_s\n")?;
        Ok(Self {
            sent: Journal::create(&folder.join(format!("{name}.{extension}")), disk)?,
            stamps,
        })
    }

    /// Appends what arrived.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn append(&mut self, bytes: &[u8], at: Stamp) -> Result<()> {
        let (before, monotonic_s, unix_s) = (self.sent.bytes(), at.monotonic_s(), at.unix_s());
        let row = format!("{before},{monotonic_s:.6},{unix_s:.6}\n");
        self.stamps.add(row.as_bytes());
        self.sent.add(bytes);
        self.write_if_due()
    }

    /// See [`Journal::write_if_due`]. Times of arrival are written before the bytes that they belong to, so that a kill
    /// leaves no bytes without one.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write_if_due(&mut self) -> Result<()> {
        if !(self.stamps.is_due() || self.sent.is_due()) {
            return Ok(());
        }
        self.sent.disk.check()?;
        self.stamps.write()?;
        self.sent.write()
    }

    /// See [`Journal::flush`].
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        self.stamps.flush()?;
        self.sent.flush()
    }
}
