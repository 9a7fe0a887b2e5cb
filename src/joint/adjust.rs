//! The adjustment: points are sorted into surfels, all unknowns are adjusted, and again with closer
//! gates.

use nalgebra::DMatrix;

use super::components::{Component, components, rescale};
use super::input::{JointInput, Scans};
use super::layout::Groups;
use super::problem::{JointProblem, State};
use super::result::{AdjustedDrive, GroupTest, Joint};
use super::settings::JointSettings;
use super::surfel::{Gates, ReferenceCells, associate};
use crate::adjustment::{DampingRule, Ended, levenberg_marquardt};
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::trajectory::{EstimatedConstant, Trajectory};

/// How far scans and reference may lie apart in each round, metres: what two steps leave, and then
/// what an adjustment leaves.
const MISFITS_M: [f64; 3] = [0.006, 0.001, 0.001];
/// Edge of the patches of the reference's surface errors, metres.
const PATCH_M: f64 = 0.3;
/// Iterations of the rounds before the last: their points are sorted anew in any case.
const ROUND_ITERATIONS: usize = 2;

/// As for the trajectory alone.
const DAMPING: DampingRule = DampingRule {
    initial: 0.0,
    factor: 10.0,
    least_raised: 1e-2,
    least_lowered: 1e-2,
    floor: 0.0,
    largest: 1e9,
    rounding: 1e-9,
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
    for (round, misfit_m) in MISFITS_M.into_iter().enumerate() {
        progress.check()?;
        let gates = Gates {
            size_m: surfel_m,
            misfit_m,
            patch_m: PATCH_M,
        };
        let found = associate(
            &scans,
            &state.motions,
            &state.poses(),
            &state.late_s,
            &reference,
            &gates,
        );
        state.shapes = vec![Vec3::zeros(); found.surfels.len()];
        state.patches = vec![0.0; found.patches];
        let begin = (&state, Vec::new(), surface_m);
        let mut problem = JointProblem::new(input, settings, found, groups.clone(), begin);
        problem.judge_by(shared.as_ref());
        let last = round + 1 == MISFITS_M.len();
        let mut passes = 0;
        loop {
            let most = if last {
                settings.max_iterations
            } else {
                ROUND_ITERATIONS
            };
            let ended = levenberg_marquardt(&mut problem, &mut state, DAMPING, most, progress)?;
            iterations += ended.iterations;
            problem.factorise(&state).ok_or_else(not_determined)?;
            let found = components(&problem, &state);
            passes += 1;
            shared = problem.shared_covariance();
            problem.judge_by(shared.as_ref());
            let change = rescale(&mut problem, &found);
            if round == 0 || passes == 3 || change < 0.1 {
                if last {
                    done = Some(conclude(&problem, &state, &found, (ended, iterations))?);
                }
                break;
            }
        }
        groups = problem.groups;
    }
    drop(stage);
    done.ok_or_else(not_determined)
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
        reference: [0.0; 6],
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
    let block = |a: usize, b: usize| inverse.block(a, b);
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
    let reference = layout.reference.and_then(|place| {
        let part = block(place, place)?;
        Some((state.reference, std::array::from_fn(|i| root(part[(i, i)]))))
    });
    let drives = problem.input.drives.iter().enumerate();
    let drives = drives.map(|(index, drive)| {
        let first = layout.first_motion[index];
        let of = |a: usize, b: usize| block(first + a, first + b);
        let records = state.motions[index].records(Some(&of));
        Ok(AdjustedDrive {
            name: drive.name.clone(),
            trajectory: Trajectory::new(records)?,
        })
    });
    Ok(Joint {
        mountings: state.mountings.clone(),
        covariance,
        late_s: late_s.collect(),
        drives: drives.collect::<Result<_>>()?,
        constants: constants.collect(),
        reference,
        surface_m: problem.surface_m,
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
