//! The trajectory stage: logs in, poses with standard deviations out.

use super::chain::{ChainFactor, NotPositive};
use super::clock;
use super::constants::Constants;
use super::covariance::PosteriorCovariance;
use super::diagnostics::imu_variance_component;
use super::graph::{Ended, Graph, State};
use super::initial::{Initial, initial};
use super::interpolate::Trajectory;
use super::rest::{Rest, rests};
use super::robust;
use super::solution::{Solution, StopReason};
use super::streams::{ClockCorrection, MotionLogs, Names, Stream, Streams};
use super::timeline::Timeline;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::trajectory::{Constant, TrajectorySettings};

/// A clock correction that moves by more than this is applied to the records, which may then lie
/// between other nodes, seconds.
const SETTLED_CLOCK_S: f64 = 5e-4;
/// Most times that records are laid out anew for their clocks.
const MOST_LAYOUTS: usize = 12;
/// Most jumps of clocks that are corrected.
const MOST_JUMPS: usize = 4;
/// The noise scale has settled where its square moves by less than this share.
const SETTLED_SCALE: f64 = 0.01;
const MOST_SCALINGS: usize = 15;

/// The estimated trajectory and all that is known about it.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// A pose at every IMU sample and one at the end of the last, with velocity, biases and
    /// standard deviations.
    pub trajectory: Trajectory,
    /// How the adjustment ended and what it left.
    pub solution: Solution,
    /// The joint covariance of all poses.
    pub covariance: PosteriorCovariance,
}

/// Estimates the trajectory from an IMU, positions of prisms or antennas, and headings: a factor
/// graph on a chain, solved by Levenberg-Marquardt with the losses of the settings.
///
/// Records that do not fit are left out and named in [`Solution::rejections`]. Without headings
/// the direction of travel gives the start, and the standard deviations say how well the yaw is
/// found.
///
/// # Errors
/// Values that are not finite, streams that do not overlap, too few positions, an IMU gap of
/// minutes, neither headings nor motion; [`Error::Cancelled`].
pub fn estimate(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    progress: &dyn Progress,
) -> Result<Estimate> {
    estimate_from(&initial, logs, settings, progress)
}

/// Where an adjustment starts.
pub(super) type Start<'a> =
    dyn Fn(&Streams, &Timeline, &[Rest], &TrajectorySettings) -> Result<Initial> + Sync + 'a;

/// As [`estimate`], from given start values.
pub(super) fn estimate_from(
    start: &Start<'_>,
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    progress: &dyn Progress,
) -> Result<Estimate> {
    let stage = progress.stage("trajectory", 0);
    // Enter the thread pool once: each entry from outside costs two thread switches.
    let mut asked = settings.clone();
    let mut idle = Vec::new();
    let adjusted = rayon::scope(|_| {
        let adjusted = adjust(start, logs, settings, progress)?;
        // Nothing in the drive tells these latencies: they stay where the project has them.
        idle = adjusted.idle_latencies();
        if idle.is_empty() {
            return Ok(adjusted);
        }
        asked
            .estimate
            .retain(|constant| latency_of(constant).is_none_or(|stream| !idle.contains(&stream)));
        adjust(start, logs, &asked, progress)
    });
    drop(stage);
    let estimate = adjusted?.conclude(&asked, &idle, progress)?;
    let solution = &estimate.solution;
    if solution.converged {
        progress.say(&solution.to_string());
    } else {
        progress.warn(&format!(
            "{solution}: check lever arm, axes, heading offset and the clocks of the logs"
        ));
    }
    Ok(estimate)
}

/// The graph at its solution.
pub(super) struct Adjusted {
    pub streams: Streams,
    pub rests: Vec<Rest>,
    pub start: Initial,
    pub graph: Graph,
    pub state: State,
    pub factor: ChainFactor,
    pub ended: Ended,
    pub corrections: Vec<ClockCorrection>,
}

