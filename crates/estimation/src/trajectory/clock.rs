//! Clocks that were set while a log ran.
//!
//! A jump leaves a trace in the time stamps: an interval unlike the others. The motion shows whether
//! it is a jump or a pause: for each trace alone, a constant is estimated by which all later records of
//! the stream are late. The most significant jump is corrected, again and again until none is
//! significant.

use super::graph::Graph;
use super::logs::{ClockCorrection, Course, MotionLogs, Stream};
use super::robust::weigh_cautiously;
use super::states::State;
use super::streams::Streams;
use crate::adjustment::ChainProblem;
use crate::sensor::Timed;
use crate::statistics::{SIGMAS_PER_MAD, median};

/// An interval is unlike the others outside this range, as shares of the median.
const USUAL_INTERVALS: std::ops::Range<f64> = 0.4..1.6;
/// At most this many traces of a stream are tested, the most unusual ones.
const MAX_TRACES: usize = 24;
/// A jump is one beyond this many of its standard deviations.
const SIGNIFICANT_SIGMAS: f64 = 6.0;
/// Smaller jumps are the jitter of stamps, seconds.
const SMALLEST_JUMP_S: f64 = 0.02;
/// How close the IMU's interval must come to its median after a correction to be set to it, seconds.
const IMU_MATCH_S: f64 = 0.05;
/// A first estimate must be at least this share of the unusual part of the interval.
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
pub fn find_jump(
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
    // One column for each trace; a single factorisation gives the estimate of each trace alone.
    let first = state.constants.count();
    for trace in &traces {
        state.constants.add_jump(trace.late_from(streams));
    }
    graph.set_clocks(&state.constants);
    let factor = graph.factor(&state).ok()?;
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
                // If the other streams are late, the IMU is early.
                Stream::Imu => imu_shift_s(before_s - late_s, before.is_none(), trace),
                _ => before_s + late_s,
            };
            best = Some((
                significance,
                ClockCorrection {
                    stream: trace.stream,
                    record: trace.record,
                    time_s: trace.time_s,
                    shift_s,
                    course: Course::Constant,
                    // The IMU's clock is the time scale: its jumps show in its own intervals.
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

/// Refines jumps of positions and headings that were estimated from the motion with the standard
/// deviations `sigma_s`. Where the unusual part of the interval agrees with the estimate, and the intervals
/// of the stream scatter by less than its standard deviation, the jump is set to that part and held: at a
/// metre a second the motion determines a jump to milliseconds, a steady log more closely. Returns
/// whether any jump was set.
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
        let stamped_s = usual.median_s - interval_s;
        let miss_s = (stamped_s - correction.shift_s).abs();
        if usual.scatter_s < STEADY_SHARE * sigma_s && miss_s < AGREEING_SIGMAS * sigma_s {
            correction.shift_s = stamped_s;
            correction.held = true;
            any = true;
        }
    }
    any
}

/// The usual interval of a stream.
struct UsualInterval {
    median_s: f64,
    /// Standard deviation from the median absolute deviation.
    scatter_s: f64,
}

/// The interval before `record`, and the usual one.
fn intervals<T: Timed>(records: &[T], record: usize) -> (f64, UsualInterval) {
    let interval = |k: usize| records[k].time_s() - records[k - 1].time_s();
    let all = (1..records.len()).map(interval);
    let median_s = median(all.clone()).unwrap_or(f64::NAN);
    let deviation_s = median(all.map(|x| (x - median_s).abs()));
    let usual = UsualInterval {
        median_s,
        scatter_s: SIGMAS_PER_MAD * deviation_s.unwrap_or(f64::NAN),
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
    /// The streams whose records are late after this jump, each with its first late record. After a jump
    /// of the IMU's clock, those are all other streams.
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

/// The correction of the IMU's times: the one that makes its interval usual where the estimate `shift_s`
/// agrees with it, else the estimate. A first estimate need only agree coarsely, since it is that of a
/// single step.
fn imu_shift_s(shift_s: f64, first: bool, trace: &Trace) -> f64 {
    let share = -shift_s / trace.unusual_s;
    let agrees_coarsely = first && MIN_IMU_SHARE < share && share < 1.0 / MIN_IMU_SHARE;
    if agrees_coarsely || (shift_s + trace.unusual_s).abs() < IMU_MATCH_S {
        -trace.unusual_s
    } else {
        shift_s
    }
}

fn traces(logs: &MotionLogs<'_>, corrections: &[ClockCorrection]) -> Vec<Trace> {
    let mut all = traces_of_stream(logs.imu, Stream::Imu, corrections);
    for (sensor, fixes) in logs.positions.iter().enumerate() {
        all.extend(traces_of_stream(
            fixes,
            Stream::Position(sensor),
            corrections,
        ));
    }
    all.extend(traces_of_stream(logs.heading, Stream::Heading, corrections));
    all
}

/// The unusual intervals of a stream, in time order.
fn traces_of_stream<T: Timed>(
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
    // A single wild stamp makes two unusual intervals, which cancel.
    let cancel = |a: usize, b: usize| {
        (1..records.len()).contains(&a)
            && (1..records.len()).contains(&b)
            && (unusual(a) + unusual(b)).abs() < USUAL_INTERVALS.start * median
    };
    let mut traces: Vec<Trace> = (1..records.len())
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
    traces.sort_by(|a, b| b.unusual_s.abs().total_cmp(&a.unusual_s.abs()));
    traces.truncate(MAX_TRACES);
    traces.sort_by_key(|trace| trace.record);
    traces
}
