//! A drive with logs: the chain of the trajectory's own graph, with its nodes, biases and constants.

mod poses;
mod residuals;

use std::borrow::Cow;
use std::f64::consts::PI;
use std::sync::{Arc, OnceLock};

use nalgebra::DMatrix;

use crate::adjustment::{ChainProblem, ChainStep, NODE, Rows, SEGMENT, STEP};
use crate::geometry::Vec3;
use crate::joint::motion::gauss_markov::GaussMarkov;
use crate::joint::motion::knots::{BRIDGE, StepPoses};
use crate::joint::motion::{ConstantValue, Motion, Places, PositionBlocks, PositionResiduals};
use crate::joint::row::RowBatch;
use crate::sensor::PoseRecord;
use crate::trajectory::PosteriorCovariance;
use crate::trajectory::graph::{Graph, Source};
use crate::trajectory::imu_series::ImuSeries;
use crate::trajectory::recovery::SampleEnd;
use crate::trajectory::states::State;

/// The part of a sensor's error that is correlated in time.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelatedError {
    /// Standard deviation of each component, in the unit of the observation.
    pub sigma: Vec<f64>,
    /// Seconds.
    pub correlation_s: f64,
}

/// Groups of observations, in this order: IMU, position sensors, heading, and all that is assumed
/// (walks of biases, correlated errors, rests, priors).
const IMU: usize = 0;

/// The chain at its present state.
#[derive(Debug, Clone)]
pub struct ChainMotion {
    graph: Arc<Graph>,
    imu: Arc<ImuSeries>,
    state: State,
    /// Names of the position sensors.
    names: Arc<Vec<String>>,
    /// Correlated errors of each position sensor, then of the heading.
    correlated: Vec<Option<GaussMarkov>>,
    /// For each step, the deviation of the attitude in its middle from the best estimate by the IMU and
    /// both nodes (body axes, radians).
    bridges: Vec<Vec3>,
    /// What the IMU says between the nodes of each step, once it has been asked for.
    ends: Arc<[OnceLock<Vec<SampleEnd>>]>,
    /// The poses of each step at this state, once they have been asked for: many passes over the rows need them.
    poses: Arc<[OnceLock<StepPoses>]>,
}

impl ChainMotion {
    /// The chain of an estimate, with the correlated errors of its position sensors and of the
    /// heading. They begin with the lasting errors of the estimate, which they replace.
    pub fn new(
        posterior: &PosteriorCovariance,
        names: Vec<String>,
        correlated: &[Option<CorrelatedError>],
    ) -> Self {
        let (graph, state, imu) = posterior.parts();
        let node_s = &graph.timeline.node_s;
        let span_s = (node_s[0], node_s[node_s.len() - 1]);
        let process = |(sensor, error): (usize, &Option<CorrelatedError>)| {
            let error = error.as_ref()?;
            let mut process = GaussMarkov::new(span_s, error.sigma.clone(), error.correlation_s);
            let values = process.value.chunks_exact_mut(process.sigma.len());
            for (value, time_s) in values.zip(&process.knot_s) {
                if sensor < names.len() {
                    let error_m = state.constants.lasting_m(sensor, *time_s);
                    value.copy_from_slice(error_m.as_slice());
                } else {
                    value[0] = state.constants.lasting_rad(*time_s);
                }
            }
            Some(process)
        };
        let correlated = correlated.iter().enumerate().map(process).collect();
        Self {
            bridges: vec![Vec3::zeros(); graph.timeline.steps()],
            ends: room(graph.timeline.steps()),
            poses: room(graph.timeline.steps()),
            graph: Arc::new(graph.clone()),
            imu: Arc::new(imu.clone()),
            state: State {
                constants: state.constants.clone().without_lasting(),
                ..state.clone()
            },
            names: Arc::new(names),
            correlated,
        }
    }

    /// The same chain with the standard deviations of the IMU multiplied by `factor`.
    pub fn with_noise_scaled(mut self, factor: f64) -> Self {
        Arc::make_mut(&mut self.graph).imu_scale *= factor;
        self.poses = room(self.steps());
        self
    }

