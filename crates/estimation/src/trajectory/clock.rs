//! Clocks that were set while a log ran.
//!
//! A jump leaves a trace in the time stamps: an interval unlike the others. The motion shows whether
//! it is a jump or a pause: a constant by which all later records of the stream are late is
//! estimated for each trace alone, and the most significant is kept, until none is.

use super::graph::Graph;
use super::robust::weigh_cautiously;
use super::states::State;
use super::streams::{ClockCorrection, MotionLogs, Stream, Streams};
use crate::adjustment::{ChainFactor, ChainProblem};
use crate::sensor::Timed;
use crate::statistics::{SIGMAS_PER_MAD, median};

/// An interval is unlike the others below and above these shares of the median.
const USUAL_INTERVALS: std::ops::Range<f64> = 0.4..1.6;
/// At most this many traces of a stream are tested, the most unusual ones.
const MAX_TRACES: usize = 24;
/// A jump is one beyond this many of its standard deviations.
const SIGNIFICANT_SIGMAS: f64 = 6.0;
/// Smaller jumps are the jitter of stamps, seconds.
const SMALLEST_JUMP_S: f64 = 0.02;
/// How close the IMU's interval must come to its median after a correction to be set to it, seconds.
const IMU_MATCH_S: f64 = 0.05;
/// The least share of it that a first estimate must be.
const MIN_IMU_SHARE: f64 = 0.25;
/// Below this share of the median an interval is that of a record logged twice.
const TWICE: f64 = 1e-3;
/// A jump found by the motion and the unusual part of its interval agree within this many standard
/// deviations.
const AGREEING_SIGMAS: f64 = 4.0;
/// The stamps give the size of a jump better than the motion where the intervals scatter by less
/// than this share of its standard deviation from the motion.
const STEADY_SHARE: f64 = 0.5;

/// The most significant jump not yet corrected, if there is one.
pub fn find(
    logs: &MotionLogs<'_>,
    streams: &Streams,
    graph: &Graph,
    state: &State,
    corrections: &[ClockCorrection],
) -> Option<ClockCorrection> {
    let traces = traces(logs, corrections);
    if traces.is_empty() {
        return None;
    }
    let (mut graph, mut state) = (graph.clone(), state.clone());
    weigh_cautiously(&mut graph, &state);
    // A column for each trace, and from one factorisation what each would be alone.
    let first = state.constants.count();
    for trace in &traces {
        state.constants.add_jump(trace.late_from(streams));
    }
    graph.set_clocks(&state.constants);
    let mut factor = ChainFactor::new(graph.layout().clone(), state.constants.count());
    graph.factorise(&state, 0.0, &mut factor).ok()?;
    let mut best: Option<(f64, ClockCorrection)> = None;
    for (trace, (late_s, sigma_s)) in traces.iter().zip(factor.each_alone(first)) {
        let significance = late_s.abs() / sigma_s;
        if late_s.abs() > SMALLEST_JUMP_S
            && significance > SIGNIFICANT_SIGMAS
            && best.as_ref().is_none_or(|(most, _)| significance > *most)
        {
            let before = corrections
                .iter()
                .find(|c| c.stream == trace.stream && c.record == trace.record);
            let before_s = before.map_or(0.0, |c| c.shift_s);
            let shift_s = match trace.stream {
                // The others late is the IMU early.
                Stream::Imu => natural(before_s - late_s, before.is_none(), trace),
                _ => before_s + late_s,
            };
            best = Some((
                significance,
                ClockCorrection {
                    stream: trace.stream,
                    record: trace.record,
                    time_s: trace.time_s,
                    shift_s,
                    // The IMU's clock is the time scale: its jumps show in its interval.
                    held: trace.stream == Stream::Imu,
                },
            ));
        }
    }
    best.map(|(_, correction)| correction)
}

/// Adds a correction, or replaces the one at the same record.
pub fn put(corrections: &mut Vec<ClockCorrection>, jump: ClockCorrection) {
    let same = |c: &&mut ClockCorrection| c.stream == jump.stream && c.record == jump.record;
    match corrections.iter_mut().find(same) {
        Some(correction) => *correction = jump,
        None => corrections.push(jump),
    }
}

