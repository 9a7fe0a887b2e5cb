//! The start: the first seconds are adjusted as a whole, then taken in step by step.

use super::options::OnlineOptions;
use super::records::{ReceivedLogs, Record, RecordId};
use super::running::Running;
use super::smoother::Smoother;
use super::update::Update;
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;
use crate::progress::Silent;
use crate::sensor::{ImuSample, Timed};
use crate::trajectory::batch::{Adjusted, Carried, adjust_once};
use crate::trajectory::graph::Graph;
use crate::trajectory::initial::initial;
use crate::trajectory::logs::{MotionLogs, Stream};
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::solution::RejectionReason;
use crate::trajectory::states::State;
use crate::trajectory::streams::{Names, Streams};
use std::collections::HashMap;

/// The median interval of this many samples shows whether times are in seconds.
pub const UNIT_KNOWN_AFTER: usize = 50;

/// Records up to a time, and their numbers in the log.
fn until<T: Timed + Copy>(records: &[T], time_s: f64) -> (Vec<T>, Vec<usize>) {
    let numbered = records.iter().copied().enumerate();
    let earlier = numbered.filter(|(_, record)| record.time_s() <= time_s);
    let (numbers, records) = earlier.unzip();
    (records, numbers)
}

/// For the records that the start takes, their numbers in the logs.
struct Numbers {
    imu: Vec<usize>,
    positions: Vec<Vec<usize>>,
    heading: Vec<usize>,
}

impl Numbers {
    fn of_stream(&self, stream: Stream) -> &[usize] {
        match stream {
            Stream::Imu => &self.imu,
            Stream::Position(sensor) => &self.positions[sensor],
            Stream::Heading => &self.heading,
        }
    }
}

/// The outcome of an attempt to start.
pub enum Start {
    /// The smoother at the end of the records so far.
    Made(Box<Running>, Update),
    /// Why the records so far do not suffice. More records may.
    NotYet(Error),
}

/// Tries to start.
///
/// # Errors
/// Faults of the logs that further records cannot cure: times in a wrong unit, stamps in bursts.
pub fn start(
    received: &ReceivedLogs,
    newest_imu_s: f64,
    settings: &TrajectorySettings,
    options: OnlineOptions,
) -> Result<Start> {
    let position_logs = received.positions.iter();
    let (positions, position_numbers): (Vec<_>, Vec<_>) = position_logs
        .map(|fixes| until(fixes, newest_imu_s))
        .unzip();
    let (heading, heading_numbers) = until(&received.heading, newest_imu_s);
    // The smoother must not continue from a stamp that leaps ahead.
    let (imu, imu_numbers) = until(&received.imu, newest_imu_s);
    let logs = MotionLogs {
        imu: &imu,
        positions: &positions,
        heading: &heading,
    };
    if let Err(error) = Streams::new(&logs, settings, &[]) {
        return match error {
            Error::Data {
                kind: Problem::TooFew | Problem::NoOverlap,
                ..
            } => Ok(Start::NotYet(error)),
            _ if imu.len() <= UNIT_KNOWN_AFTER => Ok(Start::NotYet(error)),
            _ => Err(error),
        };
    }
    let numbers = Numbers {
        imu: imu_numbers,
        positions: position_numbers,
        heading: heading_numbers,
    };
    // Later records may determine what the first seconds do not, and outweigh their outliers.
    Ok(
        match adjusted(&logs, received, &numbers, newest_imu_s, settings, options) {
            Ok((running, update)) => Start::Made(Box::new(running), update),
            Err(error) => Start::NotYet(error),
        },
    )
}

