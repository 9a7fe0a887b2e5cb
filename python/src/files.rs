//! What a file holds, and logs, poses and profiles from files and into them.

use std::path::{Path, PathBuf};

use boresight::format;
use boresight::geometry::{BodyAxes, Projection};
use boresight::progress::Progress;
use boresight::sensor::{HeadingFix, ImuSample, Observations, PoseRecord, PositionFix, ScanPoint};
use boresight::{Error, Result};
use numpy::PyReadonlyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{
    Array2, HEADING, IMU, POSE, POSITION, PROFILE, from_records, from_rows, records,
};
use crate::clouds::whole;
use crate::work::run;

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(detect, module)?)?;
    module.add_function(wrap_pyfunction!(read_log, module)?)?;
    module.add_function(wrap_pyfunction!(write_log, module)?)
}

/// The format of a file, in words, and the kinds of data that it may hold.
#[pyfunction]
fn detect(py: Python<'_>, path: PathBuf) -> PyResult<(String, Vec<&'static str>)> {
    let format = py.detach(|| format::detect(&path));
    let format = format.map_err(|error| crate::errors::exception(py, &error))?;
    // These may hold latitudes and longitudes, which need `crs`.
    let is_geographic = matches!(format.id(), "nmea" | "ros-bag");
    let kinds = [
        ("cloud", format.has_cloud()),
        ("trajectory", format.has_poses()),
        ("imu", format.has_imu()),
        ("positions", format.has_positions() || is_geographic),
        ("heading", format.has_heading()),
        ("profiles", format.has_profiles()),
        ("mountings", format.id() == "project"),
    ];
    let possible = kinds.into_iter().filter(|kind| kind.1);
    Ok((format.to_string(), possible.map(|kind| kind.0).collect()))
}

/// Settings with which a file is read.
struct Reading {
    crs: Option<Projection>,
    axes: BodyAxes,
}

pub(crate) fn body_axes(name: &str) -> PyResult<BodyAxes> {
    match name {
        "FRD" => Ok(BodyAxes::Frd),
        "FLU" => Ok(BodyAxes::Flu),
        _ => Err(PyValueError::new_err(format!(
            "body axes {name:?}, expected \"FRD\" or \"FLU\""
        ))),
    }
}

enum Log {
    Poses(Vec<PoseRecord>),
    Imu(Vec<ImuSample>),
    Positions(Vec<PositionFix>),
    Heading(Vec<HeadingFix>),
    Profiles(Vec<[f64; PROFILE]>),
}

fn read(path: &Path, kind: &str, how: &Reading, progress: &dyn Progress) -> Result<Log> {
    let crs = how.crs.as_ref();
    let _stage = progress.stage("reading the log", 0);
    let input = &format::Input::from(path);
    let log = match kind {
        "trajectory" => Log::Poses(format::read_projected_trajectory(input, how.axes, crs)?),
        "imu" => Log::Imu(format::read_imu(input)?),
        "positions" => {
            let as_found = Observations::AsFound;
            let read = format::read_projected_positions(input, &as_found, crs)?;
            for row in &read.rejected {
                progress.say(&format!("rejected {row}"));
            }
            if !read.rejected.is_empty() {
                progress.warn(&format!(
                    "{}: {} rows contain no measurement and were rejected",
                    path.display(),
                    read.rejected.len()
                ));
            }
            Log::Positions(read.fixes)
        }
        "heading" => Log::Heading(format::read_heading(input)?),
        _ => Log::Profiles(profiles(input, progress)?),
    };
    for remark in input.remarks() {
        progress.warn(&format!("{}: {remark}", path.display()));
    }
    Ok(log)
}

