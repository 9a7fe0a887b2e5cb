//! The start: the first seconds adjusted as a whole, then taken in step by step.

use super::running::Running;
use super::smoother::{Smoother, Work};
use super::{Online, Record, Stage, Update};
use crate::error::Result;
use crate::progress::Silent;
use crate::sensor::{ImuSample, Timed};
use crate::trajectory::estimate::{Carried, adjust_once};
use crate::trajectory::graph::Graph;
use crate::trajectory::initial::initial;
use crate::trajectory::solution::{Rejection, RejectionReason, StopReason};
use crate::trajectory::streams::{MotionLogs, Names, Numbered, Stream};
use std::collections::HashMap;

/// Records up to a time, and their numbers.
fn until<T: Timed + Copy>(records: &[T], time_s: f64) -> (Vec<T>, Vec<usize>) {
    let numbered = records.iter().copied().enumerate();
    let kept = numbered.filter(|(_, record)| record.time_s() <= time_s);
    let (numbers, records) = kept.unzip();
    (records, numbers)
}

impl Online {
    /// The smoother at the end of the records so far; `None` where they do not tell enough yet.
    pub(super) fn try_start(&self) -> Option<(Running, Update)> {
        self.start().ok()
    }

    fn start(&self) -> Result<(Running, Update)> {
        let settings = &self.settings;
        let (positions, position_numbers): (Vec<_>, Vec<_>) = self
            .given
            .positions
            .iter()
            .map(|fixes| until(fixes, self.newest_imu_s))
            .unzip();
        let (heading, heading_numbers) = until(&self.given.heading, self.newest_imu_s);
        // A stamp that leaps ahead must not be where the smoother goes on from.
        let (imu, imu_numbers) = until(&self.given.imu, self.newest_imu_s);
        let logs = MotionLogs {
            imu: &imu,
            positions: &positions,
            heading: &heading,
        };
        let adjusted = adjust_once(
            &initial,
            &logs,
            settings,
            (&[], &Carried::default()),
            &Silent,
        )?;
        if adjusted.ended.stop != StopReason::Converged {
            return Err(crate::error::Error::data(
                "the first seconds make no trajectory",
                "wait for more",
            ));
        }

        let first = (adjusted.start.nodes[0], adjusted.start.bias);
        let graph = Graph::growing(&adjusted.streams, settings, first);
        let (node, bias) = (adjusted.state.nodes[0], adjusted.state.biases[0]);
        let mut streams = adjusted.streams.clone();
        for rejection in &mut streams.dropped {
            let named = |stream| Names(settings).sensor(stream) == rejection.sensor;
            let numbers = (0..positions.len())
                .find(|&sensor| named(Stream::Position(sensor)))
                .map(|sensor| &position_numbers[sensor])
                .or_else(|| named(Stream::Heading).then_some(&heading_numbers))
                .or_else(|| named(Stream::Imu).then_some(&imu_numbers));
            if let Some(numbers) = numbers {
                rejection.record = numbers[rejection.record - 1] + 1;
            }
        }
        streams.positions.iter_mut().for_each(Vec::clear);
        streams.heading.clear();
        let smoother = Smoother::new(graph, node, bias, self.options);
        let mut running = Running::new(smoother, streams, settings);

        let leapt = |sample: &ImuSample| sample.time_s > self.newest_imu_s;
        for (record, sample) in self.given.imu.iter().enumerate() {
            if leapt(sample) {
                running.rejections.push(Rejection {
                    sensor: Names(settings).sensor(Stream::Imu),
                    record: record + 1,
                    time_s: sample.time_s,
                    reason: RejectionReason::TimeOrder,
                    normalised: None,
                });
            }
        }

        // At the weights that the adjustment of the whole left.
        let mut records = Vec::new();
        let mut weights = HashMap::new();
        for (sensor, fixes) in adjusted.streams.positions.iter().enumerate() {
            records.extend(fixes.iter().map(|fix| Record::Position(sensor, *fix)));
        }
        records.extend(
            adjusted
                .streams
                .heading
                .iter()
                .map(|fix| Record::Heading(*fix)),
        );
        records.sort_by(|a, b| a.time_s().total_cmp(&b.time_s()));
        for fix in &adjusted.graph.positions {
            weights.insert((Stream::Position(fix.sensor), fix.record), fix.weight);
        }
        for fix in &adjusted.graph.headings {
            let weight = weights
                .entry((Stream::Heading, fix.record))
                .or_insert(1.0_f64);
            *weight = weight.min(fix.weight);
        }
        let guess = |time_s: f64| adjusted.graph.state_at(&adjusted.state, time_s);
        for record in records {
            let time_s = record.time_s();
            let (stream, number, weight) = match record {
                Record::Position(sensor, fix) => {
                    let stream = Stream::Position(sensor);
                    let weight = weights[&(stream, fix.record)];
                    running.node_at_fix(time_s, Some(&guess))?;
                    let fix = Numbered {
                        record: position_numbers[sensor][fix.record],
                        ..fix
                    };
                    running.position(sensor, &fix, settings, Some(weight))?;
                    (stream, fix.record, weight)
                }
                Record::Heading(fix) => {
                    let weight = weights[&(Stream::Heading, fix.record)];
                    running.bridge_to(time_s, Some(&guess))?;
                    let fix = Numbered {
                        record: heading_numbers[fix.record],
                        ..fix
                    };
                    running.heading(&fix, settings, Some(weight))?;
                    (Stream::Heading, fix.record, weight)
                }
            };
            if weight == 0.0 {
                running.rejections.push(Rejection {
                    sensor: Names(settings).sensor(stream),
                    record: number + 1,
                    time_s,
                    reason: RejectionReason::Outlier,
                    normalised: None,
                });
            }
        }
        let mut work = running.smoother.update()?;
        let node_s = running.smoother.newest_s();
        if settings.zero_velocity {
            while let Some(rest) = running.rests.seen(&running.streams, settings, node_s) {
                if let Some(step) = running.smoother.graph.rest(&rest) {
                    running.smoother.touch(step.max(running.smoother.reach()));
                }
            }
            let Work {
                eliminated,
                relinearised,
            } = running.smoother.update()?;
            work.eliminated += eliminated;
            work.relinearised += relinearised;
        }
        let update = running.told(work, 0, 0);
        Ok((running, update))
    }

    /// From now on the smoother runs: what it has taken in waits no more.
    pub(super) fn started(&mut self, running: Running) {
        let newest_s = self.newest_imu_s;
        self.waiting.retain(|record| record.time_s() > newest_s);
        let last = |times: Option<f64>| times.unwrap_or(f64::NEG_INFINITY);
        let streams = &running.streams;
        for (sensor, fixes) in streams.positions.iter().enumerate() {
            self.taken_s[sensor] = last(fixes.last().map(|f| f.value.time_s));
        }
        let sensors = streams.positions.len();
        self.taken_s[sensors] = last(streams.heading.last().map(|f| f.value.time_s));
        self.stage = Stage::Running(Box::new(running));
    }
}
