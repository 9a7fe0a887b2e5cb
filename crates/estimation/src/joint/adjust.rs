//! The adjustment: points are sorted into surfels and all unknowns are adjusted, and again with tighter
//! gates.

use super::bend::{Bends, Rung};
use super::conclude::{conclude, not_determined};
use super::input::{JointInput, Scans};
use super::keyframes;
use super::layout::{Groups, REFERENCE};
use super::learn::learn;
use super::model::{
    EVIDENT_TO_IMU, EVIDENT_TO_SCANS, contradictions, imu_contradictions, scan_contradictions,
};
use super::problem::JointProblem;
use super::result::Joint;
use super::rounds::{
    Round, SCALING_SIGMAS, SETTLED_MOTION, SETTLED_SIGMAS, Steps, components_at, only_scatters,
};
use super::settings::JointSettings;
use super::slow::SlowMotions;
use super::state::State;
use super::surfel::{Association, Gates, Grid, LEAST_SIGMA_M, ReferenceCells, associate, profiles};
use crate::adjustment::StopReason;
use crate::error::{Error, Problem, Result, unless_cancelled};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Edge of the patches of the reference's surface errors, in sizes of a surfel.
const PATCH_SIZES: f64 = 6.0;
/// Fewest surfels that lie on the reference or are seen twice.
const MIN_SURFELS: usize = 50;
/// Most rounds.
const MAX_ROUNDS: usize = 10;
/// Most coarse rounds: what still moves then is weakly determined, and moves less with the noise from the residuals.
const MAX_COARSE_ROUNDS: usize = 7;

/// The outcome of an adjustment.
pub enum Outcome {
    /// The adjusted values.
    Found(Box<Joint>),
    /// The mountings seem to move more than the rung allows; if this is evident, the adjustment stops before it has settled.
    Contradicted(Contradiction),
}

/// What an adjustment found, if nothing contradicts it; `None` also if it failed.
///
/// # Errors
/// [`Error::Cancelled`].
pub fn holding(outcome: Result<Outcome>) -> Result<Option<Joint>> {
    Ok(match unless_cancelled(outcome)? {
        Some(Outcome::Found(joint)) if contradictions(&joint).is_empty() => Some(*joint),
        _ => None,
    })
}

/// Why the data contradict a rung.
pub struct Contradiction {
    /// What they contradict.
    pub reasons: Vec<String>,
    /// Whether the latency of a scanner, which was held, may be the cause.
    pub is_scanner_late: bool,
}

impl Outcome {
    fn contradicted(reasons: Vec<String>, problem: &JointProblem<'_>, state: &State) -> Self {
        let is_scanner_late = problem.is_a_scanner_late(state);
        Self::Contradicted(Contradiction {
            reasons,
            is_scanner_late,
        })
    }
}

/// The points sorted into surfels with the start values, where all rungs begin.
pub struct Sorted {
    keyframe_steps: Vec<usize>,
    association: Association,
}

