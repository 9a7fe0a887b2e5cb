//! From the solution of the graph to what users get: poses, diagnostics, and words.

use super::chain::{NODE, STEP};
use super::covariance::PosteriorCovariance;
use super::diagnostics::{Findings, StepKnowledge, conclude, examine};
use super::estimate::{Adjusted, Estimate};
use super::factors::VELOCITY;
use super::interpolate::Trajectory;
use super::recovery::recover;
use super::solution::{
    ClockJump, EstimatedConstant, Rejection, RejectionReason, Solution, StopReason,
};
use super::streams::{Names, Stream};
use crate::error::Result;
use crate::progress::Progress;
use crate::sensor::PoseRecord;
use crate::trajectory::{Constant, TrajectorySettings};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Steps whose covariances are held at a time while poses and residuals are found.
const CHUNK: usize = 512;
/// Steps harvested by one task.
const TASK: usize = 32;
/// An estimated constant is determined where the drive shrinks its prior standard deviation to less
/// than this share.
const DETERMINED_SHARE: f64 = 0.5;
/// A latency is determined where more than this share of the squared motion is not noise. Errors of
/// velocities live long: a minute holds few independent ones, whose squares scatter widely.
const LEAST_MOTION_SHARE: f64 = 0.95;
/// Residuals this many times too large are worth a warning.
const NOTABLE_FACTOR: f64 = 1.5;

/// A step, the joint covariance of its unknowns, and theirs with the constants.
type StepPart = (usize, [[f64; STEP]; STEP], Vec<f64>);

impl Adjusted {
    /// The poses with standard deviations and the residuals with redundancies.
    fn harvest(&self) -> (Vec<PoseRecord>, Findings) {
        let constants = self.factor.constants_covariance();
        // From the last steps to the first, as the recursion runs.
        let mut parts: Vec<(Vec<PoseRecord>, Findings)> = Vec::new();
        let mut chunk: Vec<StepPart> = Vec::with_capacity(CHUNK);
        let mut work = |chunk: &mut Vec<StepPart>| {
            let done: Vec<_> = chunk
                .par_chunks(TASK)
                .map(|steps| self.harvest_steps(steps, &constants))
                .collect();
            parts.extend(done);
            chunk.clear();
        };
        self.factor.marginals(|step, covariance| {
            chunk.push((step, covariance.joint(), covariance.cross.to_vec()));
            if chunk.len() == CHUNK {
                work(&mut chunk);
            }
        });
        work(&mut chunk);
        let mut records = Vec::with_capacity(self.graph.timeline.pose_s.len());
        let mut findings = Findings::new(self.graph.sensors.len());
        for (poses, found) in parts.into_iter().rev() {
            records.extend(poses);
            findings.append(found);
        }
        (records, findings)
    }

    /// Poses and residuals of steps that come from the last to the first, in order of time.
    fn harvest_steps(
        &self,
        steps: &[StepPart],
        constants: &DMatrix<f64>,
    ) -> (Vec<PoseRecord>, Findings) {
        let mut records = Vec::new();
        let mut findings = Findings::new(self.graph.sensors.len());
        for (step, unknowns, cross) in steps.iter().rev() {
            recover(&self.graph, &self.state, *step, |pose| {
                records.push(pose.with_sigma(unknowns));
            });
            let knowledge = StepKnowledge {
                step: *step,
                unknowns,
                cross,
                constants,
            };
            examine(&self.graph, &self.state, &knowledge, &mut findings);
        }
        (records, findings)
    }

    /// The estimate, told to `progress`. The latencies of the streams `idle` were asked for, and no
    /// motion tells them.
    pub fn conclude(
        self,
        settings: &TrajectorySettings,
        idle: &[Stream],
        progress: &dyn Progress,
    ) -> Result<Estimate> {
        let (records, findings) = self.harvest();
        let dropped = &self.streams.dropped;
        let (sensors, residuals, rejections) =
            conclude(&self.graph, &self.state, settings, findings, dropped);
        let solution = Solution {
            iterations: self.ended.iterations,
            converged: self.ended.stop == StopReason::Converged,
            stop: self.ended.stop,
            cost_initial: self.ended.cost_initial,
            cost_final: self.ended.cost,
            nodes: self.graph.timeline.node_s.len(),
            constants: self.constants(settings, idle),
            sensors,
            rejections,
            clock_jumps: self.clock_jumps(settings),
            imu_gaps_s: self.streams.gaps_s.clone(),
            rests_s: self.rests.iter().map(|r| (r.from_s, r.to_s)).collect(),
            residuals,
        };
        self.report(&solution, progress);
        Ok(Estimate {
            trajectory: Trajectory::new(records)?,
            solution,
            covariance: PosteriorCovariance::new(self.factor, self.graph, self.state),
        })
    }

