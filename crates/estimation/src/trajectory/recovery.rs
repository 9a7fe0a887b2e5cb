//! Poses at the IMU's rate from nodes that are farther apart.
//!
//! Between the nodes i and j the state at sample k is known from node i by the IMU, and the closing
//! error of the sums at node j, e = r(x_i, x_j, b), is distributed by the best linear estimate:
//! x_k = (x_i ⊕ sums_k) ⊕ G_k e with G_k = Σ_k Φ_jkᵀ Σ_j⁻¹, where Σ are the covariances of the sums
//! and Φ_jk carries an error at k to j. A node at k would be estimated at the same state. Its covariance
//! is F Σ Fᵀ + Σ_k − G_k Σ_j G_kᵀ with F the derivative of x_k with respect to x_i, x_j and b.

use super::graph::Graph;
use super::imu_series::{ImuSeries, SAME_INSTANT_S};
use super::motion_sums::{Corrected, Mat9, MotionSums, Transition};
use super::preintegration::Preintegrated;
use super::states::{ACCEL, ATTITUDE, GYRO, POSITION, State, VELOCITY};
use crate::adjustment::{NODE, STEP};
use crate::geometry::so3::{exp, hat, right_jacobian};
use crate::geometry::{Mat3, Vec3, WorldFromBody};
use crate::sensor::{ImuBias, PoseRecord, PoseSigma};
use std::ops::Range;

/// Unknowns of a pose: δφ (body), δp (world).
pub const POSE: usize = 6;
/// Derivative of a pose with respect to the unknowns of its step.
pub type PoseRows = [[f64; STEP]; POSE];
type Mat3x9 = nalgebra::SMatrix<f64, 3, 9>;

/// A pose of a step, with its derivatives with respect to the step's unknowns.
pub struct Recovered {
    /// Index among the poses of the trajectory.
    pub pose: usize,
    pub record: PoseRecord,
    support: PoseSupport,
}

/// What a pose depends on.
enum PoseSupport {
    /// It is the pose of a node, whose unknowns start at this column of the step's.
    Node(usize),
    /// It lies between nodes.
    Between(Box<Between>),
}

struct Between {
    rows: PoseRows,
    /// Covariance beyond that of the nodes: rotation in the body frame, position in the world.
    scatter: (Mat3, Mat3),
}

impl Recovered {
    /// Adds a gradient with respect to the pose (POSE values) to one with respect to the step's unknowns.
    pub fn pull_back(&self, by_pose: &[f64], by_step: &mut [f64; STEP]) {
        match &self.support {
            PoseSupport::Node(first) => {
                for (x, value) in by_step[*first..].iter_mut().zip(by_pose) {
                    *x += value;
                }
            }
            PoseSupport::Between(between) => {
                for (value, row) in by_pose.iter().zip(&between.rows) {
                    for (x, b) in by_step.iter_mut().zip(row) {
                        *x += value * b;
                    }
                }
            }
        }
    }

    /// The derivatives of the pose with respect to the unknowns of its step.
    pub fn rows(&self) -> PoseRows {
        match &self.support {
            PoseSupport::Node(first) => std::array::from_fn(|row| {
                std::array::from_fn(|column| f64::from(u8::from(column == first + row)))
            }),
            PoseSupport::Between(between) => between.rows,
        }
    }

    /// The record with standard deviations, given the covariance of the step's unknowns.
    pub fn with_sigma(mut self, unknowns: &[[f64; STEP]; STEP]) -> PoseRecord {
        let (rotation, position) = match &self.support {
            PoseSupport::Node(first) => {
                let block =
                    |at: usize| Mat3::from_fn(|a, b| unknowns[first + at + a][first + at + b]);
                (block(0), block(3))
            }
            PoseSupport::Between(between) => (
                propagated(&between.rows[..3], unknowns) + between.scatter.0,
                propagated(&between.rows[3..], unknowns) + between.scatter.1,
            ),
        };
        let world = self.record.world_from_body.rotation.to_rotation_matrix();
        let rotation = world.matrix() * rotation * world.matrix().transpose();
        let root = |m: &Mat3| m.diagonal().map(|x| x.max(0.0).sqrt());
        self.record.sigma = Some(PoseSigma {
            position_m: root(&position),
            rotation_rad: root(&rotation),
        });
        self.record
    }
}

