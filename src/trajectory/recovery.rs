//! Poses at the IMU's rate from nodes that are farther apart.
//!
//! Between the nodes i and j the state at sample k is known from node i by the IMU, and what the
//! sums to j miss of node j, e = r(x_i, x_j, b), is shared out by the best linear estimate:
//! x_k = (x_i ⊕ sums_k) ⊕ G_k e with G_k = Σ_k Φ_jkᵀ Σ_j⁻¹, where Σ are the covariances of the sums
//! and Φ_jk carries an error at k to j. That is what a node at k would come out at, and its
//! covariance is F Σ F ᵀ + Σ_k − G_k Σ_j G_kᵀ with F the derivative of x_k by x_i, x_j and b.

use super::chain::{NODE, STEP};
use super::factors::{ACCEL, ATTITUDE, GYRO, POSITION, VELOCITY};
use super::graph::{Graph, State};
use super::preintegration::{Mat9, MotionSums, Preintegrated, Transition};
use super::timeline::SAME_INSTANT_S;
use crate::geometry::so3::{exp, hat, right_jacobian};
use crate::geometry::{Mat3, Vec3, WorldFromBody};
use crate::sensor::{PoseRecord, PoseSigma};

/// Unknowns of a pose: δφ (body), δp (world).
pub(super) const POSE: usize = 6;
/// Derivative of a pose by the unknowns of its step.
pub(super) type PoseRows = [[f64; STEP]; POSE];
type Mat3x9 = nalgebra::SMatrix<f64, 3, 9>;

/// A pose of a step, and how it hangs on the step's unknowns.
pub(super) struct Recovered {
    /// Index among the poses of the trajectory.
    pub pose: usize,
    pub record: PoseRecord,
    hangs: Hangs,
}

enum Hangs {
    /// It is the pose of a node whose unknowns start here.
    Node(usize),
    /// It lies between nodes.
    Between(Box<Between>),
}

struct Between {
    rows: PoseRows,
    /// Variance that the nodes do not hold: rotation in the body frame, position in the world.
    own: (Mat3, Mat3),
}

impl Recovered {
    /// Adds a gradient by the pose (POSE values) to one by the step's unknowns.
    pub fn pull_back(&self, by_pose: &[f64], by_step: &mut [f64; STEP]) {
        match &self.hangs {
            Hangs::Node(first) => {
                for (x, value) in by_step[*first..].iter_mut().zip(by_pose) {
                    *x += value;
                }
            }
            Hangs::Between(between) => {
                for (value, row) in by_pose.iter().zip(&between.rows) {
                    for (x, b) in by_step.iter_mut().zip(row) {
                        *x += value * b;
                    }
                }
            }
        }
    }

