//! Writer of clouds, point by point, as E57 (ASTM E2807).

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use ::e57::{E57Writer, Extension, IntensityLimits, RawValues};
use ::e57::{Record, RecordDataType, RecordName, RecordValue};

use crate::error::{Error, Location, Result};
use crate::format::cloud::sink::{CloudPoint, CloudShape, CloudSink};
use crate::format::cloud::sink_checks::{check_position, plain_names};
use crate::format::file::guarded;
use crate::format::las::extra::{ExtraDimension, ExtraKind};
use crate::format::las::value::ExtraValue;

/// Points passed to the encoder at a time, and most batches that wait for it.
const BATCH: usize = 4096;
const WAITING: usize = 4;

/// Namespace of the dimensions: its prefix, and its name, which is not an address.
const PREFIX: &str = "boresight";
const NAMESPACE: &str = "urn:boresight:dimensions";

/// Placeholders of the identifiers of the file and of its cloud until the points are known.
const FILE_ID: &str = "{00000000-0000-8000-8000-000000000001}";
const CLOUD_ID: &str = "{00000000-0000-8000-8000-000000000002}";

/// Input of the encoder.
enum Piece {
    Points(Vec<RawValues>),
    /// The end of the points, with the identifiers without braces.
    End {
        file_id: String,
        cloud_id: String,
    },
}

struct E57Sink {
    path: PathBuf,
    has_time: bool,
    has_intensity: bool,
    dimensions: Vec<ExtraDimension>,
    batch: Vec<RawValues>,
    identity: Identity,
    /// This and the next field are `None` once the encoder has ended. The encoder's writer borrows
    /// from the file, so both live on a thread.
    pieces: Option<SyncSender<Piece>>,
    encoder: Option<JoinHandle<Result<()>>>,
}

/// Creates or replaces an E57 file with one cloud: Cartesian coordinates (m, double precision),
/// `intensity` (single precision) and `timeStamp` (s, as given, without a start time) if the shape
/// has them, the dimensions as attributes of an extension with the prefix `boresight`, and the WKT
/// of the coordinate reference system as `coordinateMetadata`. Characters of the dimensions' names
/// other than ASCII letters, digits, `-` and `_` become `_`. Without points, the file has no
/// cloud. The same points give the same bytes: the identifiers are made from checksums of
/// the content, and there is no date.
///
/// # Errors
/// Dimensions whose names clash; a file that cannot be written.
pub fn e57_sink(path: &Path, shape: &CloudShape) -> Result<Box<dyn CloudSink>> {
    let names = plain_names(path, shape, &[])?;
    let prototype = prototype(shape, &names);
    // The encoder reads from the file that it writes.
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(true)
        .open(path)
        .map_err(|e| Error::io(path, e))?;
    let (pieces, received) = sync_channel(WAITING);
    let wkt = shape.wkt.clone();
    let encoder = {
        let path = path.to_owned();
        std::thread::spawn(move || {
            guarded(&path, "E57", || {
                encode(file, prototype, wkt, &received).map_err(|e| problem(&path, &e))
            })
        })
    };
    Ok(Box::new(E57Sink {
        path: path.to_owned(),
        has_time: shape.has_time,
        has_intensity: shape.has_intensity,
        dimensions: shape.dimensions.clone(),
        batch: Vec::with_capacity(BATCH),
        identity: Identity::of(shape),
        pieces: Some(pieces),
        encoder: Some(encoder),
    }))
}