/// F Σ Fᵀ of three rows.
fn propagated(rows: &[[f64; STEP]], unknowns: &[[f64; STEP]; STEP]) -> Mat3 {
    let mut product = [[0.0; STEP]; 3];
    for (row, out) in rows.iter().zip(&mut product) {
        for (x, line) in row.iter().zip(unknowns) {
            if *x != 0.0 {
                for (o, y) in out.iter_mut().zip(line) {
                    *o += x * y;
                }
            }
        }
    }
    Mat3::from_fn(|a, b| product[a].iter().zip(&rows[b]).map(|(x, y)| x * y).sum())
}

/// What the IMU says of the end of a sample inside a step. It depends on the graph, not on the state, and holds for
/// standard deviations of the IMU that are not scaled.
#[derive(Debug)]
pub struct SampleEnd {
    sums: MotionSums,
    /// Σ_k Φ_jkᵀ Wᵀ with Wᵀ W = Σ_j⁻¹: the correction by the whitened closing error.
    gain: Mat9,
    /// Blocks of Σ_k − G_k Σ_j G_kᵀ, both in the body frame at node i: rotation, position.
    scatter: (Mat3, Mat3),
}

impl SampleEnd {
    /// The ends of all samples inside a step, in order of time.
    pub fn of_step(graph: &Graph, imu: &ImuSeries, step: usize) -> Vec<Self> {
        let factor = &graph.imu[step];
        let node_s = &graph.timeline.node_s;
        let mut running = Preintegrated::new(factor.sums.bias);
        let mut summed: Vec<(Preintegrated, Transition)> = Vec::new();
        for piece in imu.pieces(node_s[step], node_s[step + 1]) {
            let transition = running.add_piece(&piece);
            summed.push((running.clone(), transition));
        }
        let whitener = Mat9::from_fn(|a, b| factor.whitener[a][b]).transpose();
        // From the last end, which is the next node, to the first, with Φ_jk carried along.
        let mut ends = Vec::with_capacity(summed.len());
        let mut carried = Mat9::identity();
        let mut to_next = None;
        for (at, transition) in summed.into_iter().rev() {
            if let Some(to_next) = to_next.replace(transition) {
                carried = to_next.after(&carried);
                let gain = at.covariance * carried.transpose() * whitener;
                let block = |first: usize| {
                    let share = gain.fixed_rows::<3>(first);
                    at.covariance.fixed_view::<3, 3>(first, first) - share * share.transpose()
                };
                ends.push(Self {
                    sums: at.sums,
                    scatter: (block(0), block(3)),
                    gain,
                });
            }
        }
        ends.reverse();
        ends
    }
}

/// Recovers the poses of a graph at a state.
#[derive(Clone, Copy)]
pub struct Recovery<'a> {
    pub graph: &'a Graph,
    pub state: &'a State,
    pub imu: &'a ImuSeries,
}

