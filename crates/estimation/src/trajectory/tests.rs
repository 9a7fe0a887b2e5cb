//! What other modules rely on: rows of a graph together with other rows, in another solver.

use super::batch::{Adjusted, Carried, adjust_once};
use super::initial::initial;
use super::logs::MotionLogs;
use super::recovery::{POSE, Recovered, Recovery};
use super::settings::{Constant, HeadingSettings, ImuNoise, PositionSettings, TrajectorySettings};
use super::states::State;
use crate::adjustment::{
    ChainFactor, ChainProblem, ChainStep, Columns, FactorRows, NODE, Parameter, Retract, Rows,
    SEGMENT, STEP, TAIL, Unknown,
};
use crate::geometry::heading::heading_rad;
use crate::geometry::so3::exp;
use crate::geometry::{BodyAxes, BodyFromScanner, Rotation, Vec3};
use crate::progress::Silent;
use crate::sensor::{HeadingFix, ImuSample, PositionFix};
use nalgebra::{DMatrix, DVector};

const GRAVITY: f64 = 9.81;

/// Three seconds in a circle, seen by an IMU, a prism whose lever arm is estimated, and headings.
fn adjusted() -> Adjusted {
    let rate_rad_s = Vec3::new(0.0, 0.0, 0.4);
    let (radius_m, arm) = (2.0, Vec3::new(0.3, -0.2, 1.1));
    let world_from_body = |t: f64| -> Rotation { exp(&(rate_rad_s * t)) };
    let centre = |t: f64| world_from_body(t) * Vec3::new(0.0, -radius_m, 0.0);
    let imu: Vec<ImuSample> = (0..150)
        .map(|k| ImuSample {
            time_s: f64::from(k) * 0.02,
            gyro_rad_s: rate_rad_s,
            accel_m_s2: Vec3::new(0.0, radius_m * 0.16, GRAVITY),
        })
        .collect();
    // Off by a few millimetres.
    let off = |k: i32| Vec3::new(f64::from(k).sin(), f64::from(3 * k).cos(), 0.5) * 0.004;
    let prism: Vec<PositionFix> = (0..30)
        .map(|k| {
            let t = f64::from(k) * 0.1;
            let position_m = centre(t) + world_from_body(t) * arm + off(k);
            PositionFix::with_sigma(t, position_m, None)
        })
        .collect();
    let headings: Vec<HeadingFix> = (0..15)
        .map(|k| {
            let t = f64::from(k) * 0.2;
            HeadingFix::new(t, heading_rad(&world_from_body(t)), None)
        })
        .collect();
    let noise = ImuNoise {
        gyro_density: 1e-3,
        accel_density: 1e-2,
        gyro_bias_walk: 1e-5,
        accel_bias_walk: 1e-4,
    };
    let position = PositionSettings::prism(0.005, arm);
    let mut settings = TrajectorySettings::new(
        BodyAxes::Flu,
        noise,
        position,
        HeadingSettings::aligned(0.01),
    );
    settings.gravity_m_s2 = GRAVITY;
    settings.estimate = vec![Constant::LeverArm(0)];
    let logs = MotionLogs {
        imu: &imu,
        positions: &[prism],
        heading: &headings,
    };
    let nothing = Carried::default();
    adjust_once(&initial, &logs, &settings, &[], &nothing, &Silent).expect("a trajectory")
}

/// A point of a scanner at a pose between two nodes, as its height above a patch of the surface.
struct ScanFactor {
    step: usize,
    /// Index among the poses.
    pose: usize,
    point_m: Vec3,
}

impl ScanFactor {
    fn recovered(&self, adjusted: &Adjusted, state: &State) -> Recovered {
        let recovery = Recovery {
            graph: &adjusted.graph,
            state,
            imu: &adjusted.streams.imu,
        };
        let mut recovered = None;
        recovery.step(self.step, |pose| {
            if pose.pose == self.pose {
                recovered = Some(pose);
            }
        });
        recovered.expect("a pose of the step")
    }

