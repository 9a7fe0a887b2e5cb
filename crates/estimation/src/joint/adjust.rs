//! The adjustment: points are sorted into surfels, all unknowns are adjusted, and again with closer
//! gates.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::bend::{Bends, Rung};
use super::components::{Component, components, rescale};
use super::conclude::{conclude, not_determined};
use super::input::{JointInput, Scans};
use super::layout::{Groups, REFERENCE};
use super::learn::learn;
use super::model::{EVIDENT_TO_IMU, EVIDENT_TO_SCANS, imu_against, scans_against};
use super::problem::{JointProblem, LEAST_SIGMA_M};
use super::result::Joint;
use super::settings::JointSettings;
use super::state::State;
use super::surfel::{Association, Gates, ReferenceCells, associate};
use crate::adjustment::{CONVERGED_SIGMAS, DampingRule, StopReason, levenberg_marquardt};
use crate::calibration::observability::LEVER_M;
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Edge of the patches of the reference's surface errors, in sizes of a surfel.
const PATCH_SIZES: f64 = 6.0;
/// Scales of noise have settled where they change by less than this share.
const SETTLED_SCALE: f64 = 0.1;
/// And where those of a motion in time do by less, see [`learn`].
const SETTLED_MOTION: f64 = 0.3;
/// Size of the surfels with dense knots, as a share of that of others: what moves at random along the ground shows at
/// its slopes alone, and small surfels have steeper ones.
const DENSE_SHARE: f64 = 0.72;
/// Times that the noise is estimated in the last round.
const MAX_SCALINGS: usize = 3;
/// Fewest surfels that the reference knows or that are seen twice.
const MIN_SURFELS: usize = 50;
/// A parameter with a larger standard deviation is not determined, metres; rotations count as what
/// they move at [`LEVER_M`].
const MAX_SIGMA_M: f64 = 0.010;
/// Length of the last step, standard deviations, before the noise is estimated anew.
const SCALING_SIGMAS: f64 = 0.5;
/// The same with knots: how far they may move is found anew as well, which moves mountings much and residuals
/// little.
const LEARNING_SIGMAS: f64 = 2.0;
/// And at the end. Steps become shorter by a factor of two or more, and nothing is off by more than this.
const SETTLED_SIGMAS: f64 = 2.0 * CONVERGED_SIGMAS;
/// Most rounds.
const MAX_ROUNDS: usize = 10;

/// Most entries of the factor of the normal equations, 8 bytes each: those of three drives with two
/// profile scanners.
const MAX_FACTOR_ENTRIES: usize = 350_000_000;
/// Most steps from one keyframe to the next.
const MAX_KEYFRAME_STEPS: usize = 64;

/// As for the trajectory alone, but for the rise of the cost: derivatives of poses between nodes are
/// right to a hundredth, and where they vanish is not quite where the cost is least. A rise of 1e-5 is a
/// step of a fraction of a standard deviation.
pub const DAMPING: DampingRule = DampingRule {
    rounding: 1e-5,
    ..DampingRule::UNDAMPED
};

/// How an adjustment ended.
pub enum Outcome {
    /// With values.
    Found(Box<Joint>),
    /// As mountings move more than they may; where this is evident, before it had settled.
    Contradicted(Vec<String>),
}

/// Points as two steps leave them, sorted into surfels: what all rungs begin with.
pub struct Sorted {
    keyframe_steps: Vec<usize>,
    found: Association,
}

