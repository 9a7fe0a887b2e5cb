//! The adjustment: points are sorted into surfels, all unknowns are adjusted, and again with closer
//! gates.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::components::{Component, components, rescale};
use super::input::{JointInput, Scans};
use super::layout::{Groups, REFERENCE};
use super::model::BLOCKS_S;
use super::problem::{JointProblem, State};
use super::result::{AdjustedDrive, GroupTest, Joint, PoseMove};
use super::row::hampel;
use super::settings::JointSettings;
use super::surfel::{Association, Gates, ReferenceCells, associate};
use crate::adjustment::{CONVERGED_SIGMAS, DampingRule, Ended, levenberg_marquardt};
use crate::calibration::observability::LEVER_M;
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::trajectory::{EstimatedConstant, Trajectory};

/// How far scans and reference may lie apart in each round, as shares of a surfel's size: what two
/// steps leave, and then what an adjustment leaves.
const MISFIT_SHARES: [f64; 3] = [0.12, 0.02, 0.02];
/// Edge of the patches of the reference's surface errors, in sizes of a surfel.
const PATCH_SIZES: f64 = 6.0;
/// Scales of noise have settled where they change by less than this share.
const SETTLED_SCALE: f64 = 0.1;
/// Times that the noise is estimated in the last round.
const MAX_SCALINGS: usize = 3;
/// Fewest surfels that the reference knows or that are seen twice.
const MIN_SURFELS: usize = 50;
/// A parameter with a larger standard deviation is not determined, metres; rotations count as what
/// they move at [`LEVER_M`].
const MAX_SIGMA_M: f64 = 0.010;
/// Length of the last step of each round in standard deviations: points are sorted anew after all but
/// the last in any case.
const ROUND_SIGMAS: [f64; 3] = [5.0, 0.5, CONVERGED_SIGMAS];
/// A round that moves points by more than this share of a surfel is done again: they belong to other
/// surfels then.
const MAX_MOVE_SHARE: f64 = 0.1;
/// Most rounds.
const MAX_ROUNDS: usize = 10;

/// As for the trajectory alone, but for the rise of the cost: derivatives of poses between nodes are
/// right to a hundredth, and where they vanish is not quite where the cost is least. A rise of 1e-5 is a
/// step of a fraction of a standard deviation.
const DAMPING: DampingRule = DampingRule {
    initial: 0.0,
    factor: 10.0,
    least_raised: 1e-2,
    least_lowered: 1e-2,
    floor: 0.0,
    largest: 1e9,
    rounding: 1e-5,
};

/// Adjusts mountings and trajectories together.
///
/// # Errors
/// Too few surfels that scans or the reference check; unknowns that nothing determines;
/// [`Error::Cancelled`].
pub fn adjust(
    input: &JointInput<'_>,
    settings: &JointSettings,
    surfel_m: f64,
    progress: &dyn Progress,
) -> Result<Joint> {
    let stage = progress.stage("joint adjustment", 0);
    let reference = ReferenceCells::new(input.reference, surfel_m);
    let mut groups = Groups::new(input);
    let mut state = start(input);
    let surface_m = settings.reference.surface_m.unwrap_or(0.0);
    let scans: Vec<Scans<'_>> = input.drives.iter().map(|d| d.scans.clone()).collect();
    let mut iterations = 0;
    let mut done = None;
    let mut shared = None;
    let mut held = Vec::new();
    let mut round = 0;
    for _ in 0..MAX_ROUNDS {
        progress.check()?;
        let last = round + 1 == MISFIT_SHARES.len();
        let gates = Gates {
            size_m: surfel_m,
            misfit_m: MISFIT_SHARES[round] * surfel_m,
            patch_m: PATCH_SIZES * surfel_m,
        };
        let poses = state.poses();
        let found = associate(
            &scans,
            &state.motions,
            &poses,
            &state.late_s,
            &reference,
            &gates,
        );
        check_overlap(&found)?;
        state.shapes = vec![Vec3::zeros(); found.surfels.len()];
        state.patches = vec![0.0; found.patches];
        let begin = (&state, held, surface_m);
        let mut problem = JointProblem::new(input, settings, found, groups, begin);
        problem.judge_by(shared.as_ref());
        if last {
            problem.loss = hampel;
        }
        let before = state.clone();
        let mut scalings = 0;
        loop {
            let most = settings.max_iterations.saturating_sub(iterations).max(1);
            let until = (most, ROUND_SIGMAS[round]);
            let ended = levenberg_marquardt(&mut problem, &mut state, DAMPING, until, progress)?;
            iterations += ended.iterations;
            if round == 0 {
                break;
            }
            problem.factorise(&state).ok_or_else(not_determined)?;
            let found = components(&problem, &state);
            scalings += 1;
            shared = problem.shared_covariance();
            problem.judge_by(shared.as_ref());
            let change = rescale(&mut problem, &found);
            if !last {
                break;
            }
            if problem.held.is_empty() {
                problem.held = undetermined(&problem, shared.as_ref());
                if !problem.held.is_empty() {
                    problem.judge_by(None);
                    continue;
                }
            }
            if scalings >= MAX_SCALINGS || change < SETTLED_SCALE {
                done = Some(conclude(&problem, &state, &found, (ended, iterations))?);
                break;
            }
        }
        let moved_m = problem.moved_m(&before, &state);
        (groups, held) = (problem.groups, problem.held);
        if moved_m < MAX_MOVE_SHARE * surfel_m {
            if last {
                break;
            }
            round += 1;
        }
    }
    drop(stage);
    done.ok_or_else(not_determined)
}

