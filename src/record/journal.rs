//! Files of a recording: they only grow, and what is older than a second is on the disk.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::clock::Stamp;
use crate::error::{Error, Result};

/// Longest time that what was written may be lost with the power.
const FLUSH: Duration = Duration::from_secs(1);
/// Bytes that are written before that.
const PENDING: usize = 1 << 16;

/// A file that grows by whole records: what is appended at once is written at once.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    pending: Vec<u8>,
    flushed: Instant,
    bytes: u64,
}

impl Journal {
    /// Begins a file that is not there yet.
    ///
    /// # Errors
    /// It is there, or cannot be written.
    pub fn create(path: &Path) -> Result<Self> {
        let file = File::create_new(path).map_err(|error| Error::io(path, error))?;
        Ok(Self {
            path: path.to_owned(),
            file,
            pending: Vec::new(),
            flushed: Instant::now(),
            bytes: 0,
        })
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.pending.extend_from_slice(bytes);
        self.bytes += bytes.len() as u64;
        if self.pending.len() >= PENDING {
            self.write()?;
        }
        self.flush_if_due()
    }

    /// Brings to the disk what was appended, if the last time is a second ago; to be called also where nothing
    /// arrives.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush_if_due(&mut self) -> Result<()> {
        if self.flushed.elapsed() < FLUSH {
            return Ok(());
        }
        self.flush()
    }

    /// Brings to the disk what was appended.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        self.flushed = Instant::now();
        self.write()?;
        let synced = self.file.sync_data();
        synced.map_err(|error| Error::io(&self.path, error))
    }

    fn write(&mut self) -> Result<()> {
        let written = self.file.write_all(&self.pending);
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
pub struct StampedJournal {
    sent: Journal,
    stamps: Journal,
}

impl StampedJournal {
    /// Begins `name.extension` and `name.stamps.csv` in a folder.
    ///
    /// # Errors
    /// One of them is there, or cannot be written.
    pub fn create(folder: &Path, name: &str, extension: &str) -> Result<Self> {
        let mut stamps = Journal::create(&folder.join(format!("{name}.stamps.csv")))?;
        stamps.append(b"bytes_before,monotonic_s,unix_s\n")?;
        Ok(Self {
            sent: Journal::create(&folder.join(format!("{name}.{extension}")))?,
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
        self.sent.append(bytes)?;
        self.stamps.append(row.as_bytes())
    }

    /// See [`Journal::flush_if_due`].
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn flush_if_due(&mut self) -> Result<()> {
        self.sent.flush_if_due()?;
        self.stamps.flush_if_due()
    }

    /// See [`Journal::flush`].
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn flush(&mut self) -> Result<()> {
        self.sent.flush()?;
        self.stamps.flush()
    }
}