    fn nodes(&self) -> usize {
        self.state.nodes.len()
    }

    fn segments(&self) -> usize {
        self.state.biases.len()
    }

    /// Own block of the first knot of a sensor's correlated error.
    fn first_knot(&self, sensor: usize) -> usize {
        let before = self.correlated[..sensor].iter().flatten();
        let knots: usize = before.map(|process| process.knot_s.len()).sum();
        self.nodes() + self.segments() + knots
    }

    /// Own block of the first bridge.
    fn first_bridge(&self) -> usize {
        self.first_knot(self.correlated.len())
    }

    /// The standard deviation of a bridge, radians. Between nodes T apart, the sum of white noise of
    /// density q is a Brownian bridge; the first of its terms √2 q√T/(πk) sin(πk u) has 61 % of the
    /// variance, and a larger share of the variance of the mean over a step. The effect of the
    /// accelerometer's noise on positions within a step is below a micrometre.
    fn bridge_sigma_rad(&self, step: usize) -> f64 {
        let node_s = &self.graph.timeline.node_s;
        let density = self.graph.noise.gyro_density * self.graph.imu_scale;
        let duration_s = node_s[step + 1] - node_s[step];
        density * (2.0 * duration_s).sqrt() / PI
    }

    /// Group of the headings.
    fn heading(&self) -> usize {
        IMU + 1 + self.names.len()
    }

    /// Adds a factor's rows, with the correlated error of its sensor, if it has one.
    fn add(
        &self,
        step: usize,
        group: usize,
        rows: &Rows<'_>,
        error: Option<ErrorRows<'_>>,
        places: &Places<'_>,
        batch: &mut RowBatch,
    ) {
        let segment = self.graph.layout().segment(step);
        let place = |block: usize| places.first_block + block;
        for (i, (by, residual)) in rows.by_step.iter().zip(rows.residual).enumerate() {
            let moved = error.as_ref().map_or(0.0, |error| error.residual(i));
            batch.begin(places.first_group + group, rows.weight, residual + moved);
            let mut touch = |block: usize, by: &[f64]| {
                if by.iter().any(|x| *x != 0.0) {
                    batch.touch(place(block), by);
                }
            };
            touch(step, &by[..NODE]);
            touch(step + 1, &by[NODE..2 * NODE]);
            touch(self.nodes() + segment, &by[2 * NODE..STEP]);
            for (column, by) in rows.by_column() {
                batch.touch(places.constants[column], &by[i..=i]);
            }
            if let Some(error) = &error {
                for (block, share) in error.knots() {
                    let by: Vec<f64> = error.whitener(i).iter().map(|w| w * share).collect();
                    batch.touch(place(block), &by);
                }
            }
        }
    }

