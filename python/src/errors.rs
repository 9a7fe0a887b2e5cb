//! Errors of the library as Python exceptions, whose classes are in `package/boresight/errors.py`.

use boresight::Error;
use boresight::error::Location;
use pyo3::prelude::*;

/// The exception for an error.
pub(crate) fn exception(py: Python<'_>, error: &Error) -> PyErr {
    match made(py, error) {
        Ok(exception) => PyErr::from_value(exception),
        Err(failure) => failure,
    }
}

fn made<'py>(py: Python<'py>, error: &Error) -> PyResult<Bound<'py, PyAny>> {
    let classes = py.import("boresight.errors")?;
    match error {
        Error::Io { path, source } => {
            let kind = format!("{:?}", source.kind());
            let arguments = (source.raw_os_error(), kind, source.to_string(), path);
            classes.getattr("_io")?.call1(arguments)
        }
        Error::Format {
            path,
            at,
            found,
            expected,
        } => {
            let (place, number) = match at {
                Location::Line(line) => (Some("line"), *line),
                Location::Byte(byte) => (Some("byte"), *byte),
                Location::Row(row) => (Some("row"), *row),
                Location::Whole => (None, 0),
            };
            let arguments = (error.to_string(), path, place, number, found, expected);
            classes.getattr("_format")?.call1(arguments)
        }
        Error::Data {
            kind,
            problem,
            remedy,
        } => {
            let arguments = (format!("{kind:?}"), problem, remedy);
            classes.getattr("_data")?.call1(arguments)
        }
        other => classes.getattr("Error")?.call1((other.to_string(),)),
    }
}
