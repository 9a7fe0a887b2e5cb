//! Residuals with their redundancies: which observations check which, and how well they agree.

use super::chain::{ChainFactor, STEP};
use super::factors::{Quantity, Row, Rows};
use super::graph::{Graph, State};
use super::solution::{Rejection, RejectionReason, Residual, SensorDiagnostics, Tally};
use crate::statistics::{CHI_SQUARE_1_MEDIAN, median};
use crate::trajectory::TrajectorySettings;
use nalgebra::DMatrix;

/// The joint covariance of what a step touches.
pub(super) struct StepKnowledge<'a> {
    pub step: usize,
    /// Node i, node i + 1, bias.
    pub unknowns: &'a [[f64; STEP]; STEP],
    /// Of the step's unknowns with the constants, STEP × n row by row.
    pub cross: &'a [f64],
    /// Of the constants, n × n.
    pub constants: &'a DMatrix<f64>,
}

impl StepKnowledge<'_> {
    /// The variance of what one residual row predicts: jᵀ Σ j.
    fn predicted(
        &self,
        row: &[f64; STEP],
        by_constants: impl Iterator<Item = (usize, f64)>,
    ) -> f64 {
        let n = self.constants.nrows();
        let mut used = [0usize; STEP];
        let mut count = 0;
        for (a, x) in row.iter().enumerate() {
            used[count] = a;
            count += usize::from(*x != 0.0);
        }
        let used = &used[..count];
        let mut sum = 0.0;
        for (i, &a) in used.iter().enumerate() {
            let line = &self.unknowns[a];
            let others: f64 = used[i + 1..].iter().map(|&b| line[b] * row[b]).sum();
            sum += row[a] * (line[a] * row[a] + 2.0 * others);
        }
        if n == 0 {
            return sum;
        }
        let border: Vec<(usize, f64)> = by_constants.collect();
        for &(c, z) in &border {
            let inner: f64 = used.iter().map(|&a| self.cross[a * n + c] * row[a]).sum();
            let own: f64 = border
                .iter()
                .map(|&(d, w)| self.constants[(c, d)] * w)
                .sum();
            sum += z * (2.0 * inner + own);
        }
        sum
    }

    /// The redundancy 1 − jᵀ Σ j of each whitened row.
    fn redundancies<const R: usize>(&self, rows: &Rows<R>, by_constants: &[Row<R>]) -> [f64; R] {
        std::array::from_fn(|i| {
            let border = by_constants.iter().map(|(c, by)| (*c, by[i]));
            1.0 - self.predicted(&rows[i], border)
        })
    }
}

/// Which entry of the diagnostics; position sensors come first.
#[derive(Debug, Clone, Copy)]
struct Places {
    positions: usize,
}

impl Places {
    const OTHERS: usize = 5;

    fn heading(self) -> usize {
        self.positions
    }

    fn pitch(self) -> usize {
        self.positions + 1
    }

    fn rest(self) -> usize {
        self.positions + 2
    }

    fn gyro(self) -> usize {
        self.positions + 3
    }

    fn accelerometer(self) -> usize {
        self.positions + 4
    }

    fn count(self) -> usize {
        self.positions + Self::OTHERS
    }
}

/// Sums and residuals of some steps.
#[derive(Debug, Clone)]
pub(super) struct Findings {
    tallies: Vec<Tally>,
    residuals: Vec<Vec<Residual>>,
}

impl Findings {
    pub fn new(positions: usize) -> Self {
        let places = Places { positions };
        Self {
            tallies: vec![Tally::default(); places.count()],
            residuals: vec![Vec::new(); places.count()],
        }
    }

    /// Adds those of later steps.
    pub fn append(&mut self, later: Self) {
        for (sum, more) in self.tallies.iter_mut().zip(&later.tallies) {
            sum.records += more.records;
            sum.components += more.components;
            sum.raw += more.raw;
            sum.normalised += more.normalised;
            sum.redundancy += more.redundancy;
        }
        for (all, more) in self.residuals.iter_mut().zip(later.residuals) {
            all.extend(more);
        }
    }

    /// The residual of one record: raw values, normalised and whitened rows at their weight.
    fn add(&mut self, place: usize, record: Residual, redundancies: &[f64]) {
        if record.weight > 0.0 {
            let sum = &mut self.tallies[place];
            sum.records += 1;
            sum.components += record.values.len();
            sum.raw += record.values.iter().map(|x| x * x).sum::<f64>();
            let squares: f64 = record.normalised.iter().map(|x| x * x).sum();
            sum.normalised += record.weight * squares;
            sum.redundancy += redundancies.iter().sum::<f64>();
        }
        self.residuals[place].push(record);
    }
}