    /// The correlated error of a record.
    fn error_rows<'a>(
        &'a self,
        sensor: usize,
        time_s: f64,
        whitener: DMatrix<f64>,
    ) -> Option<ErrorRows<'a>> {
        let process = self.correlated.get(sensor)?.as_ref()?;
        Some(ErrorRows {
            process,
            first: self.first_knot(sensor),
            time_s,
            whitener,
        })
    }

    fn error_of(&self, source: &Source<'_>) -> Option<ErrorRows<'_>> {
        match source {
            Source::Position(fix) => {
                let whitener = DMatrix::from_fn(3, 3, |i, j| fix.whitener[(i, j)]);
                self.error_rows(fix.sensor, fix.time_s, whitener)
            }
            Source::Heading(fix) => {
                let whitener = DMatrix::from_element(1, 1, -1.0 / fix.sigma_rad);
                self.error_rows(self.names.len(), fix.time_s, whitener)
            }
            Source::Imu(_) | Source::Rest => None,
        }
    }

    fn group_of(&self, source: &Source<'_>) -> usize {
        match source {
            Source::Imu(_) => IMU,
            Source::Position(fix) => IMU + 1 + fix.sensor,
            Source::Heading(_) => self.heading(),
            Source::Rest => self.heading() + 1,
        }
    }

    /// Priors of node 0 and bias 0, walks of the biases, and correlated errors.
    fn assumed(&self, places: &Places<'_>, batch: &mut RowBatch) {
        let group = places.first_group + self.heading() + 1;
        let mut single = |block: usize, size: usize, at: usize, weight: f64, miss: f64| {
            let mut by = vec![0.0; size];
            by[at] = weight.sqrt();
            batch.begin(group, 1.0, miss * weight.sqrt());
            batch.touch(places.first_block + block, &by);
        };
        let prior = self.graph.prior(&self.state);
        for (a, (weight, miss)) in prior.weight.iter().zip(prior.miss).enumerate() {
            if a < NODE {
                single(0, NODE, a, *weight, miss);
            } else {
                single(self.nodes(), SEGMENT, a - NODE, *weight, miss);
            }
        }
        for old in 0..self.segments() - 1 {
            let walk = self.graph.walk(&self.state, old);
            for (a, (weight, miss)) in walk.weight.iter().zip(walk.miss).enumerate() {
                let mut by = [0.0; SEGMENT];
                by[a] = -weight.sqrt();
                batch.begin(group, 1.0, miss * weight.sqrt());
                let block = places.first_block + self.nodes() + old;
                batch.touch(block, &by);
                by[a] = weight.sqrt();
                batch.touch(block + 1, &by);
            }
        }
        for (sensor, process) in self.correlated.iter().enumerate() {
            let Some(process) = process else { continue };
            let first = places.first_block + self.first_knot(sensor);
            (0..process.knot_s.len()).for_each(|knot| process.rows(knot, first, group, batch));
        }
    }
}

/// Room for a value of each step.
fn room<T>(steps: usize) -> Arc<[OnceLock<T>]> {
    (0..steps).map(|_| OnceLock::new()).collect()
}

/// The correlated error e of one record: its residual r becomes r + W e.
struct ErrorRows<'a> {
    process: &'a GaussMarkov,
    /// Own block of its first knot.
    first: usize,
    time_s: f64,
    whitener: DMatrix<f64>,
}

impl ErrorRows<'_> {
    fn residual(&self, row: usize) -> f64 {
        let errors = (0..self.process.dimension()).map(|d| self.process.at(self.time_s, d));
        self.whitener(row)
            .iter()
            .zip(errors)
            .map(|(w, e)| w * e)
            .sum()
    }

    fn whitener(&self, row: usize) -> Vec<f64> {
        self.whitener.row(row).iter().copied().collect()
    }

    /// The blocks of the knots before and after, with their shares.
    fn knots(&self) -> [(usize, f64); 2] {
        let (knot, u) = self.process.locate(self.time_s);
        [(self.first + knot, 1.0 - u), (self.first + knot + 1, u)]
    }
}

impl Motion for ChainMotion {
    fn blocks(&self) -> Vec<usize> {
        let mut sizes = vec![NODE; self.nodes()];
        sizes.resize(self.nodes() + self.segments(), SEGMENT);
        for process in self.correlated.iter().flatten() {
            sizes.resize(sizes.len() + process.knot_s.len(), process.dimension());
        }
        sizes.resize(sizes.len() + self.steps(), BRIDGE);
        sizes
    }

    fn groups(&self) -> Vec<String> {
        let sensors = self.names.iter().cloned();
        let mut all: Vec<String> = std::iter::once("imu".into()).chain(sensors).collect();
        all.extend(["heading".into(), "assumed".into()]);
        all
    }

    fn steps(&self) -> usize {
        self.graph.timeline.steps()
    }

    fn step_at(&self, time_s: f64) -> Option<usize> {
        let node_s = &self.graph.timeline.node_s;
        let within = node_s[0] <= time_s && time_s <= node_s[node_s.len() - 1];
        within.then(|| self.graph.timeline.place(time_s).0)
    }

    fn pose_blocks(&self, step: usize) -> [usize; 2] {
        [step, step + 1]
    }

    fn bridge_block(&self, step: usize) -> Option<usize> {
        Some(self.first_bridge() + step)
    }

