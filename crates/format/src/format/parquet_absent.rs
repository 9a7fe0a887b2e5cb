//! Stand-in for the Parquet reader and writer in a program built without them.

use std::convert::Infallible;
use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::cloud::sink::{CloudShape, CloudSink};
use crate::format::extents::Extent;
use crate::format::input::Input;

fn absent(path: &Path) -> Error {
    Error::format(
        path,
        Location::Whole,
        "a Parquet file",
        "the same table as text, or a program built with the feature `parquet`",
    )
}

/// The header of a Parquet file; this program never has one.
pub(crate) struct Header {
    pub(crate) names: Vec<String>,
    pub(crate) is_foreign_cloud: bool,
}

/// Refuses to read.
pub(crate) fn header(input: &Input) -> Result<Header> {
    Err(absent(input.path()))
}

/// Rows that cannot be read.
#[derive(Debug)]
pub(crate) struct Rows(Infallible);

impl Rows {
    /// Refuses to read.
    pub(crate) fn open(input: &Input) -> Result<Self> {
        Err(absent(input.path()))
    }

    pub(crate) fn names(&self) -> &[String] {
        match self.0 {}
    }

    pub(crate) fn select(&mut self, _: Vec<usize>) -> Result<()> {
        match self.0 {}
    }

    pub(crate) fn advance(&mut self) -> Result<bool> {
        match self.0 {}
    }

    pub(crate) fn cell(&self, _: usize) -> Option<f64> {
        match self.0 {}
    }

    pub(crate) fn number(&self) -> u64 {
        match self.0 {}
    }

    pub(crate) fn bytes_read(&self) -> u64 {
        match self.0 {}
    }

    pub(crate) fn bytes_total(&self) -> u64 {
        match self.0 {}
    }

    pub(crate) fn error(&self, _: impl Into<String>, _: impl Into<String>) -> Error {
        match self.0 {}
    }
}

/// Refuses to write a cloud as Parquet.
///
/// # Errors
/// Always.
pub fn parquet_sink(path: &Path, _: &CloudShape) -> Result<Box<dyn CloudSink>> {
    Err(unwritable(path))
}

/// A table that cannot be written.
pub struct ParquetTable(Infallible);

impl ParquetTable {
    /// Refuses to write.
    ///
    /// # Errors
    /// Always.
    pub fn create(path: &Path, _: &[&str]) -> Result<Self> {
        Err(unwritable(path))
    }

    /// Appends a row.
    ///
    /// # Errors
    /// None: there is no such table.
    pub fn row(&mut self, _: impl IntoIterator<Item = f64>) -> Result<()> {
        match self.0 {}
    }

    /// Completes the file.
    ///
    /// # Errors
    /// None: there is no such table.
    pub fn finish(self) -> Result<()> {
        match self.0 {}
    }
}

/// Refuses to write an index.
///
/// # Errors
/// Always.
pub fn write_extents(path: &Path, _: &[Extent], _: Option<&str>) -> Result<()> {
    Err(unwritable(path))
}

fn unwritable(path: &Path) -> Error {
    Error::data(
        format!("{}: Parquet is not written by this program", path.display()),
        "write another format, or build with the feature `parquet`",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{detect, read_cloud, read_imu};

    #[test]
    fn parquet_is_detected_and_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.parquet");
        std::fs::write(&path, b"PAR1 and more").unwrap();
        let errors = [
            detect(&path).unwrap_err(),
            read_cloud(&path).unwrap_err(),
            read_imu(&path).unwrap_err(),
        ];
        for error in errors {
            let text = error.to_string();
            assert!(
                text.contains("found a Parquet file, expected the same table"),
                "{text}"
            );
        }
        assert!(ParquetTable::create(&path, &["time_s"]).is_err());
    }
}
