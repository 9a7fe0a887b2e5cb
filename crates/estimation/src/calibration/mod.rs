//! Calibration of the mountings of all scanners at once: the neighbourhoods of points are made as
//! flat as possible, coarse to fine (after Esser et al. 2024), with or without a reference.
//!
//! Start with [`calibrate`], the algorithm; then see `cost.rs` (the mathematics), `align.rs` (a rough start), `adjust.rs`
//! (one scale), `observability.rs` and `uncertainty.rs` (the quality of the result), and `constancy.rs`
//! and `gap.rs` (whether the mounting is constant).

mod adjust;
mod align;
mod constancy;
mod cost;
mod gap;
mod input;
mod minimum;
pub(crate) mod observability;
mod paper;
pub(crate) mod parameters;
mod patch;
pub(crate) mod places;
mod relative;
mod result;
mod sample;
mod scale;
mod search;
mod serialize;
mod settings;
#[cfg(test)]
mod small_case;
mod spacing;
mod uncertainty;
mod variant;

use std::time::Instant;

pub use constancy::{Block, Constancy, Correlation};
pub use gap::Gap;
pub use input::{Input, POSE_CORRELATION_S, PoseUncertainty};
use minimum::fits_as_well;
pub use minimum::{Minimum, is_within};
pub use observability::{Observability, UnobservableDirection};
pub use parameters::{Mounting, PARAMETER_NAMES, change};
pub use relative::{RelativeMounting, ScannerFromScanner, relative};
pub use result::{Calibration, Scale};
pub use sample::{ScannerSample, sample_profiles};
pub use scale::Ending;
pub use search::better_start;
pub use serialize::{MountingForms, ScannerResult};
pub use settings::{CalibrationSettings, INITIAL_SIGMA, Method, Reach};
pub use spacing::point_spacing_m;
pub use variant::Variant;

use crate::error::{Error, Problem, Result};
use crate::progress::{Progress, Steps};
use scale::{Adjusted, ScaleProblem, Solved, State};

/// Largest number of neighbourhoods in the cost of one scale. With more scanner points, every
/// second, third … is a centre: more centres of the same points add time, not information.
const MAX_CENTRES: usize = 250_000;

/// Number of scales, the finest, on which neighbourhoods are made flat; coarser ones only align clouds, as their
/// neighbourhoods reach beyond small boards. Two, as the points of the finest scale are chosen by voxel with the mountings
/// of the scale before: with one, and rotations that were 0.02° off there, a UAV's strips ended up to 0.03° off instead
/// of 0.012°.
const FINE_SCALES: usize = 2;

/// Units of progress of the finest scale: the time of a scale is about inversely proportional to its voxel size.
const UNITS_OF_FINEST: f64 = 1000.0;
/// Usual number of steps on a scale.
const STEPS: u64 = 3;
/// Usual number of steps of the paper's method on a scale.
const PAPER_STEPS: u64 = 25;