/// # Errors
/// Too little of the surface that is known or seen twice.
fn check_overlap(found: &Association) -> Result<()> {
    let checked = found
        .surfels
        .iter()
        .filter(|surfel| surfel.is_checked)
        .count();
    if checked >= MIN_SURFELS {
        return Ok(());
    }
    Err(Error::of(
        Problem::TooFew,
        format!(
            "only {checked} patches of the surface are known or seen in several passes; the joint \
             adjustment needs {MIN_SURFELS}"
        ),
        "drive several passes over the same surface, or give a reference",
    ))
}

/// Directions of all mountings, (δp, δφ), along which a parameter has a larger standard deviation than
/// [`MAX_SIGMA_M`]. Without a reference and with a lever arm that is estimated, the common height is
/// one of them: its standard deviation is then that of the prior of the lever arm.
fn undetermined(problem: &JointProblem<'_>, shared: Option<&DMatrix<f64>>) -> Vec<DVector<f64>> {
    let count = 6 * problem.input.mountings.len();
    let Some(shared) = shared else {
        return Vec::new();
    };
    let first = shared.nrows() - count;
    let scale = |i: usize| if i % 6 < 3 { 1.0 } else { LEVER_M };
    // The unknowns are (δφ, δp).
    let place = |i: usize| first + 6 * (i / 6) + (i + 3) % 6;
    let scaled = DMatrix::from_fn(count, count, |i, j| {
        shared[(place(i), place(j))] * scale(i) * scale(j)
    });
    let eigen = SymmetricEigen::new(scaled);
    let mut found: Vec<(f64, DVector<f64>)> = (0..count)
        .filter_map(|k| {
            let direction = eigen.eigenvectors.column(k);
            let sigma_m = eigen.eigenvalues[k].max(0.0).sqrt();
            (sigma_m * direction.amax() > MAX_SIGMA_M).then(|| {
                (
                    sigma_m,
                    DVector::from_fn(count, |i, _| direction[i] * scale(i)),
                )
            })
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().map(|(_, direction)| direction).collect()
}

fn not_determined() -> Error {
    Error::of(
        Problem::NotDetermined,
        "the joint adjustment is not determined",
        "use calibration.method = \"two-step\"",
    )
}

/// The start values. Constants that drives share start where the first drive found them.
fn start(input: &JointInput<'_>) -> State {
    State {
        motions: input.drives.iter().map(|d| d.motion.boxed()).collect(),
        mountings: input.mountings.clone(),
        late_s: vec![0.0; input.mountings.len()],
        shapes: Vec::new(),
        patches: Vec::new(),
        reference: [0.0; REFERENCE],
    }
}

fn conclude(
    problem: &JointProblem<'_>,
    state: &State,
    found: &[Component],
    (ended, iterations): (Ended, usize),
) -> Result<Joint> {
    let factor = problem.factor().ok_or_else(not_determined)?;
    let layout = &problem.layout;
    let inverse = factor.selected_inverse();
    let sides = problem.reference_sides();
    // With the part of the reference's own errors.
    let block = |a: usize, b: usize| {
        let mut part = inverse.block(a, b)?;
        let (row, column) = (problem.offset(a), problem.offset(b));
        for side in sides
            .iter()
            .flat_map(|s| s.chunks_exact(problem.unknowns()))
        {
            for i in 0..part.nrows() {
                for j in 0..part.ncols() {
                    part[(i, j)] += side[row + i] * side[column + j];
                }
            }
        }
        Some(part)
    };
    let count = state.mountings.len();
    let mut covariance = DMatrix::zeros(6 * count, 6 * count);
    // The unknowns are (δφ, δp), the covariance is given over (δp, δφ).
    let swapped = |i: usize| (i + 3) % 6;
    for (i, &a) in layout.mountings.iter().enumerate() {
        for (j, &b) in layout.mountings.iter().enumerate() {
            let part = block(a, b).ok_or_else(not_determined)?;
            for row in 0..6 {
                for column in 0..6 {
                    covariance[(6 * i + row, 6 * j + column)] =
                        part[(swapped(row), swapped(column))];
                }
            }
        }
    }
    let root = |x: f64| x.max(0.0).sqrt();
    let sigma = |a: usize| block(a, a).map(|c| root(c[(0, 0)]));
    let late_s = layout.late.iter().zip(&state.late_s);
    let late_s = late_s.map(|(place, value)| Some((*value, sigma((*place)?)?)));
    let constants = layout.constant_owner.iter().enumerate();
    let constants = constants.map(|(place, (drive, column))| {
        let constant = &state.motions[*drive].constants()[*column];
        let sigma = sigma(layout.first_constant + place);
        EstimatedConstant {
            name: constant.name.clone(),
            unit: constant.unit,
            start: constant.base,
            value: constant.base + constant.correction,
            sigma,
        }
    });
    let drives = problem.input.drives.iter().enumerate();
    let drives = drives.map(|(index, drive)| {
        let first = layout.first_motion[index];
        let of = |a: usize, b: usize| block(first + a, first + b);
        let records = state.motions[index].records(Some(&of));
        let before = drive.motion.records(None);
        let moved = records.iter().zip(&before).map(|(after, before)| {
            let (turn_rad, shift_m) = after
                .world_from_body
                .perturbation_from(&before.world_from_body);
            PoseMove {
                time_s: after.time_s,
                shift_m,
                turn_rad,
            }
        });
        let moved = moved.collect();
        Ok(AdjustedDrive {
            name: drive.name.clone(),
            trajectory: Trajectory::new(records)?,
            moved,
            imu: problem.groups.names[problem.groups.first_motion[index]].clone(),
            positions: BLOCKS_S
                .iter()
                .flat_map(|&block_s| state.motions[index].position_blocks(block_s))
                .collect(),
            residuals: state.motions[index].position_residuals(),
        })
    });
    Ok(Joint {
        mountings: state.mountings.clone(),
        covariance,
        late_s: late_s.collect(),
        drives: drives.collect::<Result<_>>()?,
        constants: constants.collect(),
        reference: layout.reference.map(|_| problem.settings.reference),
        surface_m: problem.surface_m,
        regions: problem.found.regions.clone(),
        held: problem.held.clone(),
        groups: tests(&problem.groups, found),
        stop: ended.stop,
        iterations,
        rows: problem.found.drives.iter().map(|d| d.rows.len()).sum(),
        surfels: problem.found.surfels.len(),
        unknowns: problem.unknowns(),
    })
}

/// The tests of all groups; those of one name together.
fn tests(groups: &Groups, found: &[Component]) -> Vec<GroupTest> {
    let mut all: Vec<(String, Component)> = Vec::new();
    for (name, component) in groups.names.iter().zip(found) {
        match all.iter_mut().find(|(known, _)| known == name) {
            Some((_, sum)) => *sum = sum.and(component),
            None => all.push((name.clone(), *component)),
        }
    }
    all.iter()
        .map(|(name, component)| GroupTest::new(name, component))
        .collect()
}