/// Adjusts with mountings that may move as much as a rung lets them; where it may climb, no longer than until
/// they evidently move more. Points are sorted for the first round where `sorted` does not have them yet, and kept
/// there for the next rung.
///
/// # Errors
/// Those of [`adjust`](super::adjust).
pub fn at_rung(
    (input, settings): (&JointInput<'_>, &JointSettings),
    surfel_m: f64,
    (rung, may_climb): (Rung, bool),
    sorted: &mut Option<Sorted>,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let mut state = start(input);
    state.bends = Bends::new(
        rung,
        &state.motions,
        (&input.mountings, input.compliance),
        &input.frames(),
    );
    let scans: Vec<Scans<'_>> = input.drives.iter().map(|d| d.scans.clone()).collect();
    let surface_m = settings.reference.surface_m.unwrap_or(0.0);
    let mut reference = ReferenceCells::new(input.reference, surfel_m, state.reference);
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
                size_m,
                misfit_m: round.misfit_share() * size_m,
                patch_m: PATCH_SIZES * size_m,
                keyframe_steps: keyframe_steps.clone(),
            };
            let (poses, late_s) = (state.poses(), &state.late_s);
            let mounted = (poses.as_slice(), state.bends.as_ref());
            let is_first = repeat == 1;
            let before =
                sorted.take_if(|before| is_first && before.keyframe_steps == keyframe_steps);
            let found = before.map_or_else(
                || associate(&scans, &state.motions, mounted, late_s, &reference, &gates),
                |before| before.found,
            );
            if is_first && may_climb {
                *sorted = Some(Sorted {
                    keyframe_steps: keyframe_steps.clone(),
                    found: found.clone(),
                });
            }
            check_overlap(input, &found)?;
            state.shapes = vec![Vec3::zeros(); found.surfels.len()];
            state.patches = vec![0.0; found.patches];
            let begin = (&state, held.clone(), surface_m);
            let problem = JointProblem::new(input, settings, found, groups.clone(), begin);
            if problem.factor_entries() <= MAX_FACTOR_ENTRIES {
                break problem;
            }
            let fewer = fewer_keyframes(&problem, &keyframe_steps);
            keyframe_steps = fewer.ok_or_else(|| too_large(&problem))?;
        };
        progress.advance(1);
        problem.judge_by(steps.shared.as_ref());
        if round == Round::Fine {
            // Residuals to surfels that are not where they are seen would pass for outliers in the first step.
            problem.fit_shapes(&mut state);
            if may_climb && !again {
                // Steps of a model that is evidently wrong are many, and may be refused.
                let reasons = scans_against(&problem, &state, EVIDENT_TO_SCANS);
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
            let found = components_at(&mut problem, &state)?;
            progress.advance(1);
            let mut reasons = imu_against(&problem, &state, (&found, EVIDENT_TO_IMU));
            if round == Round::Fine {
                reasons.extend(scans_against(&problem, &state, EVIDENT_TO_SCANS));
            }
            if !reasons.is_empty() {
                return Ok(Outcome::Contradicted(reasons));
            }
        }
        // Before points are sorted by a motion, how much there is of it.
        let is_dense = round == Round::Coarse && rung == Rung::DenseKnots;
        if is_dense && learn(&problem, &mut state) > SETTLED_MOTION {
            steps.settle(&mut problem, &mut state, round.settled_sigmas())?;
            learn(&problem, &mut state);
        }
        if round == Round::Fine {
            stop = steps.weigh_and_settle(&mut problem, &mut state)?;
        }
        let reference_m = Vec3::from_column_slice(&reference.place.left(&state.reference)[..3]);
        let moved_m = problem.moved_m(&before, &state).max(reference_m.norm());
        let settled = moved_m < round.move_share() * surfel_m;
        if round == Round::Fine && (settled || repeat == MAX_ROUNDS) {
            if stop != StopReason::Converged {
                problem.forget_factor();
            }
            let found = components_at(&mut problem, &state)?;
            progress.advance(1);
            if may_climb {
                let mut reasons = imu_against(&problem, &state, (&found, 1.0));
                reasons.extend(scans_against(&problem, &state, 1.0));
                if !reasons.is_empty() {
                    return Ok(Outcome::Contradicted(reasons));
                }
            }
            let found = conclude(&problem, &state, &found, (stop, steps.iterations), size_m)?;
            return Ok(Outcome::Found(Box::new(found)));
        }
        (groups, held) = (problem.groups, problem.held);
        again = round == Round::Fine;
        if settled {
            round = Round::Fine;
        }
        let next_m = round.size_share(rung) * surfel_m;
        if next_m != size_m || reference_m.norm() > LEAST_SIGMA_M {
            size_m = next_m;
            reference = ReferenceCells::new(input.reference, size_m, state.reference);
        }
    }
    Err(not_determined())
}

/// A round sorts the points into surfels and adjusts all unknowns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Round {
    /// From what two steps leave.
    Coarse,
    /// From what an adjustment leaves; the noise is estimated.
    Fine,
}

impl Round {
    /// Size of its surfels, as a share of the usual one.
    fn size_share(self, rung: Rung) -> f64 {
        match (self, rung) {
            (Self::Fine, Rung::DenseKnots) => DENSE_SHARE,
            _ => 1.0,
        }
    }

