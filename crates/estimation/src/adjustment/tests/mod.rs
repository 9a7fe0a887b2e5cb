mod case;
mod problem;

use crate::adjustment::chain::{CHUNK, NotPositive};
use crate::adjustment::front::{Carry, ChangeFront, StepFront, TailFront};
use crate::adjustment::functional::ChainGradient;
use crate::adjustment::layout::{NODE, SEGMENT, STEP};
use crate::adjustment::prior::BorderPrior;
use crate::adjustment::sparse::BlockPattern;
use crate::adjustment::system::{BorderSystem, StepSystem};
use case::Case;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn cases() -> Vec<Case> {
    [0, 1, 4]
        .into_iter()
        .flat_map(|n| {
            [
                Case::new(&[0], n, 0.0),
                Case::new(&[0, 0, 1, 2, 2], n, 0.0),
                Case::new(&[0, 1, 1, 1, 2], n, 0.5),
            ]
        })
        .collect()
}

/// More steps than a chunk.
fn long_case(n: usize) -> Case {
    let segments: Vec<u32> = (0..CHUNK as u32 + 9).map(|i| i / 7).collect();
    Case::new(&segments, n, 0.0)
}

/// Rounding in well-conditioned systems of up to 2,700 unknowns.
const TOLERANCE: f64 = 1e-9;

#[test]
fn solution_agrees_with_dense_cholesky() {
    for case in cases() {
        let dense = case.h.clone().cholesky().expect("positive definite");
        assert_solution(&case, &dense.solve(&case.g));
    }
}

/// The dense reference is one block of the sparse factor: nalgebra's decomposition of as many unknowns takes a seventh of
/// the time of this crate's tests.
#[test]
fn solutions_over_several_chunks_agree_with_one_dense_block() {
    for case in [long_case(0), long_case(3)] {
        let mut system = BlockPattern::new(vec![case.g.len()]).analyse(1);
        system.add(system.slot(0, 0), case.h.as_slice());
        let factor = system.factorise(&[]).expect("positive definite");
        let mut dense = case.g.clone();
        factor.solve(dense.as_mut_slice(), 1);
        assert_solution(&case, &dense);
    }
}

fn assert_solution(case: &Case, dense: &DVector<f64>) {
    let factor = case.factor().expect("positive definite");
    let solution = case.solve();
    let (nodes, segments) = (
        solution.nodes.as_flattened(),
        solution.segments.as_flattened(),
    );
    let unknowns = [nodes, segments, &solution.border].concat();
    assert_eq!(unknowns.len(), dense.len());
    for (i, x) in unknowns.iter().enumerate() {
        assert!((x - dense[i]).abs() < TOLERANCE * dense.amax(), "{i}");
    }
    let decrement = case.g.dot(dense);
    assert!((factor.decrement() - decrement).abs() < TOLERANCE * decrement);
}

#[test]
fn marginals_agree_with_dense_inverse() {
    for case in cases() {
        let (factor, n) = (case.factor().expect("positive definite"), case.count());
        let dense = case.inverse();
        let tolerance = TOLERANCE * dense.amax();
        let mut visited = Vec::new();
        factor.marginals(|step, covariance| {
            visited.push(step);
            let joint = covariance.joint();
            assert_eq!(joint.cross.len(), STEP * n);
            for (a, row) in joint.unknowns.iter().enumerate() {
                let place = case.place(step, a);
                for (b, computed) in row.iter().enumerate() {
                    let expected = dense[(place, case.place(step, b))];
                    assert!((computed - expected).abs() < tolerance, "{step} {a} {b}");
                }
                for c in 0..n {
                    let expected = dense[(place, case.border_at(c))];
                    let computed = joint.cross[a * n + c];
                    assert!(
                        (computed - expected).abs() < tolerance,
                        "{step} {a} border {c}"
                    );
                }
            }
        });
        let expected: Vec<usize> = (0..case.layout.steps()).rev().collect();
        assert_eq!(visited, expected);
    }
}

#[test]
fn covariance_of_the_border_agrees_with_dense_inverse() {
    for case in cases() {
        let dense = case.inverse();
        let (n, at) = (case.count(), case.border_at(0));
        let expected = dense.view((at, at), (n, n));
        let factor = case.factor().expect("positive definite");
        let difference = factor.border_covariance() - expected;
        assert_eq!(difference.shape(), (n, n));
        for x in &difference {
            assert!(x.abs() < TOLERANCE * expected.amax());
        }
    }
}

/// m × width random values.
fn random_block(random: &mut ChaCha8Rng, rows: usize, width: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, width, |_, _| random.random_range(-1.0..1.0))
}

/// Adds a block to a dense gradient and, row by row, to a sparse one.
fn add_to_both(full: &mut DMatrix<f64>, at: usize, sparse: &mut [f64], block: &DMatrix<f64>) {
    let (rows, width) = block.shape();
    let mut target = full.view_mut((0, at), (rows, width));
    target += block;
    for (x, value) in sparse.iter_mut().zip(block.transpose().iter()) {
        *x += value;
    }
}

