//! Features, thinning, comparison and georeferencing of points in memory.

use boresight::cloud::shape::Feature;
use boresight::cloud::{NeighbourIndex, Neighbourhood, voxel};
use boresight::comparison::{
    Aggregation, ComparisonSettings, Computed, CoreDistance, Detection, IndexedClouds,
    MeasuredScales, Normals, OpenSettings, Scales, Statistics, StreamedCloud, core_points,
};
use boresight::geometry::{BodyFromScanner, Vec3};
use boresight::georeference::Georeferencer;
use boresight::progress::Progress;
use boresight::sensor::{PoseRecord, ScanPoint, check_overlap};
use boresight::tiles::{FEATURE_COLUMNS, FeatureRow, FeatureSettings};
use boresight::trajectory::Trajectory;
use boresight::{Error, Result};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use serde_json::json;

use crate::arrays::{POSE, from_vectors, numbers, quaternion, records, vectors};
use crate::work::run;

/// Points placed at a time.
const CHUNK: usize = 1 << 16;

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(feature_columns, module)?)?;
    module.add_function(wrap_pyfunction!(default_features, module)?)?;
    module.add_function(wrap_pyfunction!(features, module)?)?;
    module.add_function(wrap_pyfunction!(thin, module)?)?;
    module.add_function(wrap_pyfunction!(m3c2, module)?)?;
    module.add_function(wrap_pyfunction!(georeference, module)?)
}

/// Names of the columns of each feature.
#[pyfunction]
fn feature_columns() -> Vec<(&'static str, Vec<&'static str>)> {
    let columns = |feature: &Feature| feature.columns().iter().map(|column| column.0).collect();
    let all = Feature::ALL.iter();
    all.map(|feature| (feature.name(), columns(feature)))
        .collect()
}

/// The features that the command writes where none are named.
#[pyfunction]
fn default_features() -> Vec<&'static str> {
    let default = FeatureSettings::default().features;
    default.iter().map(|feature| feature.name()).collect()
}

/// A row of 32-bit words a point: the columns of the named features in their order, the rest 0.
#[pyfunction]
#[pyo3(signature = (points, names, neighbours, radius_m, listener, threads))]
fn features<'py>(
    points: PyReadonlyArray2<'py, f64>,
    names: Vec<String>,
    neighbours: usize,
    radius_m: Option<f64>,
    listener: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyArray2<u32>>> {
    let wanted = names
        .iter()
        .map(|name| {
            let mut all = Feature::ALL.into_iter();
            let feature = all.find(|feature| feature.name() == name);
            feature.ok_or_else(|| PyValueError::new_err(format!("there is no feature {name:?}")))
        })
        .collect::<PyResult<Vec<Feature>>>()?;
    let neighbourhood = match radius_m {
        Some(radius_m) => Neighbourhood::Within(radius_m),
        None => Neighbourhood::Nearest(neighbours),
    };
    let points = vectors(&points)?;
    let rows = run(listener, threads, |progress| {
        check_number(points)?;
        let stage = progress.stage("features", points.len() as u64);
        let index = NeighbourIndex::new(points);
        progress.check()?;
        let rows = index.surroundings_of_all(&index, neighbourhood, progress, |_, near| {
            FeatureRow::of(near, &wanted).words
        });
        drop(stage);
        rows
    })?;
    let shape = [rows.len(), FEATURE_COLUMNS];
    PyArray1::from_vec(listener.py(), rows.into_flattened()).reshape(shape)
}

fn check_number(points: &[Vec3]) -> Result<()> {
    match u32::try_from(points.len()) {
        Ok(_) => Ok(()),
        Err(_) => Err(Error::data(
            format!("a cloud of {} points", points.len()),
            format!("give {} points at most: thin the cloud", u32::MAX),
        )),
    }
}

/// # Errors
/// A point that is not finite, as those that `georeference` leaves where there is no pose.
pub(crate) fn check_finite(points: &[Vec3], what: &str) -> Result<()> {
    let is_lost = |point: &Vec3| !point.iter().all(|x| x.is_finite());
    let Some(row) = points.par_iter().position_first(is_lost) else {
        return Ok(());
    };
    let lost = points.par_iter().filter(|point| is_lost(point)).count();
    Err(Error::data(
        format!(
            "{lost} of {} points of {what} are not finite, the first at index {row}",
            points.len()
        ),
        "leave them out: points[np.isfinite(points).all(axis=1)]",
    ))
}