    /// How far scans and reference may lie apart, as a share of a surfel's size.
    fn misfit_share(self) -> f64 {
        match self {
            Self::Coarse => 0.12,
            Self::Fine => 0.02,
        }
    }

    /// Length of the last step, standard deviations, before points are sorted anew, or the noise is estimated
    /// anew.
    fn settled_sigmas(self) -> f64 {
        match self {
            Self::Coarse => 5.0,
            Self::Fine => SCALING_SIGMAS,
        }
    }

    /// A round that moves points by more than this share of the usual size of a surfel is done again: they belong
    /// to other surfels then.
    fn move_share(self) -> f64 {
        match self {
            Self::Coarse => 0.1,
            Self::Fine => 0.02,
        }
    }
}

/// Steps of all rounds.
struct Steps<'a> {
    max_iterations: usize,
    iterations: usize,
    /// Covariance of the blocks that couple with everything, when the noise was last estimated.
    shared: Option<DMatrix<f64>>,
    progress: &'a dyn Progress,
}

impl Steps<'_> {
    /// Steps until one is shorter than so many standard deviations.
    fn settle(
        &mut self,
        problem: &mut JointProblem<'_>,
        state: &mut State,
        sigmas: f64,
    ) -> Result<StopReason> {
        let most = self.max_iterations.saturating_sub(self.iterations).max(1);
        let ended = levenberg_marquardt(problem, state, DAMPING, (most, sigmas), self.progress)?;
        self.iterations += ended.iterations;
        Ok(ended.stop)
    }

    /// Estimates the noise, how much mountings move, and which rows are trusted, in turn with steps.
    fn weigh_and_settle(
        &mut self,
        problem: &mut JointProblem<'_>,
        state: &mut State,
    ) -> Result<StopReason> {
        problem.raise_noise(state);
        let sigmas = match problem.layout.knots.is_empty() {
            true => SCALING_SIGMAS,
            false => LEARNING_SIGMAS,
        };
        for scaling in 1.. {
            let found = components_at(problem, state)?;
            self.progress.advance(1);
            let learned = learn(problem, state);
            // Dense knots follow a jump, and do not tell it from what they do themselves.
            let slow = state.bends.as_mut().filter(|b| b.rung == Rung::SlowKnots);
            let jumped = slow.is_some_and(Bends::restart);
            self.shared = problem.shared_covariance();
            problem.judge_by(self.shared.as_ref());
            let change = rescale(problem, &found);
            if self.hold(problem) {
                // Residuals say nothing of trust before the mountings are back there.
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

    /// Holds what nothing determines, where it was before; returns whether there is any yet.
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

/// What the residuals at a state say about the noise of each group; the problem then holds the factor of this
/// state or of one not far from it.
fn components_at(problem: &mut JointProblem<'_>, state: &State) -> Result<Vec<Component>> {
    problem.factorise_near(state).ok_or_else(not_determined)?;
    Ok(components(problem, state))
}

/// Half as many keyframes of the scanner with the most rows; `None` if it has few already.
///
/// Where nearly all poses see the same surface, as those of a robot with a lidar that looks far, nearly
/// all nodes are coupled with each other. All else does without the rows between keyframes: a surfel
/// that stays in sight is seen often enough.
fn fewer_keyframes(problem: &JointProblem<'_>, keyframe_steps: &[usize]) -> Option<Vec<usize>> {
    let rows_of = |scanner: usize| {
        let rows = problem.found.rows();
        rows.filter(|row| row.scanner as usize == scanner).count()
    };
    let dense = (0..keyframe_steps.len()).filter(|s| 2 * keyframe_steps[*s] <= MAX_KEYFRAME_STEPS);
    let fullest = dense.max_by_key(|&scanner| rows_of(scanner))?;
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

/// # Errors
/// Too little of the surface that is known or seen twice, or too little that a scanner saw of it.
fn check_overlap(input: &JointInput<'_>, found: &Association) -> Result<()> {
    let checked = found.surfels.iter().filter(|surfel| surfel.is_checked);
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
        let rows = found.rows().filter(|row| row.scanner == scanner).count();
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

/// The start values. Constants that drives share start where the first drive found them.
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
