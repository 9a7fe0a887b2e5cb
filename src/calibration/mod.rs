//! The mounting of all scanners at once: coarse to fine, make the neighbourhoods of points as thin
//! as possible (after Esser et al. 2024), with or without a reference.
//!
//! Read [`calibrate`] first: it is the algorithm. Then [`cost`] (the mathematics), [`adjust`] (one
//! scale), [`observability`] and [`uncertainty`] (what the result is worth), [`constancy`] (whether
//! one mounting can be right at all).

pub mod adjust;
pub mod constancy;
pub mod cost;
pub mod neighbourhoods;
pub mod observability;
pub mod paper;
pub mod parameters;
pub mod sample;
mod settings;
#[cfg(test)]
mod small_case;
pub mod uncertainty;
mod variant;

use std::time::Instant;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

pub use adjust::Ending;
pub use constancy::Constancy;
pub use parameters::Mounting;
pub use sample::{ScannerSample, sample_profiles};
pub use settings::{CalibrationSettings, Method, PARAMETER_NAMES};
pub use uncertainty::PoseUncertainty;
pub use variant::Variant;

use crate::cloud::voxel;
use crate::error::{Error, Result};
use crate::geometry::{EulerConvention, Pose, Vec3, so3};
use crate::progress::Progress;
use crate::trajectory::Trajectory;
use adjust::{ScaleResult, ScaleSettings};
use neighbourhoods::ScaleCloud;
use observability::Observability;

/// Most neighbourhoods in the cost of one scale. Beyond, every second, third … scanner point is a
/// centre, chosen once: more centres of the same points add time, not knowledge.
const MOST_CENTRES: usize = 250_000;

/// The thickness below which flatness says nothing about alignment, as a share of the voxel. What
/// the poses scatter comes on top.
const FLOOR_SHARE: f64 = 0.05;

/// What is calibrated from what.
#[derive(Debug, Clone)]
pub struct Input<'a> {
    /// Initial mountings, one a scanner.
    pub mountings: Vec<Mounting>,
    /// The scanners' points, thinned on the finest grid, in the order of `mountings`.
    pub samples: Vec<&'a ScannerSample>,
    /// Points of the reference in the world, metres; empty without one.
    pub reference: &'a [Vec3],
    /// Where the body was.
    pub trajectory: &'a Trajectory,
    /// How well that is known.
    pub poses: PoseUncertainty<'a>,
}

/// The mountings found, and what they are worth.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// How they were found.
    pub method: Method,
    /// One a scanner.
    pub mountings: Vec<Mounting>,
    /// Whether every scale converged.
    pub converged: bool,
    /// Coarse to fine.
    pub scales: Vec<Scale>,
    /// Covariance of (δt, δψ) of all scanners, body axes, zero for what was held; `None` where the
    /// normal matrix is singular, and for the paper's method, which gives none.
    pub covariance: Option<DMatrix<f64>>,
    /// What the data determine.
    pub observability: Observability,
    /// Whether the mounting seems constant; `None` where that cannot be judged.
    pub constancy: Option<Constancy>,
}

/// One scale as it went.
#[derive(Debug, Clone)]
pub struct Scale {
    /// Edge of the voxels, metres.
    pub voxel_m: f64,
    /// Iterations.
    pub iterations: usize,
    /// Scanner points.
    pub points: usize,
    /// Reference points.
    pub reference_points: usize,
    /// Neighbourhoods in the cost.
    pub neighbourhoods: usize,
    /// The method's own cost before the first and after every iteration: Σ ln(λ₃ + s²), see
    /// [`cost`], or the paper's Σσ² (m⁴).
    pub costs: Vec<f64>,
    /// How it ended.
    pub ending: Ending,
    /// Run time.
    pub seconds: f64,
    /// Mountings after this scale.
    pub mountings: Vec<Mounting>,
}