impl Recovery<'_> {
    /// Visits the poses of a step in order: that of its node where a sample begins there, and
    /// those inside it. For the last step also that of the last node.
    pub fn step(&self, step: usize, take: impl FnMut(Recovered)) {
        self.step_from(step, &SampleEnd::of_step(self.graph, self.imu, step), take);
    }

    /// As [`Self::step`], given the ends of the samples inside the step.
    pub fn step_from(&self, step: usize, ends: &[SampleEnd], mut take: impl FnMut(Recovered)) {
        let timeline = &self.graph.timeline;
        let Range {
            start: mut next,
            end,
        } = timeline.poses_of(step);
        let last_step = step + 1 == timeline.steps();
        if next < end && timeline.pose_s[next] <= timeline.node_s[step] + SAME_INSTANT_S {
            take(self.at_node(step, step, next));
            next += 1;
        }
        let inner = if last_step { end - 1 } else { end };
        if next < inner {
            self.inside(step, next..inner, ends, &mut take);
        }
        if last_step {
            take(self.at_node(step, step + 1, end - 1));
        }
    }

    /// The pose of a node, seen from a step that it bounds.
    fn at_node(&self, step: usize, node: usize, pose: usize) -> Recovered {
        let at = &self.state.nodes[node];
        let first = if node == step { 0 } else { NODE };
        let record = self.record(step, pose, at.world_from_body, at.velocity_m_s);
        Recovered {
            pose,
            record,
            support: PoseSupport::Node(first),
        }
    }

    fn record(
        &self,
        step: usize,
        pose: usize,
        world_from_body: WorldFromBody,
        velocity_m_s: Vec3,
    ) -> PoseRecord {
        PoseRecord {
            time_s: self.graph.timeline.pose_s[pose],
            world_from_body,
            velocity_m_s: Some(velocity_m_s),
            bias: Some(*self.graph.bias(self.state, step)),
            sigma: None,
        }
    }

    /// Visits the poses with these indices, which are the ends of samples inside the step.
    fn inside(
        &self,
        step: usize,
        poses: Range<usize>,
        ends: &[SampleEnd],
        take: &mut impl FnMut(Recovered),
    ) {
        let (graph, state) = (self.graph, self.state);
        let bias = graph.bias(state, step);
        let (from, to) = (&state.nodes[step], &state.nodes[step + 1]);
        let factor = &graph.imu[step];
        let closing = factor.rows(&state.constants, (from, to), bias, graph.imu_scale);
        let residual = nalgebra::SVector::<f64, 9>::from(closing.residual);
        let bias = &factor.bias(&state.constants, bias);
        let gravity = Vec3::new(0.0, 0.0, -state.constants.gravity_m_s2.value);
        let start = &from.world_from_body;
        let r = start.rotation.to_rotation_matrix().into_inner();
        let variance = graph.imu_scale * graph.imu_scale;
        for (pose, end) in poses.zip(ends) {
            let gain = end.gain * graph.imu_scale;
            let correction = gain * residual;
            let part = |at: usize| correction.fixed_rows::<3>(at).into_owned();
            let sums = end.sums.corrected(bias);
            let t = end.sums.duration_s;
            let rotation = start.rotation * sums.rotation * exp(&part(0));
            let position_m = start.translation_m
                + from.velocity_m_s * t
                + gravity * (0.5 * t * t)
                + start.rotation * (sums.position_m + part(3));
            let velocity_m_s =
                from.velocity_m_s + gravity * t + start.rotation * (sums.velocity_m_s + part(6));
            let world_from_body = WorldFromBody::new(rotation, position_m);

            let mut rows = by_sums(&end.sums, &sums, bias, &r);
            // The part of the derivative through the closing error.
            let by_rotation: Mat3x9 = gain.fixed_rows::<3>(0).into_owned();
            let by_position: Mat3x9 = r * gain.fixed_rows::<3>(3);
            for (at, share) in [(0, &by_rotation), (3, &by_position)] {
                for a in 0..3 {
                    for (k, source) in closing.by_step.iter().enumerate() {
                        let factor = share[(a, k)];
                        for (x, j) in rows[at + a].iter_mut().zip(source) {
                            *x += factor * j;
                        }
                    }
                }
            }
            let scatter = (
                end.scatter.0 * variance,
                r * end.scatter.1 * r.transpose() * variance,
            );
            take(Recovered {
                pose,
                record: self.record(step, pose, world_from_body, velocity_m_s),
                support: PoseSupport::Between(Box::new(Between { rows, scatter })),
            });
        }
    }
}

/// The derivative of a pose with respect to the step's unknowns through the sums alone, given the sums corrected to the
/// bias; `r` is world_from_body at their node.
fn by_sums(sums: &MotionSums, corrected: &Corrected, bias: &ImuBias, r: &Mat3) -> PoseRows {
    let mut rows = [[0.0; STEP]; POSE];
    let mut put = |row: usize, column: usize, block: &Mat3| {
        for a in 0..3 {
            for b in 0..3 {
                rows[row + a][column + b] = block[(a, b)];
            }
        }
    };
    let turned = corrected.rotation.to_rotation_matrix().into_inner();
    let by_gyro = right_jacobian(&sums.turn(bias)) * sums.bias_block(0, 0);
    put(0, ATTITUDE, &turned.transpose());
    put(0, GYRO, &by_gyro);
    put(3, ATTITUDE, &(-r * hat(&corrected.position_m)));
    put(3, POSITION, &Mat3::identity());
    put(3, VELOCITY, &(Mat3::identity() * sums.duration_s));
    put(3, GYRO, &(r * sums.bias_block(3, 0)));
    put(3, ACCEL, &(r * sums.bias_block(3, 3)));
    rows
}
