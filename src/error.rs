//! The one error type of the library.

use std::fmt;
use std::path::{Path, PathBuf};

/// Result of everything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// Where in a file something was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Location {
    /// The file as a whole.
    Whole,
    /// Line of a text file, counted from 1.
    Line(u64),
    /// Byte of a binary file, counted from 0.
    Byte(u64),
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => Ok(()),
            Self::Line(line) => write!(f, ", line {line}"),
            Self::Byte(byte) => write!(f, ", byte {byte}"),
        }
    }
}

/// Why readable data cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Problem {
    /// A value or a setting that cannot be right: not finite, out of range, out of order, in another
    /// unit.
    Invalid,
    /// Streams that share no time, or clouds that share no space.
    NoOverlap,
    /// Fewer data than the method needs.
    TooFew,
    /// Unknowns that the data do not determine.
    NotDetermined,
    /// A result that would replace a file from which it is made.
    WouldReplaceInput,
}

/// What went wrong, with everything needed to mend it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused a file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file does not say what its format demands.
    #[error("{}{at}: found {found}, expected {expected}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Line or byte.
        at: Location,
        /// What stands there.
        found: String,
        /// What should stand there.
        expected: String,
    },
    /// The data are readable but cannot be used together, or not for this purpose.
    #[error("{problem}\n  remedy: {remedy}")]
    Data {
        /// Which kind of problem, for programs.
        kind: Problem,
        /// What is wrong, with names and numbers.
        problem: String,
        /// What the user can do about it.
        remedy: String,
    },
    /// The work was told to stop: see `Progress::is_cancelled`.
    #[error("cancelled")]
    Cancelled,
}

impl Error {
    /// An [`Error::Io`] at `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io {
            path: path.as_ref().to_owned(),
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
            path: path.as_ref().to_owned(),
            at,
            found: found.into(),
            expected: expected.into(),
        }
    }

    /// An [`Error::Data`] of the kind [`Problem::Invalid`].
    pub fn data(problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::of(Problem::Invalid, problem, remedy)
    }

    /// An [`Error::Data`] of this kind.
    pub fn of(kind: Problem, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Data {
            kind,
            problem: problem.into(),
            remedy: remedy.into(),
        }
    }
}