/// Adjusts with mountings that may move as much as a rung allows. If it may climb, the adjustment stops as soon as
/// they evidently move more. The points of the first round are taken from `sorted` or, if it is empty, sorted and left
/// there for the next rung.
///
/// # Errors
/// Those of [`adjust`](super::adjust).
pub fn at_rung(
    input: &JointInput<'_>,
    settings: &JointSettings,
    surfel_m: f64,
    rung: Rung,
    may_climb: bool,
    sorted: &mut Option<Sorted>,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let mut state = start(input);
    state.bends = Bends::new(
        rung,
        &state.motions,
        &input.mountings,
        input.compliance,
        &input.frames(),
    )?;
    let scans: Vec<Scans<'_>> = input.drives.iter().map(|d| d.scans.clone()).collect();
    let surface_m = settings.reference.surface_m.unwrap_or(0.0);
    let grid = Grid::across(&profiles(input), surfel_m);
    let cells = |sizes_m: &[f64], moved| {
        let of_size =
            |size_m: &f64| ReferenceCells::new(input.reference, grid.with_size(*size_m), moved);
        sizes_m.iter().map(of_size).collect::<Vec<_>>()
    };
    let (mut round, mut again, mut sizes_m) = (Round::Coarse, false, vec![surfel_m]);
    let mut references = cells(&sizes_m, state.reference);
    let mut groups = Groups::new(input);
    let mut steps = Steps {
        max_iterations: settings.max_iterations,
        iterations: 0,
        progress,
    };
    let mut keyframe_steps = vec![1; input.mountings.len()];
    let mut before_last: Option<State> = None;
    for repeat in 1..=MAX_ROUNDS {
        progress.check()?;
        let mut problem = loop {
            let gates = Gates {
                misfit_m: round.misfit_share() * sizes_m[0],
                patch_m: PATCH_SIZES * sizes_m[0],
                keyframe_steps: keyframe_steps.clone(),
            };
            let (poses, bends, late_s) = (state.poses(), state.bends.as_ref(), &state.late_s);
            let is_first = repeat == 1;
            let before =
                sorted.take_if(|before| is_first && before.keyframe_steps == keyframe_steps);
            let association = before.map_or_else(
                || {
                    associate(
                        &scans,
                        &state.motions,
                        &poses,
                        bends,
                        late_s,
                        &references,
                        &gates,
                    )
                },
                |before| before.association,
            );
            if is_first && may_climb {
                *sorted = Some(Sorted {
                    keyframe_steps: keyframe_steps.clone(),
                    association: association.clone(),
                });
            }
            check_overlap(input, &association)?;
            state.shapes = vec![Vec3::zeros(); association.surfels.len()];
            state.patches = vec![0.0; association.patches];
            state.planes = vec![[0.0; 2]; association.planes.len()];
            let problem = JointProblem::new(
                input,
                settings,
                association,
                groups.clone(),
                &state,
                surface_m,
            );
            match keyframes::fewer(&problem, &keyframe_steps)? {
                Some(fewer) => keyframe_steps = fewer,
                None => break problem,
            }
        };
        progress.advance(1);
        if round == Round::Fine {
            // The residuals of surfels that are not where the scans see them would look like outliers in the
            // first step.
            problem.fit_shapes(&mut state);
        }
        if again {
            problem.find_trust(&state);
        }
        let before = state.clone();
        if round == Round::Fine && may_climb && !again {
            // A model that is evidently wrong takes many steps, which may be refused.
            steps.step(&mut problem, &mut state)?;
            let reasons = scan_contradictions(&problem, &state, EVIDENT_TO_SCANS);
            if !reasons.is_empty() {
                return Ok(Outcome::contradicted(reasons, &problem, &state));
            }
        }
        steps.settle(&mut problem, &mut state, round.settled_sigmas())?;
        if round == Round::Coarse && problem.guess_noise(&state) {
            // On ground that the surfels do not follow, scans are noisier than assumed: with too much weight they would
            // carry mountings far away along directions that they hardly determine.
            steps.settle(&mut problem, &mut state, SCALING_SIGMAS)?;
        }
        if may_climb && !again {
            let reasons = evident(&mut problem, &state, round, progress)?;
            if !reasons.is_empty() {
                return Ok(Outcome::contradicted(reasons, &problem, &state));
            }
        }
        // The size of the motion is estimated before points are sorted by it.
        if round == Round::Coarse && learn(&problem, &mut state) > SETTLED_MOTION {
            steps.settle(&mut problem, &mut state, round.settled_sigmas())?;
            learn(&problem, &mut state);
        }
        if round == Round::Fine {
            steps.weigh(&mut problem, &mut state, !again)?;
        }
        let remaining = references[0].place.remaining(&state.reference);
        let reference_m = Vec3::from_column_slice(&remaining[..3]).norm();
        let moved_m = problem.moved_m(&before, &state).max(reference_m);
        let in_two_m = before_last.map(|earlier| problem.moved_m(&earlier, &state));
        let only_scatters = in_two_m.is_some_and(|in_two_m| only_scatters(moved_m, in_two_m));
        let settled = moved_m < round.move_share() * surfel_m || only_scatters;
        if round == Round::Fine && (settled || repeat == MAX_ROUNDS) {
            let stop = steps.settle(&mut problem, &mut state, SETTLED_SIGMAS)?;
            if stop != StopReason::Converged {
                problem.forget_factor();
            }
            let components = components_at(&mut problem, &state)?;
            progress.advance(1);
            if may_climb {
                let mut reasons = imu_contradictions(&problem, &state, &components, 1.0);
                reasons.extend(scan_contradictions(&problem, &state, 1.0));
                if !reasons.is_empty() {
                    return Ok(Outcome::contradicted(reasons, &problem, &state));
                }
            }
            // Knots follow slow motions, and beyond the highest rung of the settings there are none.
            let slow = if rung < Rung::SlowKnots.min(settings.mounting.most) {
                SlowMotions::of(&problem, &state)
            } else {
                SlowMotions::default()
            };
            if may_climb && let Some(reason) = slow.contradiction(&problem, rung) {
                return Ok(Outcome::contradicted(vec![reason], &problem, &state));
            }
            let joint = conclude(&problem, &state, &components, &slow, stop, steps.iterations)?;
            return Ok(Outcome::Found(Box::new(joint)));
        }
        groups = problem.groups;
        before_last = again.then_some(before);
        again = round == Round::Fine;
        if settled || repeat >= MAX_COARSE_ROUNDS {
            round = Round::Fine;
        }
        let next_m = round.sizes_m(rung, surfel_m, settings.surfel_m.is_some());
        if next_m != sizes_m || reference_m > LEAST_SIGMA_M {
            sizes_m = next_m;
            references = cells(&sizes_m, state.reference);
        }
    }
    Err(not_determined())
}

