//! Defensive reading of LAS and LAZ: a damaged header must not exhaust memory, damaged points must
//! not cause a panic.

use std::io::BufReader;
use std::ops::Range;
use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::binary::bytes_at;
use crate::format::cloud::crs::CoordinateUnit;
use crate::format::file::guarded;
use crate::format::input::Input;
use crate::format::las::chunks as laz_chunks;
use crate::format::las::header::{self as las_header, Checked};
use crate::format::las::units::{converted, coordinate_unit, has_system};
use crate::format::plausible::{MOST_TIME_S, check_point};
use crate::format::text::civil::{adjusted_gps_from_unix_s, civil_time, unix_from_adjusted_gps_s};
use crate::geometry::{Vec3, is_finite};

/// Bytes of points decoded at a time, by each thread; a record may have 65,535 bytes.
const LARGEST_PIECE: usize = 8 << 20;

/// A decoded point with its optional values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LasPoint<'a> {
    /// Metres.
    pub(crate) position: Vec3,
    /// Seconds. Adjusted standard GPS time is converted to Unix time, like all other absolute times. NaN for a point
    /// without a time.
    pub(crate) time_s: f64,
    pub(crate) intensity: f32,
    /// The bytes after the standard fields.
    pub(crate) extra: &'a [u8],
    /// All bytes as in an uncompressed file.
    pub(crate) record: &'a [u8],
}

/// An open LAS or LAZ file.
pub(crate) struct LasFile {
    input: Input,
    reader: las::Reader,
    /// Whether the reader unpacks chunks on all threads.
    is_parallel: bool,
    points: las::PointData,
    /// Which of the decoded points have not been taken.
    ready: Range<usize>,
    taken: u64,
    bytes: u64,
    remarks: Vec<String>,
    unit: Option<CoordinateUnit>,
    /// Metres of a step of each coordinate of the file.
    metres: Vec3,
}

fn problem(path: &Path, error: las::Error) -> Error {
    let text = error.to_string();
    // The header was checked against the size of the file, so that the end of a chunk is not that of the file.
    let found = if text.contains("failed to fill whole buffer") {
        "points that end within a chunk or cannot be unpacked: the file is damaged, or was cut off"
            .to_owned()
    } else {
        text
    };
    Error::format(path, Location::Whole, found, "an undamaged LAS or LAZ file")
}

impl LasFile {
    /// Chunks of different sizes, as in COPC, are unpacked on all threads.
    pub(crate) fn open(input: &Input) -> Result<Self> {
        let mut file = Self::reopen(input)?;
        if laz_chunks::check(input, file.header(), file.bytes)? {
            file = Self::with(input, las::LazParallelism::Yes)?;
        }
        if file.has_adjusted_gps_time() {
            file.remarks.extend(Self::remark_on_dates(input));
        }
        Ok(file)
    }

    /// What to say of a file with adjusted standard GPS time if its first time looks like one of another clock: a time of
    /// the GPS week would be in the week of 2011-09-14; GPS and Unix times of the years since then, from which 10⁹ s were
    /// not taken, come out after 2042.
    fn remark_on_dates(input: &Input) -> Option<String> {
        const WEEK_S: f64 = 604_800.0;
        const LATEST_UNIX_S: f64 = 2.3e9;
        let mut file = Self::reopen(input).ok()?;
        let mut unix_s = f64::NAN;
        file.read(1, |_, point| {
            unix_s = point.time_s;
            Ok(())
        })
        .ok()?;
        let first_s = adjusted_gps_from_unix_s(unix_s);
        let mut date = civil_time(unix_s);
        let other = if (0.0..WEEK_S).contains(&first_s) {
            date = "in September 2011".to_owned();
            "seconds of the GPS week"
        } else if (LATEST_UNIX_S..MOST_TIME_S).contains(&unix_s) {
            "Unix times, or GPS times without the adjustment"
        } else {
            return None;
        };
        Some(format!(
            "the header flags times as adjusted standard GPS times, of which {first_s} s is {date}: if they are {other}, \
             correct bit 0 of its global encoding"
        ))
    }

    /// As [`open`](Self::open) where the chunks were checked, or only the header is read; unpacks on one thread.
    pub(crate) fn reopen(input: &Input) -> Result<Self> {
        // Sequential decompression does not allocate memory based on a chunk table, which may be
        // damaged.
        Self::with(input, las::LazParallelism::No)
    }

    fn with(input: &Input, parallelism: las::LazParallelism) -> Result<Self> {
        let Checked {
            content,
            bytes,
            remarks,
        } = las_header::open(input)?;
        guarded(input.path(), "LAS or LAZ", || {
            let options = las::ReaderOptions::default().with_laz_parallelism(parallelism);
            let reader = las::Reader::with_options(BufReader::new(content), options)
                .map_err(|e| problem(input.path(), e))?;
            let unit = coordinate_unit(reader.header());
            let mut remarks = remarks;
            if unit.is_none() && has_system(reader.header()) {
                remarks.push(
                    "the coordinate system does not name its unit: coordinates are read as metres"
                        .to_owned(),
                );
            }
            let metres = converted(unit.as_ref()).map_or(Vec3::repeat(1.0), |(_, metres)| metres);
            let points = las::PointDataBuilder::new()
                .for_header(reader.header())
                .build();
            Ok(Self {
                input: input.clone(),
                reader,
                is_parallel: matches!(parallelism, las::LazParallelism::Yes),
                points,
                ready: 0..0,
                taken: 0,
                bytes,
                remarks,
                unit,
                metres,
            })
        })
    }