/// Names and types of the values of a point, in the order in which they are written.
fn prototype(shape: &CloudShape, names: &[String]) -> Vec<Record> {
    let double = RecordDataType::F64;
    let record = |name, data_type| Record { name, data_type };
    let mut records = vec![
        record(RecordName::CartesianX, double.clone()),
        record(RecordName::CartesianY, double.clone()),
        record(RecordName::CartesianZ, double.clone()),
    ];
    if shape.has_time {
        records.push(record(RecordName::TimeStamp, double.clone()));
    }
    if shape.has_intensity {
        records.push(record(RecordName::Intensity, RecordDataType::F32));
    }
    for (dimension, name) in shape.dimensions.iter().zip(names) {
        let name = RecordName::Unknown {
            namespace: PREFIX.to_owned(),
            name: name.clone(),
        };
        let data_type = match dimension.kind {
            ExtraKind::F32 => RecordDataType::F32,
            ExtraKind::F64 => double.clone(),
            ExtraKind::U32 => RecordDataType::Integer {
                min: 0,
                max: i64::from(u32::MAX),
            },
            ExtraKind::I64 => RecordDataType::Integer {
                min: i64::MIN,
                max: i64::MAX,
            },
            ExtraKind::U64 => RecordDataType::Integer {
                min: 0,
                max: i64::MAX,
            },
        };
        records.push(record(name, data_type));
    }
    records
}

/// Writes the points as they arrive. If [`Piece::End`] never arrives, the file stays incomplete.
fn encode(
    file: File,
    prototype: Vec<Record>,
    wkt: Option<String>,
    pieces: &Receiver<Piece>,
) -> ::e57::Result<()> {
    let intensity_at = prototype
        .iter()
        .position(|record| record.name == RecordName::Intensity);
    let has_dimensions = prototype
        .iter()
        .any(|record| matches!(record.name, RecordName::Unknown { .. }));
    let mut writer = E57Writer::new(file, FILE_ID)?;
    // The text is written as CDATA, whose end mark `]]>` it must not contain.
    writer.set_coordinate_metadata(wkt.map(|wkt| wkt.replace("]]>", "]] >")));
    if has_dimensions {
        writer.register_extension(Extension::new(PREFIX, NAMESPACE))?;
    }
    let mut piece = pieces.recv();
    if let Ok(Piece::End { file_id, .. }) = &piece {
        // Some readers fail on a cloud without points, but not on a file without clouds.
        return writer.finalize_customized_xml(|xml| Ok(with_id(&xml, FILE_ID, file_id)));
    }
    let mut points = writer.add_pointcloud(CLOUD_ID, prototype)?;
    let mut limits: Option<(f32, f32)> = None;
    loop {
        match piece {
            Ok(Piece::Points(batch)) => {
                for values in batch {
                    if let Some(RecordValue::Single(v)) = intensity_at.map(|at| &values[at])
                        && v.is_finite()
                    {
                        let (low, high) = limits.unwrap_or((*v, *v));
                        limits = Some((low.min(*v), high.max(*v)));
                    }
                    points.add_point(values)?;
                }
            }
            Ok(Piece::End { file_id, cloud_id }) => {
                points.set_intensity_limits(limits.map(|(low, high)| IntensityLimits {
                    intensity_min: Some(RecordValue::Single(low)),
                    intensity_max: Some(RecordValue::Single(high)),
                }));
                points.finalize()?;
                drop(points);
                return writer.finalize_customized_xml(|xml| {
                    let xml = with_id(&xml, FILE_ID, &file_id);
                    Ok(with_id(&xml, CLOUD_ID, &cloud_id))
                });
            }
            Err(_) => return Ok(()),
        }
        piece = pieces.recv();
    }
}

/// The XML section with an identifier in place of its placeholder.
fn with_id(xml: &str, placeholder: &str, id: &str) -> String {
    xml.replacen(placeholder, &format!("{{{id}}}"), 1)
}

fn problem(path: &Path, error: &::e57::Error) -> Error {
    let mut cause: Option<&dyn std::error::Error> = Some(error);
    while let Some(at) = cause {
        if let Some(source) = at.downcast_ref::<std::io::Error>() {
            return Error::io(path, std::io::Error::new(source.kind(), source.to_string()));
        }
        cause = at.source();
    }
    Error::format(
        path,
        Location::Whole,
        error.to_string(),
        "points within the limits of E57",
    )
}

impl E57Sink {
    fn send(&mut self, piece: Piece) -> Result<()> {
        if let Some(pieces) = &self.pieces
            && pieces.send(piece).is_ok()
        {
            return Ok(());
        }
        self.end()
    }

