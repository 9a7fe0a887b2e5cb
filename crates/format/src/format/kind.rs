//! What a file format is: how a file of it is told, and what is read from it.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::profiles::reader::ProfileReader;
use crate::format::text::table::Columns;
use crate::sensor::{GeographicFix, HeadingFix, ImuSample, Observations, PoseRecord, Positions};

/// The beginning of a file.
pub(crate) struct Start<'a> {
    /// Up to 4096 bytes.
    pub(crate) bytes: &'a [u8],
    /// Of the whole file.
    pub(crate) size: u64,
}

impl Start<'_> {
    pub(crate) fn contains(&self, what: &[u8]) -> bool {
        self.bytes.windows(what.len()).any(|w| w == what)
    }
}

/// A record of a recording at the beginning of some bytes.
pub(crate) struct WholeRecord {
    pub(crate) length: usize,
    pub(crate) time_s: f64,
}

/// Tells the record at the beginning of some bytes, if all of it is there and its time is one of those asked for;
/// the time is looked at first, as this is asked at every byte.
pub(crate) type RecordAt = fn(&[u8], &dyn Fn(f64) -> bool) -> Option<WholeRecord>;

/// A reader of a file.
pub(crate) type Reader<T> = fn(&Path) -> Result<T>;

/// Units and frame of what a file holds and whether they are found in it, given by the format, or assumed: a short line.
#[derive(Clone, Copy)]
pub(crate) enum Frame {
    /// The same for all files of the format.
    Fixed(&'static str),
    /// Each file tells.
    OfFile(Reader<String>),
}

/// A file format. Each has its constant in the file of its reader, and a line in the table of
/// [`kinds`](super::kinds).
pub(crate) struct Kind {
    /// As in JSON.
    pub(crate) id: &'static str,
    /// In words.
    pub(crate) name: &'static str,
    /// Whether a file that begins so is one.
    pub(crate) signature: Option<fn(&Start<'_>) -> bool>,
    /// The header of a table; the first needed column is the time where it has one.
    pub(crate) columns: Option<Columns<'static>>,
    /// Whether a table with this header is one, where other programs name the columns.
    pub(crate) header: Option<fn(&[String]) -> bool>,
    /// Whether its lines, which have only numbers, begin with these.
    pub(crate) numbers: Option<fn(&[f64]) -> bool>,
    /// Ends of names, where the content does not tell.
    pub(crate) extensions: &'static [&'static str],
    pub(crate) imu: Option<Reader<Vec<ImuSample>>>,
    pub(crate) heading: Option<Reader<Vec<HeadingFix>>>,
    pub(crate) positions: Option<fn(&Path, &Observations) -> Result<Positions>>,
    pub(crate) geographic: Option<Reader<Vec<GeographicFix>>>,
    pub(crate) poses: Option<Reader<Vec<PoseRecord>>>,
    pub(crate) cloud: Option<Reader<PointCloud>>,
    pub(crate) profiles: Option<Reader<Box<dyn ProfileReader>>>,
    /// Tells a whole record at the beginning of bytes, for salvaging.
    pub(crate) record: Option<RecordAt>,
    /// The coordinate reference system that a file names, as WKT.
    pub(crate) wkt: Option<Reader<Option<String>>>,
    /// Where each record with a time ends, bytes, and its time, where that is not a line of a table.
    pub(crate) record_ends: Option<Reader<Vec<(u64, f64)>>>,
    /// Other files that are read with one, those that are missing too where they would be.
    pub(crate) beside: Option<fn(&Path) -> Vec<PathBuf>>,
    /// What else a file holds, in a line.
    pub(crate) contents: Option<Reader<String>>,
    /// Units and frame.
    pub(crate) frame: Frame,
    /// What a user should know of it.
    pub(crate) note: &'static str,
}

impl Kind {
    /// Of which nothing is known yet.
    pub(crate) const fn new(id: &'static str, name: &'static str) -> Self {
        Self {
            id,
            name,
            signature: None,
            columns: None,
            header: None,
            numbers: None,
            extensions: &[],
            imu: None,
            heading: None,
            positions: None,
            geographic: None,
            poses: None,
            cloud: None,
            profiles: None,
            record: None,
            wkt: None,
            record_ends: None,
            beside: None,
            contents: None,
            frame: Frame::Fixed(""),
            note: "",
        }
    }
}

/// A file format that is told, and in most cases read.
#[derive(Clone, Copy)]
pub struct Format(pub(crate) &'static Kind);

impl Format {
    /// Its name in results, such as `las`, `imu-csv` or `project`.
    pub fn id(self) -> &'static str {
        self.0.id
    }

    /// Whether its points can be read in pieces.
    pub fn is_las(self) -> bool {
        matches!(self.id(), "las" | "laz")
    }

    /// Whether it is a text table with one measurement in a row.
    pub fn is_table(self) -> bool {
        self.0.columns.is_some()
    }

    /// Whether it may hold the samples of an IMU.
    pub fn has_imu(self) -> bool {
        self.0.imu.is_some()
    }

    /// Whether it may hold headings.
    pub fn has_heading(self) -> bool {
        self.0.heading.is_some()
    }

    /// Whether it may hold positions.
    pub fn has_positions(self) -> bool {
        self.0.positions.is_some()
    }

    /// Whether it may hold poses.
    pub fn has_poses(self) -> bool {
        self.0.poses.is_some()
    }

    /// Whether it may hold a cloud.
    pub fn has_cloud(self) -> bool {
        self.0.cloud.is_some()
    }

    /// Whether it may hold points in the frame of a scanner.
    pub fn has_profiles(self) -> bool {
        self.0.profiles.is_some()
    }
}

impl PartialEq for Format {
    fn eq(&self, other: &Self) -> bool {
        self.id() == other.id()
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.name)
    }
}

impl fmt::Debug for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.id())
    }
}

impl serde::Serialize for Format {
    fn serialize<S: serde::Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        to.serialize_str(self.id())
    }
}