/// Adds the residuals of one step.
pub(super) fn examine(
    graph: &Graph,
    state: &State,
    known: &StepKnowledge<'_>,
    found: &mut Findings,
) {
    let step = known.step;
    let places = Places {
        positions: graph.sensors.len(),
    };
    let constants = state.constants.as_slice();
    let bias = graph.bias(state, step);
    let (from, to) = (&state.nodes[step], &state.nodes[step + 1]);
    for fix in graph.positions_of(step) {
        let sensor = &graph.sensors[fix.sensor];
        let mut whole = fix.clone();
        let rejected = fix.weight == 0.0;
        if rejected {
            whole.weight = 1.0;
        }
        let (rows, border, _) = whole.rows(sensor, &graph.known, from, bias, constants);
        let gravity = graph.known.gravity_m_s2(constants);
        let values = fix.residual(sensor, gravity, from, bias, constants);
        let normalised = fix.normalised(&values);
        let redundancies = known.redundancies(&rows, &border);
        let tests = (0..3).map(|i| test(normalised[i], redundancies[i], rejected));
        let record = Residual {
            record: fix.record + 1,
            time_s: fix.time_s,
            values: values.iter().copied().collect(),
            normalised: normalised.iter().copied().collect(),
            tests: tests.collect(),
            weight: fix.weight,
        };
        found.add(fix.sensor, record, &redundancies);
    }
    for fix in &graph.headings[graph.heading_range(step)] {
        let mut whole = fix.clone();
        let rejected = fix.weight == 0.0;
        if rejected {
            whole.weight = 1.0;
        }
        let (rows, border, _) = whole.rows(&graph.known, from, bias, constants);
        let value = fix.residual(&graph.known, from, bias, constants);
        let redundancies = known.redundancies(&rows, &border);
        let place = match fix.quantity {
            Quantity::Heading => places.heading(),
            Quantity::Pitch(_) => places.pitch(),
        };
        let record = Residual {
            record: fix.record + 1,
            time_s: fix.time_s,
            values: vec![value],
            normalised: vec![value / fix.sigma_rad],
            tests: vec![test(value / fix.sigma_rad, redundancies[0], rejected)],
            weight: fix.weight,
        };
        found.add(place, record, &redundancies);
    }
    if let Some(rest) = &graph.rests[step] {
        let (rows, normalised) = rest.rows(from);
        let sum = &mut found.tallies[places.rest()];
        sum.records += 1;
        sum.components += 3;
        sum.raw += from.velocity_m_s.norm_squared();
        sum.normalised += normalised.iter().map(|x| x * x).sum::<f64>();
        sum.redundancy += known.redundancies(&rows, &[]).iter().sum::<f64>();
    }
    examine_imu(graph, state, known, (from, to), found, places);
}

fn examine_imu(
    graph: &Graph,
    state: &State,
    known: &StepKnowledge<'_>,
    (from, to): (&super::factors::NodeState, &super::factors::NodeState),
    found: &mut Findings,
    places: Places,
) {
    let constants = state.constants.as_slice();
    let bias = graph.bias(state, known.step);
    let factor = &graph.imu[known.step];
    let (rows, border, whitened) =
        factor.rows(&graph.known, (from, to), (bias, constants), graph.imu_scale);
    let redundancies = known.redundancies(&rows, &border);
    let dt = factor.duration_s();
    let gravity = graph.known.gravity_m_s2(constants);
    let [turn, _, velocity] = factor.residual(gravity, from, to, bias);
    for (place, raw, range) in [
        (places.gyro(), turn / dt, 0..3),
        (places.accelerometer(), velocity / dt, 3..9),
    ] {
        let sum = &mut found.tallies[place];
        sum.records += 1;
        sum.components += 3;
        sum.raw += raw.norm_squared();
        sum.normalised += whitened[range.clone()].iter().map(|x| x * x).sum::<f64>();
        sum.redundancy += redundancies[range].iter().sum::<f64>();
    }
}

/// Ω/r of gyro and accelerometer together, and r; `None` where nothing checks them.
pub(super) fn imu_variance_component(
    graph: &Graph,
    state: &State,
    factor: &ChainFactor,
) -> Option<(f64, f64)> {
    let places = Places {
        positions: graph.sensors.len(),
    };
    let constants = factor.constants_covariance();
    let mut found = Findings::new(places.positions);
    factor.marginals(|step, covariance| {
        let known = StepKnowledge {
            step,
            unknowns: &covariance.joint(),
            cross: covariance.cross,
            constants: &constants,
        };
        let nodes = (&state.nodes[step], &state.nodes[step + 1]);
        examine_imu(graph, state, &known, nodes, &mut found, places);
    });
    let sums = [places.gyro(), places.accelerometer()].map(|place| found.tallies[place]);
    let redundancy: f64 = sums.iter().map(|s| s.redundancy).sum();
    let square: f64 = sums.iter().map(|s| s.normalised).sum();
    (redundancy > 1.0).then(|| (square / redundancy, redundancy))
}

