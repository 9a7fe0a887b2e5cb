//! Builds the graph of a drive from its streams.

use super::context::FactorContext;
use super::factor_graph::Graph;
use crate::error::{Error, Result};
use crate::sensor::ImuBias;
use crate::trajectory::constants::Constants;
use crate::trajectory::factors::{ImuFactor, PositionSensor, RestFactor};
use crate::trajectory::imu_series::ImuSeries;
use crate::trajectory::preintegration::Preintegrated;
use crate::trajectory::rest::Rest;
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::states::NodeState;
use crate::trajectory::streams::Streams;
use crate::trajectory::timeline::{Timeline, starts};
use rayon::prelude::*;

impl Graph {
    /// Places the streams on the timeline. `first` are the start values of node 0 and of the bias, about
    /// which the priors are centred and the IMU is integrated.
    ///
    /// # Errors
    /// An IMU noise whose covariance is not positive definite.
    pub fn new(
        timeline: Timeline,
        streams: &Streams,
        settings: &TrajectorySettings,
        constants: &Constants,
        rests: &[Rest],
        first: (NodeState, ImuBias),
    ) -> Result<Self> {
        let mut graph = Self::without_steps(timeline, settings, first);
        let steps = 0..graph.timeline.steps();
        let factors: Result<Vec<ImuFactor>> = steps
            .clone()
            .into_par_iter()
            .with_min_len(32)
            .map(|step| imu_factor(&graph.preintegrated(&streams.imu, step, &first.1)))
            .collect();
        graph.imu = factors?;
        graph.rests = steps.map(|step| graph.rest_factor(step, rests)).collect();
        let context = FactorContext {
            imu: &streams.imu,
            settings,
            constants,
            about: &first.1,
        };
        graph.add_positions(streams, &context);
        graph.add_headings(streams, &context);
        Ok(graph)
    }

    /// A graph without factors.
    pub(super) fn without_steps(
        timeline: Timeline,
        settings: &TrajectorySettings,
        first: (NodeState, ImuBias),
    ) -> Self {
        let sensors = settings.positions.iter().map(|sensor| PositionSensor {
            station_m: sensor.station_m,
            up: settings.axes.up(),
        });
        Self {
            timeline,
            noise: settings.imu,
            imu: Vec::new(),
            imu_scale: 1.0,
            positions: Vec::new(),
            position_start: vec![0],
            headings: Vec::new(),
            heading_start: vec![0],
            rests: Vec::new(),
            sensors: sensors.collect(),
            first,
        }
    }

    /// The IMU's samples from the node of a step to the next, integrated about the bias `about`.
    pub(super) fn preintegrated(
        &self,
        imu: &ImuSeries,
        step: usize,
        about: &ImuBias,
    ) -> Preintegrated {
        let node_s = &self.timeline.node_s;
        Preintegrated::over(*about, imu.pieces(node_s[step], node_s[step + 1]))
    }

    fn add_positions(&mut self, streams: &Streams, context: &FactorContext<'_>) {
        let mut placed = Vec::new();
        for (sensor, fixes) in streams.positions.iter().enumerate() {
            for fix in fixes {
                let (step, after_node_s) = self.timeline.place(fix.value.time_s);
                let node_s = self.timeline.node_s[step];
                placed.push((step, context.position(sensor, fix, (node_s, after_node_s))));
            }
        }
        placed.sort_by_key(|(step, _)| *step);
        self.position_start = starts(placed.iter().map(|p| p.0), self.timeline.steps());
        self.positions = placed.into_iter().map(|(_, factor)| factor).collect();
    }

    fn add_headings(&mut self, streams: &Streams, context: &FactorContext<'_>) {
        let mut steps = Vec::new();
        for fix in &streams.heading {
            let (step, after_node_s) = self.timeline.place(fix.value.time_s);
            let factors = context.headings(fix, (self.timeline.node_s[step], after_node_s));
            steps.extend(factors.iter().map(|_| step));
            self.headings.extend(factors);
        }
        self.heading_start = starts(steps.into_iter(), self.timeline.steps());
    }

    /// The factor that holds the velocity at zero at the node of a step, if the body rests and a bias
    /// begins there: the number of such nodes does not depend on how dense the nodes are.
    pub(super) fn rest_factor(&self, step: usize, rests: &[Rest]) -> Option<RestFactor> {
        let time_s = self.timeline.node_s[step];
        let begins = step == 0 || self.timeline.layout.changes_before(step);
        let resting = begins && rests.iter().any(|rest| rest.holds_at(time_s));
        resting.then_some(RestFactor {
            sigma_m_s: Rest::SIGMA_M_S,
        })
    }
}

pub(super) fn imu_factor(preintegrated: &Preintegrated) -> Result<ImuFactor> {
    ImuFactor::new(preintegrated).ok_or_else(|| {
        Error::data(
            "the covariance of the IMU noise is not positive definite",
            "check the IMU's noise densities",
        )
    })
}