/// Indices of the points kept.
#[pyfunction]
#[pyo3(signature = (points, voxel_m, listener, threads))]
fn thin<'py>(
    points: PyReadonlyArray2<'py, f64>,
    voxel_m: f64,
    listener: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyArray1<u32>>> {
    let points = vectors(&points)?;
    let indices = run(listener, threads, |progress| {
        check_number(points)?;
        check_finite(points, "the cloud")?;
        let _stage = progress.stage("thinning", points.len() as u64);
        Ok(voxel::thin(points, voxel_m))
    })?;
    Ok(PyArray1::from_vec(listener.py(), indices))
}

/// Settings of a comparison.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Comparing {
    corepoint_spacing_m: Option<f64>,
    normal_radii: Option<Vec<f64>>,
    cyl_radius: Option<f64>,
    max_distance: Option<f64>,
    registration_error: f64,
    robust_aggr: bool,
    student: bool,
    one_sided: bool,
    min_points: u32,
    direction: Option<[f64; 3]>,
    orientation_vector: [f64; 3],
}

impl Comparing {
    fn open(&self) -> OpenSettings {
        OpenSettings {
            scales: Scales {
                core_spacing_m: self.corepoint_spacing_m,
                normal_radii_m: self.normal_radii.clone(),
                cylinder_radius_m: self.cyl_radius,
                max_distance_m: self.max_distance,
            },
            registration_error_m: self.registration_error,
            aggregation: if self.robust_aggr {
                Aggregation::Median
            } else {
                Aggregation::Mean
            },
            detection: if self.student {
                Detection::Student
            } else {
                Detection::Normal
            },
            one_sided: self.one_sided,
            min_points: Some(self.min_points),
        }
    }

    /// The settings, with scales that are needed and not given measured from the clouds.
    fn settings(
        &self,
        reference: &[Vec3],
        compared: &[Vec3],
        computed: Computed,
    ) -> Result<ComparisonSettings> {
        let open = self.open();
        let measured = if open.scales.lack(computed) {
            let mut points = |each: &mut dyn FnMut(&[Vec3]) -> Result<()>| each(reference);
            let mut others = |each: &mut dyn FnMut(&[Vec3]) -> Result<()>| each(compared);
            let reference = StreamedCloud {
                count: reference.len() as u64,
                points: &mut points,
            };
            let compared = StreamedCloud {
                count: compared.len() as u64,
                points: &mut others,
            };
            MeasuredScales::of(reference, compared)?
        } else {
            None
        };
        Ok(open.closed(measured.as_ref()))
    }
}

