//! The mounting of all scanners at once: coarse to fine, make the neighbourhoods of points as thin
//! as possible (after Esser et al. 2024), with or without a reference.
//!
//! Read [`calibrate`] first: it is the algorithm. Then `cost.rs` (the mathematics), `adjust.rs` (one
//! scale), `observability.rs` and `uncertainty.rs` (what the result is worth), `constancy.rs`
//! (whether one mounting can be right at all).

mod adjust;
mod constancy;
mod cost;
mod damping;
mod input;
mod observability;
mod paper;
mod parameters;
mod result;
mod sample;
mod scale;
mod serialize;
mod settings;
#[cfg(test)]
mod small_case;
mod uncertainty;

use std::sync::Arc;
use std::time::Instant;

pub use constancy::{Block, Constancy};
pub use input::{Input, PoseUncertainty};
pub use observability::{FreeDirection, Observability};
pub use parameters::{Mounting, PARAMETER_NAMES};
pub use result::{Calibration, Scale};
pub use sample::{ScannerSample, sample_profiles};
pub use scale::Ending;
pub use serialize::{MountingForms, ScannerResult};
pub use settings::{CalibrationSettings, Method};

use crate::error::Result;
use crate::progress::Progress;
use scale::{Adjusted, ScaleProblem, Solved, State};

/// Most neighbourhoods in the cost of one scale. Beyond, every second, third … scanner point is a
/// centre, chosen once: more centres of the same points add time, not knowledge.
const MOST_CENTRES: usize = 250_000;

/// Makes neighbourhoods thin coarse to fine, then says what the mountings found are worth.
///
/// From arrays, with the trajectory of the body, points of a reference in the world, and of each
/// scanner the times and the points in its own frame:
///
/// ```
/// use boresight::Result;
/// use boresight::calibration::{CalibrationSettings, Input, Mounting, ScannerSample, calibrate};
/// # use boresight::geometry::{BodyFromScanner, Rotation, Vec3, WorldFromBody};
/// # use boresight::{progress::Silent, sensor::PoseRecord, trajectory::Trajectory};
/// # // Two fans across the track look down on waves; four passes, out and back along x and y.
/// # let height = |x: f64, y: f64| 0.1 * (2.0 * x + y).sin() + 0.1 * (3.0 * y - x).cos();
/// # let pose_at = |time_s: f64| {
/// #     let (pass, along) = ((time_s / 10.0).floor(), (time_s % 10.0) / 5.0 - 1.0);
/// #     let yaw = pass * std::f64::consts::FRAC_PI_2;
/// #     let turn = Rotation::from_euler_angles(0.1 * time_s.sin(), 0.1 * (2.0 * time_s).cos(), yaw);
/// #     WorldFromBody::new(turn, Vec3::new(along * yaw.cos(), along * yaw.sin(), 2.0))
/// # };
/// # let truth = [-1.0, 1.0].map(|side: f64| {
/// #     let turn = Rotation::from_euler_angles(0.5 * side, 0.02, std::f64::consts::FRAC_PI_2);
/// #     BodyFromScanner::new(turn, Vec3::new(0.3, 0.5 * side, 0.1))
/// # });
/// # let scans = truth.map(|body_from_scanner| {
/// #     let (mut times_s, mut points_m) = (Vec::new(), Vec::new());
/// #     for (profile, beam) in (0..4000).flat_map(|profile| (-9..=9).map(move |beam| (profile, beam))) {
/// #         let time_s = 0.01 * f64::from(profile);
/// #         let world_from_scanner = pose_at(time_s) * body_from_scanner;
/// #         let angle = 0.05 * f64::from(beam);
/// #         let direction = Vec3::new(angle.sin(), 0.0, -angle.cos());
/// #         let range = (0..20).fold(2.0, |range, _| {
/// #             let hit = world_from_scanner.map(&(direction * range));
/// #             range + hit.z - height(hit.x, hit.y)
/// #         });
/// #         times_s.push(time_s);
/// #         points_m.push(direction * range);
/// #     }
/// #     (times_s, points_m)
/// # });
/// # let reference: Vec<Vec3> = (0..40_000)
/// #     .map(|i| (f64::from(i % 200) * 0.025 - 2.5, f64::from(i / 200) * 0.025 - 2.5))
/// #     .map(|(x, y)| Vec3::new(x, y, height(x, y)))
/// #     .collect();
/// # let poses = (0..=4000).map(|i| 0.01 * f64::from(i)).map(|time_s| PoseRecord {
/// #     time_s,
/// #     world_from_body: pose_at(time_s),
/// #     velocity_m_s: None,
/// #     bias: None,
/// #     sigma: None,
/// # });
/// # let trajectory = Trajectory::new(poses.collect())?;
/// # let off = |pose: &BodyFromScanner| pose.perturbed(&Vec3::new(0.01, -0.01, 0.01), &Vec3::repeat(0.02));
/// # let [left, right] = truth.each_ref().map(off);
/// let settings = CalibrationSettings {
///     voxel_sizes_m: vec![0.1, 0.05],
///     ..Default::default()
/// };
/// let mountings = vec![Mounting::new("left", left), Mounting::new("right", right)];
/// let thinned = mountings.iter().zip(&scans).map(|(mounting, (times_s, points_m))| {
///     ScannerSample::from_points(mounting, times_s, points_m, &trajectory, &settings)
/// });
/// let samples = thinned.collect::<Result<Vec<_>>>()?;
/// let input = Input::new(mountings, &samples, &trajectory).with_reference(&reference);
/// let found = calibrate(&input, &settings, &Silent)?;
/// println!("{}", serde_json::to_string(&found.scanners())?); // with standard deviations
/// # assert!(found.converged);
/// # for (found, truth) in found.poses().iter().zip(&truth) {
/// #     assert!((found.translation_m - truth.translation_m).norm() < 2e-3);
/// # }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Settings or input that make no sense; a scanner without points; fewer points than a
/// neighbourhood needs; [`Error::Cancelled`](crate::Error::Cancelled).
pub fn calibrate(
    input: &Input<'_>,
    settings: &CalibrationSettings,
    progress: &dyn Progress,
) -> Result<Calibration> {
    let (coarser_m, finest_m) = settings.scales()?;
    input.check()?;
    let stage = progress.stage("calibration", settings.voxel_sizes_m.len() as u64);
    let mut scales = Vec::new();
    let mut solve = |mountings, voxel_m| -> Result<Solved> {
        let (solved, scale) = solve_scale(input, mountings, voxel_m, settings, progress)?;
        let (points, iterations, ending) = (scale.points, scale.iterations, scale.ending);
        progress.say(&format!(
            "voxels of {:.0} mm: {points} points, {iterations} iterations, {ending}",
            voxel_m * 1e3,
        ));
        scales.push(scale);
        stage.advance(1)?;
        Ok(solved)
    };
    let mut mountings = input.mountings.clone();
    for &voxel_m in coarser_m {
        mountings = solve(mountings, voxel_m)?.state.mountings;
    }
    let solved = solve(mountings, finest_m)?;
    drop(stage);
    let _stage = progress.stage("uncertainty", 0);
    Ok(Calibration {
        method: settings.method,
        converged: scales.iter().all(|scale| scale.ending.is_converged()),
        covariance: match settings.method {
            Method::Paper => None,
            Method::Reweighted => uncertainty::covariance(input, &solved),
        },
        constancy: Constancy::of(&solved.state.surface, input.trajectory),
        mountings: solved.state.mountings,
        observability: solved.observability,
        scales,
    })
}

