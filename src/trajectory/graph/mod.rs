//! The factor graph of one drive: its unknowns, its factors, and what each touches.

mod adjustment;
mod growing;

pub(super) use adjustment::{Ended, MOST_ITERATIONS, moved_bias, moved_node};

use super::constants::Constants;
use super::factors::{
    Ahead, HeadingFactor, ImuFactor, NodeState, PositionFactor, PositionSensor, Quantity,
    RestFactor,
};
use super::preintegration::{MotionSums, Preintegrated};
use super::rest::Rest;
use super::streams::{Numbered, Stream, Streams};
use super::timeline::{Timeline, starts};
use crate::error::{Error, Result};
use crate::geometry::heading::wrap;
use crate::geometry::{Mat3, Vec3};
use crate::sensor::{HeadingFix, ImuBias, ImuSample, PositionFix};
use crate::trajectory::{ImuNoise, TrajectorySettings};
use rayon::prelude::*;

/// All unknowns.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub nodes: Vec<NodeState>,
    pub biases: Vec<ImuBias>,
    /// Corrections of the constants, in the order of [`Constants::unknowns`].
    pub constants: Vec<f64>,
}

/// The factor graph.
#[derive(Debug, Clone)]
pub(super) struct Graph {
    pub timeline: Timeline,
    pub samples: Vec<ImuSample>,
    pub bridged: Vec<bool>,
    noise: ImuNoise,
    bridge_noise: ImuNoise,
    /// One a step.
    pub imu: Vec<ImuFactor>,
    /// Factor on the standard deviations of the IMU.
    pub imu_scale: f64,
    /// Sorted by step.
    pub positions: Vec<PositionFactor>,
    position_start: Vec<u32>,
    pub headings: Vec<HeadingFactor>,
    heading_start: Vec<u32>,
    /// Whether the body rests at a node, and a bias begins there.
    pub rests: Vec<Option<RestFactor>>,
    pub sensors: Vec<PositionSensor>,
    pub known: Constants,
    /// Centre of the priors.
    first: (NodeState, ImuBias),
}

impl Graph {
    /// Lays the streams out on the timeline, about the start values of node 0 and of the bias.
    pub fn new(
        timeline: Timeline,
        streams: &Streams,
        settings: &TrajectorySettings,
        known: Constants,
        rests: &[Rest],
        first: (NodeState, ImuBias),
    ) -> Result<Self> {
        let bias = first.1;
        let sensors = position_sensors(settings, &known);
        let mut graph = Self {
            samples: streams.imu.clone(),
            bridged: streams.bridged.clone(),
            noise: settings.imu,
            bridge_noise: streams.bridge_noise,
            imu: Vec::new(),
            imu_scale: 1.0,
            positions: Vec::new(),
            position_start: Vec::new(),
            headings: Vec::new(),
            heading_start: Vec::new(),
            rests: rest_factors(&timeline, rests),
            sensors,
            known,
            first,
            timeline,
        };
        let factors: Option<Vec<ImuFactor>> = (0..graph.timeline.steps())
            .into_par_iter()
            .with_min_len(32)
            .map(|step| ImuFactor::new(&graph.preintegrated(step, &bias)))
            .collect();
        graph.imu = factors.ok_or_else(|| {
            Error::data(
                "the IMU noise makes no positive definite covariance",
                "check the IMU's noise densities",
            )
        })?;
        graph.add_positions(streams, settings, &bias);
        graph.add_headings(streams, settings, &bias);
        Ok(graph)
    }

    /// The IMU from the node of a step to the next.
    fn preintegrated(&self, step: usize, bias: &ImuBias) -> Preintegrated {
        let (from, to) = (self.timeline.node_s[step], self.timeline.node_s[step + 1]);
        let mut sums = Preintegrated::new(*bias);
        for piece in self.timeline.pieces(from, to) {
            let sample = &self.samples[piece.sample];
            let noise = self.noise_of(piece.sample);
            sums.add(
                sample.gyro_rad_s,
                sample.accel_m_s2,
                piece.duration_s,
                noise,
            );
        }
        sums
    }

    /// Noise of a sample: that of the datasheet, or of unknown motion where it bridges a gap.
    pub fn noise_of(&self, sample: usize) -> &ImuNoise {
        if self.bridged[sample] {
            &self.bridge_noise
        } else {
            &self.noise
        }
    }

    fn ahead(&self, step: usize, time_s: f64, rest_s: f64, bias: &ImuBias) -> Ahead {
        let sample = self.samples[self.timeline.pose_at_or_before(time_s)];
        if rest_s == 0.0 {
            return Ahead { sums: None, sample };
        }
        let mut sums = MotionSums::new(*bias);
        for piece in self.timeline.pieces(self.timeline.node_s[step], time_s) {
            let sample = &self.samples[piece.sample];
            sums.add(sample.gyro_rad_s, sample.accel_m_s2, piece.duration_s);
        }
        Ahead {
            sums: Some(Box::new(sums)),
            sample,
        }
    }

    fn add_positions(&mut self, streams: &Streams, settings: &TrajectorySettings, bias: &ImuBias) {
        let mut placed = Vec::new();
        for (sensor, fixes) in streams.positions.iter().enumerate() {
            for fix in fixes {
                let at = self.timeline.place(fix.value.time_s);
                placed.push((at.0, self.position_factor(sensor, fix, settings, at, bias)));
            }
        }
        placed.sort_by_key(|(step, _)| *step);
        self.position_start = starts(placed.iter().map(|p| p.0), self.timeline.steps());
        self.positions = placed.into_iter().map(|(_, factor)| factor).collect();
    }