/// Makes neighbourhoods thin coarse to fine, then judges the result.
///
/// # Errors
/// A scanner without points; fewer points than a neighbourhood needs; [`Error::Cancelled`].
pub fn calibrate(
    input: &Input<'_>,
    settings: &CalibrationSettings,
    progress: &dyn Progress,
) -> Result<Calibration> {
    let mut mountings = input.mountings.clone();
    let mut scales = Vec::new();
    let mut last = None;
    let stage = progress.stage("calibration", settings.voxel_sizes_m.len() as u64);
    for &voxel_m in &settings.voxel_sizes_m {
        let started = Instant::now();
        let cloud = scale_cloud(input, &mountings, voxel_m, settings)?;
        let result = adjust(&cloud, input, &mountings, voxel_m, settings, progress)?;
        mountings = result.mountings.clone();
        progress.say(&format!(
            "voxels of {:.0} mm: {} points, {} iterations, {}",
            voxel_m * 1e3,
            cloud.movable.len(),
            result.iterations,
            result.ending
        ));
        scales.push(Scale {
            voxel_m,
            iterations: result.iterations,
            points: cloud.movable.len(),
            reference_points: cloud.fixed.len(),
            neighbourhoods: result.neighbourhoods.len(),
            costs: result.costs.clone(),
            ending: result.ending,
            seconds: started.elapsed().as_secs_f64(),
            mountings: mountings.clone(),
        });
        last = Some((cloud, result));
        stage.advance(1)?;
    }
    drop(stage);
    let Some((cloud, result)) = last else {
        return Err(Error::data(
            "no voxel size is given",
            "set calibration.voxel_sizes_m",
        ));
    };
    let _stage = progress.stage("uncertainty", 0);
    Ok(judge(input, settings.method, &cloud, result, scales))
}

/// The points of one scale.
fn scale_cloud(
    input: &Input<'_>,
    mountings: &[Mounting],
    voxel_m: f64,
    settings: &CalibrationSettings,
) -> Result<ScaleCloud> {
    let samples: Vec<_> = input
        .samples
        .par_iter()
        .zip(mountings)
        .map(|(sample, mounting)| {
            let pose = &mounting.body_from_scanner;
            sample::thin_further(&sample.points, pose, voxel_m, settings.pass_gap_s)
        })
        .collect();
    let kept = voxel::thin(input.reference, voxel_m);
    let fixed = kept
        .iter()
        .map(|&index| input.reference[index as usize])
        .collect();
    let cloud = ScaleCloud::new(&samples, fixed, floor_m(input, voxel_m));
    let all = cloud.movable.len() + cloud.fixed.len();
    if all < 2 * settings.neighbours {
        return Err(Error::data(
            format!(
                "only {all} points are left on voxels of {voxel_m} m, where every neighbourhood \
                 needs {}",
                settings.neighbours
            ),
            "use smaller calibration.voxel_sizes_m or fewer calibration.neighbours",
        ));
    }
    Ok(cloud)
}

/// s of the cost: the share of the voxel, and the standard deviation of a coordinate of the poses,
/// the median along the drive so that an outage does not count. Passes cannot agree better than
/// their poses.
fn floor_m(input: &Input<'_>, voxel_m: f64) -> f64 {
    let sigmas = input
        .trajectory
        .nodes()
        .iter()
        .filter_map(|node| node.sigma);
    let mut variances: Vec<f64> = sigmas
        .map(|sigma| sigma.position_m.norm_squared() / 3.0)
        .collect();
    variances.sort_by(f64::total_cmp);
    let variance = variances.get(variances.len() / 2).copied().unwrap_or(0.0);
    (variance + (FLOOR_SHARE * voxel_m).powi(2)).sqrt()
}

/// Adjusts one scale in the directions that the data determine there.
fn adjust(
    cloud: &ScaleCloud,
    input: &Input<'_>,
    start: &[Mounting],
    voxel_m: f64,
    settings: &CalibrationSettings,
    progress: &dyn Progress,
) -> Result<ScaleResult> {
    let scale = ScaleSettings {
        voxel_m,
        k: settings.neighbours,
        stride: cloud.movable.len().div_ceil(MOST_CENTRES).max(1),
        max_iterations: settings.max_iterations,
    };
    let placed = cloud.place(start);
    let found = neighbourhoods::find(cloud, &placed, scale.k, scale.stride);
    let equations = cost::normal_equations(cloud, &placed, &found);
    let seen = observability::judge(&equations, &parameters::free_basis(start), start);
    let basis_of = |now: &[Mounting]| seen.determined(&parameters::free_basis(now));
    let mut result = match settings.method {
        Method::Reweighted => adjust::adjust_scale(cloud, start, &basis_of, scale, progress)?,
        Method::Paper => paper::adjust_scale(cloud, start, &basis_of, scale, progress)?,
    };
    hold_free_directions(cloud, input, &mut result);
    Ok(result)
}