    /// z − (offset + slopes · (x, y)) of the point in the world.
    fn rows(
        &self,
        pose: &Recovered,
        mounting: &Parameter<BodyFromScanner>,
        patch: &Parameter<Vec3>,
    ) -> FactorRows<1> {
        let world_from_body = &pose.record.world_from_body;
        let in_body = mounting.value.map(&self.point_m);
        let in_world = world_from_body.map(&in_body);
        let shape = Vec3::new(1.0, in_world.x, in_world.y);
        // ∂r with respect to the point, in world and in body axes.
        let by_world = Vec3::new(-patch.value.y, -patch.value.z, 1.0);
        let by_body = world_from_body.rotation.inverse() * by_world;
        let turned = in_body.cross(&by_body);
        let by_pose: [f64; POSE] = [turned, by_world].map(<[f64; 3]>::from).as_flattened()[..]
            .try_into()
            .expect("six");
        let mut by_step = [[0.0; STEP]];
        pose.pull_back(&by_pose, &mut by_step[0]);
        let mut rows = FactorRows::new([in_world.z - shape.dot(&patch.value)], by_step);
        let arm = mounting.value.rotation * self.point_m;
        let by_mounting = [arm.cross(&by_body), by_body].map(<[f64; 3]>::from);
        let by_mounting = by_mounting.as_flattened();
        if let (Some(mounting), Some(patch)) = (mounting.block(), patch.block()) {
            rows.touch::<_, 6>(mounting, std::array::from_fn(|i| [by_mounting[i]]));
            rows.touch::<_, 3>(patch, std::array::from_fn(|i| [-shape[i]]));
        }
        rows
    }
}

/// The state with unknown `a` of a step moved by `h`.
fn moved(adjusted: &Adjusted, step: usize, a: usize, h: f64) -> State {
    let mut state = adjusted.state.clone();
    let mut all = [0.0; STEP];
    all[a] = h;
    state.nodes[step] = state.nodes[step].retracted(&all[..NODE]);
    state.nodes[step + 1] = state.nodes[step + 1].retracted(&all[NODE..2 * NODE]);
    let bias = adjusted.graph.layout().segment(step);
    state.biases[bias] = state.biases[bias].retracted(&all[2 * NODE..]);
    state
}

/// A mounting and a patch, in columns after those of the constants.
fn beside(adjusted: &Adjusted) -> (Parameter<BodyFromScanner>, Parameter<Vec3>, Columns) {
    let mut columns = Columns {
        count: adjusted.state.constants.count(),
    };
    let rotation = exp(&Vec3::new(-2.1, 0.4, 0.7));
    let mut mounting = Parameter::held(BodyFromScanner::new(rotation, Vec3::new(1.2, -0.5, 0.6)));
    let mut patch = Parameter::held(Vec3::new(0.1, -0.2, 0.3));
    mounting.estimate(&mut columns);
    patch.estimate(&mut columns);
    (mounting, patch, columns)
}

#[test]
fn a_scan_row_between_nodes_meets_finite_differences() {
    let adjusted = adjusted();
    let (mounting, patch, columns) = beside(&adjusted);
    let scan = ScanFactor {
        step: 7,
        pose: adjusted.graph.timeline.poses_of(7).start + 2,
        point_m: Vec3::new(0.4, 0.0, -1.3),
    };
    let residual = |state: &State, mounting: &_, patch: &_| {
        let pose = scan.recovered(&adjusted, state);
        scan.rows(&pose, mounting, patch).residual[0]
    };
    let state = &adjusted.state;
    let rows = scan.rows(&scan.recovered(&adjusted, state), &mounting, &patch);
    let h = 1e-5;
    for (a, analytic) in rows.by_step[0].iter().enumerate() {
        let value = |h| residual(&moved(&adjusted, scan.step, a, h), &mounting, &patch);
        let numeric = (value(h) - value(-h)) / (2.0 * h);
        // Shares of the closing error are linearised at zero: it is below 1e-3 of the motion.
        let error = (numeric - analytic).abs();
        assert!(
            error < 1e-3 * analytic.abs().max(0.1),
            "{a}: {numeric} {analytic}"
        );
    }
    let view = rows.weighted(1.0);
    assert_eq!(view.columns, [3, 4, 5, 6, 7, 8, 9, 10, 11]);
    for (column, by) in view.by_column() {
        let value = |h: f64| {
            let mut step = vec![0.0; columns.count];
            step[column] = h;
            let (mut mounting, mut patch) = (mounting.clone(), patch.clone());
            mounting.retract(&step);
            patch.retract(&step);
            residual(state, &mounting, &patch)
        };
        let numeric = (value(h) - value(-h)) / (2.0 * h);
        assert!(
            (numeric - by[0]).abs() < 1e-8,
            "{column}: {numeric} {}",
            by[0]
        );
    }
}

/// Normal equations of any rows, dense: nodes, biases, then all columns beside the chain.
struct Dense {
    nodes: usize,
    chain: usize,
    h: DMatrix<f64>,
    g: DVector<f64>,
}

impl Dense {
    fn new(adjusted: &Adjusted, columns: usize) -> Self {
        let layout = adjusted.graph.layout();
        let nodes = layout.nodes() * NODE;
        let chain = nodes + layout.segments() * SEGMENT;
        Self {
            nodes,
            chain,
            h: DMatrix::zeros(chain + columns, chain + columns),
            g: DVector::zeros(chain + columns),
        }
    }