/// What contradicts the model evidently, so that it is left before it has settled.
fn evident(
    problem: &mut JointProblem<'_>,
    state: &State,
    round: Round,
    progress: &dyn Progress,
) -> Result<Vec<String>> {
    let components = components_at(problem, state)?;
    progress.advance(1);
    let mut reasons = imu_contradictions(problem, state, &components, EVIDENT_TO_IMU);
    if round == Round::Fine {
        reasons.extend(scan_contradictions(problem, state, EVIDENT_TO_SCANS));
    }
    Ok(reasons)
}

/// Checks that enough of the surface is known or seen twice, and that each scanner saw enough of it.
///
/// # Errors
/// Too few surfels that are known or seen twice, or too few that a scanner saw.
fn check_overlap(input: &JointInput<'_>, association: &Association) -> Result<()> {
    let checked = association
        .surfels
        .iter()
        .filter(|surfel| surfel.is_checked);
    let checked = checked.count();
    if checked < MIN_SURFELS {
        return Err(Error::of(
            Problem::TooFew,
            format!(
                "only {checked} patches of the surface are known or seen in several passes; the \
                 joint adjustment needs {MIN_SURFELS}"
            ),
            "drive several passes over the same surface, or give a reference",
        ));
    }
    for (scanner, mounting) in (0..).zip(&input.mountings) {
        let rows = association
            .rows()
            .filter(|row| row.scanner == scanner)
            .count();
        if rows < MIN_SURFELS {
            return Err(Error::of(
                Problem::TooFew,
                format!(
                    "scanner `{}` saw only {rows} patches of the surface; the joint adjustment \
                     needs {MIN_SURFELS}",
                    mounting.name
                ),
                "choose larger surfels with joint.surfel_m, or leave the scanner out",
            ));
        }
    }
    Ok(())
}

/// The start values. Constants that drives share start at the values of the first drive.
fn start(input: &JointInput<'_>) -> State {
    State {
        motions: input.drives.iter().map(|d| d.motion.boxed()).collect(),
        mountings: input.mountings.clone(),
        bends: None,
        late_s: vec![0.0; input.mountings.len()],
        shapes: Vec::new(),
        patches: Vec::new(),
        planes: Vec::new(),
        reference: [0.0; REFERENCE],
    }
}