    /// Waits for the encoder to end.
    fn end(&mut self) -> Result<()> {
        self.pieces = None;
        let Some(encoder) = self.encoder.take() else {
            return Err(Error::format(
                &self.path,
                Location::Whole,
                "a point after an error",
                "no further points",
            ));
        };
        encoder
            .join()
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

impl CloudSink for E57Sink {
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()> {
        check_position(&self.path, point)?;
        self.identity.add(point);
        let p = point.position;
        let mut values = Vec::with_capacity(5 + self.dimensions.len());
        values.extend([p.x, p.y, p.z].map(RecordValue::Double));
        if self.has_time {
            values.push(RecordValue::Double(point.time_s));
        }
        if self.has_intensity {
            values.push(RecordValue::Single(point.intensity));
        }
        for (at, dimension) in self.dimensions.iter().enumerate() {
            let value = point.values.get(at).copied().unwrap_or(ExtraValue::NONE);
            values.push(match dimension.kind {
                ExtraKind::F32 => RecordValue::Single(value.number() as f32),
                ExtraKind::F64 => RecordValue::Double(value.number()),
                // `as` saturates and converts NaN to 0.
                ExtraKind::U32 => RecordValue::Integer(i64::from(value.number() as u32)),
                ExtraKind::I64 => RecordValue::Integer(value.signed().unwrap_or(i64::MIN)),
                ExtraKind::U64 => RecordValue::Integer(value.signed().unwrap_or(i64::MAX)),
            });
        }
        self.batch.push(values);
        if self.batch.len() < BATCH {
            return Ok(());
        }
        let batch = std::mem::replace(&mut self.batch, Vec::with_capacity(BATCH));
        self.send(Piece::Points(batch))
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        let batch = std::mem::take(&mut self.batch);
        if !batch.is_empty() {
            self.send(Piece::Points(batch))?;
        }
        let (file_id, cloud_id) = self.identity.finish();
        self.send(Piece::End { file_id, cloud_id })?;
        self.end()
    }
}

impl Drop for E57Sink {
    fn drop(&mut self) {
        // The encoder ends when no more pieces can arrive. Its file must be closed before it is removed.
        self.pieces = None;
        if let Some(encoder) = self.encoder.take() {
            let _ = encoder.join();
        }
    }
}

/// Checksums of the content: one each of the shape, the positions, the times and the other values.
struct Identity([crc32fast::Hasher; 4]);

impl Identity {
    fn of(shape: &CloudShape) -> Self {
        let mut sums: [crc32fast::Hasher; 4] = Default::default();
        sums[0].update(&[u8::from(shape.has_time), u8::from(shape.has_intensity)]);
        for dimension in &shape.dimensions {
            sums[0].update(dimension.name.as_bytes());
            sums[0].update(&[0]);
        }
        sums[0].update(shape.wkt.as_deref().unwrap_or_default().as_bytes());
        Self(sums)
    }

    fn add(&mut self, point: &CloudPoint<'_>) {
        for v in point.position.iter() {
            self.0[1].update(&v.to_le_bytes());
        }
        self.0[2].update(&point.time_s.to_le_bytes());
        self.0[3].update(&point.intensity.to_le_bytes());
        for v in point.values {
            self.0[3].update(&v.number().to_le_bytes());
        }
    }

    /// Identifiers of the file and of its cloud: UUIDs of version 8, which applications define
    /// (RFC 9562).
    fn finish(&self) -> (String, String) {
        let sums = self.0.clone().map(crc32fast::Hasher::finalize);
        let bits = sums
            .iter()
            .fold(0u128, |id, sum| id << 32 | u128::from(*sum));
        (identifier(bits), identifier(!bits))
    }
}

fn identifier(bits: u128) -> String {
    let version_and_variant = bits & !(0xf << 76 | 0x3 << 62) | 0x8 << 76 | 0x2 << 62;
    let digits = format!("{version_and_variant:032X}");
    format!(
        "{}-{}-{}-{}-{}",
        &digits[..8],
        &digits[8..12],
        &digits[12..16],
        &digits[16..20],
        &digits[20..]
    )
}
