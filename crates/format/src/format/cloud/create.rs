//! Writing of clouds in the format that the end of the file name selects.

use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};
use crate::format::cloud::sink::{CloudPoint, CloudShape, CloudSink};
use crate::format::cloud::sink_checks::{check_position, plain_names};
use crate::format::las::value::ExtraValue;
use crate::format::las::writer::CloudWriter;
use crate::format::log::tables::TableWriter;
use crate::format::{copc_sink, e57_sink, parquet_sink, ply_sink};

/// Creates or replaces a file for a cloud of this shape.
type Create = fn(&Path, &CloudShape) -> Result<Box<dyn CloudSink>>;

/// Ends of names and their writers; the first one that matches is used.
const WRITERS: [(&str, Create); 7] = [
    (".copc.laz", copc_sink),
    (".laz", las_sink),
    (".las", las_sink),
    (".e57", e57_sink),
    (".ply", ply_sink),
    (".parquet", parquet_sink),
    (".csv", table_sink),
];

fn writer(path: &Path) -> Option<Create> {
    let name = path.file_name()?.to_str()?.to_lowercase();
    let mut writers = WRITERS.iter();
    let (_, create) = writers.find(|(end, _)| name.ends_with(end))?;
    Some(*create)
}

/// Whether the end of a name selects a format in which clouds are written.
pub fn is_cloud_name(path: &Path) -> bool {
    writer(path).is_some()
}

/// Creates or replaces a cloud file in the format given by the end of its name: `.copc.laz`, `.laz`,
/// `.las`, `.e57`, `.ply`, `.parquet` or `.csv`.
///
/// # Errors
/// Another end; a shape that the format cannot hold; a file that cannot be written.
pub fn create_cloud(path: &Path, shape: &CloudShape) -> Result<Box<dyn CloudSink>> {
    let create = writer(path).ok_or_else(|| {
        let ends: Vec<&str> = WRITERS.iter().map(|(end, _)| *end).collect();
        Error::format(
            path,
            Location::Whole,
            "a name with another extension",
            format!("a name that ends in {}", ends.join(", ")),
        )
    })?;
    create(path, shape)
}

fn las_sink(path: &Path, shape: &CloudShape) -> Result<Box<dyn CloudSink>> {
    Ok(Box::new(CloudWriter::spanning(path, shape)?))
}

/// Text with one column for each value.
struct TableSink {
    path: PathBuf,
    sheet: TableWriter,
    has_time: bool,
    has_intensity: bool,
    dimensions: usize,
}

fn table_sink(path: &Path, shape: &CloudShape) -> Result<Box<dyn CloudSink>> {
    let mut header = vec!["east_m", "north_m", "up_m"];
    header.extend(shape.has_time.then_some("time_s"));
    header.extend(shape.has_intensity.then_some("intensity"));
    let names = plain_names(
        path,
        shape,
        &["east_m", "north_m", "up_m", "time_s", "intensity"],
    )?;
    header.extend(names.iter().map(String::as_str));
    Ok(Box::new(TableSink {
        path: path.to_owned(),
        sheet: TableWriter::create(path, &header)?,
        has_time: shape.has_time,
        has_intensity: shape.has_intensity,
        dimensions: shape.dimensions.len(),
    }))
}

impl CloudSink for TableSink {
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()> {
        check_position(&self.path, point)?;
        let p = point.position;
        let time_s = self.has_time.then_some(point.time_s);
        let intensity = self.has_intensity.then(|| f64::from(point.intensity));
        let value = |at: usize| point.values.get(at).copied().unwrap_or(ExtraValue::NONE);
        let values = (0..self.dimensions).map(value);
        let cells = [p.x, p.y, p.z].into_iter().chain(time_s).chain(intensity);
        self.sheet.row(cells.map(ExtraValue::Number).chain(values))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.sheet.finish()
    }
}