/// Thins the points, finds their neighbourhoods, and adjusts the mountings in the directions that
/// the data determine.
fn solve_scale(
    input: &Input<'_>,
    mountings: Vec<Mounting>,
    voxel_m: f64,
    settings: &CalibrationSettings,
    progress: &dyn Progress,
) -> Result<(Solved, Scale)> {
    let started = Instant::now();
    let cloud = input.thinned(&mountings, voxel_m, settings)?;
    let (points, reference_points) = (cloud.movable.len(), cloud.fixed.len());
    let problem = ScaleProblem {
        cloud: Arc::new(cloud),
        voxel_m,
        floor_m: input.floor_m(voxel_m),
        k: settings.neighbours,
        stride: points.div_ceil(MOST_CENTRES).max(1),
        max_iterations: settings.max_iterations,
    };
    let start = problem.at(mountings);
    let observability = Observability::of(&start.equations, &start.mountings);
    let Adjusted {
        state,
        ending,
        iterations,
        costs,
    } = match settings.method {
        Method::Reweighted => adjust::minimise(&problem, start, &observability, progress)?,
        Method::Paper => paper::minimise(&problem, start.mountings, &observability, progress)?,
    };
    let solved = hold_free_directions(&problem, &input.mountings, state);
    let scale = Scale {
        voxel_m,
        iterations,
        points,
        reference_points,
        neighbourhoods: solved.state.surface.planes.len(),
        cost: costs.last().copied().unwrap_or(f64::NAN),
        costs,
        ending,
        seconds: started.elapsed().as_secs_f64(),
        mountings: solved.state.mountings.clone(),
    };
    Ok((solved, scale))
}

/// Brings back to its initial value what the solved scale shows to be undetermined: a coarse scale
/// may have moved it before that could be seen. The cost does not notice.
fn hold_free_directions(problem: &ScaleProblem, initial: &[Mounting], state: State) -> Solved {
    let observability = Observability::of(&state.equations, &state.mountings);
    let floor_m = problem.floor_m;
    if observability.free.is_empty() {
        return Solved {
            state,
            observability,
            floor_m,
        };
    }
    let change = parameters::change(initial, &state.mountings);
    let mountings = parameters::moved(&state.mountings, &observability.back_to(&change));
    let surface = state.surface.moved(&parameters::poses(&mountings));
    let state = problem.state(mountings, surface);
    Solved {
        observability: Observability::of(&state.equations, &state.mountings),
        state,
        floor_m,
    }
}