    /// The factor of a fix that lies `rest_s` after the node of `step`.
    fn position_factor(
        &self,
        sensor: usize,
        fix: &Numbered<PositionFix>,
        settings: &TrajectorySettings,
        (step, rest_s): (usize, f64),
        bias: &ImuBias,
    ) -> PositionFactor {
        let time_s = fix.value.time_s;
        PositionFactor {
            ahead: self.ahead(step, time_s, rest_s, bias),
            sensor,
            record: fix.record,
            time_s,
            position_m: fix.value.position_m,
            whitener: whitener(fix.value.covariance_m2, &settings.positions[sensor].sigma_m),
            weight: 1.0,
            late: self.known.late(Stream::Position(sensor), fix.record),
        }
    }

    fn add_headings(&mut self, streams: &Streams, settings: &TrajectorySettings, bias: &ImuBias) {
        let mut steps = Vec::new();
        for fix in &streams.heading {
            let at = self.timeline.place(fix.value.time_s);
            let factors = self.heading_factors(fix, settings, at, bias);
            steps.extend(factors.iter().map(|_| at.0));
            self.headings.extend(factors);
        }
        self.heading_start = starts(steps.into_iter(), self.timeline.steps());
    }

    /// The factors of a heading, and of its pitch, that lies `rest_s` after the node of `step`.
    fn heading_factors(
        &self,
        fix: &Numbered<HeadingFix>,
        settings: &TrajectorySettings,
        (step, rest_s): (usize, f64),
        bias: &ImuBias,
    ) -> Vec<HeadingFactor> {
        let antennas = &settings.heading;
        let time_s = fix.value.time_s;
        let ahead = self.ahead(step, time_s, rest_s, bias);
        let heading = antennas.mounting_offset_rad - antennas.grid_convergence_rad;
        let factor = |quantity, value_rad, sigma_rad| HeadingFactor {
            ahead: ahead.clone(),
            record: fix.record,
            time_s,
            quantity,
            value_rad,
            sigma_rad,
            weight: 1.0,
            late: self.known.late(Stream::Heading, fix.record),
        };
        let mut factors = vec![factor(
            Quantity::Heading,
            wrap(fix.value.heading_rad + heading),
            fix.value.sigma_rad.unwrap_or(antennas.sigma_rad),
        )];
        if let Some(pitch_rad) = fix.value.pitch_rad {
            // Seen from above, the baseline lies counter-clockwise of the x axis by the offset.
            let (sin, cos) = antennas.mounting_offset_rad.sin_cos();
            let baseline = Vec3::x() * cos + settings.axes.up().cross(&Vec3::x()) * sin;
            let sigma = fix.value.pitch_sigma_rad;
            factors.push(factor(
                Quantity::Pitch(baseline),
                pitch_rad,
                sigma.unwrap_or(antennas.pitch_sigma_rad),
            ));
        }
        factors
    }

    /// Exchanges the constants, and with them which columns say how late each record is.
    pub fn set_constants(&mut self, known: Constants) {
        for fix in &mut self.positions {
            fix.late = known.late(Stream::Position(fix.sensor), fix.record);
        }
        for fix in &mut self.headings {
            fix.late = known.late(Stream::Heading, fix.record);
        }
        for (sensor, columns) in self.sensors.iter_mut().zip(&known.positions) {
            sensor.columns = *columns;
        }
        self.known = known;
    }

    /// The position factors of a step.
    pub fn positions_of(&self, step: usize) -> &[PositionFactor] {
        &self.positions[self.position_range(step)]
    }

    /// Where in [`Graph::positions`] those of a step stand.
    pub fn position_range(&self, step: usize) -> std::ops::Range<usize> {
        self.position_start[step] as usize..self.position_start[step + 1] as usize
    }

    /// Where in [`Graph::headings`] those of a step stand.
    pub fn heading_range(&self, step: usize) -> std::ops::Range<usize> {
        self.heading_start[step] as usize..self.heading_start[step + 1] as usize
    }

    /// The bias in force in a step.
    pub fn bias<'s>(&self, state: &'s State, step: usize) -> &'s ImuBias {
        &state.biases[self.timeline.layout.bias_of_step[step] as usize]
    }
}

fn position_sensors(settings: &TrajectorySettings, known: &Constants) -> Vec<PositionSensor> {
    let sensors = settings.positions.iter().zip(&known.positions);
    sensors
        .map(|(sensor, columns)| PositionSensor {
            lever_arm_m: sensor.lever_arm_m,
            station_m: sensor.station_m,
            up: settings.axes.up(),
            columns: *columns,
        })
        .collect()
}

/// The resting nodes at which a bias begins: as many whatever the nodes.
fn rest_factors(timeline: &Timeline, rests: &[Rest]) -> Vec<Option<RestFactor>> {
    (0..timeline.steps())
        .map(|step| {
            let time_s = timeline.node_s[step];
            let resting = rests.iter().any(|rest| rest.holds_at(time_s));
            let begins = step == 0 || timeline.layout.changes_before(step);
            (resting && begins).then_some(RestFactor {
                sigma_m_s: Rest::SIGMA_M_S,
            })
        })
        .collect()
}

/// W with Wᵀ W the inverse of the covariance, or of the variances where none is given.
fn whitener(covariance_m2: Option<Mat3>, sigma_m: &Vec3) -> Mat3 {
    covariance_m2
        .and_then(|c| c.cholesky())
        .and_then(|c| c.l().try_inverse())
        .unwrap_or_else(|| Mat3::from_diagonal(&sigma_m.map(|s| 1.0 / s)))
}