/// Calibrates the mountings coarse to fine, and determines their observability and covariance.
///
/// The [guide](crate#calibrate-two-scanners) has an example with plain arrays.
///
/// # Errors
/// Invalid settings or input; a scanner without points; too few points for the
/// neighbourhoods; [`Error::Cancelled`].
pub fn calibrate(
    input: &Input<'_>,
    settings: &CalibrationSettings,
    progress: &dyn Progress,
) -> Result<Calibration> {
    let (coarser_m, finest_m) = settings.scales()?;
    input.check()?;
    let weight = |voxel_m: f64| (UNITS_OF_FINEST * finest_m / voxel_m).round() as u64;
    let weights = settings
        .voxel_sizes_m
        .iter()
        .map(|voxel_m| weight(*voxel_m));
    let expected = match settings.method {
        Method::Paper => PAPER_STEPS,
        Method::TwoStep | Method::Joint => STEPS,
    };
    let stage = progress.stage("calibration", weights.sum());
    let steps = |voxel_m| Steps::new(progress, expected, weight(voxel_m));
    let mut scales: Vec<Scale> = Vec::new();
    let mut add = |scale: Scale| {
        let (points, iterations, ending) = (scale.points, scale.iterations, scale.ending);
        let voxels = format!("voxels of {:.0} mm", scale.voxel_m * 1e3);
        progress.say(&format!(
            "{voxels}: {points} points, {iterations} iterations, {ending}"
        ));
        show(input, &scale.mountings, &voxels, progress);
        scales.push(scale);
        progress.check()
    };
    let mut mountings = input.mountings.clone();
    show(input, &mountings, "start", progress);
    for &voxel_m in coarser_m {
        let steps = steps(voxel_m);
        let scale = pass_scale(input, mountings.clone(), voxel_m, settings, &steps);
        steps.finish();
        match scale {
            Ok(scale) => {
                mountings.clone_from(&scale.mountings);
                add(scale)?;
            }
            // A scale that is too coarse for the scene leaves its work to the next.
            Err(Error::Data {
                kind: Problem::TooFew,
                problem,
                ..
            }) => {
                progress.say(&format!("skipping a scale: {problem}"));
                progress.check()?;
            }
            Err(error) => return Err(error),
        }
    }
    let steps = steps(finest_m);
    let solved = solve_scale(input, mountings, finest_m, settings, &steps);
    steps.finish();
    let (solved, scale) = solved?;
    add(scale)?;
    drop(stage);
    // The covariance takes about as long as the search for other minima.
    let _stage = progress.stage("uncertainty", 2 * Minimum::STEPS);
    let finest = scales.last().map(|scale| scale.ending);
    let is_kept = finest.is_some_and(Ending::is_kept);
    let is_reached = !is_kept && finest.is_some_and(Ending::is_converged);
    let has_covariance = settings.method != Method::Paper && is_reached;
    let covariance = has_covariance.then(|| uncertainty::covariance(input, &solved));
    let covariance = covariance.flatten();
    let minimum = match settings.method {
        Method::Paper => None,
        Method::TwoStep | Method::Joint => {
            match Minimum::test(input, &solved.state.mountings, settings, progress)? {
                Some((mut minimum, others)) => {
                    for other in others {
                        let end = follow(input, &mut minimum, other, &solved, settings, progress)?;
                        // What standard deviations allow is not another minimum.
                        let is_apart = |end: &Vec<Mounting>| {
                            let change = change(&solved.state.mountings, end);
                            let covariance = covariance.as_ref();
                            covariance.is_none_or(|c| !is_within(&change, c))
                        };
                        minimum.alternative = end.filter(is_apart).or(minimum.alternative);
                    }
                    Some(minimum)
                }
                None => None,
            }
        }
    };
    let is_doubtful = minimum.as_ref().is_some_and(Minimum::is_doubtful);
    let mut held = solved.observability.unobservable.iter();
    let is_held = held.any(|held| held.is_hidden);
    Ok(Calibration {
        method: settings.method,
        converged: is_reached && scales.iter().all(|scale| scale.ending.is_converged()),
        // Standard deviations belong to a minimum that was reached and is not one of several; the paper's method has none.
        covariance: covariance.filter(|_| !is_doubtful),
        origin_sigma_m: 0.0,
        minimum,
        // Mountings that are off let points over relief look as if something moved.
        gap: (!is_kept)
            .then(|| Gap::test(&solved.state.surface))
            .flatten(),
        constancy: (!is_kept && !is_held)
            .then(|| Constancy::test(&solved.state.surface, input.trajectory))
            .flatten(),
        mountings: solved.state.mountings,
        observability: solved.observability,
        scales,
    })
}

