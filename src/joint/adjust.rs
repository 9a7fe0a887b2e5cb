//! The adjustment: points are sorted into surfels, all unknowns are adjusted, and again with closer
//! gates.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::bend::{Bends, Rung};
use super::components::{Component, components, rescale};
use super::conclude::{conclude, not_determined};
use super::input::{JointInput, Scans};
use super::layout::{Groups, REFERENCE};
use super::model::contradictions;
use super::problem::{JointProblem, LEAST_SIGMA_M};
use super::result::{Climb, Joint};
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
/// Times that the noise is estimated in the last round.
const MAX_SCALINGS: usize = 3;
/// Fewest surfels that the reference knows or that are seen twice.
const MIN_SURFELS: usize = 50;
/// A parameter with a larger standard deviation is not determined, metres; rotations count as what
/// they move at [`LEVER_M`].
const MAX_SIGMA_M: f64 = 0.010;
/// Length of the last step, standard deviations, before points are sorted anew, and before the noise is
/// estimated anew.
const SORTING_SIGMAS: f64 = 5.0;
const SCALING_SIGMAS: f64 = 0.5;
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
    let mut begin = start(input);
    let least = match (input.known, input.compliance) {
        (Some(_), []) => Rung::Rigid,
        (Some(_), _) => Rung::Compliance,
        (None, _) => settings.mounting.least,
    };
    let mountings = &input.mountings;
    begin.bends = Bends::new(least, &begin.motions, mountings, input.compliance);
    let (mut found, mut state) = at_rung(input, settings, surfel_m, begin, progress)?;
    let mut ladder = Vec::new();
    loop {
        let reasons = contradictions(&found);
        let allowed = |rung: &Rung| *rung <= settings.mounting.most && input.known.is_none();
        let (false, Some(next)) = (reasons.is_empty(), state.rung().next().filter(allowed)) else {
            break;
        };
        progress.say(&format!(
            "the mountings are not {}: {}",
            state.rung().name(),
            reasons[0]
        ));
        let left = Climb {
            rung: state.rung(),
            reasons,
        };
        let mut begin = state.clone();
        begin.bends = Bends::new(next, &begin.motions, mountings, &[]);
        match at_rung(input, settings, surfel_m, begin, progress) {
            Ok(climbed) => (found, state) = climbed,
            Err(Error::Cancelled) => return Err(Error::Cancelled),
            // The rung below could be made.
            Err(error) => {
                progress.say(&format!("{} ones cannot be adjusted: {error}", next.name()));
                break;
            }
        }
        ladder.push(left);
    }
    drop(stage);
    found.ladder = ladder;
    Ok(found)
}

/// Adjusts with mountings that may move as much as those of the start values, from these.
fn at_rung(
    input: &JointInput<'_>,
    settings: &JointSettings,
    surfel_m: f64,
    mut state: State,
    progress: &dyn Progress,
) -> Result<(Joint, State)> {
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
    let (mut round, mut again) = (Round::Coarse, false);
    let mut keyframe_steps = vec![1; input.mountings.len()];
    for repeat in 1..=MAX_ROUNDS {
        progress.check()?;
        let mut problem = loop {
            let gates = Gates {
                size_m: surfel_m,
                misfit_m: round.misfit_share() * surfel_m,
                patch_m: PATCH_SIZES * surfel_m,
                keyframe_steps: keyframe_steps.clone(),
            };
            let (poses, late_s) = (state.poses(), &state.late_s);
            let mounted = (poses.as_slice(), state.bends.as_ref());
            let found = associate(&scans, &state.motions, mounted, late_s, &reference, &gates);
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
        problem.judge_by(steps.shared.as_ref());
        if again {
            problem.fit_shapes(&mut state);
            problem.find_trust(&state);
        }
        let before = state.clone();
        let stop = match round {
            Round::Coarse => steps.settle(&mut problem, &mut state, SORTING_SIGMAS)?,
            Round::Fine => steps.weigh_and_settle(&mut problem, &mut state)?,
        };
        let reference_m = Vec3::from_column_slice(&reference.place.left(&state.reference)[..3]);
        let moved_m = problem.moved_m(&before, &state).max(reference_m.norm());
        let settled = moved_m < round.move_share() * surfel_m;
        if round == Round::Fine && (settled || repeat == MAX_ROUNDS) {
            let found = components_at(&mut problem, &state)?;
            let found = conclude(&problem, &state, &found, (stop, steps.iterations))?;
            return Ok((found, state));
        }
        if reference_m.norm() > LEAST_SIGMA_M {
            reference = ReferenceCells::new(input.reference, surfel_m, state.reference);
        }
        (groups, held) = (problem.groups, problem.held);
        again = round == Round::Fine;
        if settled {
            round = Round::Fine;
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
    /// How far scans and reference may lie apart, as a share of a surfel's size.
    fn misfit_share(self) -> f64 {
        match self {
            Self::Coarse => 0.12,
            Self::Fine => 0.02,
        }
    }

    /// A round that moves points by more than this share of a surfel is done again: they belong to
    /// other surfels then.
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

    /// Estimates the noise, and which rows are trusted, in turn with steps.
    fn weigh_and_settle(
        &mut self,
        problem: &mut JointProblem<'_>,
        state: &mut State,
    ) -> Result<StopReason> {
        self.settle(problem, state, SCALING_SIGMAS)?;
        problem.raise_noise(state);
        for scaling in 1.. {
            let found = components_at(problem, state)?;
            self.shared = problem.shared_covariance();
            problem.judge_by(self.shared.as_ref());
            let change = rescale(problem, &found);
            if self.hold(problem) {
                // Residuals say nothing of trust before the mountings are back there.
                self.settle(problem, state, SCALING_SIGMAS)?;
            }
            problem.find_trust(state);
            if scaling == MAX_SCALINGS || change < SETTLED_SCALE {
                break;
            }
            self.settle(problem, state, SCALING_SIGMAS)?;
        }
        self.settle(problem, state, CONVERGED_SIGMAS)
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

/// What the residuals at a state say about the noise of each group; the problem then holds the factor.
fn components_at(problem: &mut JointProblem<'_>, state: &State) -> Result<Vec<Component>> {
    problem.factorise(state).ok_or_else(not_determined)?;
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