fn profiles(input: &format::Input, progress: &dyn Progress) -> Result<Vec<[f64; PROFILE]>> {
    use crate::arrays::Record;
    let mut reader = format::open_profiles(input)?;
    let stage = progress.stage("reading profiles", reader.bytes_total());
    let (mut rows, mut chunk, mut bytes) = (Vec::new(), Vec::new(), 0);
    while reader.next_chunk(&mut chunk)? {
        rows.extend(chunk.iter().map(ScanPoint::to_row));
        stage.advance(reader.bytes_read() - bytes)?;
        bytes = reader.bytes_read();
    }
    Ok(rows)
}

fn projection(py: Python<'_>, crs: Option<&str>) -> PyResult<Option<Projection>> {
    let projection = crs.map(Projection::new).transpose();
    projection.map_err(|error| crate::errors::exception(py, &error))
}

/// The rows of a log of this kind.
#[pyfunction]
#[pyo3(signature = (path, kind, crs, axes, listener, threads))]
fn read_log<'py>(
    path: PathBuf,
    kind: &str,
    crs: Option<&str>,
    axes: &str,
    listener: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<Array2<'py>> {
    let py = listener.py();
    let how = Reading {
        crs: projection(py, crs)?,
        axes: body_axes(axes)?,
    };
    match run(listener, threads, |progress| {
        read(&path, kind, &how, progress)
    })? {
        Log::Poses(poses) => from_records(py, &poses),
        Log::Imu(samples) => from_records(py, &samples),
        Log::Positions(fixes) => from_records(py, &fixes),
        Log::Heading(fixes) => from_records(py, &fixes),
        Log::Profiles(rows) => from_rows(py, rows),
    }
}

/// Writes the rows of a log of this kind: poses as `.tum`, `.sbet` or a table, others as a table.
#[pyfunction]
#[pyo3(signature = (path, kind, rows, crs, listener, threads))]
fn write_log<'py>(
    path: PathBuf,
    kind: &str,
    rows: PyReadonlyArray2<'py, f64>,
    crs: Option<&str>,
    listener: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<()> {
    let crs = projection(listener.py(), crs)?;
    let log = match kind {
        "trajectory" => Log::Poses(records::<POSE, _>(&rows)?),
        "imu" => Log::Imu(records::<IMU, _>(&rows)?),
        "positions" => Log::Positions(records::<POSITION, _>(&rows)?),
        "heading" => Log::Heading(records::<HEADING, _>(&rows)?),
        _ => Log::Profiles(crate::arrays::rows::<PROFILE>(&rows)?.to_vec()),
    };
    run(listener, threads, |progress| {
        let _stage = progress.stage("writing the log", 0);
        let end = path.extension().and_then(|end| end.to_str());
        let end = end.unwrap_or_default().to_lowercase();
        whole(&path, |staged| write(staged, &end, &log, crs.as_ref()))
    })
}

fn write(path: &Path, end: &str, log: &Log, crs: Option<&Projection>) -> Result<()> {
    use crate::arrays::Record;
    match (log, end) {
        (Log::Poses(poses), "tum") => format::write_tum(path, poses),
        (Log::Poses(poses), "sbet") => match crs {
            Some(crs) => format::write_sbet(path, poses, crs),
            None => Err(Error::data(
                "SBET has latitudes and longitudes",
                "name the projected system of the poses, such as crs=\"EPSG:25832\"",
            )),
        },
        (_, end) if !matches!(end, "csv" | "parquet") => Err(Error::format(
            path,
            boresight::error::Location::Whole,
            "a name with another extension",
            "a name that ends in .csv or .parquet, for a trajectory also .tum or .sbet",
        )),
        (Log::Poses(poses), _) => format::write_trajectory(path, poses),
        (Log::Imu(samples), _) => format::write_imu(path, samples),
        (Log::Positions(fixes), _) => format::write_positions(path, fixes),
        (Log::Heading(fixes), _) => format::write_heading(path, fixes),
        (Log::Profiles(rows), _) => {
            let points: Vec<ScanPoint> = rows.iter().map(ScanPoint::of_row).collect();
            format::write_profiles(path, &points)
        }
    }
}