#[test]
fn functionals_of_all_unknowns_agree_with_dense_inverse() {
    let rows = 4;
    for case in cases() {
        let (factor, n) = (case.factor().expect("positive definite"), case.count());
        let dense = case.inverse();
        let (nodes, segments) = (case.layout.nodes(), case.layout.segments());
        let mut random = ChaCha8Rng::seed_from_u64(9);
        // Selected nodes and segments: a segment before and after the first node, and none at all.
        let selections = [
            (vec![nodes / 2, nodes - 1, nodes / 2], vec![]),
            (vec![nodes - 1], vec![0, segments / 2]),
            (vec![0], vec![segments - 1]),
            (vec![], vec![segments - 1]),
            (vec![], vec![]),
        ];
        for ((at_nodes, at_segments), with_border) in
            selections.iter().flat_map(|s| [(s, false), (s, true)])
        {
            let mut gradient = ChainGradient::new(rows, &case.layout, n);
            let mut full = DMatrix::zeros(rows, case.g.len());
            for &node in at_nodes {
                let block = random_block(&mut random, rows, NODE);
                add_to_both(&mut full, node * NODE, gradient.node_mut(node), &block);
            }
            for &segment in at_segments {
                let block = random_block(&mut random, rows, SEGMENT);
                let at = case.segment_at(segment);
                add_to_both(&mut full, at, gradient.segment_mut(segment), &block);
            }
            if with_border {
                let block = random_block(&mut random, rows, n);
                let at = case.border_at(0);
                add_to_both(&mut full, at, gradient.border_mut(), &block);
            }
            let expected = &full * &dense * full.transpose();
            let difference = factor.of_functional(&gradient) - &expected;
            assert!(difference.amax() <= TOLERANCE * expected.amax());
        }
    }
}

/// A border without couplings does not change the solution of the chain by a single bit.
#[test]
fn a_border_that_touches_nothing_changes_nothing() {
    let alone = Case::new(&[0, 0, 1], 0, 0.1);
    let mut beside = Case::new(&[0, 0, 1], 0, 0.1);
    beside.borders.fill(BorderSystem::new(2));
    beside.border = BorderPrior {
        weight: vec![4.0, 9.0],
        miss: vec![1.0, 2.0],
    };
    beside.border_damping = vec![0.0; 2];
    let (alone, beside) = (alone.solve(), beside.solve());
    assert_eq!(
        (alone.nodes, alone.segments),
        (beside.nodes, beside.segments)
    );
    let expected = [-1.0, -2.0];
    for (computed, expected) in beside.border.iter().zip(expected) {
        assert!((computed - expected).abs() < TOLERANCE);
    }
}

/// Eliminating step by step with [`Carry`], as an online smoother does, gives the same fronts.
#[test]
fn fronts_eliminated_one_by_one_are_those_of_the_batch() {
    let case = Case::new(&[0, 0, 1, 2, 2], 0, 0.0);
    let factor = case.factor().expect("positive definite");
    let mut carry = Carry::new(&case.prior);
    for i in 0..case.layout.steps() {
        if case.layout.changes_before(i) {
            let old = case.layout.segment_of_step[i] as usize - 1;
            let mut front = ChangeFront::ZERO;
            assert!(carry.change_segment(&case.walks[old], &case.damping, &mut front));
            assert_eq!(&front, factor.change(old).0);
        }
        let mut front = StepFront::ZERO;
        assert!(carry.eliminate_step(&mut case.steps[i].clone(), &case.damping, &mut front));
        // Entries below the diagonal are not read, and not compared.
        for a in 0..NODE {
            assert_eq!(front.rows[a][a..], factor.step(i).0.rows[a][a..]);
        }
        assert_eq!(front.y, factor.step(i).0.y);
    }
    let mut tail = TailFront::ZERO;
    assert!(carry.eliminate_tail(&case.damping, &mut tail));
    assert_eq!(tail.y, factor.tail().0.y);
}

#[test]
fn each_alone_is_the_solution_without_the_other_columns() {
    let case = Case::new(&[0, 0, 1, 2], 4, 0.1);
    let factor = case.factor().expect("positive definite");
    let first = 1;
    for (i, (step, sigma)) in factor.each_alone(first).into_iter().enumerate() {
        // The dense system without the other columns.
        let others = (first..4).filter(|c| *c != first + i);
        let gone: Vec<usize> = others.map(|c| case.border_at(c)).collect();
        let h = case
            .h
            .clone()
            .remove_rows_at(&gone)
            .remove_columns_at(&gone);
        let g = case.g.clone().remove_rows_at(&gone);
        let place = case.border_at(first);
        let inverse = h.try_inverse().expect("regular");
        let expected = (&inverse * g)[place];
        assert!((step - expected).abs() < TOLERANCE * expected.abs().max(1.0));
        let expected = inverse[(place, place)].sqrt();
        assert!((sigma - expected).abs() < TOLERANCE * expected);
    }
}

#[test]
fn one_thread_and_two_give_the_same_bits() {
    for case in [long_case(0), long_case(4)] {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("a pool");
            let factor = pool.install(|| case.factor().expect("positive definite"));
            let tail = factor.tail().0.rows;
            (tail, factor.decrement(), factor.border_covariance())
        };
        assert_eq!(run(1), run(2));
    }
}

#[test]
fn an_unknown_that_is_not_determined_is_named() {
    let mut case = Case::new(&[0, 0, 0], 0, 0.0);
    // Only node 0 has a prior: step 1 starts without information and adds none.
    case.steps.fill(StepSystem::ZERO);
    assert_eq!(case.factor().err(), Some(NotPositive::Node(1)));
    let mut case = Case::new(&[0, 0, 0], 2, 0.0);
    // Column 1 touches nothing and has no prior.
    for border in &mut case.borders {
        border.h[1].fill(0.0);
        border.c[1] = 0.0;
        border.c[3] = 0.0;
    }
    case.border.weight[1] = 0.0;
    assert_eq!(case.factor().err(), Some(NotPositive::Border(1)));
}
