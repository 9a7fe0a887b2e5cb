//! Turns the solution of the graph into what users get: poses, diagnostics and messages.

use super::batch::Adjusted;
use super::diagnostics::{Findings, diagnostics, examine};
use super::graph::Source;
use super::interpolate::Trajectory;
use super::recovery::Recovery;
use super::settings::{Constant, TrajectorySettings};
use super::solution::{
    ClockJump, EstimatedConstant, NOISE_SCALE, Rejection, RejectionReason, Solution,
};
use super::streams::Names;
use crate::adjustment::{StepCovariance, residual_information};
use crate::error::Result;
use crate::progress::Progress;
use crate::sensor::PoseRecord;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Steps whose covariances are held at a time while poses and residuals are found.
const CHUNK: usize = 512;
/// Steps evaluated by one task.
const TASK: usize = 32;
/// An estimated constant is determined where the drive shrinks its prior standard deviation to less
/// than this share.
const DETERMINED_SHARE: f64 = 0.5;
/// Residuals larger than their sigma by this factor are worth a warning.
const NOTABLE_FACTOR: f64 = 1.5;

/// A step and the joint covariance of its unknowns.
type StepPart = (usize, StepCovariance);

/// The poses of the adjusted drive and the quality of its solution, reported to `progress`. The
/// corrections of times in `unobservable` were to be estimated, but do not show in the motion.
pub fn conclude(
    adjusted: &Adjusted,
    settings: &TrajectorySettings,
    unobservable: &[Constant],
    progress: &dyn Progress,
) -> Result<(Trajectory, Solution)> {
    let Adjusted {
        streams,
        rests,
        graph,
        state,
        ended,
        ..
    } = adjusted;
    let (records, findings) = adjusted.poses_and_residuals();
    let (sensors, residuals, rejections) =
        diagnostics(graph, state, settings, findings, &streams.dropped);
    let solution = Solution {
        iterations: ended.iterations,
        converged: ended.stop.is_converged(),
        stop: ended.stop,
        cost_initial: ended.cost_initial,
        cost_final: ended.cost,
        nodes: graph.timeline.node_s.len(),
        constants: adjusted.constants(settings, unobservable),
        sensors,
        rejections,
        clock_jumps: adjusted.clock_jumps(settings),
        imu_gaps_s: streams.imu.gaps_s.clone(),
        rests_s: rests.iter().map(|r| (r.from_s, r.to_s)).collect(),
        residuals,
    };
    adjusted.report(&solution, progress);
    Ok((Trajectory::new(records)?, solution))
}

impl Adjusted {
    /// The poses with standard deviations and the residuals with redundancies.
    fn poses_and_residuals(&self) -> (Vec<PoseRecord>, Findings) {
        let border = self.factor.border_covariance();
        // The recursion runs from the last step to the first.
        let mut parts: Vec<(Vec<PoseRecord>, Findings)> = Vec::new();
        let mut chunk: Vec<StepPart> = Vec::with_capacity(CHUNK);
        let mut work = |chunk: &mut Vec<StepPart>| {
            let done: Vec<_> = chunk
                .par_chunks(TASK)
                .map(|steps| self.evaluate(steps, &border))
                .collect();
            parts.extend(done);
            chunk.clear();
        };
        self.factor.marginals(|step, marginal| {
            chunk.push((step, marginal.joint()));
            if chunk.len() == CHUNK {
                work(&mut chunk);
            }
        });
        work(&mut chunk);
        let mut records = Vec::with_capacity(self.graph.timeline.pose_s.len());
        let mut findings = Findings::new(self.graph.sensors.len());
        for (poses, part) in parts.into_iter().rev() {
            records.extend(poses);
            findings.append(part);
        }
        (records, findings)
    }

    /// Poses and residuals, in order of time, of steps that are given from the last to the first.
    fn evaluate(&self, steps: &[StepPart], border: &DMatrix<f64>) -> (Vec<PoseRecord>, Findings) {
        let recovery = Recovery {
            graph: &self.graph,
            state: &self.state,
            imu: &self.streams.imu,
        };
        let mut records = Vec::new();
        let mut findings = Findings::new(self.graph.sensors.len());
        for (step, covariance) in steps.iter().rev() {
            recovery.step(*step, |pose| {
                records.push(pose.with_sigma(&covariance.unknowns))
            });
            let (graph, state) = (&self.graph, &self.state);
            examine(graph, state, *step, covariance, border, &mut findings);
        }
        (records, findings)
    }

    /// The clocks that were set during recording. Of an estimated correction, the last part is still in its
    /// constant.
    fn clock_jumps(&self, settings: &TrajectorySettings) -> Vec<ClockJump> {
        let mut late_s = self.state.constants.clocks().map(|clock| clock.value);
        self.corrections
            .iter()
            .map(|correction| {
                let more_s = if correction.held {
                    0.0
                } else {
                    late_s.next().unwrap_or(0.0)
                };
                (correction, correction.shift_s + more_s)
            })
            .filter(|(correction, _)| correction.record > 0)
            .map(|(correction, shift_s)| ClockJump {
                sensor: Names(settings).sensor(correction.stream),
                record: correction.record + 1,
                time_s: correction.time_s,
                size_s: -shift_s,
            })
            .collect()
    }

