//! The information of residuals on the variance of their factors.

use super::chain::{ChainFactor, ChainStep, ChainSystem};
use super::layout::TAIL;
use super::problem::ChainProblem;
use super::rows::Rows;
use super::system::{BorderSystem, StepSystem, assemble};
use crate::statistics::drawn_sign;

/// Number of random sign vectors; each gives tr R² with a standard deviation of √(2 tr R⁴), some 20 %
/// of it.
const PROBES: u64 = 8;

/// The random sign of a row in a probe.
fn sign(probe: u64, step: usize, row: usize) -> f64 {
    drawn_sign(probe << 48 | (step as u64) << 8 | row as u64)
}

/// tr R² over the rows of the chosen factors, R = I − J H⁻¹ Jᵀ, by |R z|² for random signs z
/// (Hutchinson 1990): the Fisher information of the logarithm of their variance is half of it.
/// `None` if the normal equations are not positive definite.
pub fn residual_information<P: ChainProblem>(
    problem: &P,
    state: &P::State,
    chosen: impl Fn(&P::Source<'_>) -> bool + Sync,
) -> Option<f64> {
    let layout = problem.layout();
    let border = problem.border_prior(state);
    let count = border.weight.len();
    let mut factor = ChainFactor::new(layout.clone(), count);
    let mut x = ChainStep::new(layout, count);
    let mut sum = 0.0;
    for probe in 0..PROBES {
        // The signs of a factor's rows, 0 if it is not chosen; `before` counts the chosen rows before it.
        let signs = |step: usize, before: &mut usize, chosen: bool, rows: &Rows<'_>| {
            let number = rows.residual.len();
            let first = *before;
            *before += if chosen { number } else { 0 };
            let sign = |row| if chosen { sign(probe, step, row) } else { 0.0 };
            (first..first + number).map(sign).collect::<Vec<f64>>()
        };
        factor
            .factorise(&ChainSystem {
                // g = √w Jᵀ z instead of −w Jᵀ r.
                step: &|step, system: &mut StepSystem, border: &mut BorderSystem| {
                    let mut before = 0;
                    problem.rows(state, step, |source, rows| {
                        let mut z = signs(step, &mut before, chosen(&source), &rows);
                        z.iter_mut().for_each(|z| *z /= -rows.weight.sqrt());
                        let rows = Rows {
                            residual: &z,
                            ..rows
                        };
                        assemble(&rows, system, border);
                    });
                },
                walk: &|old| problem.walk(state, old).met(),
                prior: problem.prior(state).met(),
                damping: [0.0; TAIL],
                border: border.clone().met(),
                border_damping: vec![0.0; count],
            })
            .ok()?;
        factor.back_substitute(&mut x);
        for step in 0..layout.steps() {
            let segment = &x.segments[layout.segment_of_step[step] as usize];
            let unknowns = || {
                x.nodes[step]
                    .iter()
                    .chain(&x.nodes[step + 1])
                    .chain(segment)
            };
            let mut before = 0;
            problem.rows(state, step, |source, rows| {
                let chosen = chosen(&source);
                let z = signs(step, &mut before, chosen, &rows);
                if !chosen {
                    return;
                }
                for (i, (row, z)) in rows.by_step.iter().zip(z).enumerate() {
                    let chain: f64 = row.iter().zip(unknowns()).map(|(j, x)| j * x).sum();
                    let border = rows.by_column().map(|(c, by)| by[i] * x.border[c]);
                    let predicted = chain + border.sum::<f64>();
                    sum += (z - rows.weight.sqrt() * predicted).powi(2);
                }
            });
        }
    }
    Some(sum / PROBES as f64)
}
