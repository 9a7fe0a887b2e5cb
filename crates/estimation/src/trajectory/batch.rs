//! The adjustment of a whole drive, repeated until clocks and outliers have settled.

use super::clock;
use super::constants::Constants;
use super::graph::Graph;
use super::initial::Initial;
use super::lasting::Modes;
use super::logs::{ClockCorrection, MotionLogs, Stream};
use super::rest::{Rest, rests};
use super::robust::{self, MAX_ITERATIONS};
use super::settings::{Constant, TrajectorySettings};
use super::states::{State, VELOCITY};
use super::streams::{Names, Streams};
use super::timeline::Timeline;
use super::variance::imu_mean_component;
use crate::adjustment::{ChainFactor, ChainProblem, Ended, NODE, NotPositive};
use crate::error::{Error, Problem, Result};
use crate::progress::Progress;

/// A clock correction that moves by more than this is applied to the records, which may then lie
/// between other nodes, seconds.
const SETTLED_CLOCK_S: f64 = 5e-4;
/// A scale factor of the gyroscope that is off by more than this is applied to the samples. In a second between nodes and
/// at 0.5 rad/s, poses in between are off by an eighth of 25 µrad.
const SETTLED_GYRO_SCALE: f64 = 5e-5;
/// Largest number of adjustments between which clocks are corrected.
const MAX_LAYOUTS: usize = 12;
/// At most this many jumps of clocks are corrected.
const MAX_JUMPS: usize = 4;
/// A latency is determined where more than this share of the squared motion is not noise. The errors of
/// velocities are correlated over long times: a minute holds few independent ones, and their squares
/// scatter widely.
const MIN_MOTION_SHARE: f64 = 0.95;
/// The noise scale has settled where its square changes by less than this share.
const SETTLED_SCALE: f64 = 0.01;
const MAX_SCALINGS: usize = 15;

/// Finds the start values of an adjustment.
pub type Start<'a> =
    dyn Fn(&Streams, &Timeline, &[Rest], &TrajectorySettings) -> Result<Initial> + Sync + 'a;

/// The graph at its solution.
pub struct Adjusted {
    pub streams: Streams,
    pub rests: Vec<Rest>,
    pub start: Initial,
    pub graph: Graph,
    pub state: State,
    pub factor: ChainFactor,
    pub ended: Ended,
    pub corrections: Vec<ClockCorrection>,
}

/// What one adjustment passes on to the next.
#[derive(Debug, Clone, Default)]
pub struct Carried {
    constants: Option<Constants>,
    weights: Option<robust::Weights>,
}

impl Carried {
    fn of(adjusted: &Adjusted) -> Self {
        Self {
            constants: Some(adjusted.state.constants.clone()),
            weights: Some(robust::Weights::of(&adjusted.graph)),
        }
    }
}