/// Lets the finer scales lead on from `other` mountings that fit as well at the coarsest scale, as [`calibrate`] did from
/// the start: along directions that the coarsest scale hardly determines, it ends far away at nearly the same cost. If the
/// finer scales keep them apart, returns where they end.
fn follow(
    input: &Input<'_>,
    minimum: &mut Minimum,
    other: Vec<Mounting>,
    solved: &Solved,
    settings: &CalibrationSettings,
    progress: &dyn Progress,
) -> Result<Option<Vec<Mounting>>> {
    // Rare, and not among the expected steps.
    let progress = &Steps::new(progress, 1, 0);
    let mut begin = other;
    let mut finest = None;
    let finer_m = settings.voxel_sizes_m.get(1..);
    if let Some((&finest_m, middle_m)) = finer_m.and_then(<[f64]>::split_last) {
        for &voxel_m in middle_m {
            let scale = pass_scale(input, begin.clone(), voxel_m, settings, progress);
            // As in `calibrate`, the next scale begins where this one did.
            if let Some(scale) = unless_too_few(scale)? {
                begin = scale.mountings;
            }
        }
        let solved = solve_scale(input, begin.clone(), finest_m, settings, progress);
        if let Some((solved, scale)) = unless_too_few(solved)? {
            begin = scale.mountings;
            finest = Some((solved.state, finest_m));
        }
    }
    // Without finer scales, it stays another minimum.
    let is_elsewhere = finest.is_none_or(|(end, voxel_m): (State, f64)| {
        let solution = &solved.state;
        minimum.ends_elsewhere(&input.mountings, solution, &end.mountings, voxel_m)
            && fits_as_well(&end, solution, voxel_m)
    });
    Ok(is_elsewhere.then_some(begin))
}

/// `None` if a scale has too few points.
fn unless_too_few<T>(result: Result<T>) -> Result<Option<T>> {
    match result {
        Err(Error::Data {
            kind: Problem::TooFew,
            ..
        }) => Ok(None),
        other => other.map(Some),
    }
}

/// Offers the clouds with these mountings, and the reference.
fn show(input: &Input<'_>, mountings: &[Mounting], moment: &str, progress: &dyn Progress) {
    let names = mountings.iter().map(|mounting| mounting.name.as_str());
    let names: Vec<&str> = names
        .chain((!input.reference.is_empty()).then_some("reference"))
        .collect();
    progress.clouds(moment, &names, &|each| {
        input
            .reference
            .iter()
            .for_each(|point| each(mountings.len(), (*point).into()));
        for (cloud, (mounting, sample)) in mountings.iter().zip(input.samples).enumerate() {
            let placed = sample.placed(&mounting.body_from_scanner);
            placed.for_each(|point| each(cloud, point.into()));
        }
    });
}

/// A scale before the finest, of which only the mountings go on.
fn pass_scale(
    input: &Input<'_>,
    mountings: Vec<Mounting>,
    voxel_m: f64,
    settings: &CalibrationSettings,
    progress: &dyn Progress,
) -> Result<Scale> {
    let mut finest = settings.voxel_sizes_m.iter().rev().take(FINE_SCALES);
    if settings.method == Method::Paper || finest.any(|size| *size == voxel_m) {
        let (_, scale) = solve_scale(input, mountings, voxel_m, settings, progress)?;
        return Ok(scale);
    }
    let started = Instant::now();
    let problem = ScaleProblem::new(input, &mountings, voxel_m, MAX_CENTRES, settings)?;
    let (mountings, course) = aligned(&problem, &input.mountings, mountings, progress)?;
    Ok(course.scale(&problem, mountings, started))
}

/// Thins the points, searches their neighbourhoods, and adjusts the mountings in the directions
/// that the data determine.
fn solve_scale(
    input: &Input<'_>,
    mountings: Vec<Mounting>,
    voxel_m: f64,
    settings: &CalibrationSettings,
    progress: &dyn Progress,
) -> Result<(Solved, Scale)> {
    let started = Instant::now();
    let problem = ScaleProblem::new(input, &mountings, voxel_m, MAX_CENTRES, settings)?;
    let (solved, course) = match settings.method {
        Method::Paper => {
            let start = problem.at(mountings.clone());
            let observability = Observability::new(&start.equations, &start.mountings);
            let adjusted = paper::minimise(&problem, mountings, &observability, progress)?;
            let course = Course::of(&adjusted);
            let solved = hold_unobservable_directions(&problem, &input.mountings, adjusted.state);
            (solved, course)
        }
        Method::TwoStep | Method::Joint => {
            let is_coarsest = settings.voxel_sizes_m.first() == Some(&voxel_m);
            let begin = if is_coarsest {
                aligned(&problem, &input.mountings, mountings, progress)?.0
            } else {
                mountings
            };
            flattened(&problem, &input.mountings, begin, progress)?
        }
    };
    let scale = course.scale(&problem, solved.state.mountings.clone(), started);
    Ok((solved, scale))
}