/// One array for each value of the core points, and their statistics as JSON, `None` without a distance.
#[pyfunction]
#[pyo3(signature = (reference, compared, core, normals, settings, listener, threads))]
fn m3c2<'py>(
    reference: PyReadonlyArray2<'py, f64>,
    compared: PyReadonlyArray2<'py, f64>,
    core: Option<PyReadonlyArray2<'py, f64>>,
    normals: Option<PyReadonlyArray2<'py, f64>>,
    settings: Comparing,
    listener: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let (reference, compared) = (vectors(&reference)?, vectors(&compared)?);
    let core = core.as_ref().map(vectors).transpose()?;
    let given = normals.as_ref().map(vectors).transpose()?;
    let (distances, statistics) = run(listener, threads, |progress| {
        check_number(reference)?;
        check_finite(reference, "the first epoch")?;
        check_number(compared)?;
        check_finite(compared, "the second epoch")?;
        let normals = match (given, settings.direction) {
            (Some(given), _) => Normals::Given(given),
            (None, Some(direction)) => Normals::Fixed(direction.into()),
            (None, None) => Normals::MostPlanar {
                orientation: settings.orientation_vector.into(),
            },
        };
        let computed = Computed {
            core_points: core.is_none(),
            normals: matches!(normals, Normals::MostPlanar { .. }),
        };
        let settings = settings.settings(reference, compared, computed)?;
        let thinned = match core {
            Some(_) => Vec::new(),
            None => core_points(reference, &settings),
        };
        let core = core.unwrap_or(&thinned);
        let stage = progress.stage("indexing the clouds", 0);
        let indexed = IndexedClouds::new(reference, compared, normals, &settings)?;
        drop(stage);
        progress.check()?;
        let _stage = progress.stage("comparing the clouds (M3C2)", core.len() as u64);
        let distances = indexed.distances(core, normals, progress)?;
        let statistics = match Statistics::of(&distances) {
            Ok(statistics) => Some(json!(statistics).to_string()),
            // Scripts for py4dgeo expect arrays of NaN.
            Err(error) => {
                progress.warn(&error.to_string());
                None
            }
        };
        Ok((distances, statistics))
    })?;
    let py = listener.py();
    let core = &distances.core;
    let number = |value: fn(&CoreDistance) -> f64| {
        PyArray1::from_vec(py, core.iter().map(value).collect::<Vec<f64>>())
    };
    let count = |value: fn(&CoreDistance) -> u32| {
        let counts = core.iter().map(|core| i64::from(value(core)));
        PyArray1::from_vec(py, counts.collect::<Vec<i64>>())
    };
    let vector =
        |value: fn(&CoreDistance) -> Vec3| from_vectors(py, core.iter().map(value).collect());
    let arrays = PyDict::new(py);
    arrays.set_item("corepoints", vector(|core| core.point)?)?;
    arrays.set_item("normals", vector(|core| core.normal)?)?;
    arrays.set_item("normal_radii", number(|core| core.normal_radius_m))?;
    arrays.set_item("distances", number(|core| core.distance_m))?;
    arrays.set_item("lodetection", number(|core| core.level_of_detection_m))?;
    arrays.set_item("spread1", number(|core| core.reference_spread_m))?;
    arrays.set_item("num_samples1", count(|core| core.reference_count))?;
    arrays.set_item("spread2", number(|core| core.compared_spread_m))?;
    arrays.set_item("num_samples2", count(|core| core.compared_count))?;
    arrays.set_item("statistics", statistics)?;
    Ok(arrays)
}

/// Positions in the world; NaN where there is no pose.
#[pyfunction]
#[pyo3(signature = (points, times_s, poses, mounting, time_offset_s, listener, threads))]
fn georeference<'py>(
    points: PyReadonlyArray2<'py, f64>,
    times_s: PyReadonlyArray1<'py, f64>,
    poses: PyReadonlyArray2<'py, f64>,
    mounting: ([f64; 4], [f64; 3]),
    time_offset_s: f64,
    listener: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (points, times_s) = (vectors(&points)?, numbers(&times_s)?);
    let poses: Vec<PoseRecord> = records::<POSE, _>(&poses)?;
    let mounting = BodyFromScanner::new(quaternion(mounting.0), mounting.1.into());
    let placed = run(listener, threads, |progress| {
        place(points, times_s, poses, mounting, time_offset_s, progress)
    })?;
    from_vectors(listener.py(), placed)
}

fn place(
    points: &[Vec3],
    times_s: &[f64],
    poses: Vec<PoseRecord>,
    mounting: BodyFromScanner,
    time_offset_s: f64,
    progress: &dyn Progress,
) -> Result<Vec<Vec3>> {
    let trajectory = Trajectory::new(poses)?;
    let first_s = times_s.iter().copied().fold(f64::INFINITY, f64::min) + time_offset_s;
    let last_s = times_s.iter().copied().fold(f64::NEG_INFINITY, f64::max) + time_offset_s;
    if !times_s.is_empty() {
        let span_s = trajectory.span_s();
        check_overlap(
            ("the points", (first_s, last_s)),
            ("the trajectory", span_s),
        )?;
    }
    let stage = progress.stage("georeferencing", points.len() as u64);
    let nowhere = Vec3::repeat(f64::NAN);
    let mut placed = vec![nowhere; points.len()];
    let chunks = placed.par_chunks_mut(CHUNK);
    let given = points.par_chunks(CHUNK).zip(times_s.par_chunks(CHUNK));
    chunks
        .zip(given)
        .try_for_each(|(placed, (points, times_s))| {
            let mut georeferencer = Georeferencer::new(&trajectory, mounting, time_offset_s);
            for ((place, &position_m), &time_s) in placed.iter_mut().zip(points).zip(times_s) {
                let point = ScanPoint {
                    time_s,
                    position_m,
                    intensity: 0.0,
                };
                *place = georeferencer.place(&point).unwrap_or(nowhere);
            }
            stage.advance(placed.len() as u64)
        })?;
    drop(stage);
    Ok(placed)
}