/// The same from the median of the single components, which faults at less than half of the steps
/// do not move: v²/r of each component that others check, over the median of χ² with one degree.
pub(super) fn imu_median_component(
    graph: &Graph,
    state: &State,
    factor: &ChainFactor,
) -> Option<f64> {
    /// Components that others check less tell nothing but rounding.
    const CHECKED: f64 = 1e-3;
    let constants = factor.constants_covariance();
    let mut ratios: Vec<f64> = Vec::with_capacity(9 * state.nodes.len());
    factor.marginals(|step, covariance| {
        let known = StepKnowledge {
            step,
            unknowns: &covariance.joint(),
            cross: covariance.cross,
            constants: &constants,
        };
        let nodes = (&state.nodes[step], &state.nodes[step + 1]);
        let at = (graph.bias(state, step), state.constants.as_slice());
        let (rows, border, whitened) =
            graph.imu[step].rows(&graph.known, nodes, at, graph.imu_scale);
        let redundancies = known.redundancies(&rows, &border);
        let checked = whitened.iter().zip(redundancies);
        ratios.extend(
            checked
                .filter(|(_, r)| *r > CHECKED)
                .map(|(v, r)| v * v / r),
        );
    });
    median(ratios).map(|median| median / CHI_SQUARE_1_MEDIAN)
}

/// The residual in its own standard deviations. That of a rejected record scatters by the
/// measurement and the prediction both; nothing checks a record whose redundancy is zero.
fn test(normalised: f64, redundancy: f64, rejected: bool) -> f64 {
    /// Redundancies below are rounding.
    const LEAST: f64 = 1e-6;
    let variance = if rejected {
        2.0 - redundancy
    } else {
        redundancy
    };
    if variance > LEAST {
        normalised / variance.sqrt()
    } else {
        0.0
    }
}

/// Diagnostics of all sensors, with the residuals of each, and the outliers.
pub(super) fn conclude(
    graph: &Graph,
    state: &State,
    settings: &TrajectorySettings,
    findings: Findings,
    dropped: &[Rejection],
) -> (Vec<SensorDiagnostics>, Vec<Vec<Residual>>, Vec<Rejection>) {
    let places = Places {
        positions: graph.sensors.len(),
    };
    let mut names: Vec<(String, &'static str)> = settings
        .positions
        .iter()
        .map(|sensor| (sensor.name.clone(), "m"))
        .collect();
    let others = [
        ("heading", "rad"),
        ("pitch", "rad"),
        ("rest", "m/s"),
        ("gyro", "rad/s"),
        ("accelerometer", "m/s²"),
    ];
    names.extend(others.map(|(name, unit)| (name.to_owned(), unit)));
    let mut sensors: Vec<SensorDiagnostics> = names
        .iter()
        .zip(&findings.tallies)
        .map(|((name, unit), sums)| SensorDiagnostics::new(name, unit, sums))
        .collect();
    sensors.push(SensorDiagnostics::new(
        "bias_walk",
        "",
        &walk_tally(graph, state, &findings.tallies, places),
    ));
    let mut rejections = dropped.to_vec();
    for (sensor, residuals) in sensors.iter_mut().zip(&findings.residuals) {
        let of_this = |r: &&Rejection| r.sensor == sensor.name;
        sensor.ignored = dropped.iter().filter(of_this).count();
        for residual in residuals.iter().filter(|r| r.weight == 0.0) {
            sensor.rejected += 1;
            let square: f64 = residual.normalised.iter().map(|x| x * x).sum();
            rejections.push(Rejection {
                sensor: sensor.name.clone(),
                record: residual.record,
                time_s: residual.time_s,
                reason: RejectionReason::Outlier,
                normalised: Some(square.sqrt()),
            });
        }
    }
    let mut residuals = findings.residuals;
    residuals.push(Vec::new());
    (sensors, residuals, rejections)
}

/// The walk of the biases with the priors. All redundancies add up to the observations of
/// positions, headings and rests, because the IMU, the walks and the priors together are as many
/// as the unknowns: what the others leave is theirs.
fn walk_tally(graph: &Graph, state: &State, tallies: &[Tally], places: Places) -> Tally {
    let checked: f64 = tallies.iter().map(|t| t.redundancy).sum();
    let aiding: usize = tallies[..places.gyro()].iter().map(|t| t.components).sum();
    let count = state.biases.len() - 1;
    let square = |k: usize| -> f64 {
        let walk = graph.walk(state, k);
        walk.weight
            .iter()
            .zip(&walk.difference)
            .map(|(w, d)| w * d * d)
            .sum()
    };
    Tally {
        records: count,
        components: 6 * count,
        raw: 0.0,
        normalised: (0..count).map(square).sum(),
        redundancy: aiding as f64 - checked,
    }
}
