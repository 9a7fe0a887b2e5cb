//! Records of fixed length, appended to many files and read back.

use std::fs::{File, OpenOptions};
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Memory for buffered records, bytes.
const BUFFERS: usize = 64 << 20;

/// Appends to many files at once, in large pieces and with one file open at a time.
pub(super) struct Appender {
    buffers: Vec<Vec<u8>>,
    /// Approximate limit on the bytes buffered for each file.
    most: usize,
}

impl Appender {
    pub(super) fn new(files: usize) -> Self {
        Self {
            buffers: vec![Vec::new(); files],
            most: (BUFFERS / files.max(1)).clamp(4 << 10, 1 << 20),
        }
    }

    /// Appends a record to the file with this number and path.
    pub(super) fn push(
        &mut self,
        file: usize,
        parts: &[&[u8]],
        path: impl Fn() -> PathBuf,
    ) -> Result<()> {
        let buffer = &mut self.buffers[file];
        for part in parts {
            buffer.extend_from_slice(part);
        }
        if buffer.len() >= self.most {
            append(&path(), buffer)?;
            buffer.clear();
        }
        Ok(())
    }

    /// Writes buffered records.
    pub(super) fn finish(self, path: impl Fn(usize) -> PathBuf) -> Result<()> {
        for (file, buffer) in self.buffers.iter().enumerate() {
            if !buffer.is_empty() {
                append(&path(file), buffer)?;
            }
        }
        Ok(())
    }
}

fn append(path: &Path, bytes: &[u8]) -> Result<()> {
    OpenOptions::new()
        .create(true)
        .append(true)
        .open(path)
        .and_then(|mut file| file.write_all(bytes))
        .map_err(|e| Error::io(path, e))
}

/// Calls `each` with every record of a file of records of `N` bytes.
pub(super) fn read_records<const N: usize>(
    path: &Path,
    mut each: impl FnMut(&[u8; N]) -> Result<()>,
) -> Result<()> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let mut left = file.metadata().map_err(|e| Error::io(path, e))?.len() / N as u64;
    let mut input = BufReader::with_capacity(1 << 20, file);
    let mut record = [0; N];
    while left > 0 {
        input
            .read_exact(&mut record)
            .map_err(|e| Error::io(path, e))?;
        each(&record)?;
        left -= 1;
    }
    Ok(())
}

/// The first eight bytes as a number.
pub(super) fn number(bytes: &[u8]) -> u64 {
    let (words, _) = bytes.as_chunks::<8>();
    words.first().map_or(0, |word| u64::from_le_bytes(*word))
}
