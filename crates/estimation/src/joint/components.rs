//! Variance components: the test of each group's noise by Ω = Σ r² over the redundancy
//! Σ (1 − j H⁻¹ jᵀ).

use super::problem::JointProblem;
use super::row::{Row, RowBatch};
use super::state::State;
use crate::statistics::drawn_sign;

/// Number of random sign vectors; each gives the trace with a standard deviation of √(2 tr ((J H⁻¹ Jᵀ)²)).
pub const PROBES: usize = 8;
/// Groups with less redundancy keep their standard deviations.
const MIN_REDUNDANCY: f64 = 30.0;
/// So do groups whose redundancy is less than this many standard deviations of the probes.
const PROBE_SIGMAS: f64 = 4.0;

/// Largest Newton step in ln s² (ln 4), unless the noise itself is larger by more.
pub const MAX_STEP: f64 = 1.386;
/// Largest exponent n/r of a step: with little redundancy, r falls with the scale, and the full step overshoots.
const MAX_EXPONENT: f64 = 3.0;

/// The variance component of a group.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Component {
    /// Number of rows.
    pub rows: usize,
    /// Ω: weighted sum of squared normalised residuals.
    pub chi_square: f64,
    /// Redundancy: the number of rows that check the others.
    pub redundancy: f64,
    /// Sum of the squares of the rows' redundancies.
    pub squares: f64,
}

impl Component {
    /// Ω over the redundancy: 1 if the standard deviations are right; `None` if nothing checks the
    /// group.
    pub fn ratio(&self) -> Option<f64> {
        (self.redundancy > 1.0).then(|| self.chi_square / self.redundancy)
    }

    /// Whether its redundancy is significantly larger than zero, given the error of the probes.
    fn is_redundant(&self) -> bool {
        let trace = (self.rows as f64 - self.redundancy).max(0.0);
        let probe_sigma = (2.0 * trace / PROBES as f64).sqrt();
        self.redundancy > MIN_REDUNDANCY.max(PROBE_SIGMAS * probe_sigma)
    }

    /// The factor on the standard deviation by a Newton step in ln s² of at least `least`, for this ratio of the squares of
    /// residuals to those expected. The redundancies change with the scale, ∂ ln(Ω/r) / ∂ ln s² = −Σ rᵢ² / Σ rᵢ to first
    /// order over the redundancies rᵢ of rows that do not share unknowns.
    pub fn newton(&self, ratio: f64, least: f64) -> f64 {
        let exponent = (self.redundancy / self.squares).clamp(1.0, MAX_EXPONENT);
        let most = ratio.ln().max(MAX_STEP);
        (0.5 * (ratio.ln() * exponent).clamp(least, most)).exp()
    }

    /// Both groups together.
    pub fn and(&self, other: &Self) -> Self {
        Self {
            rows: self.rows + other.rows,
            chi_square: self.chi_square + other.chi_square,
            redundancy: self.redundancy + other.redundancy,
            squares: self.squares + other.squares,
        }
    }
}

/// The sign of a row or unknown in a probe.
pub fn sign(probe: usize, row: usize) -> f64 {
    drawn_sign((probe as u64) << 48 | row as u64)
}

/// Visits every row with its number and the places of its unknowns.
fn each_row(
    problem: &JointProblem<'_>,
    state: &State,
    mut take: impl FnMut(usize, &Row<'_>, &[usize]),
) {
    let mut number = 0;
    let mut places = Vec::new();
    problem.visit(state, |batch: &RowBatch| {
        for row in batch.rows() {
            problem.places(&row, &mut places);
            take(number, &row, &places);
            number += 1;
        }
    });
}

/// The component of each group at a state, with the factor that the problem holds, at this state or at one nearby.
/// The traces are computed at the factor's own state: derivatives at another state would involve directions that are
/// nearly free in the factor, such as slopes across a narrow strip. They are estimated with probes, because
/// E zᵀ J H⁻¹ Jᵀ z over random signs z is the trace (Hutchinson 1990).
pub fn components(problem: &JointProblem<'_>, state: &State) -> Vec<Component> {
    let mut all = vec![Component::default(); problem.groups.names.len()];
    let (Some(factor), Some(factored)) = (problem.factor(), problem.factored()) else {
        return all;
    };
    let unknowns = problem.unknowns();
    let mut sides = vec![0.0; unknowns * PROBES];
    each_row(problem, factored, |number, row, places| {
        let root = row.weight.sqrt();
        for (probe, side) in sides.chunks_exact_mut(unknowns).enumerate() {
            let z = sign(probe, number) * root;
            for (place, by) in places.iter().zip(row.by) {
                side[*place] += z * by;
            }
        }
    });
    factor.solve(&mut sides, PROBES);
    each_row(problem, factored, |number, row, places| {
        let root = row.weight.sqrt();
        // Of the probes with even and with odd numbers.
        let mut halves = [0.0; 2];
        for (probe, side) in sides.chunks_exact(unknowns).enumerate() {
            let terms = places
                .iter()
                .zip(row.by)
                .map(|(place, by)| side[*place] * by);
            halves[probe % 2] += sign(probe, number) * root * terms.sum::<f64>();
        }
        let component = &mut all[row.group];
        if row.weight > 0.0 {
            component.rows += 1;
            let [a, b] = halves.map(|leverage| 1.0 - 2.0 * leverage / PROBES as f64);
            component.redundancy += 0.5 * (a + b);
            // The errors of both are independent.
            component.squares += a * b;
        }
    });
    problem.visit_residuals(state, |batch| {
        for row in batch.rows() {
            all[row.group].chi_square += row.weight * row.residual * row.residual;
        }
    });
    all
}

/// Scales the noise of scans and reference to their residuals (Förstner 1979). The redundancy r of n
/// rows changes with the scale: ∂ ln(Ω/r) / ∂ ln s² = −r/n to first order, so a Newton step takes s² to
/// s² (Ω/r)^(n/r). Returns the relative change, root mean square over rows.
///
/// With knots, the variance that they leave out is also noise, but is not estimated here: the noise then only rises.
pub fn rescale(problem: &mut JointProblem<'_>, components: &[Component]) -> f64 {
    let least = if problem.layout.knots.is_empty() {
        -MAX_STEP
    } else {
        0.0
    };
    let (mut rows, mut squares) = (0.0, 0.0);
    for (group, component) in components.iter().enumerate() {
        if problem.groups.is_estimated(group) && component.is_redundant() {
            let ratio = component.chi_square / component.redundancy;
            let factor = component.newton(ratio, least);
            problem.groups.scale[group] *= factor;
            rows += component.rows as f64;
            squares += component.rows as f64 * (factor - 1.0).powi(2);
        }
    }
    problem.forget_factor();
    if rows > 0.0 {
        (squares / rows).sqrt()
    } else {
        0.0
    }
}