    pub(crate) fn input(&self) -> &Input {
        &self.input
    }

    pub(crate) fn path(&self) -> &Path {
        self.input.path()
    }

    pub(crate) fn header(&self) -> &las::Header {
        self.reader.header()
    }

    /// Whether the file has adjusted standard GPS time, which is read as Unix time.
    pub(crate) fn has_adjusted_gps_time(&self) -> bool {
        self.has_time() && self.header().gps_time_type() == las::GpsTimeType::Standard
    }

    pub(crate) fn has_time(&self) -> bool {
        self.header().point_format().has_gps_time
    }

    /// What was corrected or converted, one sentence each.
    pub(crate) fn remarks(&self) -> Vec<String> {
        let mut remarks = self.remarks.clone();
        if let Some((name, metres)) = self.converted() {
            remarks.push(format!(
                "coordinates are converted to metres from the unit {name} of {} m (heights: {} m)",
                metres.x, metres.z
            ));
        }
        remarks
    }

    /// Whether coordinates are latitudes and longitudes.
    pub(crate) fn is_geographic(&self) -> bool {
        self.unit == Some(CoordinateUnit::Degree)
    }

    /// The name of the unit of the coordinates, if they are converted to metres, and its metres east, north and up.
    pub(crate) fn converted(&self) -> Option<(&str, Vec3)> {
        converted(self.unit.as_ref()).filter(|(_, metres)| *metres == self.metres)
    }

    /// Leaves coordinates in the unit of the file.
    pub(crate) fn keep_unit(&mut self) {
        self.metres = Vec3::repeat(1.0);
    }

    pub(crate) fn taken(&self) -> u64 {
        self.taken
    }

    pub(crate) fn bytes_total(&self) -> u64 {
        self.bytes
    }

    /// Whether [`LasFile::seek`] works: the decoder cannot seek if compressed chunks have different
    /// numbers of points, as in COPC.
    pub(crate) fn can_seek(&self) -> bool {
        let laz = self.header().laz_vlr();
        !laz.is_ok_and(|laz| laz.uses_variable_size_chunks())
    }

    /// Seeks to a point, counted from 0.
    pub(crate) fn seek(&mut self, index: u64) -> Result<()> {
        self.taken = index;
        self.ready = 0..0;
        let Self { input, reader, .. } = self;
        let path = input.path();
        guarded(path, "LAS or LAZ", || {
            reader.seek(index).map_err(|e| problem(path, e))
        })
    }

    /// Decodes up to `n` points, calls `take` with each and its index, and returns their number.
    pub(crate) fn read(
        &mut self,
        n: usize,
        mut take: impl FnMut(u64, LasPoint<'_>) -> Result<()>,
    ) -> Result<u64> {
        let Self {
            input,
            reader,
            is_parallel,
            points,
            ready,
            taken,
            metres,
            ..
        } = self;
        let path = input.path();
        let format = *reader.header().point_format();
        let (length, extra) = (points.record_len(), usize::from(format.extra_bytes));
        let most = LARGEST_PIECE / length.max(1);
        let n = n.min(most);
        if ready.start == ready.end {
            let decoded = if *is_parallel {
                most * rayon::current_num_threads()
            } else {
                n
            };
            let count = guarded(path, "LAS or LAZ", || {
                reader
                    .fill_points(decoded as u64, points)
                    .map_err(|e| problem(path, e))
            })?;
            *ready = 0..count as usize;
        }
        let first = *taken;
        let given = ready.start..ready.end.min(ready.start + n);
        let count = given.len() as u64;
        ready.start = given.end;
        *taken += count;
        let transforms = *reader.header().transforms();
        let time_at = if format.is_extended { 22 } else { 20 };
        let time = |record: &[u8]| f64::from_le_bytes(bytes_at(record, time_at));
        let is_adjusted = reader.header().gps_time_type() == las::GpsTimeType::Standard;
        let records = &points.raw_bytes()[given.start * length..given.end * length];
        for (i, record) in records.chunks_exact(length).enumerate() {
            let raw = |at: usize| i32::from_le_bytes(bytes_at(record, at));
            let point = LasPoint {
                position: Vec3::new(
                    transforms.x.direct(raw(0)),
                    transforms.y.direct(raw(4)),
                    transforms.z.direct(raw(8)),
                )
                .component_mul(metres),
                time_s: match format.has_gps_time.then(|| time(record)) {
                    Some(time_s) if time_s.is_finite() && is_adjusted => {
                        unix_from_adjusted_gps_s(time_s)
                    }
                    Some(time_s) if time_s.is_finite() => time_s,
                    _ => f64::NAN,
                },
                intensity: f32::from(u16::from_le_bytes(bytes_at(record, 12))),
                extra: &record[length - extra..],
                record,
            };
            if !is_finite(&point.position) {
                return Err(point_error(
                    path,
                    first + i as u64,
                    "a coordinate that is not finite",
                    "finite numbers",
                ));
            }
            check_point(path, first + i as u64, &point.position, point.time_s)?;
            take(first + i as u64, point)?;
        }
        Ok(count)
    }
}

/// A format error at a point, counted from 0.
pub(crate) fn point_error(path: &Path, index: u64, found: &str, expected: &str) -> Error {
    Error::format(
        path,
        Location::Whole,
        format!("{found} at point {index}"),
        expected,
    )
}