/// Course of one scale, as in [`Scale`].
struct Course {
    iterations: usize,
    neighbourhoods: usize,
    costs: Vec<f64>,
    ending: Ending,
}

impl Course {
    fn of(adjusted: &Adjusted) -> Self {
        Self {
            iterations: adjusted.iterations,
            neighbourhoods: adjusted.state.surface.planes.len(),
            costs: adjusted.costs.clone(),
            ending: adjusted.ending,
        }
    }

    /// That of a scale which began at a moment and ends at these mountings.
    fn scale(self, problem: &ScaleProblem, mountings: Vec<Mounting>, started: Instant) -> Scale {
        Scale {
            voxel_m: problem.voxel_m,
            iterations: self.iterations,
            points: problem.cloud.movable.len(),
            reference_points: problem.cloud.fixed.len(),
            neighbourhoods: self.neighbourhoods,
            cost: self.costs.last().copied().unwrap_or(f64::NAN),
            costs: self.costs,
            ending: self.ending,
            seconds: started.elapsed().as_secs_f64(),
            mountings,
        }
    }
}

/// The mountings with which the clouds agree, if these are as near as initial values are.
fn aligned(
    problem: &ScaleProblem,
    initial: &[Mounting],
    start: Vec<Mounting>,
    progress: &dyn Progress,
) -> Result<(Vec<Mounting>, Course)> {
    let aligned = align::align(problem, initial, &start, progress)?;
    let ending = if aligned.neighbourhoods == 0 && patch::has_several_clouds(problem) {
        Ending::Apart
    } else if problem.is_far(initial, &aligned.mountings) {
        Ending::Kept
    } else {
        Ending::Aligned
    };
    let course = Course {
        iterations: aligned.steps,
        neighbourhoods: aligned.neighbourhoods,
        costs: aligned.costs,
        ending,
    };
    let mountings = if ending.is_kept() {
        start
    } else {
        aligned.mountings
    };
    Ok((mountings, course))
}

/// The mountings with which neighbourhoods are flattest in the directions that the data determine, near those with which
/// the clouds agree.
fn flattened(
    problem: &ScaleProblem,
    initial: &[Mounting],
    aligned: Vec<Mounting>,
    progress: &dyn Progress,
) -> Result<(Solved, Course)> {
    let start = hold_unobservable_directions(problem, initial, problem.at(aligned));
    let aligned = start.state.mountings.clone();
    let adjusted = adjust::minimise(problem, start.state, &start.observability, progress)?;
    let mut course = Course::of(&adjusted);
    let mut state = adjusted.state;
    let has_left = problem.has_left(&aligned, &state.mountings);
    if has_left || problem.is_far(initial, &state.mountings) {
        course.ending = Ending::Kept;
    } else if patch::has_several_clouds(problem)
        && patch::patches(problem, &state.surface.placed).is_empty()
    {
        course.ending = Ending::Apart;
    }
    if course.ending.is_kept() {
        state = problem.at(aligned);
    }
    Ok((
        hold_unobservable_directions(problem, initial, state),
        course,
    ))
}

/// Restores the initial values along the directions that are unobservable at the solution: a
/// coarser scale may have moved the mountings along them. The cost stays the same.
fn hold_unobservable_directions(
    problem: &ScaleProblem,
    initial: &[Mounting],
    state: State,
) -> Solved {
    let found = problem.solved(state);
    let Solved {
        state,
        observability,
        ..
    } = &found;
    if observability.unobservable.is_empty() {
        return found;
    }
    let change = change(initial, &state.mountings);
    let mountings = parameters::moved(&state.mountings, &observability.restoring(&change));
    let surface = state.surface.moved(&parameters::poses(&mountings));
    problem.solved(problem.state(mountings, surface))
}
