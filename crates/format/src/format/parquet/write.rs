//! Clouds and tables written as Parquet.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use ::parquet::data_type::{DataType, DoubleType, FloatType, Int32Type, Int64Type};
use ::parquet::errors::ParquetError;
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::{EnabledStatistics, WriterProperties};
use ::parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use ::parquet::schema::types::Type;

use crate::error::{Error, Result};
use crate::format::cloud::sink::{CloudPoint, CloudShape, CloudSink};
use crate::format::cloud::sink_checks::check_position;
use crate::format::las::extra::ExtraKind;
use crate::format::las::value::ExtraValue;

/// Rows per row group.
const GROUP: usize = 100_000;

/// Metadata key of the coordinate reference system (WKT).
pub(super) const CRS_KEY: &str = "crs_wkt";

/// The values of a column that have not been written yet.
enum Cells {
    /// Without nulls.
    F64(Vec<f64>),
    F32(Vec<f32>),
    /// The bits of unsigned numbers.
    U32(Vec<i32>),
    /// With the definition level of every row: 0 for a null.
    Optional(Vec<f64>, Vec<i16>),
    I64(Vec<i64>, Vec<i16>),
    /// The bits of unsigned numbers.
    U64(Vec<i64>, Vec<i16>),
}

impl Cells {
    fn schema(&self, name: &str) -> std::result::Result<Type, ParquetError> {
        let (kind, logical) = match self {
            Self::F64(_) | Self::Optional(..) => (Physical::DOUBLE, None),
            Self::F32(_) => (Physical::FLOAT, None),
            Self::U32(_) => (Physical::INT32, Some(LogicalType::integer(32, false))),
            Self::I64(..) => (Physical::INT64, Some(LogicalType::integer(64, true))),
            Self::U64(..) => (Physical::INT64, Some(LogicalType::integer(64, false))),
        };
        let repetition = match self {
            Self::Optional(..) | Self::I64(..) | Self::U64(..) => Repetition::OPTIONAL,
            _ => Repetition::REQUIRED,
        };
        Type::primitive_type_builder(name, kind)
            .with_repetition(repetition)
            .with_logical_type(logical)
            .build()
    }

    fn push(&mut self, value: ExtraValue) {
        let number = value.number();
        match self {
            Self::F64(values) => values.push(number),
            Self::F32(values) => values.push(number as f32),
            // `as` saturates and converts NaN to 0.
            Self::U32(values) => values.push((number as u32).cast_signed()),
            Self::Optional(values, levels) => {
                push_some(values, levels, (!number.is_nan()).then_some(number));
            }
            Self::I64(values, levels) => push_some(values, levels, value.signed()),
            Self::U64(values, levels) => {
                push_some(values, levels, value.unsigned().map(u64::cast_signed));
            }
        }
    }

    fn write(
        &mut self,
        column: SerializedColumnWriter<'_>,
    ) -> std::result::Result<(), ParquetError> {
        match self {
            Self::F64(values) => write::<DoubleType>(column, values, None),
            Self::F32(values) => write::<FloatType>(column, values, None),
            Self::U32(values) => write::<Int32Type>(column, values, None),
            Self::Optional(values, levels) => {
                write::<DoubleType>(column, values, Some(levels))?;
                levels.clear();
                Ok(())
            }
            Self::I64(values, levels) | Self::U64(values, levels) => {
                write::<Int64Type>(column, values, Some(levels))?;
                levels.clear();
                Ok(())
            }
        }
    }
}

/// Appends a value and its definition level.
fn push_some<T>(values: &mut Vec<T>, levels: &mut Vec<i16>, value: Option<T>) {
    levels.push(i16::from(value.is_some()));
    values.extend(value);
}

fn write<T: DataType>(
    mut column: SerializedColumnWriter<'_>,
    values: &mut Vec<T::T>,
    levels: Option<&[i16]>,
) -> std::result::Result<(), ParquetError> {
    column.typed::<T>().write_batch(values, levels, None)?;
    values.clear();
    column.close()
}

/// An open file.
struct Sheet {
    path: PathBuf,
    out: SerializedFileWriter<BufWriter<File>>,
    columns: Vec<Cells>,
    rows: usize,
}

impl Sheet {
    /// Creates or replaces the file.
    fn create(path: &Path, columns: Vec<(&str, Cells)>, wkt: Option<&str>) -> Result<Self> {
        let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        if let Some(twice) = (1..names.len()).find(|&i| names[..i].contains(&names[i])) {
            return Err(Error::data(
                format!("{}: the column {} twice", path.display(), names[twice]),
                "give every column a different name",
            ));
        }
        let problem = |e| problem(path, e);
        let fields: std::result::Result<Vec<_>, _> = columns
            .iter()
            .map(|(name, cells)| cells.schema(name).map(Arc::new))
            .collect();
        let schema = Type::group_type_builder("schema")
            .with_fields(fields.map_err(problem)?)
            .build()
            .map_err(problem)?;
        let wkt = wkt.map(|wkt| vec![KeyValue::new(CRS_KEY.to_owned(), wkt.to_owned())]);
        let properties = WriterProperties::builder()
            .set_created_by("boresight".to_owned())
            .set_compression(Compression::SNAPPY)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_key_value_metadata(wkt)
            .build();
        let file = File::create(path).map_err(|e| Error::io(path, e))?;
        let out = BufWriter::with_capacity(1 << 18, file);
        let out = SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties));
        Ok(Self {
            path: path.to_owned(),
            out: out.map_err(problem)?,
            columns: columns.into_iter().map(|(_, cells)| cells).collect(),
            rows: 0,
        })
    }

    /// Appends a row; missing cells have no value.
    fn push(&mut self, cells: impl IntoIterator<Item = ExtraValue>) -> Result<()> {
        let mut cells = cells.into_iter();
        for column in &mut self.columns {
            column.push(cells.next().unwrap_or(ExtraValue::NONE));
        }
        debug_assert!(cells.next().is_none(), "more cells than columns");
        self.rows += 1;
        match self.rows {
            GROUP => self.flush(),
            _ => Ok(()),
        }
    }

    fn flush(&mut self) -> Result<()> {
        self.rows = 0;
        let (out, columns) = (&mut self.out, &mut self.columns);
        write_group(out, columns).map_err(|e| problem(&self.path, e))
    }

    fn finish(mut self) -> Result<()> {
        if self.rows > 0 {
            self.flush()?;
        }
        let out = self.out.into_inner().map_err(|e| problem(&self.path, e))?;
        out.into_inner()
            .map(drop)
            .map_err(|e| Error::io(&self.path, e.into_error()))
    }
}