/// What a layout hands on to the next one of the same logs.
#[derive(Debug, Clone, Default)]
pub(super) struct Carried {
    constants: Vec<f64>,
    weights: Option<robust::Weights>,
}

impl Carried {
    fn of(adjusted: &Adjusted) -> Self {
        Self {
            constants: adjusted.state.constants.clone(),
            weights: Some(robust::Weights::of(&adjusted.graph)),
        }
    }
}

/// Adjusts, and again where the clocks turn out to be off or to have jumped.
fn adjust(
    begin: &Start<'_>,
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    progress: &dyn Progress,
) -> Result<Adjusted> {
    let mut corrections = latencies(settings);
    let mut carried = Carried::default();
    let mut layouts = 0;
    let mut before: Option<Adjusted> = None;
    loop {
        let mut adjusted = adjust_once(begin, logs, settings, (&corrections, &carried), progress)?;
        layouts += 1;
        // A jump stays where the records fit better with it.
        if let Some(before) = before.take_if(|before| before.cost() <= adjusted.cost()) {
            progress.warn("the last jump of a clock does not help: not corrected");
            adjusted = before;
            layouts = MOST_LAYOUTS;
        }
        if layouts == MOST_LAYOUTS {
            adjusted.finish(settings, progress)?;
            return Ok(adjusted);
        }
        let moved = adjusted.settle_clocks(&mut corrections);
        if moved > SETTLED_CLOCK_S {
            carried = Carried::of(&adjusted);
            continue;
        }
        if clock::set_to_stamps(logs, &mut corrections, &adjusted.clock_sigmas()) {
            // Of the constants carried on, those of clocks are no more.
            carried = Carried {
                constants: Vec::new(),
                ..Carried::of(&adjusted)
            };
            continue;
        }
        let jumps = corrections.iter().filter(|c| c.record > 0).count();
        if jumps < MOST_JUMPS {
            let found = clock::find(
                logs,
                &adjusted.streams,
                &adjusted.graph,
                &adjusted.state,
                settings,
                &corrections,
            );
            if let Some(jump) = found {
                progress.say(&format!(
                    "the clock of {} seems to jump before record {} at {:.3} s",
                    Names(settings).sensor(jump.stream),
                    jump.record + 1,
                    jump.time_s
                ));
                clock::put(&mut corrections, jump);
                // Records that the jump had made outliers come back: the search starts afresh.
                carried = Carried {
                    weights: None,
                    ..Carried::of(&adjusted)
                };
                before = Some(adjusted);
                continue;
            }
        }
        adjusted.finish(settings, progress)?;
        return Ok(adjusted);
    }
}

/// The stream whose latency a constant is.
fn latency_of(constant: &Constant) -> Option<Stream> {
    match constant {
        Constant::TimeOffset(sensor) => Some(Stream::Position(*sensor)),
        Constant::HeadingTimeOffset => Some(Stream::Heading),
        _ => None,
    }
}

/// A correction from the first record on for each latency that is to be estimated.
fn latencies(settings: &TrajectorySettings) -> Vec<ClockCorrection> {
    settings
        .estimate
        .iter()
        .filter_map(latency_of)
        .map(|stream| ClockCorrection {
            stream,
            record: 0,
            time_s: 0.0,
            shift_s: 0.0,
            held: false,
        })
        .collect()
}

