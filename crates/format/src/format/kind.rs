//! Description of a file format: how it is detected, and which readers it has.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::input::Input;
use crate::format::profiles::reader::ProfileReader;
use crate::format::text::table::Columns;
use crate::sensor::{
    GeographicFix, GeographicPose, HeadingFix, ImuSample, Observations, PoseRecord, Positions,
};

/// The beginning of a file.
pub(crate) struct Start<'a> {
    /// Up to 4096 bytes.
    pub(crate) bytes: &'a [u8],
    /// Size of the whole file, bytes.
    pub(crate) size: u64,
    /// Extension of its name in lower case, before that of a compression.
    pub(crate) extension: &'a str,
}

impl Start<'_> {
    pub(crate) fn contains(&self, what: &[u8]) -> bool {
        self.bytes.windows(what.len()).any(|w| w == what)
    }
}

/// A complete record at the beginning of a byte slice.
pub(crate) struct WholeRecord {
    /// Bytes.
    pub(crate) length: usize,
    /// Seconds.
    pub(crate) time_s: f64,
}

/// Finds a complete record at the beginning of a byte slice whose time satisfies the condition. The time is checked
/// first, because this function is called at every byte.
pub(crate) type RecordAt = fn(&[u8], &dyn Fn(f64) -> bool) -> Option<WholeRecord>;

/// A function that reads a file or an excerpt of it.
pub(crate) type Reader<T> = fn(&Input) -> Result<T>;

/// Units and frame of a file's content in one line, and whether the file or its format states them or they are
/// assumed.
#[derive(Clone, Copy)]
pub(crate) enum Frame {
    /// The same for all files of the format.
    Fixed(&'static str),
    /// Read from each file.
    OfFile(Reader<String>),
}

/// A file format. Each format is a constant in the module of its reader and is listed in
/// [`kinds`](super::kinds).
pub(crate) struct Kind {
    /// Name in JSON.
    pub(crate) id: &'static str,
    /// Name in messages.
    pub(crate) name: &'static str,
    /// Whether a file with this beginning has this format.
    pub(crate) signature: Option<fn(&Start<'_>) -> bool>,
    /// Columns of a table. The first needed column is the time if the table has one.
    pub(crate) columns: Option<Columns<'static>>,
    /// Whether a table with this header has this format, for tables of other programs.
    pub(crate) header: Option<fn(&[String]) -> bool>,
    /// Whether these numbers can be the first line, for text without a header.
    pub(crate) numbers: Option<fn(&[f64]) -> bool>,
    /// File extensions, for files whose content is ambiguous.
    pub(crate) extensions: &'static [&'static str],
    pub(crate) imu: Option<Reader<Vec<ImuSample>>>,
    pub(crate) heading: Option<Reader<Vec<HeadingFix>>>,
    pub(crate) positions: Option<fn(&Input, &Observations) -> Result<Positions>>,
    pub(crate) geographic: Option<Reader<Vec<GeographicFix>>>,
    pub(crate) poses: Option<Reader<Vec<PoseRecord>>>,
    /// Reads poses with latitudes and longitudes.
    pub(crate) geographic_poses: Option<Reader<Vec<GeographicPose>>>,
    /// Whether its poses have roll, pitch and heading, of a body with x forward, y left, z up.
    pub(crate) has_navigation_angles: bool,
    pub(crate) cloud: Option<Reader<PointCloud>>,
    pub(crate) profiles: Option<Reader<Box<dyn ProfileReader>>>,
    /// Finds a complete record at the beginning of a byte slice, for salvaging.
    pub(crate) record: Option<RecordAt>,
    /// Reads the coordinate reference system of a file, as WKT.
    pub(crate) wkt: Option<Reader<Option<String>>>,
    /// The end of each record that has a time (bytes from the start of the file) and its time, for formats whose
    /// records are not lines of a table.
    pub(crate) record_ends: Option<Reader<Vec<(u64, f64)>>>,
    /// Other files that are read together with a file, at the paths where they belong, even if they are missing.
    pub(crate) beside: Option<fn(&Path) -> Vec<PathBuf>>,
    /// All contents of a file in one line, for formats that hold several kinds of measurements.
    pub(crate) contents: Option<Reader<String>>,
    /// Units and frame.
    pub(crate) frame: Frame,
    /// A remark for the user.
    pub(crate) note: &'static str,
}

impl Kind {
    /// A format without readers.
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
            geographic_poses: None,
            has_navigation_angles: false,
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

/// A file format that is detected and, in most cases, read.
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

    /// Whether it may hold latitudes and longitudes.
    pub fn has_geographic(self) -> bool {
        self.0.geographic.is_some()
    }

    /// Whether it may hold poses.
    pub fn has_poses(self) -> bool {
        self.0.poses.is_some() || self.has_geographic_poses()
    }

    /// Whether its poses have latitudes and longitudes, which a projection turns into positions.
    pub fn has_geographic_poses(self) -> bool {
        self.0.geographic_poses.is_some()
    }

    /// Whether its poses have roll, pitch and heading: the body has x forward, y left, z up until it is turned to the axes
    /// of a project.
    pub fn has_navigation_angles(self) -> bool {
        self.0.has_navigation_angles
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
