//! Trajectories, calibrations and whole runs, from projects and from logs in memory.

use std::path::{Path, PathBuf};

use boresight::calibration::Method;
use boresight::geometry::Vec3;
use boresight::pipeline::{self, OpenProject, Options, Outcome, Placement, stages};
use boresight::progress::Progress;
use boresight::project::Project;
use boresight::sensor::{HeadingFix, ImuSample, PoseRecord, PositionFix};
use boresight::simulation::Scenario;
use boresight::trajectory::{
    HeadingSettings, ImuDatasheet, ImuNoise, MotionLogs, PoseGradient, PositionSettings,
    PosteriorCovariance, Solution, TrajectorySettings, estimate,
};
use boresight::{Error, Result};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;

use crate::arrays::{Array2, HEADING, IMU, POSITION, from_records, records};
use crate::files::body_axes;
use crate::work::run as run_on;

/// Columns of the gradient of a pose.
const POSE: usize = 6;

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Smoothed>()?;
    module.add_function(wrap_pyfunction!(smooth_project, module)?)?;
    module.add_function(wrap_pyfunction!(smooth_logs, module)?)?;
    module.add_function(wrap_pyfunction!(command, module)?)?;
    module.add_function(wrap_pyfunction!(simulate, module)?)
}

/// An estimated trajectory.
#[pyclass(frozen, module = "boresight._boresight")]
struct Smoothed {
    poses: Vec<PoseRecord>,
    result: String,
    /// In a box: Python aligns its objects to 16 bytes, and the covariance needs 64.
    covariance: Option<Box<PosteriorCovariance>>,
}

#[pymethods]
impl Smoothed {
    /// The poses as rows.
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        from_records(py, &self.poses)
    }

    /// How the adjustment ended, as JSON; `null` for poses from a file.
    fn result(&self) -> &str {
        &self.result
    }

    /// The joint covariance of the poses at these indices, 6 rows each; `None` for poses from a file.
    fn covariance<'py>(
        &self,
        py: Python<'py>,
        indices: Vec<usize>,
    ) -> PyResult<Option<Array2<'py>>> {
        let Some(covariance) = &self.covariance else {
            return Ok(None);
        };
        let nodes = covariance.nodes();
        if let Some(index) = indices.iter().find(|index| **index >= nodes) {
            return Err(PyIndexError::new_err(format!(
                "pose {index} of a trajectory of {nodes} poses"
            )));
        }
        let size = POSE * indices.len();
        let covariance = py.detach(|| {
            let mut gradient = PoseGradient::new(size, nodes);
            for (at, &index) in indices.iter().enumerate() {
                let mut block = vec![0.0; size * POSE];
                for axis in 0..POSE {
                    block[(at * POSE + axis) * POSE + axis] = 1.0;
                }
                gradient.add(index, &block);
            }
            covariance.of_functional(&gradient).as_slice().to_vec()
        });
        let array = PyArray1::from_vec(py, covariance).reshape([size, size])?;
        Ok(Some(array))
    }
}

impl Smoothed {
    /// Poses with the origin added back, which was subtracted for the estimation.
    fn new(
        mut poses: Vec<PoseRecord>,
        origin_m: Vec3,
        solution: Option<&Solution>,
        covariance: Option<PosteriorCovariance>,
    ) -> Self {
        for pose in &mut poses {
            pose.world_from_body.translation_m += origin_m;
        }
        let result = solution.map(|solution| pipeline::result::trajectory(solution, &poses));
        Self {
            result: serde_json::Value::from(result).to_string(),
            poses,
            covariance: covariance.map(Box::new),
        }
    }
}

/// The project file that is meant: of a folder, the `project.toml` in it.
fn project_file(path: &Path) -> PathBuf {
    let inside = path.join("project.toml");
    if path.is_dir() && inside.is_file() {
        inside
    } else {
        path.to_owned()
    }
}

fn read_project(path: &Path) -> Result<Project> {
    let project = Project::read(&project_file(path))?;
    project.check_files()?;
    Ok(project)
}

/// The trajectory of a project.
#[pyfunction]
#[pyo3(signature = (project, listener, threads))]
fn smooth_project(
    project: PathBuf,
    listener: &Bound<'_, PyAny>,
    threads: Option<usize>,
) -> PyResult<Smoothed> {
    run_on(listener, threads, |progress| {
        let project = OpenProject::new(&read_project(&project)?);
        let estimated = stages::poses(&project, progress);
        let estimated = estimated.map_err(|error| error.within(&project.inputs()))?;
        let poses = estimated.poses.trajectory.poses().to_vec();
        let solution = estimated.poses.solution.as_ref();
        Ok(Smoothed::new(
            poses,
            project.origin_m(),
            solution,
            estimated.covariance,
        ))
    })
}

/// Settings of a trajectory from logs in memory.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Smoothing {
    axes: String,
    gravity_m_s2: f64,
    lever_arm_m: [f64; 3],
    sigma_position_m: [f64; 3],
    sigma_heading_rad: f64,
    heading_offset_rad: f64,
    gyro_noise_deg_sqrt_h: f64,
    accel_noise_ug_sqrt_hz: f64,
    gyro_bias_instability_deg_h: f64,
    accel_bias_instability_ug: f64,
}

