//! Variance components of the IMU: the ratio of its residuals to its noise.

use super::graph::Graph;
use super::states::State;
use crate::adjustment::ChainFactor;
use crate::statistics::{CHI_SQUARE_1_MEDIAN, median};

/// Visits the whitened residuals of the IMU at every step, each with its redundancy.
fn visit(graph: &Graph, state: &State, factor: &ChainFactor, mut visit: impl FnMut(f64, f64)) {
    let border = factor.border_covariance();
    factor.marginals(|step, marginal| {
        let nodes = (&state.nodes[step], &state.nodes[step + 1]);
        let bias = graph.bias(state, step);
        let rows = graph.imu[step].rows(&state.constants, nodes, bias, graph.imu_scale);
        let redundancies = marginal.joint().redundancies(&rows.weighted(1.0), &border);
        for (residual, redundancy) in rows.residual.iter().zip(redundancies) {
            visit(*residual, redundancy);
        }
    });
}

/// Ω/r of gyro and accelerometer together; `None` where they are not checked.
pub fn imu_mean_component(graph: &Graph, state: &State, factor: &ChainFactor) -> Option<f64> {
    let (mut square, mut redundancy) = (0.0, 0.0);
    visit(graph, state, factor, |residual, r| {
        square += residual * residual;
        redundancy += r;
    });
    (redundancy > 1.0).then(|| square / redundancy)
}

/// The same from the median of the single components, which faults at less than half of the steps
/// do not move: v²/r of each component that others check, over the median of χ² with one degree.
pub fn imu_median_component(graph: &Graph, state: &State, factor: &ChainFactor) -> Option<f64> {
    /// The residuals of components checked less than this are nothing but rounding errors.
    const CHECKED: f64 = 1e-3;
    let mut ratios: Vec<f64> = Vec::with_capacity(9 * state.nodes.len());
    visit(graph, state, factor, |residual, r| {
        if r > CHECKED {
            ratios.push(residual * residual / r);
        }
    });
    median(ratios).map(|median| median / CHI_SQUARE_1_MEDIAN)
}
