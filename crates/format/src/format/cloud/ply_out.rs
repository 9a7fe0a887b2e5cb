//! Writer of clouds, point by point, as binary little-endian PLY.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::format::cloud::sink::{CloudPoint, CloudShape, CloudSink};
use crate::format::cloud::sink_checks::{check_position, plain_names};
use crate::format::las::extra::{ExtraDimension, ExtraKind};
use crate::format::las::value::ExtraValue;

const RESERVED: [&str; 5] = ["x", "y", "z", "time_s", "intensity"];

/// Digits of the largest number of points.
const DIGITS: usize = 20;

struct PlySink {
    path: PathBuf,
    out: BufWriter<File>,
    has_time: bool,
    has_intensity: bool,
    dimensions: Vec<ExtraDimension>,
    /// The lines of the header after the number of points.
    properties: String,
    record: Vec<u8>,
    count: u64,
}

/// Creates or replaces a PLY file: for each point `x`, `y`, `z` (m) as `double`, `time_s` (s) as
/// `double` and `intensity` as `float` if the shape has them, and the dimensions as `float`,
/// `double` or `uint`, integers of 64 bits as `double`, which rounds them above 2⁵³. Characters of their names other than ASCII letters, digits, `-` and `_`
/// become `_`. PLY has no field for the coordinate reference system, so it is lost. A cloud
/// without points gives a valid file. The same points give the same bytes.
///
/// # Errors
/// Dimensions whose names clash; a file that cannot be written.
pub fn ply_sink(path: &Path, shape: &CloudShape) -> Result<Box<dyn CloudSink>> {
    let names = plain_names(path, shape, &RESERVED)?;
    let mut properties = String::new();
    let mut property = |kind: &str, name: &str| {
        properties += &format!("property {kind} {name}\n");
    };
    for axis in ["x", "y", "z"] {
        property("double", axis);
    }
    if shape.has_time {
        property("double", "time_s");
    }
    if shape.has_intensity {
        property("float", "intensity");
    }
    for (dimension, name) in shape.dimensions.iter().zip(&names) {
        let kind = match stored(dimension.kind) {
            ExtraKind::F32 => "float",
            ExtraKind::U32 => "uint",
            _ => "double",
        };
        property(kind, name);
    }
    let file = File::create(path).map_err(|e| Error::io(path, e))?;
    let mut sink = PlySink {
        path: path.to_owned(),
        out: BufWriter::with_capacity(1 << 20, file),
        has_time: shape.has_time,
        has_intensity: shape.has_intensity,
        dimensions: shape.dimensions.clone(),
        properties,
        record: Vec::new(),
        count: 0,
    };
    let header = sink.header();
    sink.write(header.as_bytes())?;
    Ok(Box::new(sink))
}

/// The type in which values are stored: PLY has no integers of 64 bits.
fn stored(kind: ExtraKind) -> ExtraKind {
    match kind {
        ExtraKind::I64 | ExtraKind::U64 => ExtraKind::F64,
        other => other,
    }
}

impl PlySink {
    /// The header, which has the same length for any number of points: a comment is shortened as
    /// the number grows. Leading zeros would not do, because some readers take them for octal numbers.
    fn header(&self) -> String {
        let count = self.count.to_string();
        let fill = "-".repeat(DIGITS - count.len());
        format!(
            "ply\nformat binary_little_endian 1.0\ncomment boresight -{fill}\n\
             element vertex {count}\n{}end_header\n",
            self.properties
        )
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.out
            .write_all(bytes)
            .map_err(|e| Error::io(&self.path, e))
    }
}

impl CloudSink for PlySink {
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()> {
        check_position(&self.path, point)?;
        self.record.clear();
        for v in point.position.iter() {
            self.record.extend_from_slice(&v.to_le_bytes());
        }
        if self.has_time {
            self.record.extend_from_slice(&point.time_s.to_le_bytes());
        }
        if self.has_intensity {
            self.record
                .extend_from_slice(&point.intensity.to_le_bytes());
        }
        for (at, dimension) in self.dimensions.iter().enumerate() {
            let value = point.values.get(at).copied().unwrap_or(ExtraValue::NONE);
            stored(dimension.kind).append(value, &mut self.record);
        }
        self.count += 1;
        self.out
            .write_all(&self.record)
            .map_err(|e| Error::io(&self.path, e))
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        let header = self.header();
        self.out
            .seek(SeekFrom::Start(0))
            .and_then(|_| self.out.write_all(header.as_bytes()))
            .and_then(|()| self.out.flush())
            .map_err(|e| Error::io(&self.path, e))
    }
}
