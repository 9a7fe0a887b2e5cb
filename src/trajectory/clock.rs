//! Clocks that were set while a log ran.
//!
//! A jump leaves a trace in the stamps: an interval unlike the others. Whether it is a jump or a
//! pause, the motion tells: one more constant, by which all later records of the stream are late,
//! is estimated for each trace in turn, and the most significant is kept, until none is.

use super::chain::ChainFactor;
use super::constants::Constants;
use super::graph::{Graph, State};
use super::robust::{cautious_weights, set_weights, squares};
use super::streams::{ClockCorrection, MotionLogs, Stream, Streams};
use crate::project::TrajectorySettings;
use crate::sensor::Timed;

/// An interval is unlike the others below and above these shares of the median.
const USUAL_INTERVALS: std::ops::Range<f64> = 0.4..1.6;
/// Most traces tested in a stream, the most unusual ones.
const MOST_TRACES: usize = 24;
/// A jump is one beyond this many of its standard deviations.
const SIGNIFICANT_SIGMAS: f64 = 6.0;
/// Smaller jumps are the jitter of stamps, seconds.
const SMALLEST_JUMP_S: f64 = 0.02;
/// How close the IMU's interval must come to its median after a correction to be set to it, seconds.
const IMU_MATCH_S: f64 = 0.05;

/// The most significant jump not yet corrected, if there is one.
pub(super) fn find(
    logs: &MotionLogs<'_>,
    streams: &Streams,
    graph: &Graph,
    state: &State,
    settings: &TrajectorySettings,
    corrections: &[ClockCorrection],
) -> Option<ClockCorrection> {
    let mut graph = graph.clone();
    let weights = cautious_weights(&squares(&graph, state), graph.positions.len());
    set_weights(&mut graph, &weights);
    let mut best: Option<(f64, ClockCorrection)> = None;
    for trace in traces(logs, corrections) {
        let known = Constants::new(settings, corrections).with_jump(&trace, streams);
        let column = known.count() - 1;
        graph.set_constants(known);
        let mut state = state.clone();
        state.constants.push(0.0);
        let mut factor = ChainFactor::new(graph.timeline.layout.clone(), graph.known.count());
        if graph.factorise(&state, 0.0, &mut factor).is_err() {
            continue;
        }
        let mut nodes = vec![Default::default(); state.nodes.len()];
        let mut biases = vec![Default::default(); state.biases.len()];
        let mut constants = vec![0.0; state.constants.len()];
        factor.back_substitute(&mut nodes, &mut biases, &mut constants);
        let late_s = constants[column];
        let sigma_s = factor.constants_covariance()[(column, column)].sqrt();
        let significance = late_s.abs() / sigma_s;
        if late_s.abs() > SMALLEST_JUMP_S
            && significance > SIGNIFICANT_SIGMAS
            && best.as_ref().is_none_or(|(most, _)| significance > *most)
        {
            let shift_s = match trace.stream {
                // The others late is the IMU early.
                Stream::Imu => natural(-late_s, &trace),
                _ => late_s,
            };
            best = Some((
                significance,
                ClockCorrection {
                    stream: trace.stream,
                    record: trace.record,
                    time_s: trace.time_s,
                    shift_s,
                },
            ));
        }
    }
    best.map(|(_, correction)| correction)
}

/// An unusual interval: before `record` the stream's clock may have jumped.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trace {
    pub stream: Stream,
    pub record: usize,
    pub time_s: f64,
    /// Length of the interval less the usual one, seconds.
    unusual_s: f64,
}

/// The correction that makes the IMU's interval usual, where the estimate agrees with it.
fn natural(shift_s: f64, trace: &Trace) -> f64 {
    if (shift_s + trace.unusual_s).abs() < IMU_MATCH_S {
        -trace.unusual_s
    } else {
        shift_s
    }
}

fn traces(logs: &MotionLogs<'_>, corrections: &[ClockCorrection]) -> Vec<Trace> {
    let mut all = of_stream(logs.imu, Stream::Imu, corrections);
    for (sensor, fixes) in logs.positions.iter().enumerate() {
        all.extend(of_stream(fixes, Stream::Position(sensor), corrections));
    }
    all.extend(of_stream(logs.heading, Stream::Heading, corrections));
    all
}

fn of_stream<T: Timed>(
    records: &[T],
    stream: Stream,
    corrections: &[ClockCorrection],
) -> Vec<Trace> {
    if records.len() < 3 {
        return Vec::new();
    }
    let interval = |k: usize| records[k].time_s() - records[k - 1].time_s();
    let mut all: Vec<f64> = (1..records.len()).map(interval).collect();
    let middle = all.len() / 2;
    let median = *all.select_nth_unstable_by(middle, f64::total_cmp).1;
    let corrected = |record: usize| {
        corrections
            .iter()
            .any(|c| c.stream == stream && c.record == record)
    };
    let mut found: Vec<Trace> = (1..records.len())
        .filter(|&k| !USUAL_INTERVALS.contains(&(interval(k) / median)) && !corrected(k))
        .map(|k| Trace {
            stream,
            record: k,
            time_s: records[k].time_s(),
            unusual_s: interval(k) - median,
        })
        .collect();
    found.sort_by(|a, b| b.unusual_s.abs().total_cmp(&a.unusual_s.abs()));
    found.truncate(MOST_TRACES);
    found.sort_by_key(|trace| trace.record);
    found
}