fn write_group(
    out: &mut SerializedFileWriter<BufWriter<File>>,
    columns: &mut [Cells],
) -> std::result::Result<(), ParquetError> {
    let mut group = out.next_row_group()?;
    for cells in columns {
        if let Some(column) = group.next_column()? {
            cells.write(column)?;
        }
    }
    group.close().map(drop)
}

/// The error of a file that the library cannot write.
pub(super) fn problem(path: &Path, error: ParquetError) -> Error {
    let source = match error {
        ParquetError::External(source) => match source.downcast::<std::io::Error>() {
            Ok(source) => *source,
            Err(source) => std::io::Error::other(source),
        },
        other => std::io::Error::other(other),
    };
    Error::io(path, source)
}

/// A cloud with columns `east_m`, `north_m`, `up_m` (64 bits), `time_s` (64 bits) and `intensity`
/// (32 bits) if the shape has them, and the dimensions by name and type. Compressed with Snappy; the
/// coordinate reference system is the file's metadata `crs_wkt`. The same points give the same bytes.
struct ParquetCloud {
    sheet: Sheet,
    has_time: bool,
    has_intensity: bool,
    dimensions: usize,
}

/// Creates or replaces a Parquet file for a cloud.
///
/// # Errors
/// A dimension with the name of another column, a file that cannot be written.
pub fn parquet_sink(path: &Path, shape: &CloudShape) -> Result<Box<dyn CloudSink>> {
    let f64s = || Cells::F64(Vec::new());
    let f32s = || Cells::F32(Vec::new());
    let mut columns: Vec<(&str, Cells)> = ["east_m", "north_m", "up_m"]
        .map(|name| (name, f64s()))
        .into();
    columns.extend(shape.has_time.then(|| ("time_s", f64s())));
    columns.extend(shape.has_intensity.then(|| ("intensity", f32s())));
    for dimension in &shape.dimensions {
        let cells = match dimension.kind {
            ExtraKind::F32 => f32s(),
            // Values of LAS that stand for no data are nulls.
            ExtraKind::F64 => Cells::Optional(Vec::new(), Vec::new()),
            ExtraKind::U32 => Cells::U32(Vec::new()),
            ExtraKind::I64 => Cells::I64(Vec::new(), Vec::new()),
            ExtraKind::U64 => Cells::U64(Vec::new(), Vec::new()),
        };
        columns.push((&dimension.name, cells));
    }
    Ok(Box::new(ParquetCloud {
        sheet: Sheet::create(path, columns, shape.wkt.as_deref())?,
        has_time: shape.has_time,
        has_intensity: shape.has_intensity,
        dimensions: shape.dimensions.len(),
    }))
}

impl CloudSink for ParquetCloud {
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()> {
        let p = &point.position;
        check_position(&self.sheet.path, point)?;
        let time = self.has_time.then_some(point.time_s);
        let intensity = self.has_intensity.then_some(f64::from(point.intensity));
        let values = point.values.iter().copied().take(self.dimensions);
        let cells = [p.x, p.y, p.z].into_iter().chain(time).chain(intensity);
        self.sheet.push(cells.map(ExtraValue::Number).chain(values))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.sheet.finish()
    }
}

/// A table of 64-bit numbers that is written as Parquet, row by row, with the column names of the same
/// table in text. NaN becomes a null, as it becomes an empty cell in text. Compressed with Snappy. The
/// same rows give the same bytes. Dropped before [`finish`](Self::finish), it leaves an incomplete file.
pub struct ParquetTable(Sheet);

impl ParquetTable {
    /// Creates or replaces the file.
    ///
    /// # Errors
    /// A repeated name, a file that cannot be written.
    pub fn create(path: &Path, names: &[&str]) -> Result<Self> {
        let cells = || Cells::Optional(Vec::new(), Vec::new());
        let columns = names.iter().map(|name| (*name, cells())).collect();
        Sheet::create(path, columns, None).map(Self)
    }

    /// Appends a row, with a cell for each column.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn row(&mut self, cells: impl IntoIterator<Item = f64>) -> Result<()> {
        self.0.push(cells.into_iter().map(ExtraValue::Number))
    }

    /// Completes the file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(self) -> Result<()> {
        self.0.finish()
    }
}