/// Brings back to its initial value what the solved scale shows to be undetermined: a coarse scale
/// may have moved it before that could be seen. The cost does not notice.
fn hold_free_directions(cloud: &ScaleCloud, input: &Input<'_>, result: &mut ScaleResult) {
    let equations = cost::normal_equations(cloud, &result.placed, &result.neighbourhoods);
    let basis = parameters::free_basis(&result.mountings);
    let seen = observability::judge(&equations, &basis, &result.mountings);
    if seen.free.is_empty() {
        return;
    }
    let change = change(&input.mountings, &result.mountings);
    result.mountings = parameters::moved(&result.mountings, &seen.back_to(&change));
    result.placed = cloud.place(&result.mountings);
}

/// (δt, δψ) that lead from `from` to `to`.
fn change(from: &[Mounting], to: &[Mounting]) -> DVector<f64> {
    let parts: Vec<f64> = from
        .iter()
        .zip(to)
        .flat_map(|(from, to)| {
            let (from, to) = (&from.body_from_scanner, &to.body_from_scanner);
            let shift: Vec3 = to.translation.vector - from.translation.vector;
            let turn = so3::log(&(to.rotation * from.rotation.inverse()));
            [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
        })
        .collect();
    DVector::from_vec(parts)
}

/// Observability, covariance and constancy at the solution.
fn judge(
    input: &Input<'_>,
    method: Method,
    cloud: &ScaleCloud,
    result: ScaleResult,
    scales: Vec<Scale>,
) -> Calibration {
    let ScaleResult {
        mountings,
        placed,
        neighbourhoods,
        ..
    } = result;
    let equations = cost::normal_equations(cloud, &placed, &neighbourhoods);
    let basis = parameters::free_basis(&mountings);
    let observability = observability::judge(&equations, &basis, &mountings);
    let covariance = match method {
        Method::Paper => None,
        Method::Reweighted => {
            let gradient = uncertainty::gradient_covariance(
                cloud,
                &placed,
                &neighbourhoods,
                &mountings,
                input.trajectory,
                input.poses,
            );
            let determined = observability.determined(&basis);
            uncertainty::mounting_covariance(&equations.matrix, &determined, &gradient)
        }
    };
    let constancy = constancy::judge(cloud, &placed, &neighbourhoods, input.trajectory);
    let converged = scales.iter().all(|scale| scale.ending.is_converged());
    Calibration {
        method,
        mountings,
        converged,
        scales,
        covariance,
        observability,
        constancy,
    }
}

impl Calibration {
    /// Names of the parameters of scanner `scanner` that the data do not determine.
    pub fn unobservable(&self, scanner: usize) -> Vec<&'static str> {
        (0..6)
            .filter(|&parameter| !self.is_observable(scanner, parameter))
            .map(|parameter| PARAMETER_NAMES[parameter])
            .collect()
    }

    /// Whether the data determine this parameter; angles are those of the mounting's own convention.
    pub fn is_observable(&self, scanner: usize, parameter: usize) -> bool {
        self.is_observable_in(scanner, parameter, self.mountings[scanner].convention)
    }

    /// The same with the angles of `convention`.
    fn is_observable_in(
        &self,
        scanner: usize,
        parameter: usize,
        convention: EulerConvention,
    ) -> bool {
        let free = &self.observability.free;
        !free
            .iter()
            .any(|free| free.moves((scanner, parameter), convention, &self.mountings))
    }

    /// Standard deviations of tx, ty, tz (metres) and of the three Euler angles (radians) of
    /// `scanner` in `convention`; `None` for what was held.
    pub fn sigmas(&self, scanner: usize, convention: EulerConvention) -> [Option<f64>; 6] {
        let mounting = &self.mountings[scanner];
        let Some(covariance) = &self.covariance else {
            return [None; 6];
        };
        let block = covariance.fixed_view::<6, 6>(6 * scanner, 6 * scanner);
        let jacobian = parameters::euler_jacobian_body(convention, &mounting.body_from_scanner);
        let rotation = block.fixed_view::<3, 3>(3, 3).into_owned();
        let angles = jacobian * rotation * jacobian.transpose();
        std::array::from_fn(|parameter| {
            let held = convention == mounting.convention && mounting.fixed[parameter];
            let held = held || (parameter < 3 && mounting.fixed[parameter]);
            if held || !self.is_observable_in(scanner, parameter, convention) {
                return None;
            }
            let variance: f64 = if parameter < 3 {
                block[(parameter, parameter)]
            } else {
                angles[(parameter - 3, parameter - 3)]
            };
            (variance > 0.0).then(|| variance.sqrt())
        })
    }

    /// Poses of the scanners on the body.
    pub fn poses(&self) -> Vec<Pose> {
        self.mountings
            .iter()
            .map(|mounting| mounting.body_from_scanner)
            .collect()
    }
}