/// Adjusts the first seconds and takes them in.
fn adjusted(
    logs: &MotionLogs<'_>,
    received: &ReceivedLogs,
    numbers: &Numbers,
    newest_imu_s: f64,
    settings: &TrajectorySettings,
    options: OnlineOptions,
) -> Result<(Running, Update)> {
    // The modes of a lasting error need the span of the whole drive.
    let mut without_lasting = settings.clone();
    for position in &mut without_lasting.positions {
        position.sigma_correlated_m = Vec3::zeros();
    }
    without_lasting.heading.sigma_correlated_rad = 0.0;
    let adjusted = adjust_once(
        &initial,
        logs,
        &without_lasting,
        &[],
        &Carried::default(),
        &Silent,
    )?;
    if !adjusted.ended.stop.is_converged() {
        return Err(Error::of(
            Problem::TooFew,
            "the first seconds do not determine a trajectory",
            "wait for more records",
        ));
    }
    let mut running = at_first_node(&adjusted, numbers, settings, options);
    let leapt = |sample: &ImuSample| sample.time_s > newest_imu_s;
    for (record, sample) in received.imu.iter().enumerate() {
        if leapt(sample) {
            let at = RecordId {
                stream: Stream::Imu,
                record,
                time_s: sample.time_s,
            };
            running.refuse(at, RejectionReason::TimeOrder, settings);
        }
    }
    take_in(&adjusted, numbers, settings, &mut running)?;
    let mut work = running.update()?;
    let node_s = running.smoother.newest_s();
    if settings.zero_velocity {
        running.hold_rests(settings, node_s);
        let more = running.update()?;
        work.eliminated += more.eliminated;
        work.relinearised += more.relinearised;
    }
    let update = running.newest(work, 0, 0);
    Ok((running, update))
}

/// The smoother at its first node, before it takes in a record.
fn at_first_node(
    adjusted: &Adjusted,
    numbers: &Numbers,
    settings: &TrajectorySettings,
    options: OnlineOptions,
) -> Running {
    let first = (adjusted.start.nodes[0], adjusted.start.bias);
    let graph = Graph::growing(&adjusted.streams, settings, first);
    let state = State {
        nodes: vec![adjusted.state.nodes[0]],
        biases: vec![adjusted.state.biases[0]],
        constants: adjusted.state.constants.clone(),
    };
    let mut streams = adjusted.streams.clone();
    for rejection in &mut streams.dropped {
        let mut all = (0..numbers.positions.len())
            .map(Stream::Position)
            .chain([Stream::Heading, Stream::Imu]);
        let dropped_from = all.find(|stream| Names(settings).sensor(*stream) == rejection.sensor);
        if let Some(stream) = dropped_from {
            rejection.record = numbers.of_stream(stream)[rejection.record - 1] + 1;
        }
    }
    streams.positions.iter_mut().for_each(Vec::clear);
    streams.heading.clear();
    Running::new(Smoother::new(graph, state, options), streams, settings)
}

/// Takes all records in, with the weights that they have in the adjustment as a whole.
fn take_in(
    adjusted: &Adjusted,
    numbers: &Numbers,
    settings: &TrajectorySettings,
    running: &mut Running,
) -> Result<()> {
    let streams = &adjusted.streams;
    let mut records = Vec::new();
    for (sensor, fixes) in streams.positions.iter().enumerate() {
        records.extend(fixes.iter().map(|fix| Record::Position(sensor, *fix)));
    }
    let headings = streams.heading.iter();
    records.extend(headings.map(|fix| Record::Heading(*fix)));
    records.sort_by(|a, b| a.time_s().total_cmp(&b.time_s()));
    let mut weights = HashMap::new();
    for fix in &adjusted.graph.positions {
        weights.insert((Stream::Position(fix.sensor), fix.record), fix.weight);
    }
    for fix in &adjusted.graph.headings {
        let weight = weights.entry((Stream::Heading, fix.record));
        let weight = weight.or_insert(1.0_f64);
        *weight = weight.min(fix.weight);
    }
    let guess = |time_s: f64| {
        let graph = &adjusted.graph;
        graph.state_at(&streams.imu, &adjusted.state, time_s)
    };
    for record in records {
        let (stream, time_s, number) = (record.stream(), record.time_s(), record.number());
        let weight = weights[&(stream, number)];
        match record {
            Record::Position(sensor, mut fix) => {
                running.node_at_fix(time_s, Some(&guess))?;
                fix.record = numbers.of_stream(stream)[number];
                running.position(sensor, &fix, settings, Some(weight))?;
            }
            Record::Heading(mut fix) => {
                running.bridge_to(time_s, Some(&guess))?;
                fix.record = numbers.of_stream(stream)[number];
                running.heading(&fix, settings, Some(weight))?;
            }
        }
        if weight == 0.0 {
            let at = RecordId {
                stream,
                record: numbers.of_stream(stream)[number],
                time_s,
            };
            running.refuse(at, RejectionReason::Outlier, settings);
        }
    }
    Ok(())
}
