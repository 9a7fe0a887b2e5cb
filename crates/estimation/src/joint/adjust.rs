//! The adjustment: points are sorted into surfels and all unknowns are adjusted, and again with tighter
//! gates.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::bend::{Bends, Rung};
use super::components::{Component, components, rescale};
use super::conclude::{conclude, not_determined};
use super::input::{JointInput, Scans};
use super::layout::{Groups, REFERENCE};
use super::learn::learn;
use super::model::{EVIDENT_TO_IMU, EVIDENT_TO_SCANS, imu_contradictions, scan_contradictions};
use super::problem::{JointProblem, LEAST_SIGMA_M};
use super::result::Joint;
use super::settings::JointSettings;
use super::state::State;
use super::surfel::{Association, Gates, Grid, ReferenceCells, associate, profiles};
use crate::adjustment::{CONVERGED_SIGMAS, DampingRule, StopReason, levenberg_marquardt};
use crate::calibration::observability::LEVER_M;
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Edge of the patches of the reference's surface errors, in sizes of a surfel.
const PATCH_SIZES: f64 = 6.0;
/// The scales of noise have settled if they change by less than this share.
const SETTLED_SCALE: f64 = 0.1;
/// The parameters of the motion in time have settled if they change by less than this; see [`learn`].
const SETTLED_MOTION: f64 = 0.3;
/// Size of the surfels with dense knots, as a share of the usual size: a random motion along the ground shows only at
/// slopes, and small surfels have steeper slopes.
const DENSE_SHARE: f64 = 0.72;
/// Most times that the noise is estimated in the last round.
const MAX_SCALINGS: usize = 3;
/// Fewest surfels that lie on the reference or are seen twice.
const MIN_SURFELS: usize = 50;
/// A parameter with a larger standard deviation is not determined, metres; rotations are converted by
/// [`LEVER_M`].
const MAX_SIGMA_M: f64 = 0.010;
/// Length of the last step, standard deviations, before the noise is estimated again.
const SCALING_SIGMAS: f64 = 0.5;
/// The same with knots, whose standard deviations are then estimated again too: this moves mountings much and
/// residuals little.
const LEARNING_SIGMAS: f64 = 2.0;
/// Length of the last step at the end, standard deviations. Because steps become shorter by a factor of two or more,
/// no unknown is then off by more than this.
const SETTLED_SIGMAS: f64 = 2.0 * CONVERGED_SIGMAS;
/// Most rounds.
const MAX_ROUNDS: usize = 10;

/// Most entries of the factor of the normal equations, 8 bytes each: those of three drives with two
/// profile scanners.
const MAX_FACTOR_ENTRIES: usize = 350_000_000;
/// Most steps from one keyframe to the next.
const MAX_KEYFRAME_STEPS: usize = 64;

/// As for the trajectory alone, except for the allowed rise of the cost: derivatives of poses between nodes
/// are accurate to a hundredth, so the gradient does not vanish exactly at the least cost. A rise of 1e-5 is
/// a step of a fraction of a standard deviation.
pub const DAMPING: DampingRule = DampingRule {
    rounding: 1e-5,
    ..DampingRule::UNDAMPED
};

/// The outcome of an adjustment.
pub enum Outcome {
    /// The adjusted values.
    Found(Box<Joint>),
    /// Reasons why the mountings move more than the rung allows; if this is evident, the adjustment stops
    /// before it has settled.
    Contradicted(Vec<String>),
}

