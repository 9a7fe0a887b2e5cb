//! Point records written in batches as LAS or LAZ.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};
use crate::format::file::extension;
use crate::format::file::guarded;

/// Points compressed at a time: several of the format's chunks of 50,000, so that all threads are
/// busy.
const BATCH: usize = 200_000;

/// Bytes of the header with the point counts of versions before 1.4.
const LEGACY_COUNTS: Range<u64> = 107..131;

/// An open LAS or LAZ file that takes complete point records. The same records give the same bytes
/// for any number of threads.
pub(crate) struct LasOut {
    path: PathBuf,
    /// `None` once it has been closed or abandoned.
    writer: Option<las::Writer<BufWriter<File>>>,
    records: Vec<u8>,
    /// Bytes per record.
    length: usize,
}

/// Whether the file name asks for compression.
///
/// # Errors
/// A name that ends in neither `.las` nor `.laz`.
pub(crate) fn is_compressed(path: &Path) -> Result<bool> {
    match extension(path).as_str() {
        "laz" => Ok(true),
        "las" => Ok(false),
        other => Err(Error::format(
            path,
            Location::Whole,
            format!("an output cloud with the extension `{other}`"),
            "`laz` or `las`",
        )),
    }
}

impl LasOut {
    /// Creates or replaces the file.
    ///
    /// # Errors
    /// A header that LAS does not allow, a file that cannot be written.
    pub(crate) fn create(path: &Path, header: las::Builder) -> Result<Self> {
        let header = header.into_header().map_err(|e| problem(path, e))?;
        let length = usize::from(header.point_format().len());
        let file = File::create(path).map_err(|e| Error::io(path, e))?;
        let writer = las::Writer::new(BufWriter::with_capacity(1 << 20, file), header)
            .map_err(|e| problem(path, e))?;
        Ok(Self {
            path: path.to_owned(),
            writer: Some(writer),
            records: Vec::with_capacity(BATCH * length),
            length,
        })
    }

    /// Appends one record, given in consecutive parts.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(crate) fn push(&mut self, parts: &[&[u8]]) -> Result<()> {
        for part in parts {
            self.records.extend_from_slice(part);
        }
        debug_assert_eq!(self.records.len() % self.length, 0);
        if self.records.len() >= BATCH * self.length {
            self.flush()?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        let empty = Vec::with_capacity(BATCH * self.length);
        let records = std::mem::replace(&mut self.records, empty);
        let written = guarded(&self.path, "LAS or LAZ", || {
            las::PointDataBuilder::new()
                .for_header(writer.header())
                .build_from_bytes(records)
                .and_then(|points| writer.write_points(&points))
                .map_err(|e| problem(&self.path, e))
        });
        if written.is_err()
            && let Some(writer) = self.writer.take()
        {
            leak(writer);
        }
        written
    }

    /// Writes buffered data and completes the header.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(crate) fn finish(mut self) -> Result<()> {
        self.flush()?;
        let Some(mut writer) = self.writer.take() else {
            return Ok(());
        };
        if let Err(error) = close(&self.path, &mut writer) {
            leak(writer);
            return Err(error);
        }
        let is_extended = writer.header().point_format().is_extended;
        let out = writer.into_inner().map_err(|e| problem(&self.path, e))?;
        let mut out = out
            .into_inner()
            .map_err(|e| Error::io(&self.path, e.into_error()))?;
        if is_extended {
            // Point formats from 6 on have no legacy counts (LAS 1.4, table 3).
            out.seek(SeekFrom::Start(LEGACY_COUNTS.start))
                .and_then(|_| {
                    out.write_all(&[0; (LEGACY_COUNTS.end - LEGACY_COUNTS.start) as usize])
                })
                .map_err(|e| Error::io(&self.path, e))?;
        }
        Ok(())
    }
}

impl Drop for LasOut {
    fn drop(&mut self) {
        if let Some(mut writer) = self.writer.take()
            && close(&self.path, &mut writer).is_err()
        {
            leak(writer);
        }
    }
}

fn close(path: &Path, writer: &mut las::Writer<BufWriter<File>>) -> Result<()> {
    guarded(path, "LAS or LAZ", || {
        writer.close().map_err(|e| problem(path, e))
    })
}

/// A writer that could not be closed tries again when dropped, and panics. It is leaked instead, so
/// that its file stays open until the process ends; the error is already being returned.
fn leak(writer: las::Writer<BufWriter<File>>) {
    std::mem::forget(writer);
}

/// The error of a file whose encoder failed.
pub(crate) fn problem(path: &Path, error: las::Error) -> Error {
    match error {
        las::Error::Io(source) => Error::io(path, source),
        las::Error::LasZipError(laz::LasZipError::IoError(source)) => Error::io(path, source),
        other => Error::format(
            path,
            Location::Whole,
            other.to_string(),
            "points within the limits of LAS",
        ),
    }
}