/// Sets the jumps of positions and headings that the motion found, with the standard deviations
/// `sigma_s`, to the unusual part of their interval and holds them there, where the two agree and
/// the stream's intervals scatter by less: at a metre a second the motion determines a jump to
/// milliseconds, a steady log more closely. Whether any was set.
pub fn set_to_stamps(
    logs: &MotionLogs<'_>,
    corrections: &mut [ClockCorrection],
    sigma_s: &[f64],
) -> bool {
    let mut any = false;
    let estimated = corrections.iter_mut().filter(|c| !c.held);
    for (correction, sigma_s) in estimated.zip(sigma_s).filter(|(c, _)| c.record > 0) {
        let (interval_s, usual) = match correction.stream {
            Stream::Imu => continue,
            Stream::Position(sensor) => intervals(&logs.positions[sensor], correction.record),
            Stream::Heading => intervals(logs.heading, correction.record),
        };
        let natural_s = usual.median_s - interval_s;
        let miss_s = (natural_s - correction.shift_s).abs();
        if usual.scatter_s < STEADY_SHARE * sigma_s && miss_s < AGREEING_SIGMAS * sigma_s {
            correction.shift_s = natural_s;
            correction.held = true;
            any = true;
        }
    }
    any
}

/// The intervals of a stream.
struct Usual {
    median_s: f64,
    /// Standard deviation from the median absolute deviation.
    scatter_s: f64,
}

/// The interval before `record`, and all.
fn intervals<T: Timed>(records: &[T], record: usize) -> (f64, Usual) {
    let interval = |k: usize| records[k].time_s() - records[k - 1].time_s();
    let all = (1..records.len()).map(interval);
    let median_s = median(all.clone()).unwrap_or(f64::NAN);
    let off = median(all.map(|x| (x - median_s).abs()));
    let usual = Usual {
        median_s,
        scatter_s: SIGMAS_PER_MAD * off.unwrap_or(f64::NAN),
    };
    (interval(record), usual)
}

/// An unusual interval: before `record` the stream's clock may have jumped.
#[derive(Debug, Clone, Copy)]
struct Trace {
    stream: Stream,
    record: usize,
    time_s: f64,
    /// Length of the interval less the usual one, seconds.
    unusual_s: f64,
}

impl Trace {
    /// The streams whose records are late after a jump here, each from a record on. For the IMU
    /// that is all others.
    fn late_from(&self, streams: &Streams) -> Vec<(Stream, usize)> {
        if self.stream != Stream::Imu {
            return vec![(self.stream, self.record)];
        }
        let mut from = Vec::new();
        for (sensor, fixes) in streams.positions.iter().enumerate() {
            let after = fixes.partition_point(|f| f.value.time_s < self.time_s);
            from.extend(
                fixes[after..]
                    .first()
                    .map(|f| (Stream::Position(sensor), f.record)),
            );
        }
        let headings = &streams.heading;
        let after = headings.partition_point(|h| h.value.time_s < self.time_s);
        from.extend(
            headings[after..]
                .first()
                .map(|h| (Stream::Heading, h.record)),
        );
        from
    }
}

/// The correction that makes the IMU's interval usual, where the estimate agrees with it: coarsely
/// at first, as the estimate is that of one step.
fn natural(shift_s: f64, first: bool, trace: &Trace) -> f64 {
    let share = -shift_s / trace.unusual_s;
    let alike = first && MIN_IMU_SHARE < share && share < 1.0 / MIN_IMU_SHARE;
    if alike || (shift_s + trace.unusual_s).abs() < IMU_MATCH_S {
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
    let median = intervals(records, 1).1.median_s;
    let corrected = |record: usize| {
        corrections
            .iter()
            .any(|c| c.stream == stream && c.record == record && !c.held)
    };
    let unusual = |k: usize| interval(k) - median;
    // One wild stamp makes two intervals unlike the others, which cancel.
    let cancel = |a: usize, b: usize| {
        (1..records.len()).contains(&a)
            && (1..records.len()).contains(&b)
            && (unusual(a) + unusual(b)).abs() < USUAL_INTERVALS.start * median
    };
    let mut found: Vec<Trace> = (1..records.len())
        .filter(|&k| {
            let share = interval(k) / median;
            !USUAL_INTERVALS.contains(&share)
                && share.abs() > TWICE
                && !cancel(k - 1, k)
                && !cancel(k, k + 1)
                && !corrected(k)
        })
        .map(|k| Trace {
            stream,
            record: k,
            time_s: records[k].time_s(),
            unusual_s: unusual(k),
        })
        .collect();
    found.sort_by(|a, b| b.unusual_s.abs().total_cmp(&a.unusual_s.abs()));
    found.truncate(MAX_TRACES);
    found.sort_by_key(|trace| trace.record);
    found
}