/// Adjusts, and adjusts again where clocks turn out to be off or to have jumped.
pub fn adjust(
    begin: &Start<'_>,
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    progress: &dyn Progress,
) -> Result<Adjusted> {
    let of_constant = |constant: &Constant| ClockCorrection::of(*constant, logs);
    let mut corrections: Vec<_> = settings.estimate.iter().filter_map(of_constant).collect();
    let mut carried = Carried::default();
    let mut layouts = 0;
    let mut before: Option<Adjusted> = None;
    loop {
        let mut adjusted = adjust_once(begin, logs, settings, &corrections, &carried, progress)?;
        layouts += 1;
        // The correction of a jump is kept only if the records fit better with it.
        if let Some(before) = before.take_if(|before| before.cost() <= adjusted.cost()) {
            progress.warn("correcting the last jump of a clock does not improve the fit: the times are left as logged");
            adjusted = before;
            layouts = MAX_LAYOUTS;
        }
        if layouts == MAX_LAYOUTS {
            adjusted.finish(settings, progress)?;
            return Ok(adjusted);
        }
        let moved = adjusted.settle_clocks(&mut corrections);
        let is_scaled = adjusted.state.constants.gyro_scale.left() <= SETTLED_GYRO_SCALE;
        if moved > SETTLED_CLOCK_S || !is_scaled {
            carried = Carried::of(&adjusted);
            continue;
        }
        if clock::set_to_stamps(logs, &mut corrections, &adjusted.clock_sigmas()) {
            // The constants hold clocks that are no longer estimated: they are not passed on.
            carried = Carried {
                constants: None,
                ..Carried::of(&adjusted)
            };
            continue;
        }
        let jumps = corrections.iter().filter(|c| c.record > 0).count();
        if jumps < MAX_JUMPS {
            let jump = clock::find_jump(
                logs,
                &adjusted.streams,
                &adjusted.graph,
                &adjusted.state,
                &corrections,
            );
            if let Some(jump) = jump {
                progress.say(&format!(
                    "the clock of {} seems to jump before record {} at {:.3} s",
                    Names(settings).sensor(jump.stream),
                    jump.record + 1,
                    jump.time_s
                ));
                clock::put(&mut corrections, jump);
                // Records that were outliers because of the jump may fit now: the search starts afresh.
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

/// Adjusts once, with these corrections of the clocks.
pub fn adjust_once(
    begin: &Start<'_>,
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    corrections: &[ClockCorrection],
    carried: &Carried,
    progress: &dyn Progress,
) -> Result<Adjusted> {
    let mut streams = Streams::new(logs, settings, corrections)?;
    if let Some(before) = &carried.constants {
        streams.imu.divide_rates(&before.gyro_scale.factor.value);
    }
    let timeline = Timeline::new(&streams, settings.nodes, settings.max_step_s);
    let rests = rests(&streams, settings);
    let start = begin(&streams, &timeline, &rests, settings)?;
    let mut constants = Constants::new(settings, corrections);
    add_lasting(&mut constants, settings, &streams);
    if let Some(before) = &carried.constants {
        constants.resume(before);
    }
    let held: &[Rest] = if settings.zero_velocity { &rests } else { &[] };
    let first = (start.nodes[0], start.bias);
    let mut graph = Graph::new(timeline, &streams, settings, &constants, held, first)?;
    let mut factor = ChainFactor::new(graph.layout().clone(), constants.count());
    let mut state = State {
        biases: start.biases.clone(),
        nodes: start.nodes.clone(),
        constants,
    };
    let weights = carried.weights.as_ref();
    let ended = robust::solve(
        &mut graph,
        &mut state,
        &mut factor,
        settings,
        weights,
        progress,
    )?;
    if !ended.stop.is_converged() {
        graph.factorise(&state, 0.0, &mut factor).map_err(|free| {
            let what = match free {
                NotPositive::Node(node) => {
                    format!("the trajectory at {:.3} s", graph.timeline.node_s[node])
                }
                NotPositive::Border(column) => state.constants.described[column].name.clone(),
            };
            Error::of(
                Problem::NotDetermined,
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

/// Adds the lasting errors that the settings state, as far as they stand out from the noise of the records.
fn add_lasting(constants: &mut Constants, settings: &TrajectorySettings, streams: &Streams) {
    let span_s = streams.span_s();
    let modes = |correlation_s: f64, noise_share: f64, records: usize| {
        let every_s = (span_s.1 - span_s.0) / records.max(1) as f64;
        Modes::new(span_s, correlation_s, noise_share.powi(2) * every_s)
    };
    for (sensor, position) in settings.positions.iter().enumerate() {
        let lasting_m = position.sigma_correlated_m;
        if lasting_m.amax() > 0.0 {
            let share = position.sigma_m.min() / lasting_m.amax();
            let modes = modes(
                position.correlation_s,
                share,
                streams.positions[sensor].len(),
            );
            constants.add_lasting_position(sensor, lasting_m, modes);
        }
    }
    let heading = &settings.heading;
    if heading.sigma_correlated_rad > 0.0 && !streams.heading.is_empty() {
        let share = heading.sigma_rad / heading.sigma_correlated_rad;
        let modes = modes(heading.correlation_s, share, streams.heading.len());
        constants.add_lasting_heading(heading.sigma_correlated_rad, modes);
    }
}

impl Adjusted {
    /// Adds the estimated latencies to `corrections`; returns the largest, seconds.
    fn settle_clocks(&self, corrections: &mut [ClockCorrection]) -> f64 {
        let mut largest = 0.0_f64;
        let estimated = corrections.iter_mut().filter(|correction| !correction.held);
        for (clock, correction) in self.state.constants.clocks().zip(estimated) {
            let late_s = clock.value;
            largest = largest.max(late_s.abs());
            if late_s.abs() > SETTLED_CLOCK_S {
                correction.shift_s += late_s;
            }
        }
        largest
    }

    /// The cost with the losses of the settings, including rejected records.
    fn cost(&self) -> f64 {
        robust::truncated_cost(&self.graph, &self.ended)
    }

    /// Estimates the noise scale, which requires settled clocks.
    fn finish(&mut self, settings: &TrajectorySettings, progress: &dyn Progress) -> Result<()> {
        if settings.estimate.contains(&Constant::ImuNoiseScale) {
            self.scale_noise(progress)
        } else {
            Ok(())
        }
    }

    /// Standard deviations of the clock corrections that are estimated, in their order.
    fn clock_sigmas(&self) -> Vec<f64> {
        let covariance = self.factor.border_covariance();
        let clocks = self.state.constants.clocks();
        let columns = clocks
            .filter_map(|clock| clock.block())
            .flat_map(|b| b.columns());
        columns.map(|c| covariance[(c, c)].sqrt()).collect()
    }

    /// Scales the IMU's standard deviations until its residuals match them: the
    /// variance component Ω/r of gyro and accelerometer together becomes 1 (Förstner 1979).
    fn scale_noise(&mut self, progress: &dyn Progress) -> Result<()> {
        for _ in 0..MAX_SCALINGS {
            let component = imu_mean_component(&self.graph, &self.state, &self.factor);
            let Some(square) = component else { break };
            self.graph.imu_scale *= square.sqrt();
            let again =
                self.graph
                    .solve(&mut self.state, &mut self.factor, MAX_ITERATIONS, progress)?;
            self.ended.iterations += again.iterations;
            self.ended.stop = again.stop;
            self.ended.cost = again.cost;
            if (square - 1.0).abs() < SETTLED_SCALE {
                return Ok(());
            }
        }
        progress.warn("imu.noise_scale did not converge: the value is that of the last round");
        Ok(())
    }

    /// The streams whose latency is estimated but cannot be observed in the motion.
    pub fn unobservable_latencies(&self) -> Vec<Stream> {
        let estimated = self.corrections.iter().filter(|c| c.record == 0 && !c.held);
        estimated
            .map(|c| c.stream)
            .filter(|stream| self.motion_share(*stream) < MIN_MOTION_SHARE)
            .collect()
    }

    /// The share of real motion in the squared estimate of the motion that determines when a record of the
    /// stream was taken; the rest is noise. Of a body at rest, all is noise.
    fn motion_share(&self, stream: Stream) -> f64 {
        let (mut motion, mut noise) = (0.0, 0.0);
        if stream == Stream::Heading {
            for (sample, pair) in self.streams.imu.windows(2).enumerate() {
                let (step, _) = self.graph.timeline.place(pair[0].time_s);
                let bias = self.graph.bias(&self.state, step);
                let density = self.streams.imu.noise_of(sample).gyro_density;
                motion += (pair[0].gyro_rad_s - bias.gyro_rad_s).norm_squared();
                noise += 3.0 * density.powi(2) / (pair[1].time_s - pair[0].time_s);
            }
        } else {
            self.factor.marginals(|step, covariance| {
                motion += self.state.nodes[step].velocity_m_s.norm_squared();
                noise += (VELOCITY..NODE).map(|i| covariance.node[i][i]).sum::<f64>();
            });
        }
        1.0 - noise / motion
    }
}
