//! Residuals with their redundancies: how well observations check each other, and how well they agree.

use super::factors::Quantity;
use super::graph::{Graph, Source};
use super::settings::TrajectorySettings;
use super::solution::{Rejection, RejectionReason, Residual, SensorDiagnostics, Tally};
use super::states::State;
use crate::adjustment::{ChainProblem, Rows, StepCovariance};
use nalgebra::DMatrix;

/// Indices of the sensors in the diagnostics; position sensors come first.
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
pub struct Findings {
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

    /// Adds a record with its number (from 0), its time and its raw residuals.
    fn record(
        &mut self,
        place: usize,
        record: usize,
        time_s: f64,
        values: Vec<f64>,
        rows: &Rows<'_>,
        redundancies: &[f64],
    ) {
        if rows.weight > 0.0 {
            let normalised = rows.weight * square(rows.residual);
            self.add(place, &values, normalised, redundancies);
        }
        let tests = rows.residual.iter().zip(redundancies);
        self.residuals[place].push(Residual {
            record: record + 1,
            time_s,
            values,
            normalised: rows.residual.to_vec(),
            tests: tests
                .map(|(v, r)| test(*v, *r, rows.weight == 0.0))
                .collect(),
            weight: rows.weight,
        });
    }

    /// Adds raw residuals and the weighted sum of the normalised squares to the sums.
    fn add(&mut self, place: usize, values: &[f64], normalised: f64, redundancies: &[f64]) {
        let sum = &mut self.tallies[place];
        sum.records += 1;
        sum.components += values.len();
        sum.raw += square(values);
        sum.normalised += normalised;
        sum.redundancy += redundancies.iter().sum::<f64>();
    }
}

fn square(values: &[f64]) -> f64 {
    values.iter().map(|x| x * x).sum()
}

/// Adds the residuals of one step, given the covariances of its unknowns and of the constants.
pub fn examine(
    graph: &Graph,
    state: &State,
    step: usize,
    unknowns: &StepCovariance,
    border: &DMatrix<f64>,
    findings: &mut Findings,
) {
    let places = Places {
        positions: graph.sensors.len(),
    };
    let (node, next) = (&state.nodes[step], &state.nodes[step + 1]);
    let (bias, constants) = (graph.bias(state, step), &state.constants);
    graph.rows(state, step, |source, rows| {
        // Rejected records are tested at full weight.
        let weight = if rows.weight > 0.0 { rows.weight } else { 1.0 };
        let redundancies = unknowns.redundancies(&Rows { weight, ..rows }, border);
        match source {
            Source::Position(fix) => {
                let values = fix.residual(&graph.sensors[fix.sensor], constants, node, bias);
                let values = values.iter().copied().collect();
                findings.record(
                    fix.sensor,
                    fix.record,
                    fix.time_s,
                    values,
                    &rows,
                    &redundancies,
                );
            }
            Source::Heading(fix) => {
                let values = vec![fix.residual(constants, node, bias)];
                let place = match fix.quantity {
                    Quantity::Heading => places.heading(),
                    Quantity::Pitch(_) => places.pitch(),
                };
                findings.record(place, fix.record, fix.time_s, values, &rows, &redundancies);
            }
            Source::Rest => {
                let values = node.velocity_m_s.as_slice();
                findings.add(places.rest(), values, square(rows.residual), &redundancies);
            }
            Source::Imu(factor) => {
                let dt = factor.sums.duration_s;
                let [turn, _, velocity] = factor.residual(constants, (node, next), bias);
                for (place, raw, range) in [
                    (places.gyro(), turn / dt, 0..3),
                    (places.accelerometer(), velocity / dt, 3..9),
                ] {
                    let normalised = square(&rows.residual[range.clone()]);
                    findings.add(place, raw.as_slice(), normalised, &redundancies[range]);
                }
            }
        }
    });
}

/// The residual divided by its standard deviation. The residual of a rejected record scatters with
/// measurement and prediction together; a record without redundancy is not checked by others.
fn test(normalised: f64, redundancy: f64, rejected: bool) -> f64 {
    /// Smaller redundancies are rounding errors.
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

/// Diagnostics of all sensors, the residuals of each, and the records that are not used.
pub fn diagnostics(
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

/// Statistics of the random walk of the biases, with the priors. All redundancies add up to the number of
/// observations of positions, headings and rests, because the IMU, the walks and the priors together are
/// as many as the unknowns: what the other sensors leave of that sum is theirs.
fn walk_tally(graph: &Graph, state: &State, tallies: &[Tally], places: Places) -> Tally {
    let checked: f64 = tallies.iter().map(|t| t.redundancy).sum();
    let aiding: usize = tallies[..places.gyro()].iter().map(|t| t.components).sum();
    let count = state.biases.len() - 1;
    let square = |k: usize| 2.0 * graph.walk(state, k).cost();
    Tally {
        records: count,
        components: 6 * count,
        raw: 0.0,
        normalised: (0..count).map(square).sum(),
        redundancy: aiding as f64 - checked,
    }
}