pub(super) fn adjust_once(
    begin: &Start<'_>,
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    (corrections, carried): (&[ClockCorrection], &Carried),
    progress: &dyn Progress,
) -> Result<Adjusted> {
    let streams = Streams::new(logs, settings, corrections)?;
    let timeline = Timeline::new(&streams, settings.nodes);
    let rests = rests(&streams, settings);
    let start = begin(&streams, &timeline, &rests, settings)?;
    let known = Constants::new(settings, corrections);
    let mut constants = vec![0.0; known.count()];
    for (i, (value, before)) in constants.iter_mut().zip(&carried.constants).enumerate() {
        // What times had found has become a correction.
        *value = if known.is_time(i) { 0.0 } else { *before };
    }
    let held: &[Rest] = if settings.zero_velocity { &rests } else { &[] };
    let first = (start.nodes[0], start.bias);
    let mut graph = Graph::new(timeline, &streams, settings, known, held, first)?;
    let layout = graph.timeline.layout.clone();
    let mut state = State {
        biases: start.biases.clone(),
        nodes: start.nodes.clone(),
        constants,
    };
    let mut factor = ChainFactor::new(layout, graph.known.count());
    let weights = carried.weights.as_ref();
    let ended = robust::solve(
        &mut graph,
        &mut state,
        &mut factor,
        settings,
        weights,
        progress,
    )?;
    if ended.stop != StopReason::Converged {
        graph.factorise(&state, 0.0, &mut factor).map_err(|free| {
            let what = match free {
                NotPositive::Node(node) => {
                    format!("the trajectory at {:.3} s", graph.timeline.node_s[node])
                }
                NotPositive::Constant(constant) => graph.known.unknowns[constant].name.clone(),
            };
            Error::data(
                format!(
                    "{what} is not determined ({} after {} iterations)",
                    ended.stop, ended.iterations
                ),
                "check lever arm, axes, heading offset and the clocks of the logs",
            )
        })?;
    }
    Ok(Adjusted {
        streams,
        rests,
        start,
        graph,
        state,
        factor,
        ended,
        corrections: corrections.to_vec(),
    })
}

impl Adjusted {
    /// Moves what the time constants found into `corrections`; the largest move, seconds.
    fn settle_clocks(&self, corrections: &mut [ClockCorrection]) -> f64 {
        let mut largest = 0.0_f64;
        for (column, correction) in self
            .graph
            .known
            .clocks()
            .zip(corrections.iter_mut().filter(|correction| !correction.held))
        {
            let late_s = self.state.constants[column];
            largest = largest.max(late_s.abs());
            if late_s.abs() > SETTLED_CLOCK_S {
                correction.shift_s += late_s;
            }
        }
        largest
    }

    /// What the losses count all records.
    fn cost(&self) -> f64 {
        robust::truncated_cost(&self.graph, &self.ended)
    }

    /// Finds what is found once the clocks are.
    fn finish(&mut self, settings: &TrajectorySettings, progress: &dyn Progress) -> Result<()> {
        match settings.estimate.contains(&Constant::ImuNoiseScale) {
            true => self.scale_noise(progress),
            false => Ok(()),
        }
    }

    /// Standard deviations of the clock corrections that are estimated, in their order.
    fn clock_sigmas(&self) -> Vec<f64> {
        let covariance = self.factor.constants_covariance();
        let columns = self.graph.known.clocks();
        columns.map(|c| covariance[(c, c)].sqrt()).collect()
    }

    /// Scales the IMU's standard deviations until its residuals are as large as they say: the
    /// variance component Ω/r of gyro and accelerometer together becomes 1 (Förstner 1979).
    fn scale_noise(&mut self, progress: &dyn Progress) -> Result<()> {
        for _ in 0..MOST_SCALINGS {
            let component = imu_variance_component(&self.graph, &self.state, &self.factor);
            let Some((square, _)) = component else { break };
            self.graph.imu_scale *= square.sqrt();
            let again = self.graph.solve(
                &mut self.state,
                &mut self.factor,
                super::graph::MOST_ITERATIONS,
                progress,
            )?;
            self.ended.iterations += again.iterations;
            self.ended.stop = again.stop;
            self.ended.cost = again.cost;
            if (square - 1.0).abs() < SETTLED_SCALE {
                return Ok(());
            }
        }
        progress.warn("imu.noise_scale has not settled: the value is that of the last round");
        Ok(())
    }
}