/// The points sorted into surfels with the result of two steps, where all rungs begin.
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
    );
    let scans: Vec<Scans<'_>> = input.drives.iter().map(|d| d.scans.clone()).collect();
    let surface_m = settings.reference.surface_m.unwrap_or(0.0);
    let grid = Grid::across(&profiles(input), surfel_m);
    let mut reference = ReferenceCells::new(input.reference, grid, state.reference);
    let (mut groups, mut held) = (Groups::new(input), Vec::new());
    let mut steps = Steps {
        max_iterations: settings.max_iterations,
        iterations: 0,
        shared: None,
        progress,
    };
    let (mut round, mut again, mut size_m) = (Round::Coarse, false, surfel_m);
    let mut keyframe_steps = vec![1; input.mountings.len()];
    for repeat in 1..=MAX_ROUNDS {
        progress.check()?;
        let mut problem = loop {
            let gates = Gates {
                misfit_m: round.misfit_share() * size_m,
                patch_m: PATCH_SIZES * size_m,
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
                        &reference,
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
            let problem = JointProblem::new(
                input,
                settings,
                association,
                groups.clone(),
                &state,
                held.clone(),
                surface_m,
            );
            if problem.factor_entries() <= MAX_FACTOR_ENTRIES {
                break problem;
            }
            let fewer = fewer_keyframes(&problem, &keyframe_steps);
            keyframe_steps = fewer.ok_or_else(|| too_large(&problem))?;
        };
        progress.advance(1);
        problem.judge_by(steps.shared.as_ref());
        if round == Round::Fine {
            // The residuals of surfels that are not where the scans see them would look like outliers in the
            // first step.
            problem.fit_shapes(&mut state);
            if may_climb && !again {
                // A model that is evidently wrong takes many steps, which may be refused.
                let reasons = scan_contradictions(&problem, &state, EVIDENT_TO_SCANS);
                if !reasons.is_empty() {
                    return Ok(Outcome::Contradicted(reasons));
                }
            }
        }
        if again {
            problem.find_trust(&state);
        }
        let before = state.clone();
        let mut stop = steps.settle(&mut problem, &mut state, round.settled_sigmas())?;
        if may_climb && !again {
            let components = components_at(&mut problem, &state)?;
            progress.advance(1);
            let mut reasons = imu_contradictions(&problem, &state, &components, EVIDENT_TO_IMU);
            if round == Round::Fine {
                reasons.extend(scan_contradictions(&problem, &state, EVIDENT_TO_SCANS));
            }
            if !reasons.is_empty() {
                return Ok(Outcome::Contradicted(reasons));
            }
        }
        // The size of the motion is estimated before points are sorted by it.
        let is_dense = round == Round::Coarse && rung == Rung::DenseKnots;
        if is_dense && learn(&problem, &mut state) > SETTLED_MOTION {
            steps.settle(&mut problem, &mut state, round.settled_sigmas())?;
            learn(&problem, &mut state);
        }
        if round == Round::Fine {
            stop = steps.weigh_and_settle(&mut problem, &mut state)?;
        }
        let reference_m =
            Vec3::from_column_slice(&reference.place.remaining(&state.reference)[..3]);
        let moved_m = problem.moved_m(&before, &state).max(reference_m.norm());
        let settled = moved_m < round.move_share() * surfel_m;
        if round == Round::Fine && (settled || repeat == MAX_ROUNDS) {
            if stop != StopReason::Converged {
                problem.forget_factor();
            }
            let components = components_at(&mut problem, &state)?;
            progress.advance(1);
            if may_climb {
                let mut reasons = imu_contradictions(&problem, &state, &components, 1.0);
                reasons.extend(scan_contradictions(&problem, &state, 1.0));
                if !reasons.is_empty() {
                    return Ok(Outcome::Contradicted(reasons));
                }
            }
            let joint = conclude(
                &problem,
                &state,
                &components,
                stop,
                steps.iterations,
                size_m,
            )?;
            return Ok(Outcome::Found(Box::new(joint)));
        }
        (groups, held) = (problem.groups, problem.held);
        again = round == Round::Fine;
        if settled {
            round = Round::Fine;
        }
        let next_m = round.size_share(rung) * surfel_m;
        if next_m != size_m || reference_m.norm() > LEAST_SIGMA_M {
            size_m = next_m;
            let grid = grid.with_size(size_m);
            reference = ReferenceCells::new(input.reference, grid, state.reference);
        }
    }
    Err(not_determined())
}

/// A round sorts the points into surfels and adjusts all unknowns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Round {
    /// Starts from the result of two steps.
    Coarse,
    /// Starts from the result of an adjustment; the noise is estimated.
    Fine,
}

impl Round {
    /// Size of its surfels, as a share of the usual size.
    fn size_share(self, rung: Rung) -> f64 {
        match (self, rung) {
            (Self::Fine, Rung::DenseKnots) => DENSE_SHARE,
            _ => 1.0,
        }
    }

    /// Largest distance between scans and reference, as a share of a surfel's size.
    fn misfit_share(self) -> f64 {
        match self {
            Self::Coarse => 0.12,
            Self::Fine => 0.02,
        }
    }

    /// Length of the last step, standard deviations, before points are sorted again, or the noise is estimated
    /// again.
    fn settled_sigmas(self) -> f64 {
        match self {
            Self::Coarse => 5.0,
            Self::Fine => SCALING_SIGMAS,
        }
    }

    /// Largest displacement of points, as a share of the usual size of a surfel. A round that moves them by more is
    /// repeated, because they then belong to other surfels.
    fn move_share(self) -> f64 {
        match self {
            Self::Coarse => 0.1,
            Self::Fine => 0.02,
        }
    }
}