    /// The clocks that were set while they logged. What was found last of those estimated is still
    /// in their constants.
    fn clock_jumps(&self, settings: &TrajectorySettings) -> Vec<ClockJump> {
        let mut late_s = self.graph.known.clocks().map(|c| self.state.constants[c]);
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

    /// The streams whose latency is a constant, and that no motion tells the latency of.
    pub fn idle_latencies(&self) -> Vec<Stream> {
        let estimated = self.corrections.iter().filter(|c| c.record == 0 && !c.held);
        estimated
            .map(|c| c.stream)
            .filter(|stream| self.motion_share(*stream) < LEAST_MOTION_SHARE)
            .collect()
    }

    /// How much of the squared motion that tells when a record of the stream was taken is motion,
    /// and not the noise of its estimate: of a body at rest, none.
    fn motion_share(&self, stream: Stream) -> f64 {
        let (mut motion, mut noise) = (0.0, 0.0);
        if stream == Stream::Heading {
            for (step, pair) in self.graph.samples.windows(2).enumerate() {
                let bias = self
                    .graph
                    .bias(&self.state, self.graph.timeline.place(pair[0].time_s).0);
                let density = self.graph.noise_of(step).gyro_density;
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

    fn constants(&self, settings: &TrajectorySettings, idle: &[Stream]) -> Vec<EstimatedConstant> {
        let covariance = self.factor.constants_covariance();
        let unknowns = &self.graph.known.unknowns;
        let mut found: Vec<EstimatedConstant> = unknowns
            .iter()
            .enumerate()
            .map(|(i, unknown)| {
                let sigma = covariance[(i, i)].sqrt();
                let determined = sigma < DETERMINED_SHARE * unknown.prior_sigma;
                let start = if unknown.unit == "s" {
                    0.0
                } else {
                    unknown.base
                };
                EstimatedConstant {
                    name: unknown.name.clone(),
                    unit: unknown.unit,
                    start,
                    value: if determined {
                        unknown.base + self.state.constants[i]
                    } else {
                        start
                    },
                    sigma: determined.then_some(sigma),
                }
            })
            .collect();
        found.extend(idle.iter().map(|stream| EstimatedConstant {
            name: format!("{}.time_offset", Names(settings).sensor(*stream)),
            unit: "s",
            start: 0.0,
            value: 0.0,
            sigma: None,
        }));
        if settings.estimate.contains(&Constant::ImuNoiseScale) {
            // The information of ln s² is ½ tr R², so that s scatters by √(½ / tr R²) of itself.
            let information = self.graph.imu_information(&self.state);
            let relative = information.map_or(f64::INFINITY, |square| (0.5 / square).sqrt());
            let determined = relative < DETERMINED_SHARE;
            found.push(EstimatedConstant {
                name: "imu.noise_scale".into(),
                unit: "",
                start: 1.0,
                value: if determined {
                    self.graph.imu_scale
                } else {
                    1.0
                },
                sigma: determined.then_some(relative * self.graph.imu_scale),
            });
        }
        found
    }

    /// Says what was found in the logs beside the trajectory.
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
        for (from, to) in &self.streams.gaps_s {
            progress.warn(&format!(
                "the IMU log is silent from {from:.3} s to {to:.3} s: bridged, with the sigma of \
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
            if matches!(sensor.unit, "m" | "rad")
                && let Some(factor) = sensor.variance_component.map(f64::sqrt)
                && sensor.chi_square > sensor.chi_square_bounds_95[1]
                && factor > NOTABLE_FACTOR
            {
                progress.warn(&format!(
                    "the residuals of {} are {factor:.1} times what its sigma says",
                    sensor.name
                ));
            }
        }
    }
}

/// A line for each sensor and reason, and each record below it.
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
        progress.warn(&format!(
            "{} of the records of {sensor} are left out: {reason}",
            all.len()
        ));
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
