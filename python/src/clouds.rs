//! Clouds from files and into them.

use std::path::{Path, PathBuf};

use boresight::format::{
    CloudClock, CloudPoint, CloudRows, CloudShape, ExtraDimension, ExtraKind, ExtraValue,
    create_cloud,
};
use boresight::geometry::Vec3;
use boresight::output::Staging;
use boresight::progress::Progress;
use boresight::{Error, Result};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{from_vectors, numbers, vectors};
use crate::kernels::check_finite;
use crate::work::run;

/// Points between two reports of progress.
const STEP: usize = 1 << 16;

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(read_cloud, module)?)?;
    module.add_function(wrap_pyfunction!(write_cloud, module)?)
}

/// A cloud, one list for each value.
#[derive(Default)]
struct Columns {
    points: Vec<Vec3>,
    time_s: Vec<f64>,
    intensity: Vec<f32>,
    values: Vec<Vec<ExtraValue>>,
    dimensions: Vec<ExtraDimension>,
    wkt: Option<String>,
}

fn read(path: &Path, progress: &dyn Progress) -> Result<Columns> {
    let rows = CloudRows::open(path)?;
    for remark in rows.remarks() {
        progress.warn(&format!("{}: {remark}", path.display()));
    }
    let (shape, points) = (rows.shape().clone(), rows.len() as usize);
    let mut columns = Columns {
        points: Vec::with_capacity(points),
        time_s: Vec::with_capacity(if shape.has_time { points } else { 0 }),
        intensity: Vec::with_capacity(if shape.has_intensity { points } else { 0 }),
        values: vec![Vec::with_capacity(points); shape.dimensions.len()],
        dimensions: shape.dimensions,
        wkt: shape.wkt,
    };
    let _stage = progress.stage("reading the cloud", points as u64);
    rows.for_each(progress, &mut |point| {
        columns.points.push(point.position);
        if shape.has_time {
            columns.time_s.push(point.time_s);
        }
        if shape.has_intensity {
            columns.intensity.push(point.intensity);
        }
        for (column, value) in columns.values.iter_mut().zip(point.values) {
            column.push(*value);
        }
        Ok(())
    })?;
    Ok(columns)
}

/// Points, attributes by name, and the coordinate reference system.
#[pyfunction]
#[pyo3(signature = (path, listener, threads))]
#[expect(clippy::type_complexity, reason = "a tuple for Python")]
fn read_cloud<'py>(
    path: PathBuf,
    listener: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<(
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyDict>,
    Option<String>,
)> {
    let read = run(listener, threads, |progress| read(&path, progress))?;
    let py = listener.py();
    let attributes = PyDict::new(py);
    if !read.time_s.is_empty() {
        attributes.set_item("time_s", PyArray1::from_vec(py, read.time_s))?;
    }
    if !read.intensity.is_empty() {
        attributes.set_item("intensity", PyArray1::from_vec(py, read.intensity))?;
    }
    for (dimension, values) in read.dimensions.iter().zip(read.values) {
        let name = &dimension.name;
        match dimension.kind {
            ExtraKind::U32 => {
                let whole = values.iter().map(|value| value.number() as u32);
                let whole: Vec<u32> = whole.collect();
                attributes.set_item(name, PyArray1::from_vec(py, whole))?;
            }
            // As in files that have no empty cells, the last integer stands for no value.
            ExtraKind::I64 => {
                let whole = values.iter().map(|v| v.signed().unwrap_or(i64::MIN));
                let whole: Vec<i64> = whole.collect();
                attributes.set_item(name, PyArray1::from_vec(py, whole))?;
            }
            ExtraKind::U64 => {
                let whole = values.iter().map(|v| v.unsigned().unwrap_or(u64::MAX));
                let whole: Vec<u64> = whole.collect();
                attributes.set_item(name, PyArray1::from_vec(py, whole))?;
            }
            ExtraKind::F32 | ExtraKind::F64 => {
                let values = values.iter().map(|value| value.number()).collect();
                attributes.set_item(name, PyArray1::from_vec(py, values))?;
            }
        }
    }
    Ok((from_vectors(py, read.points)?, attributes, read.wkt))
}

/// An attribute of the points to write: its name, its kind (`u4`, `f4` or `f8`) and its values.
type Attribute<'py> = (String, String, PyReadonlyArray1<'py, f64>);

/// Writes a cloud in the format that the end of the name asks for.
#[pyfunction]
#[pyo3(signature = (path, points, attributes, wkt, listener, threads))]
fn write_cloud<'py>(
    path: PathBuf,
    points: PyReadonlyArray2<'py, f64>,
    attributes: Vec<Attribute<'py>>,
    wkt: Option<String>,
    listener: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<()> {
    let points = vectors(&points)?;
    let (mut time_s, mut intensity) = (None, None);
    let (mut dimensions, mut values) = (Vec::new(), Vec::new());
    for (name, kind, array) in &attributes {
        if array.len() != points.len() {
            return Err(PyValueError::new_err(format!(
                "{} values of {name:?} for {} points",
                array.len(),
                points.len()
            )));
        }
        match name.as_str() {
            "time_s" => time_s = Some(numbers(array)?),
            "intensity" => intensity = Some(numbers(array)?),
            _ => {
                let kind = match kind.as_str() {
                    "u4" => ExtraKind::U32,
                    "f4" => ExtraKind::F32,
                    _ => ExtraKind::F64,
                };
                dimensions.push(ExtraDimension::new(name, kind, ""));
                values.push(numbers(array)?);
            }
        }
    }
    let first = points.first().copied().unwrap_or_default();
    let span_s = time_s.map_or((f64::NAN, f64::NAN), |times_s: &[f64]| {
        let times_s = times_s.iter().copied();
        let first_s = times_s.clone().fold(f64::INFINITY, f64::min);
        (first_s, times_s.fold(f64::NEG_INFINITY, f64::max))
    });
    let shape = CloudShape {
        low: points.iter().fold(first, |low, point| low.inf(point)),
        high: points.iter().fold(first, |high, point| high.sup(point)),
        median: None,
        grid: None,
        has_time: time_s.is_some(),
        clock: CloudClock::of_span(span_s.0, span_s.1),
        has_intensity: intensity.is_some(),
        dimensions,
        wkt,
    };
    run(listener, threads, |progress| {
        if points.is_empty() {
            return Err(Error::data("a cloud without points", "give at least one"));
        }
        check_finite(points, "the cloud")?;
        whole(&path, |staged| {
            let stage = progress.stage("writing the cloud", points.len() as u64);
            let mut sink = create_cloud(staged, &shape)?;
            let mut row = vec![ExtraValue::NONE; values.len()];
            for (at, position) in points.iter().enumerate() {
                row.iter_mut()
                    .zip(&values)
                    .for_each(|(value, column)| *value = column[at].into());
                sink.push(&CloudPoint {
                    position: *position,
                    time_s: time_s.map_or(f64::NAN, |times_s| times_s[at]),
                    intensity: intensity.map_or(0.0, |values| values[at] as f32),
                    values: &row,
                })?;
                if at % STEP == STEP - 1 {
                    stage.advance(STEP as u64)?;
                }
            }
            progress.check()?;
            sink.finish()
        })
    })
}

/// Writes a file that appears whole or not at all.
pub(crate) fn whole(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    // A folder that is missing is not made, as by Python's own functions.
    folder
        .metadata()
        .map_err(|error| Error::io(folder, error))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let staging = Staging::new(folder, &[], &[&*name])?;
    let staged = staging.path(&name);
    write(&staged).map_err(|error| error.renamed(&staged, path))?;
    staging.commit()
}
