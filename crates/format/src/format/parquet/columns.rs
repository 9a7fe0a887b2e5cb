//! The columns of a Parquet file: their types, and the names by which tables are read.

use ::parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type};
use ::parquet::file::metadata::ParquetMetaData;
use ::parquet::schema::types::ColumnDescriptor;

use crate::format::text::unit::factor;

/// The names of the columns, as the reader of a table looks them up.
#[derive(Debug)]
pub(crate) struct Header {
    pub(crate) names: Vec<String>,
    /// Whether the file has `x`, `y` and `z`, which were renamed to the coordinates of a cloud.
    pub(crate) is_foreign_cloud: bool,
}

/// The kind of number in a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value {
    Float,
    Signed,
    Unsigned,
    /// Time since 1970 in fractions of a second.
    Time {
        per_second: i64,
    },
}

impl Value {
    /// `None` if the column does not hold numbers.
    pub(super) fn of(column: &ColumnDescriptor) -> Option<Self> {
        use ConvertedType as Converted;
        if column.max_rep_level() > 0 {
            return None;
        }
        match column.physical_type() {
            Type::FLOAT | Type::DOUBLE => return Some(Self::Float),
            Type::INT32 | Type::INT64 => {}
            _ => return None,
        }
        let per_second = match (column.logical_type_ref(), column.converted_type()) {
            (Some(LogicalType::Timestamp(time)), _) => match time.unit {
                TimeUnit::MILLIS => 1_000,
                TimeUnit::MICROS => 1_000_000,
                TimeUnit::NANOS => 1_000_000_000,
            },
            (Some(LogicalType::Integer(integer)), _) => {
                return Some(if integer.is_signed {
                    Self::Signed
                } else {
                    Self::Unsigned
                });
            }
            (Some(_), _) => return None,
            (None, Converted::TIMESTAMP_MILLIS) => 1_000,
            (None, Converted::TIMESTAMP_MICROS) => 1_000_000,
            (
                None,
                Converted::UINT_8 | Converted::UINT_16 | Converted::UINT_32 | Converted::UINT_64,
            ) => return Some(Self::Unsigned),
            (
                None,
                Converted::NONE
                | Converted::INT_8
                | Converted::INT_16
                | Converted::INT_32
                | Converted::INT_64,
            ) => return Some(Self::Signed),
            (None, _) => return None,
        };
        (column.physical_type() == Type::INT64).then_some(Self::Time { per_second })
    }

    pub(super) fn of_i32(self, value: i32) -> f64 {
        match self {
            Self::Unsigned => f64::from(value as u32),
            _ => f64::from(value),
        }
    }

    pub(super) fn of_i64(self, value: i64) -> f64 {
        match self {
            Self::Unsigned => value as u64 as f64,
            // Nanoseconds since 1970 have more digits than `f64`.
            Self::Time { per_second } => {
                let fraction = value.rem_euclid(per_second) as f64 / per_second as f64;
                value.div_euclid(per_second) as f64 + fraction
            }
            _ => value as f64,
        }
    }
}

/// The type of a column in words.
pub(super) fn type_of(column: &ColumnDescriptor) -> String {
    let physical = column.physical_type();
    match (column.max_rep_level(), column.logical_type_ref()) {
        (0, None) => physical.to_string(),
        (0, Some(logical)) => {
            let logical = format!("{logical:?}");
            let name = logical.split(['(', ' ']).next().unwrap_or_default();
            format!("{physical} ({name})")
        }
        _ => "list".to_owned(),
    }
}

/// Names of a time stamp without a unit, or with one that its type replaces.
const STAMPS: [&str; 10] = [
    "time",
    "timestamp",
    "datetime",
    "date",
    "t",
    "time_s",
    "time_ms",
    "time_us",
    "time_ns",
    // The index of a table of pandas.
    "__index_level_0__",
];
/// Names of a point's values in files of other programs.
const FOREIGN: [(&str, &str); 8] = [
    ("x", "east_m"),
    ("y", "north_m"),
    ("z", "up_m"),
    ("gps_time", "time_s"),
    ("gpstime", "time_s"),
    ("time", "time_s"),
    ("t", "time_s"),
    ("intensity", "intensity"),
];

/// The names by which tables are read: those of the file, but `time_s` for a time stamp, and the names
/// of a cloud's columns for `x`, `y`, `z`, times and intensity of other programs.
pub(super) fn header_of(content: &ParquetMetaData) -> Header {
    let columns = content.file_metadata().schema_descr().columns();
    let mut names: Vec<String> = columns.iter().map(|c| c.path().string()).collect();
    let stamp = columns.iter().zip(&names).position(|(column, name)| {
        let name = name.to_lowercase();
        matches!(Value::of(column), Some(Value::Time { .. })) && STAMPS.contains(&name.as_str())
    });
    if let Some(stamp) = stamp
        && !(names.iter().enumerate())
            .any(|(i, name)| i != stamp && factor(name, "time_s").is_some())
    {
        names[stamp] = "time_s".to_owned();
    }
    let place = |names: &[String], wanted: &str| {
        let is_one = |name: &String| name.eq_ignore_ascii_case(wanted);
        names.iter().position(is_one)
    };
    let has = |wanted| place(&names, wanted).is_some();
    // With a quaternion the rows are poses, and only the native names tell their frame.
    let is_foreign_cloud = ["x", "y", "z"].into_iter().all(has) && !has("east_m") && !has("qw");
    if is_foreign_cloud {
        for (from, to) in FOREIGN {
            if let Some(place) = place(&names, from)
                && !names.iter().any(|name| name == to)
            {
                names[place] = to.to_owned();
            }
        }
    }
    Header {
        names,
        is_foreign_cloud,
    }
}
