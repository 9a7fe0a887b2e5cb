//! Tables and clouds as Apache Parquet, read and written.
//!
//! A file is read like the text table with the same columns: with the same names, units in names and
//! order. A null is an empty cell. Floating-point numbers of 32 and 64 bits and all integers are
//! read; timestamps become seconds since 1970-01-01. Pages are unpacked here and not by the library,
//! because it allocates what a page claims: a damaged or hostile file must not take more memory than
//! four times its size and 64 MiB.

mod columns;
mod extents;
mod footer;
mod pages;
mod rows;
#[cfg(test)]
mod tests;
mod unpack;
mod write;

use std::path::Path;

use ::parquet::errors::ParquetError;

use crate::error::{Error, Location, Result};
use crate::format::input::Input;
pub(crate) use columns::Header;
pub use extents::write_extents;
pub(crate) use rows::Rows;
pub use write::{ParquetTable, parquet_sink};

/// Reads the names of the columns.
///
/// # Errors
/// A file that is no Parquet, is damaged or encrypted.
pub(crate) fn header(input: &Input) -> Result<Header> {
    Ok(Rows::open(input)?.into_header())
}

/// The error of a file that the library cannot read.
fn damaged(path: &Path, at: Location, error: ParquetError) -> Error {
    match error {
        ParquetError::External(source) => match source.downcast::<std::io::Error>() {
            Ok(source) if source.raw_os_error().is_some() => Error::io(path, *source),
            Ok(source) => Error::format(path, at, source.to_string(), WHOLE),
            Err(source) => Error::format(path, at, source.to_string(), WHOLE),
        },
        ParquetError::General(text) | ParquetError::EOF(text) | ParquetError::NYI(text) => {
            Error::format(path, at, text, WHOLE)
        }
        other => Error::format(path, at, other.to_string(), WHOLE),
    }
}

/// What is expected of a file that cannot be decoded.
const WHOLE: &str = "an undamaged Parquet file";
