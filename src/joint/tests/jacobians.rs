//! Every derivative of every row against central differences.

use super::case::{Case, Dense, residuals};
use crate::joint::problem::{JointProblem, State};
use nalgebra::DMatrix;

/// Metres, radians, seconds, slopes: second differences of all residuals, divided by their own
/// derivative, are below 10 per unit, so that central differences err by some 1e-9, as does rounding.
const STEP: f64 = 1e-5;

/// Central differences of all residuals by all unknowns.
fn differences(problem: &JointProblem<'_>, state: &State) -> DMatrix<f64> {
    let unknowns = problem.unknowns();
    let mut step = vec![0.0; unknowns];
    let columns: Vec<_> = (0..unknowns)
        .map(|unknown| {
            let mut at = |h: f64| {
                step[unknown] = h;
                residuals(problem, &problem.retracted(state, &step))
            };
            let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
            step[unknown] = 0.0;
            difference
        })
        .collect();
    DMatrix::from_columns(&columns)
}

#[test]
fn survey() {
    for (name, case) in [
        ("full", Case::full()),
        ("plain", Case::plain()),
        ("file", Case::from_file()),
    ] {
        let input = case.input();
        let (problem, state) = case.problem(&input);
        // Off the start.
        let step: Vec<f64> = (0..problem.unknowns())
            .map(|i| 1e-3 * (1.7 * i as f64).sin())
            .collect();
        let state = problem.retracted(&state, &step);
        let t = std::time::Instant::now();
        let dense = Dense::new(&problem, &state);
        println!(
            "{name}: {} unknowns {} rows {} surfels {} patches, steps {}, scan rows {}",
            problem.unknowns(),
            dense.groups.len(),
            problem.found.surfels.len(),
            problem.found.patches,
            state.motions[0].steps(),
            problem.found.drives[0].rows.len()
        );
        let numeric = differences(&problem, &state);
        println!("{:?}", t.elapsed());
        // per group and block kind
        let layout = &problem.layout;
        let kind = |b: usize| -> String {
            if b < layout.first_surfel {
                format!("motion{}", layout.sizes[b])
            } else if b < layout.first_patch {
                "surfel".into()
            } else if Some(b) == layout.reference {
                "reference".into()
            } else if layout.mountings.contains(&b) {
                "mounting".into()
            } else if layout.late.contains(&Some(b)) {
                "late".into()
            } else if b < layout.first_constant {
                "patch".into()
            } else {
                "constant".into()
            }
        };
        let mut worst: std::collections::BTreeMap<(String, String, usize), (f64, f64)> =
            Default::default();
        for block in 0..layout.sizes.len() {
            let first = problem.offset(block);
            for j in 0..layout.sizes[block] {
                for (row, group) in dense.groups.iter().enumerate() {
                    let (a, n) = (dense.jacobian[(row, first + j)], numeric[(row, first + j)]);
                    let e = worst
                        .entry((problem.groups.names[*group].clone(), kind(block), j))
                        .or_default();
                    e.0 = e.0.max((a - n).abs());
                    e.1 = e.1.max(a.abs());
                }
            }
        }
        for (k, (e, m)) in worst {
            if m > 0.0 || e > 0.0 {
                println!("{k:?} error {e:.2e} of {m:.2e}  rel {:.1e}", e / m);
            }
        }
    }
}