/// The trajectory of logs in memory.
#[pyfunction]
#[pyo3(signature = (imu, positions, heading, settings, listener, threads))]
fn smooth_logs<'py>(
    imu: PyReadonlyArray2<'py, f64>,
    positions: PyReadonlyArray2<'py, f64>,
    heading: PyReadonlyArray2<'py, f64>,
    settings: Smoothing,
    listener: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<Smoothed> {
    let imu: Vec<ImuSample> = records::<IMU, _>(&imu)?;
    let mut fixes: Vec<PositionFix> = records::<POSITION, _>(&positions)?;
    let heading: Vec<HeadingFix> = records::<HEADING, _>(&heading)?;
    let noise = ImuNoise::from_datasheet(&ImuDatasheet {
        gyro_noise_deg_sqrt_h: settings.gyro_noise_deg_sqrt_h,
        accel_noise_ug_sqrt_hz: settings.accel_noise_ug_sqrt_hz,
        gyro_bias_instability_deg_h: settings.gyro_bias_instability_deg_h,
        accel_bias_instability_ug: settings.accel_bias_instability_ug,
    });
    let mut position = PositionSettings::prism(1.0, settings.lever_arm_m.into());
    position.sigma_m = settings.sigma_position_m.into();
    let mut aligned = HeadingSettings::aligned(settings.sigma_heading_rad);
    aligned.mounting_offset_rad = settings.heading_offset_rad;
    let axes = body_axes(&settings.axes)?;
    let mut all = TrajectorySettings::new(axes, noise, position, aligned);
    all.gravity_m_s2 = settings.gravity_m_s2;
    run_on(listener, threads, |progress| {
        // Whole metres near the drive, as a project's origin: large coordinates cost digits.
        let first = fixes.first().map_or(Vec3::zeros(), |fix| fix.position_m);
        let origin_m = if first.amax() > 1e4 {
            first.map(f64::round)
        } else {
            Vec3::zeros()
        };
        for fix in &mut fixes {
            fix.position_m -= origin_m;
        }
        let logs = MotionLogs {
            imu: &imu,
            positions: &[fixes],
            heading: &heading,
        };
        let estimate = estimate(&logs, &all, progress)?;
        let poses = estimate.trajectory.poses().to_vec();
        Ok(Smoothed::new(
            poses,
            origin_m,
            Some(&estimate.solution),
            Some(estimate.covariance),
        ))
    })
}

/// A result as JSON, its summary, and the files written.
pub(crate) type OutcomeParts = (String, String, Vec<PathBuf>);

pub(crate) fn parts(outcome: Outcome) -> OutcomeParts {
    (outcome.result.to_string(), outcome.summary, outcome.files)
}

/// Runs a command on a project: `calibrate`, `run`, `trajectory` or `georeference`.
#[pyfunction]
#[pyo3(signature = (name, project, out, fresh, method, calibration, trajectory, listener, threads))]
#[expect(clippy::too_many_arguments, reason = "the arguments of the commands")]
fn command(
    name: &str,
    project: PathBuf,
    out: Option<PathBuf>,
    fresh: bool,
    method: Option<&str>,
    calibration: Option<PathBuf>,
    trajectory: Option<PathBuf>,
    listener: &Bound<'_, PyAny>,
    threads: Option<usize>,
) -> PyResult<OutcomeParts> {
    let method = method.map(method_of).transpose()?;
    run_on(listener, threads, |progress| {
        let options = Options {
            out: out.unwrap_or_else(|| project_file(&project).with_file_name("out")),
            seed: None,
            fresh,
            kept: Vec::new(),
        };
        if name == "georeference" {
            let project = Project::read(&project_file(&project))?;
            let (calibration, trajectory) = (calibration.as_deref(), trajectory.as_deref());
            let placement = Placement::new(&project, calibration, trajectory)?;
            let placed = pipeline::georeference(&placement, &options, progress);
            return placed
                .map(parts)
                .map_err(|error| error.within(placement.inputs()));
        }
        let mut project = read_project(&project)?;
        if let Some(method) = method {
            project = pipeline::with_method(&project, method, progress);
        }
        let stage: Stage = match name {
            "calibrate" => pipeline::calibrate,
            "run" => pipeline::run,
            _ => pipeline::trajectory,
        };
        let done = stage(&project, &options, progress);
        done.map(parts)
            .map_err(|error| error.within(&project.inputs()))
    })
}

/// The method of a calibration of this name.
fn method_of(name: &str) -> PyResult<Method> {
    match name {
        "joint" => Ok(Method::Joint),
        "two-step" => Ok(Method::TwoStep),
        "paper" => Ok(Method::Paper),
        _ => Err(PyValueError::new_err(format!(
            "method is {name:?}, expected \"joint\", \"two-step\" or \"paper\""
        ))),
    }
}

/// A command on a project.
type Stage = fn(&Project, &Options, &dyn Progress) -> Result<Outcome>;

/// Writes the drives of a scenario.
#[pyfunction]
#[pyo3(signature = (scenario, out, seed, force, listener, threads))]
fn simulate(
    scenario: String,
    out: PathBuf,
    seed: Option<u64>,
    force: bool,
    listener: &Bound<'_, PyAny>,
    threads: Option<usize>,
) -> PyResult<OutcomeParts> {
    run_on(listener, threads, |progress| {
        if out.join("scenario.toml").exists() && !force {
            return Err(Error::format(
                &out,
                boresight::error::Location::Whole,
                "simulated drives",
                "an unused name, or force=True to replace them",
            ));
        }
        let options = Options {
            out,
            seed,
            fresh: false,
            kept: Vec::new(),
        };
        pipeline::simulate(Scenario::load(&scenario)?, &options, progress).map(parts)
    })
}