    fn constants(
        &self,
        settings: &TrajectorySettings,
        unobservable: &[Constant],
    ) -> Vec<EstimatedConstant> {
        let covariance = self.factor.border_covariance();
        let corrections = self.state.constants.corrections();
        let described = self.state.constants.described.iter();
        let columns = described
            .take(self.state.constants.before_lasting())
            .enumerate();
        let mut constants: Vec<EstimatedConstant> = columns
            .map(|(i, column)| {
                let sigma = covariance[(i, i)].sqrt();
                let determined = sigma < DETERMINED_SHARE * column.prior_sigma;
                let start = if column.unit == "s" { 0.0 } else { column.base };
                EstimatedConstant {
                    name: column.name.clone(),
                    unit: column.unit.into(),
                    start,
                    value: if determined {
                        column.base + corrections[i]
                    } else {
                        start
                    },
                    sigma: determined.then_some(sigma),
                }
            })
            .collect();
        constants.extend(unobservable.iter().map(|constant| EstimatedConstant {
            name: constant.name(&settings.positions),
            unit: "s".into(),
            start: 0.0,
            value: 0.0,
            sigma: None,
        }));
        if settings.estimate.contains(&Constant::ImuNoiseScale) {
            // The information of ln s² is ½ tr R², so that s scatters by √(½ / tr R²) of itself.
            let of_imu = |source: &Source<'_>| matches!(source, Source::Imu(_));
            let information = residual_information(&self.graph, &self.state, of_imu);
            let relative = information.map_or(f64::INFINITY, |square| (0.5 / square).sqrt());
            let determined = relative < DETERMINED_SHARE;
            constants.push(EstimatedConstant {
                name: NOISE_SCALE.into(),
                unit: String::new(),
                start: 1.0,
                value: if determined {
                    self.graph.imu_scale
                } else {
                    1.0
                },
                sigma: determined.then_some(relative * self.graph.imu_scale),
            });
        }
        constants
    }

    /// Reports what the adjustment shows besides the trajectory: rests, gaps, jumps of clocks, rejected
    /// records, constants and residuals.
    fn report(&self, solution: &Solution, progress: &dyn Progress) {
        if let Some(rest) = &self.start.rest {
            progress.say(&format!(
                "gyro bias from the rest between {:.1} s and {:.1} s",
                rest.from_s, rest.to_s
            ));
        }
        if self.start.heading_from_motion {
            progress.warn("no headings: the yaw starts from the direction of travel");
        }
        for (from, to) in &self.streams.imu.gaps_s {
            progress.warn(&format!(
                "the IMU log has a gap from {from:.3} s to {to:.3} s: bridged, with the sigma of \
                 unknown motion"
            ));
        }
        for jump in &solution.clock_jumps {
            progress.warn(&format!(
                "the clock of {} jumps by {:.3} s before record {} at {:.3} s: corrected",
                jump.sensor, jump.size_s, jump.record, jump.time_s
            ));
        }
        report_rejections(&solution.rejections, progress);
        for constant in &solution.constants {
            match constant.sigma {
                Some(sigma) => progress.say(&format!(
                    "{} = {:.6} ± {sigma:.6} {} (project: {:.6})",
                    constant.name, constant.value, constant.unit, constant.start
                )),
                None => progress.warn(&format!(
                    "{} is not determined by this drive: held at {:.6} {}",
                    constant.name, constant.start, constant.unit
                )),
            }
        }
        for sensor in &solution.sensors {
            if matches!(sensor.unit.as_str(), "m" | "rad")
                && let Some(factor) = sensor.variance_component.map(f64::sqrt)
                && sensor.chi_square > sensor.chi_square_bounds_95[1]
                && factor > NOTABLE_FACTOR
            {
                progress.warn(&format!(
                    "the residuals of {} are {factor:.1} times as large as its sigma",
                    sensor.name
                ));
            }
        }
    }
}

/// Reports a line for each sensor and reason, and each record below it.
fn report_rejections(rejections: &[Rejection], progress: &dyn Progress) {
    let mut groups: Vec<(&str, RejectionReason, Vec<&Rejection>)> = Vec::new();
    for rejection in rejections {
        let same = groups
            .iter_mut()
            .find(|(sensor, reason, _)| *sensor == rejection.sensor && *reason == rejection.reason);
        match same {
            Some((.., all)) => all.push(rejection),
            None => groups.push((&rejection.sensor, rejection.reason, vec![rejection])),
        }
    }
    for (sensor, reason, all) in groups {
        progress.warn(&match all.len() {
            1 => format!("1 record of {sensor} is excluded: {reason}"),
            count => format!("{count} records of {sensor} are excluded: {reason}"),
        });
        for rejection in all {
            let size = rejection
                .normalised
                .map_or_else(String::new, |n| format!(", {n:.1} sigma"));
            progress.say(&format!(
                "  {sensor} record {} at {:.3} s: {reason}{size}",
                rejection.record, rejection.time_s
            ));
        }
    }
}