/// The steps of all rounds.
struct Steps<'a> {
    max_iterations: usize,
    iterations: usize,
    /// Covariance of the blocks that couple with everything, from the last estimate of the noise.
    shared: Option<DMatrix<f64>>,
    progress: &'a dyn Progress,
}

impl Steps<'_> {
    /// Takes steps until one is shorter than `sigmas` standard deviations.
    fn settle(
        &mut self,
        problem: &mut JointProblem<'_>,
        state: &mut State,
        sigmas: f64,
    ) -> Result<StopReason> {
        let most = self.max_iterations.saturating_sub(self.iterations).max(1);
        let ended = levenberg_marquardt(problem, state, DAMPING, most, sigmas, self.progress)?;
        self.iterations += ended.iterations;
        Ok(ended.stop)
    }

    /// Alternates steps with estimates of the noise, of the motion of mountings, and of the trust in rows.
    fn weigh_and_settle(
        &mut self,
        problem: &mut JointProblem<'_>,
        state: &mut State,
    ) -> Result<StopReason> {
        problem.raise_noise(state);
        let sigmas = if problem.layout.knots.is_empty() {
            SCALING_SIGMAS
        } else {
            LEARNING_SIGMAS
        };
        for scaling in 1.. {
            let components = components_at(problem, state)?;
            self.progress.advance(1);
            let learned = learn(problem, state);
            // Dense knots follow a jump, which cannot be told from their own motion.
            let slow = state.bends.as_mut().filter(|b| b.rung == Rung::SlowKnots);
            let jumped = slow.is_some_and(Bends::restart);
            self.shared = problem.shared_covariance();
            problem.judge_by(self.shared.as_ref());
            let change = rescale(problem, &components);
            if self.hold(problem) {
                // Residuals show nothing about trust before the mountings are back at their start values.
                self.settle(problem, state, SCALING_SIGMAS)?;
            }
            problem.find_trust(state);
            let is_settled = change < SETTLED_SCALE && learned < SETTLED_MOTION && !jumped;
            if scaling == MAX_SCALINGS || is_settled {
                break;
            }
            self.settle(problem, state, sigmas)?;
        }
        self.settle(problem, state, SETTLED_SIGMAS)
    }

    /// Holds the directions that nothing determines at their start values; returns whether there are new
    /// ones.
    fn hold(&self, problem: &mut JointProblem<'_>) -> bool {
        if !problem.held.is_empty() {
            return false;
        }
        problem.held = undetermined(problem, self.shared.as_ref());
        if !problem.held.is_empty() {
            problem.judge_by(None);
        }
        !problem.held.is_empty()
    }
}

/// The variance components of all groups at a state; the problem then holds the factor at this state or at one
/// nearby.
fn components_at(problem: &mut JointProblem<'_>, state: &State) -> Result<Vec<Component>> {
    problem.factorise_near(state).ok_or_else(not_determined)?;
    Ok(components(problem, state))
}

/// Keyframe intervals with half as many keyframes of the scanner with the most rows; `None` if it has few
/// already.
///
/// If nearly all poses see the same surface, such as those of a robot with a long-range lidar, nearly all
/// nodes are coupled with each other. The adjustment can do without the rows between keyframes: a surfel
/// that stays in view is seen often enough.
fn fewer_keyframes(problem: &JointProblem<'_>, keyframe_steps: &[usize]) -> Option<Vec<usize>> {
    let row_count = |scanner: usize| {
        let rows = problem.association.rows();
        rows.filter(|row| row.scanner as usize == scanner).count()
    };
    let dense = (0..keyframe_steps.len()).filter(|s| 2 * keyframe_steps[*s] <= MAX_KEYFRAME_STEPS);
    let fullest = dense.max_by_key(|&scanner| row_count(scanner))?;
    let mut fewer = keyframe_steps.to_vec();
    fewer[fullest] *= 2;
    Some(fewer)
}

fn too_large(problem: &JointProblem<'_>) -> Error {
    Error::of(
        Problem::TooMany,
        format!(
            "the normal equations of the joint adjustment need {:.0} GB: too many poses see the \
             same surface",
            8e-9 * problem.factor_entries() as f64
        ),
        "shorten the drive, limit the range of the scanner, or choose larger surfels with \
         joint.surfel_m",
    )
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
    let mut directions: Vec<(f64, DVector<f64>)> = (0..count)
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
    directions.sort_by(|a, b| b.0.total_cmp(&a.0));
    directions
        .into_iter()
        .map(|(_, direction)| direction)
        .collect()
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
        reference: [0.0; REFERENCE],
    }
}