    fn add(&mut self, step: usize, segment: usize, rows: &Rows<'_>) {
        let place = |a: usize| match a {
            a if a < 2 * NODE => step * NODE + a,
            a => self.nodes + segment * SEGMENT + a - 2 * NODE,
        };
        for (i, (row, residual)) in rows.by_step.iter().zip(rows.residual).enumerate() {
            let chain = row.iter().enumerate().map(|(a, x)| (place(a), *x));
            let beside = rows.by_column().map(|(c, by)| (self.chain + c, by[i]));
            let all: Vec<(usize, f64)> = chain.chain(beside).collect();
            for (a, x) in &all {
                self.g[*a] -= rows.weight * x * residual;
                for (b, y) in &all {
                    self.h[(*a, *b)] += rows.weight * x * y;
                }
            }
        }
    }

    /// A prior, or a walk between two places.
    fn add_weight(&mut self, places: &[(usize, f64)], weight: f64, miss: f64) {
        for (a, x) in places {
            self.g[*a] -= weight * x * miss;
            for (b, y) in places {
                self.h[(*a, *b)] += weight * x * y;
            }
        }
    }

    /// All rows and priors of the graph.
    fn of_graph(adjusted: &Adjusted, state: &State, columns: usize) -> Self {
        let (graph, mut all) = (&adjusted.graph, Self::new(adjusted, columns));
        for step in 0..graph.layout().steps() {
            let segment = graph.layout().segment(step);
            graph.rows(state, step, |_, rows| all.add(step, segment, &rows));
        }
        let prior = graph.prior(state);
        for a in 0..TAIL {
            let place = if a < NODE { a } else { all.nodes + a - NODE };
            all.add_weight(&[(place, 1.0)], prior.weight[a], prior.miss[a]);
        }
        for old in 0..graph.layout().segments() - 1 {
            let walk = graph.walk(state, old);
            for a in 0..SEGMENT {
                let place = all.nodes + old * SEGMENT + a;
                let ends = [(place, -1.0), (place + SEGMENT, 1.0)];
                all.add_weight(&ends, walk.weight[a], walk.miss[a]);
            }
        }
        let border = graph.border_prior(state);
        for (c, (weight, miss)) in border.weight.iter().zip(&border.miss).enumerate() {
            all.add_weight(&[(all.chain + c, 1.0)], *weight, *miss);
        }
        all
    }
}

#[test]
fn another_solver_finds_the_step_of_the_chain_and_takes_scan_rows_beside() {
    let adjusted = adjusted();
    // Off the solution, so that there is a step.
    let state = moved(&adjusted, 3, 4, 0.02);
    let count = state.constants.count();
    let mut factor = ChainFactor::new(adjusted.graph.layout().clone(), count);
    let factorised = adjusted.graph.factorise(&state, 0.0, &mut factor);
    factorised.expect("positive definite");
    let mut step = ChainStep::new(adjusted.graph.layout(), count);
    factor.back_substitute(&mut step);
    let dense = Dense::of_graph(&adjusted, &state, count);
    let solution = dense
        .h
        .cholesky()
        .expect("positive definite")
        .solve(&dense.g);
    let nodes = step.nodes.as_flattened();
    let chain = [nodes, step.segments.as_flattened(), &step.border].concat();
    for (a, b) in chain.iter().zip(&solution) {
        assert!((a - b).abs() < 1e-6 * solution.amax(), "{a} {b}");
    }

    let (mounting, patch, columns) = beside(&adjusted);
    let mut joint = Dense::of_graph(&adjusted, &state, columns.count);
    for step in 0..adjusted.graph.layout().steps() {
        let poses = adjusted.graph.timeline.poses_of(step);
        let segment = adjusted.graph.layout().segment(step);
        for pose in poses {
            let turn = pose as f64;
            let scan = ScanFactor {
                step,
                pose,
                point_m: Vec3::new(turn.sin(), turn.cos(), -1.3),
            };
            let rows = scan.rows(&scan.recovered(&adjusted, &state), &mounting, &patch);
            joint.add(step, segment, &rows.weighted(1e8));
        }
    }
    // A single plane determines neither the mounting's height apart from the patch's, nor the turn about
    // its normal.
    for column in count..columns.count {
        joint.add_weight(&[(joint.chain + column, 1.0)], 1.0, 0.0);
    }
    let covariance = joint.h.cholesky().expect("positive definite").inverse();
    let sigma = |column: usize| covariance[(joint.chain + column, joint.chain + column)].sqrt();
    // The tilts of the mounting are known far better than by the prior of 1 rad; along the normal it is
    // free.
    assert!(
        sigma(count) < 0.05 && sigma(count + 1) < 0.05,
        "{} {}",
        sigma(count),
        sigma(count + 1)
    );
    assert!(sigma(count + 5) > 0.3, "{}", sigma(count + 5));
}
