//! The error type of the library.

use std::fmt;
use std::path::{Path, PathBuf};

/// The result type of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Start of the names of staging folders, in which files are written before they appear; the lock file of each ends in
/// `.lock`.
pub(crate) const STAGING: &str = ".staging-";

/// Where a file appears that is written to this path, which may be in a staging folder.
fn final_path(path: &Path) -> PathBuf {
    let is_staging = |name: &std::ffi::OsStr| {
        let name = name.to_string_lossy();
        name.starts_with(STAGING) && !name.ends_with(".lock")
    };
    if !path.iter().any(is_staging) {
        return path.to_owned();
    }
    let parts = path.components();
    parts.filter(|part| !is_staging(part.as_os_str())).collect()
}

/// A result that may be missing: `None` for any error but a cancellation.
///
/// # Errors
/// [`Error::Cancelled`].
pub fn unless_cancelled<T>(result: Result<T>) -> Result<Option<T>> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(Error::Cancelled) => Err(Error::Cancelled),
        Err(_) => Ok(None),
    }
}

/// A place in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Location {
    /// The file as a whole.
    Whole,
    /// Line of a text file, counted from 1.
    Line(u64),
    /// Byte of a binary file, counted from 0.
    Byte(u64),
    /// Row of a binary table, counted from 1.
    Row(u64),
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => Ok(()),
            Self::Line(line) => write!(f, ", line {line}"),
            Self::Byte(byte) => write!(f, ", byte {byte}"),
            Self::Row(row) => write!(f, ", row {row}"),
        }
    }
}

/// Longest text that a message quotes from a file, characters.
const LONGEST_QUOTE: usize = 1000;

/// Shortens a text that is too long to print.
fn shortened(text: String) -> String {
    match text.char_indices().nth(LONGEST_QUOTE) {
        None => text,
        Some((end, _)) => format!("{}… ({} bytes more)", &text[..end], text.len() - end),
    }
}

/// Why readable data cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Problem {
    /// An invalid value or setting: not finite, out of range, out of order or in the wrong unit.
    Invalid,
    /// Streams that do not overlap in time, or clouds that do not overlap in space.
    NoOverlap,
    /// Too few data for the method.
    TooFew,
    /// More data than memory holds.
    TooMany,
    /// Unknowns that the data do not determine.
    NotDetermined,
    /// Values that are given as known, and that the data contradict.
    Contradicted,
    /// A result that would overwrite one of its inputs.
    WouldReplaceInput,
    /// A result that would overwrite a file that is not a result.
    WouldReplaceFile,
}

/// An error with everything needed to fix its cause.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened, read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The content of a file does not match its format.
    #[error("{}{at}: found {found}, expected {expected}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Line or byte.
        at: Location,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// Readable data that cannot be used together, or not for this purpose.
    #[error("{problem}\n  remedy: {remedy}")]
    Data {
        /// The kind of problem, for programs to match.
        kind: Problem,
        /// What is wrong, with names and numbers.
        problem: String,
        /// What the user can do about it.
        remedy: String,
    },
    /// The work was cancelled: see `Progress::is_cancelled`.
    #[error("cancelled")]
    Cancelled,
}

impl Error {
    /// An [`Error::Io`] at `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io {
            path: final_path(path.as_ref()),
            source,
        }
    }

    /// An [`Error::Format`] at `path`.
    pub fn format(
        path: impl AsRef<Path>,
        at: Location,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Format {
            path: final_path(path.as_ref()),
            at,
            found: shortened(found.into()),
            expected: shortened(expected.into()),
        }
    }

    /// The same error about the file `to` instead of `from`.
    pub fn renamed(self, from: &Path, to: &Path) -> Self {
        let new = |path: PathBuf| if path == from { to.to_owned() } else { path };
        match self {
            Self::Io { path, source } => Self::Io {
                path: new(path),
                source,
            },
            Self::Format {
                path,
                at,
                found,
                expected,
            } => Self::Format {
                path: new(path),
                at,
                found,
                expected,
            },
            Self::Data {
                kind,
                problem,
                remedy,
            } => Self::Data {
                kind,
                problem: problem.replace(&*from.to_string_lossy(), &to.to_string_lossy()),
                remedy,
            },
            Self::Cancelled => Self::Cancelled,
        }
    }

    /// The same error; a message that names none of the `inputs` is prefixed with the first of them.
    pub fn within(self, inputs: &[PathBuf]) -> Self {
        let is_named = |problem: &str| {
            let names = inputs.iter().filter_map(|path| path.file_name()?.to_str());
            names.into_iter().any(|name| problem.contains(name))
        };
        match (self, inputs.first()) {
            (
                Self::Data {
                    kind,
                    problem,
                    remedy,
                },
                Some(first),
            ) if !is_named(&problem) => Self::Data {
                kind,
                problem: format!("{}: {problem}", first.display()),
                remedy,
            },
            (other, _) => other,
        }
    }

    /// An [`Error::Data`] of the kind [`Problem::Invalid`].
    pub fn data(problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::of(Problem::Invalid, problem, remedy)
    }

    /// An [`Error::Data`] of the given kind.
    pub fn of(kind: Problem, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Data {
            kind,
            problem: problem.into(),
            remedy: remedy.into(),
        }
    }
}