    /// The record with standard deviations, given the covariance of the step's unknowns.
    pub fn with_sigma(mut self, unknowns: &[[f64; STEP]; STEP]) -> PoseRecord {
        let (rotation, position) = match &self.hangs {
            Hangs::Node(first) => {
                let block =
                    |at: usize| Mat3::from_fn(|a, b| unknowns[first + at + a][first + at + b]);
                (block(0), block(3))
            }
            Hangs::Between(between) => (
                propagated(&between.rows[..3], unknowns) + between.own.0,
                propagated(&between.rows[3..], unknowns) + between.own.1,
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

/// One sample's end inside a step.
struct Inside {
    sums: MotionSums,
    covariance: Mat9,
    /// Carries an error at this end to the next.
    to_next: Option<Transition>,
}

/// Hands over the poses of a step in order: that of its node where a sample begins there, and
/// those inside it. For the last step also that of the last node.
pub(super) fn recover(graph: &Graph, state: &State, step: usize, mut take: impl FnMut(Recovered)) {
    let timeline = &graph.timeline;
    let std::ops::Range {
        start: mut next,
        end,
    } = timeline.poses_of(step);
    let last_step = step + 1 == timeline.steps();
    if next < end && timeline.pose_s[next] <= timeline.node_s[step] + SAME_INSTANT_S {
        take(at_node(graph, state, step, step, next));
        next += 1;
    }
    let inner = if last_step { end - 1 } else { end };
    if next < inner {
        for pose in inside(graph, state, step, next..inner).into_iter().rev() {
            take(pose);
        }
    }
    if last_step {
        take(at_node(graph, state, step, step + 1, end - 1));
    }
}

/// The pose of a node, seen from a step that it bounds.
fn at_node(graph: &Graph, state: &State, step: usize, node: usize, pose_index: usize) -> Recovered {
    let at = &state.nodes[node];
    let first = if node == step { 0 } else { NODE };
    Recovered {
        pose: pose_index,
        record: PoseRecord {
            time_s: graph.timeline.pose_s[pose_index],
            world_from_body: WorldFromBody::new(at.rotation, at.position_m),
            velocity_m_s: Some(at.velocity_m_s),
            bias: Some(*graph.bias(state, step)),
            sigma: None,
        },
        hangs: Hangs::Node(first),
    }
}

/// The poses `wanted`, which are the ends of samples inside the step, from the last to the first.
fn inside(
    graph: &Graph,
    state: &State,
    step: usize,
    wanted: std::ops::Range<usize>,
) -> Vec<Recovered> {
    let constants = state.constants.as_slice();
    let bias = graph.bias(state, step);
    let (from, to) = (&state.nodes[step], &state.nodes[step + 1]);
    let factor = &graph.imu[step];
    let (whitened_rows, _, whitened) =
        factor.rows(&graph.known, (from, to), (bias, constants), graph.imu_scale);
    let whitener = Mat9::from_fn(|a, b| factor.whitener[a][b] / graph.imu_scale);
    let gravity = Vec3::new(0.0, 0.0, -graph.known.gravity_m_s2(constants));
    let r = from.rotation.to_rotation_matrix().into_inner();

    let ends = integrate(graph, step, &factor.sums.bias);
    // From the last end inside to the first, with Φ_jk carried along.
    let mut carried = Mat9::identity();
    let count = wanted.len();
    let variance = graph.imu_scale * graph.imu_scale;
    let mut found = Vec::with_capacity(count);
    for (pose_index, end) in wanted.zip(&ends).rev() {
        if let Some(transition) = &end.to_next {
            carried = transition.after(&carried);
        }
        let shared = end.covariance * variance * carried.transpose() * whitener.transpose();
        let correction = shared * nalgebra::SVector::<f64, 9>::from(whitened);
        let part = |at: usize| Vec3::new(correction[at], correction[at + 1], correction[at + 2]);
        let sums = end.sums.corrected(bias);
        let t = end.sums.duration_s;
        let rotation = from.rotation * sums.rotation * exp(&part(0));
        let position_m = from.position_m
            + from.velocity_m_s * t
            + gravity * (0.5 * t * t)
            + from.rotation * (sums.position_m + part(3));
        let velocity_m_s =
            from.velocity_m_s + gravity * t + from.rotation * (sums.velocity_m_s + part(6));

        // By the sums alone.
        let mut rows = [[0.0; STEP]; POSE];
        let mut put = |row: usize, column: usize, block: &Mat3| {
            for a in 0..3 {
                for b in 0..3 {
                    rows[row + a][column + b] = block[(a, b)];
                }
            }
        };
        let turned = sums.rotation.to_rotation_matrix().into_inner();
        put(0, ATTITUDE, &turned.transpose());
        let by_gyro = right_jacobian(&end.sums.turn(bias)) * end.sums.bias_block(0, 0);
        put(0, GYRO, &by_gyro);
        put(3, ATTITUDE, &(-r * hat(&sums.position_m)));
        put(3, POSITION, &Mat3::identity());
        put(3, VELOCITY, &(Mat3::identity() * t));
        put(3, GYRO, &(r * end.sums.bias_block(3, 0)));
        put(3, ACCEL, &(r * end.sums.bias_block(3, 3)));
        // And by what is shared out of the closing error.
        let share_rotation: Mat3x9 = shared.fixed_rows::<3>(0).into_owned();
        let share_position: Mat3x9 = r * shared.fixed_rows::<3>(3);
        for (at, share) in [(0, &share_rotation), (3, &share_position)] {
            for a in 0..3 {
                for (k, source) in whitened_rows.iter().enumerate() {
                    let factor = share[(a, k)];
                    for (x, j) in rows[at + a].iter_mut().zip(source) {
                        *x += factor * j;
                    }
                }
            }
        }
        let block = |at: usize| end.covariance.fixed_view::<3, 3>(at, at) * variance;
        let own_rotation = block(0) - share_rotation * share_rotation.transpose();
        let own_position =
            r * block(3) * r.transpose() - share_position * share_position.transpose();
        found.push(Recovered {
            pose: pose_index,
            record: PoseRecord {
                time_s: graph.timeline.pose_s[pose_index],
                world_from_body: WorldFromBody::new(rotation, position_m),
                velocity_m_s: Some(velocity_m_s),
                bias: Some(*bias),
                sigma: None,
            },
            hangs: Hangs::Between(Box::new(Between {
                rows,
                own: (own_rotation, own_position),
            })),
        });
    }
    found
}

/// The sums at the end of every sample inside the step.
fn integrate(graph: &Graph, step: usize, about: &crate::sensor::ImuBias) -> Vec<Inside> {
    let (from, to) = (graph.timeline.node_s[step], graph.timeline.node_s[step + 1]);
    let mut sums = Preintegrated::new(*about);
    let mut ends: Vec<Inside> = Vec::new();
    for piece in graph.timeline.pieces(from, to) {
        let sample = &graph.samples[piece.sample];
        let noise = graph.noise_of(piece.sample);
        let transition = sums.add(
            sample.gyro_rad_s,
            sample.accel_m_s2,
            piece.duration_s,
            noise,
        );
        if let Some(before) = ends.last_mut() {
            before.to_next = Some(transition);
        }
        ends.push(Inside {
            sums: sums.sums.clone(),
            covariance: sums.covariance,
            to_next: None,
        });
    }
    // The last end is the next node.
    ends.pop();
    ends
}