    fn poses(&self, step: usize) -> Cow<'_, StepPoses> {
        Cow::Borrowed(self.poses[step].get_or_init(|| self.recovered(step)))
    }

    fn rows(&self, step: usize, places: &Places<'_>, batch: &mut RowBatch) {
        if step == self.steps() {
            self.assumed(places, batch);
            return;
        }
        self.graph.rows(&self.state, step, |source, rows| {
            let error = self.error_of(&source);
            let group = self.group_of(&source);
            self.add(step, group, &rows, error, places, batch);
        });
        let w = 1.0 / self.bridge_sigma_rad(step);
        for (i, value) in self.bridges[step].iter().enumerate() {
            let mut by = [0.0; BRIDGE];
            by[i] = w;
            batch.begin(places.first_group + IMU, 1.0, value * w);
            batch.touch(places.first_block + self.first_bridge() + step, &by);
        }
    }

    fn moved(&self, own_step: &[f64], constants: &[f64]) -> Box<dyn Motion> {
        let (nodes, rest) = own_step.split_at(self.nodes() * NODE);
        let (segments, mut errors) = rest.split_at(self.segments() * SEGMENT);
        let step = ChainStep {
            nodes: nodes.as_chunks::<NODE>().0.to_vec(),
            segments: segments.as_chunks::<SEGMENT>().0.to_vec(),
            border: constants.to_vec(),
        };
        let mut moved = self.clone();
        moved.poses = room(self.steps());
        moved.state = self.graph.retracted(&self.state, &step);
        for process in moved.correlated.iter_mut().flatten() {
            let (step, rest) = errors.split_at(process.value.len());
            process
                .value
                .iter_mut()
                .zip(step)
                .for_each(|(x, d)| *x += d);
            errors = rest;
        }
        for (bridge, step) in moved.bridges.iter_mut().zip(errors.chunks_exact(BRIDGE)) {
            *bridge += Vec3::from_column_slice(step);
        }
        Box::new(moved)
    }

    fn damping_sigma(&self) -> Vec<f64> {
        let all = self.graph.damping_sigma();
        let mut sigma: Vec<f64> = all[..NODE].repeat(self.nodes());
        sigma.extend(all[NODE..].repeat(self.segments()));
        for process in self.correlated.iter().flatten() {
            sigma.extend(process.sigma.repeat(process.knot_s.len()));
        }
        let bridges = (0..self.steps()).map(|step| self.bridge_sigma_rad(step));
        sigma.extend(bridges.flat_map(|sigma| [sigma; BRIDGE]));
        sigma
    }

    fn records(
        &self,
        covariance: Option<&(dyn Fn(usize, usize) -> Option<DMatrix<f64>> + Sync)>,
    ) -> Vec<PoseRecord> {
        let mut records = Vec::with_capacity(self.graph.timeline.pose_s.len());
        for step in 0..self.steps() {
            let unknowns = covariance.and_then(|block| self.step_covariance(step, block));
            self.recover(step, |pose| {
                let record = match &unknowns {
                    Some(unknowns) => pose.with_sigma(unknowns),
                    None => pose.record,
                };
                records.push(self.bridged(step, record));
            });
        }
        records
    }

    fn constants(&self) -> Vec<ConstantValue> {
        let corrections = self.state.constants.corrections();
        let described = self.state.constants.described.iter();
        described
            .zip(corrections)
            .map(|(column, correction)| ConstantValue {
                name: column.name.clone(),
                unit: column.unit,
                base: column.base,
                correction,
                prior_sigma: column.prior_sigma,
            })
            .collect()
    }

    fn boxed(&self) -> Box<dyn Motion> {
        Box::new(self.clone())
    }

    fn position_blocks(&self, block_s: f64) -> Vec<PositionBlocks> {
        let sensors = self.names.iter().enumerate();
        sensors
            .map(|(sensor, name)| self.blocks_of(sensor, name, block_s))
            .collect()
    }

    fn position_residuals(&self) -> Vec<PositionResiduals> {
        let sensors = self.names.iter().enumerate();
        sensors
            .map(|(sensor, name)| self.residuals_of(sensor, name))
            .collect()
    }
}
