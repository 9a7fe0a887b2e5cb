//! The posterior covariance of the whole trajectory, kept as its Cholesky factor.

use super::graph::Graph;
use super::imu_series::ImuSeries;
use super::recovery::{POSE, Recovery};
use super::states::{BIAS, State};
use crate::adjustment::{ChainFactor, ChainGradient, NODE, STEP};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Mark of a node without gradient.
const NONE: u32 = u32::MAX;

/// Gradient of m linear functionals with respect to the poses of a trajectory, sparse over the poses: m × 6 per
/// pose over (δφ rad in the body frame with R ← R Exp(δφ), δp m in the world).
#[derive(Debug, Clone, PartialEq)]
pub struct PoseGradient {
    rows: usize,
    slot: Vec<u32>,
    values: Vec<f64>,
}

impl PoseGradient {
    /// A gradient of zero, for `rows` functionals of a trajectory of `nodes` nodes.
    pub fn new(rows: usize, nodes: usize) -> Self {
        Self {
            rows,
            slot: vec![NONE; nodes],
            values: Vec::new(),
        }
    }

    /// Number of functionals m.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The m × 6 block of `node`, row by row, to be added to.
    ///
    /// # Panics
    /// Where `node` is not below the number of nodes.
    pub fn block_mut(&mut self, node: usize) -> &mut [f64] {
        let size = self.rows * POSE;
        if self.slot[node] == NONE {
            self.slot[node] = (self.values.len() / size.max(1)) as u32;
            self.values.resize(self.values.len() + size, 0.0);
        }
        let start = self.slot[node] as usize * size;
        &mut self.values[start..start + size]
    }

    /// Adds an m × 6 block (row by row) to `node`.
    ///
    /// # Panics
    /// Where `node` is not below the number of nodes.
    pub fn add(&mut self, node: usize, block: &[f64]) {
        debug_assert_eq!(block.len(), self.rows * POSE);
        for (x, b) in self.block_mut(node).iter_mut().zip(block) {
            *x += b;
        }
    }

    fn block(&self, node: usize) -> Option<&[f64]> {
        let slot = self.slot[node];
        let size = self.rows * POSE;
        let start = slot as usize * size;
        (slot != NONE).then(|| &self.values[start..start + size])
    }
}

/// The joint covariance of all poses, as the factor of H = Uᵀ U at the solution and the relation of
/// the poses to the nodes. Propagates any linear functional of the poses with the full correlation in time.
#[derive(Debug, Clone)]
pub struct PosteriorCovariance {
    factor: ChainFactor,
    graph: Graph,
    state: State,
    imu: ImuSeries,
}

impl PosteriorCovariance {
    pub(super) fn new(factor: ChainFactor, graph: Graph, state: State, imu: ImuSeries) -> Self {
        Self {
            factor,
            graph,
            state,
            imu,
        }
    }

    /// The graph, its solution, and the IMU's samples, for problems that have other unknowns too.
    pub(crate) fn parts(&self) -> (&Graph, &State, &ImuSeries) {
        (&self.graph, &self.state, &self.imu)
    }

    /// The factor of the normal equations.
    pub(super) fn factor(&self) -> &ChainFactor {
        &self.factor
    }

    /// Number of poses of the trajectory.
    pub fn nodes(&self) -> usize {
        self.graph.timeline.pose_s.len()
    }

    /// The covariance G H⁻¹ Gᵀ (m × m) of the functionals with this gradient, by one forward
    /// substitution. Units are those of the functionals, squared. The scatter of poses between nodes
    /// about what the nodes determine is left out: it is independent from step to step and below
    /// a hundredth of the common part.
    ///
    /// # Panics
    /// Where the gradient was made for another number of poses.
    pub fn of_functional(&self, gradient: &PoseGradient) -> DMatrix<f64> {
        assert_eq!(
            gradient.slot.len(),
            self.nodes(),
            "gradient of another trajectory"
        );
        self.factor.of_functional(&self.by_unknowns(gradient))
    }

    /// The gradient with respect to the unknowns of the chain, from that with respect to the poses.
    fn by_unknowns(&self, gradient: &PoseGradient) -> ChainGradient {
        let layout = &self.factor.layout;
        let m = gradient.rows;
        let steps: Vec<Vec<[f64; STEP]>> = (0..layout.steps())
            .into_par_iter()
            .map(|step| self.by_step(gradient, step))
            .collect();
        let mut by_unknowns = ChainGradient::new(m, layout, self.factor.border());
        for (step, rows) in steps
            .iter()
            .enumerate()
            .filter(|(_, rows)| !rows.is_empty())
        {
            let add = |target: &mut [f64], from: usize, width: usize| {
                for (row, values) in target.chunks_exact_mut(width).zip(rows) {
                    for (x, value) in row.iter_mut().zip(&values[from..]) {
                        *x += value;
                    }
                }
            };
            add(by_unknowns.node_mut(step), 0, NODE);
            add(by_unknowns.node_mut(step + 1), NODE, NODE);
            let bias = layout.segment_of_step[step] as usize;
            add(by_unknowns.segment_mut(bias), 2 * NODE, BIAS);
        }
        by_unknowns
    }

    /// The gradient with respect to the unknowns of one step, m rows; empty where it is zero for all poses
    /// of the step.
    fn by_step(&self, gradient: &PoseGradient, step: usize) -> Vec<[f64; STEP]> {
        let poses = self.graph.timeline.poses_of(step);
        if poses.clone().all(|pose| gradient.block(pose).is_none()) {
            return Vec::new();
        }
        let mut rows = vec![[0.0; STEP]; gradient.rows];
        let recovery = Recovery {
            graph: &self.graph,
            state: &self.state,
            imu: &self.imu,
        };
        recovery.step(step, |pose| {
            if let Some(block) = gradient.block(pose.pose) {
                for (row, values) in rows.iter_mut().zip(block.chunks_exact(POSE)) {
                    pose.pull_back(values, row);
                }
            }
        });
        rows
    }
}
