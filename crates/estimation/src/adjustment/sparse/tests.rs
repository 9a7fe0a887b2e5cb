//! Tests against dense algebra on random structures, and the run time on a structure like a survey's.

use super::dissection::nested_dissection;
use super::structure::NotPositiveBlock;
use super::{BlockPattern, SparseFactor, SparseSystem};
use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Instant;

/// A system and the same H as a dense matrix.
struct Case {
    sizes: Vec<usize>,
    system: SparseSystem,
    dense: DMatrix<f64>,
    rng: ChaCha8Rng,
}

impl Case {
    /// Blocks of 1 to 9 unknowns. Each factor touches a few blocks that are near to each other, and all of the
    /// last ones.
    fn random(seed: u64, blocks: usize, constants: usize) -> Self {
        Self::with_factors(seed, blocks, constants, 3 * blocks)
    }

    fn with_factors(seed: u64, blocks: usize, constants: usize, factors: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let sizes: Vec<usize> = (0..blocks)
            .map(|_| [9, 6, 3, 1][rng.random_range(0..4)])
            .collect();
        let last = blocks - constants;
        let mut factors: Vec<Vec<usize>> = (0..factors)
            .map(|_| {
                let around = rng.random_range(0..last);
                let mut touched: Vec<usize> = (0..rng.random_range(0..4))
                    .map(|_| (around + rng.random_range(0..6)) % last)
                    .chain(last..blocks)
                    .collect();
                touched.insert(touched.len() / 2, around);
                touched
            })
            .collect();
        // A pair far apart, and a block on its own.
        factors.push(vec![last - 1, 0]);
        factors.retain(|touched| !touched.contains(&(last / 2)));
        let mut pattern = BlockPattern::new(sizes.clone());
        for touched in &factors {
            pattern.couple(touched);
        }
        let mut system = pattern.analyse(last);
        let n = system.unknowns();
        let mut dense = DMatrix::zeros(n, n);
        for block in 0..blocks {
            let weight = DMatrix::identity(sizes[block], sizes[block]) * 0.1;
            add(&mut system, &mut dense, &sizes, block, block, &weight);
        }
        for touched in &mut factors {
            touched.sort_unstable();
            touched.dedup();
            let rows = rng.random_range(1..5);
            let jacobians: Vec<DMatrix<f64>> = touched
                .iter()
                .map(|&block| {
                    DMatrix::from_fn(rows, sizes[block], |_, _| rng.random_range(-1.0..1.0))
                })
                .collect();
            for (i, &a) in touched.iter().enumerate() {
                for (j, &b) in touched.iter().enumerate().skip(i) {
                    let product = jacobians[i].tr_mul(&jacobians[j]);
                    // In either order.
                    if (i + j) % 2 == 0 {
                        add(&mut system, &mut dense, &sizes, a, b, &product);
                    } else {
                        add(&mut system, &mut dense, &sizes, b, a, &product.transpose());
                    }
                }
            }
        }
        Self {
            sizes,
            system,
            dense,
            rng,
        }
    }

    fn sides(&mut self, count: usize) -> DMatrix<f64> {
        let rng = &mut self.rng;
        DMatrix::from_fn(self.dense.nrows(), count, |_, _| {
            rng.random_range(-1.0..1.0)
        })
    }

    fn factor(&mut self) -> SparseFactor {
        self.system.factorise(&[]).expect("positive definite")
    }

    fn inverse(&self) -> DMatrix<f64> {
        let dense = Cholesky::new(self.dense.clone()).expect("positive definite");
        dense.inverse()
    }
}

fn add(
    system: &mut SparseSystem,
    dense: &mut DMatrix<f64>,
    sizes: &[usize],
    a: usize,
    b: usize,
    values: &DMatrix<f64>,
) {
    let by_rows = values.transpose();
    system.add(system.slot(a, b), by_rows.as_slice());
    let (i, j) = (system.offset(a), system.offset(b));
    let mut block = dense.view_mut((i, j), (sizes[a], sizes[b]));
    block += values;
    if a != b {
        let mut block = dense.view_mut((j, i), (sizes[b], sizes[a]));
        block += by_rows;
    }
}

fn assert_near(computed: &DMatrix<f64>, expected: &DMatrix<f64>, what: &str) {
    let error = (computed - expected).norm() / expected.norm();
    assert!(error < 1e-10, "{what}: relative error {error:e}");
}

fn cases() -> impl Iterator<Item = Case> {
    // The last supernode of the last one is of several tiles.
    let shapes = [(3, 0), (4, 1), (12, 3), (30, 0), (60, 5), (90, 2), (80, 50)];
    (0..)
        .zip(shapes)
        .map(|(seed, (blocks, constants))| Case::random(seed, blocks, constants))
}

#[test]
fn products_and_solutions_agree_with_dense_algebra() {
    for mut case in cases() {
        let sides = case.sides(3);
        let product = case.system.multiply(sides.column(0).as_slice());
        let expected = &case.dense * sides.column(0);
        assert_near(
            &DMatrix::from_column_slice(product.len(), 1, &product),
            &DMatrix::from_column_slice(product.len(), 1, expected.as_slice()),
            "product",
        );
        assert_eq!(case.system.diagonal(), case.dense.diagonal().as_slice());

        let factor = case.factor();
        let inverse = case.inverse();
        let mut solution = sides.clone();
        factor.solve(solution.as_mut_slice(), 3);
        assert_near(&solution, &(&inverse * &sides), "solution");
    }
}

#[test]
fn a_factorisation_multiplies_half_the_squares_of_the_heights() {
    // Two blocks that are coupled, so that columns are 5 to 1 high, and one on its own.
    let mut pattern = BlockPattern::new(vec![2, 3, 4]);
    pattern.couple(&[0, 1]);
    let system = pattern.analyse(3);
    let expected = 0.5 * f64::from(25 + 16 + 9 + 4 + 1 + 16 + 9 + 4 + 1);
    assert_eq!(system.factor_products(), expected);
}

#[test]
fn any_structure_is_solved() {
    for seed in 0..300 {
        let blocks = 2 + seed as usize % 14;
        let constants = seed as usize % 3 % blocks;
        let mut case = Case::with_factors(seed, blocks, constants, seed as usize % 23);
        let sides = case.sides(1);
        let mut solution = sides.clone();
        case.factor().solve(solution.as_mut_slice(), 1);
        assert_near(&(&case.dense * solution), &sides, "right-hand side");
    }
}

#[test]
fn selected_inverse_is_the_inverse_where_the_factor_has_entries() {
    for mut case in cases() {
        let selected = case.factor().selected_inverse(|_| true);
        let inverse = case.inverse();
        for a in 0..case.sizes.len() {
            for b in 0..case.sizes.len() {
                let (i, j) = (case.system.offset(a), case.system.offset(b));
                let size = (case.sizes[a], case.sizes[b]);
                let coupled = case.dense.view((i, j), size).iter().any(|x| *x != 0.0);
                let entries = selected.block(a, b);
                assert!(
                    entries.is_some() || !coupled,
                    "blocks {a} and {b} are coupled"
                );
                if let Some(entries) = entries {
                    let error = (entries - inverse.view((i, j), size)).norm();
                    assert!(
                        error < 1e-10 * inverse.norm(),
                        "blocks {a} and {b}: {error:e}"
                    );
                }
            }
        }
    }
}

#[test]
fn requested_blocks_alone_have_the_same_covariance() {
    let mut withheld = 0;
    for mut case in cases() {
        let factor = case.factor();
        let all = factor.selected_inverse(|_| true);
        let is_requested = |block: usize| block.is_multiple_of(3);
        let some = factor.selected_inverse(is_requested);
        for a in 0..case.sizes.len() {
            for b in 0..case.sizes.len() {
                let entries = some.block(a, b);
                if is_requested(a) && is_requested(b) {
                    assert_eq!(entries, all.block(a, b), "blocks {a} and {b}");
                }
                withheld += usize::from(entries.is_none() && all.block(a, b).is_some());
            }
        }
    }
    assert!(withheld > 0, "nothing is left out");
}

#[test]
fn damping_is_added_to_the_diagonal_and_memory_is_used_again() {
    let mut case = Case::random(7, 40, 2);
    let sides = case.sides(1);
    let damping: Vec<f64> = sides.iter().map(|x| x.abs() * 5.0).collect();
    let mut factor = case.factor();
    case.system
        .factorise_into(&damping, &mut factor)
        .expect("positive definite");
    let damped = &case.dense + DMatrix::from_diagonal(&DVector::from_vec(damping));
    let expected = Cholesky::new(damped)
        .expect("positive definite")
        .solve(&sides);
    let mut solution = sides.clone();
    factor.solve(solution.as_mut_slice(), 1);
    assert_near(&solution, &expected, "damped solution");

    case.system.gradient_mut().copy_from_slice(sides.as_slice());
    assert_eq!(case.system.gradient(), sides.as_slice());
    case.system.zero();
    assert!(case.system.gradient().iter().all(|x| *x == 0.0));
    assert!(case.system.diagonal().iter().all(|x| *x == 0.0));
    assert!(case.system.factorise_into(&[], &mut factor).is_err());
    let ones = vec![1.0; case.system.unknowns()];
    case.system
        .factorise_into(&ones, &mut factor)
        .expect("the identity");
    let mut solution = sides.clone();
    factor.solve(solution.as_mut_slice(), 1);
    assert_eq!(solution, sides);
}

#[test]
fn blocks_kept_to_the_end_are_eliminated_last_in_their_order() {
    for constants in [1, 2, 6] {
        let mut case = Case::random(3, 40, constants);
        let factor = case.factor();
        let n = case.system.unknowns();
        let count = (40 - constants..40).map(|block| case.sizes[block]).sum();
        let covariance = case
            .inverse()
            .view_range(n - count.., n - count..)
            .into_owned();
        let step = DMatrix::from_fn(count, 1, |i, _| (1.0 + i as f64).sin());
        let solved = covariance.lu().solve(&step).expect("regular");
        let expected = step.tr_mul(&solved);
        let length = factor.last_squared_length(step.as_slice());
        assert_near(&DMatrix::from_element(1, 1, length), &expected, "length");
    }
}

#[test]
fn dissection_lists_each_block_once_and_halves_before_their_separator() {
    // Two runs of blocks that are coupled only by the last block.
    let mut later: Vec<Vec<u32>> = (0..400).map(|k| vec![k + 1, 400]).collect();
    later[199] = vec![400];
    later[399] = vec![400];
    later.push(Vec::new());
    let mut order = nested_dissection(&later, &[3; 401]);
    assert!(
        order[300..].contains(&400),
        "the last block parts the others"
    );
    order.sort_unstable();
    assert!(order.iter().copied().eq(0..401));
    assert!(nested_dissection(&later, &[]).is_empty());
    assert_eq!(nested_dissection(&later, &[6]), [0]);
}

#[test]
fn block_whose_pivot_fails_is_named() {
    for (block, value) in [
        (0, -1e3),
        (5, -1e3),
        (17, f64::NAN),
        (28, f64::INFINITY),
        (39, -1e6),
    ] {
        let mut case = Case::random(11, 40, 3);
        let size = case.sizes[block];
        let slot = case.system.slot(block, block);
        let mut values = vec![0.0; size * size];
        values[0] = value;
        case.system.add(slot, &values);
        let failed = case.system.factorise(&[]).map(|_| ());
        assert_eq!(failed, Err(NotPositiveBlock(block)));
    }
}

#[test]
fn nan_entries_fail_the_factorisation() {
    let mut case = Case::random(12, 40, 3);
    let size = case.sizes[1] * case.sizes[39];
    let slot = case.system.slot(1, 39);
    case.system.add(slot, &vec![f64::NAN; size]);
    assert!(case.system.factorise(&[]).is_err());
}

#[test]
fn system_without_unknowns_has_a_factor() {
    let mut system = BlockPattern::new(Vec::new()).analyse(0);
    let factor = system.factorise(&[]).expect("nothing to fail");
    factor.solve(&mut [], 1);
    assert_eq!(factor.last_squared_length(&[]), 0.0);
    factor.selected_inverse(|_| true);
}

#[test]
#[should_panic(expected = "only coupled blocks")]
fn blocks_that_are_not_coupled_have_no_slot() {
    let mut pattern = BlockPattern::new(vec![3, 3, 3]);
    pattern.couple(&[0, 1]);
    pattern.analyse(3).slot(2, 0);
}

/// The sizes of the blocks of a typical survey, the index of the first constant, and the blocks of each
/// factor: a route of lanes back and forth, and patches beside each other, each seen from some of the
/// lanes for `visit` steps.
fn survey(visit: usize) -> (Vec<usize>, usize, Vec<Vec<usize>>) {
    const LANES: usize = 5;
    let (steps, patches) = (3700, 18_000);
    let length = steps / LANES;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut sizes = vec![9; steps + 1];
    sizes.resize(sizes.len() + steps, 6);
    sizes.resize(sizes.len() + patches, 3);
    let last = sizes.len();
    sizes.resize(last + 30, 1);
    let (first_bias, first_patch) = (steps + 1, 2 * steps + 1);
    let mut factors = Vec::new();
    for step in 0..steps {
        let next = (first_bias + step + 1).min(first_patch - 1);
        factors.push(vec![step, step + 1, first_bias + step, next]);
    }
    for patch in 0..patches {
        let at = patch * length / patches;
        let seen = rng.random_range(3..=LANES);
        let first = rng.random_range(0..=LANES - seen);
        for lane in first..first + seen {
            let along = if lane % 2 == 0 { at } else { length - 1 - at };
            let along = (along + rng.random_range(0..3)).min(length - visit);
            for step in lane * length + along..lane * length + along + visit {
                factors.push(vec![step, step + 1, first_bias + step, first_patch + patch]);
            }
        }
    }
    for factor in &mut factors {
        factor.dedup();
        factor.extend(last..last + 30);
    }
    (sizes, last, factors)
}

/// As [`survey`], and a lidar that sees each of other patches from many steps.
fn survey_with_lidar() -> (Vec<usize>, usize, Vec<Vec<usize>>) {
    const PATCHES: usize = 20_000;
    let (mut sizes, last, mut factors) = survey(1);
    sizes.splice(last..last, [3; PATCHES]);
    for block in factors.iter_mut().flatten().filter(|block| **block >= last) {
        *block += PATCHES;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for patch in last..last + PATCHES {
        for _ in 0..60 {
            let step = 8 * rng.random_range(0..460);
            let constants = last + PATCHES..sizes.len();
            factors.push(
                [step, step + 1, patch]
                    .into_iter()
                    .chain(constants)
                    .collect(),
            );
        }
    }
    (sizes, last + PATCHES, factors)
}

#[test]
#[ignore = "measures time"]
fn time_of_a_survey() {
    fn timed<T>(what: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        println!("  {what}: {:.3} s", start.elapsed().as_secs_f64());
        result
    }
    for (name, (sizes, last, factors)) in [
        ("one step a visit", survey(1)),
        ("two steps a visit", survey(2)),
        ("with a lidar", survey_with_lidar()),
    ] {
        println!("{name}");
        let mut pattern = BlockPattern::new(sizes.clone());
        timed("coupling", || {
            for factor in &factors {
                pattern.couple(factor);
            }
        });
        let mut system = timed("analysis", || pattern.analyse(last));
        timed("assembly, slots included", || {
            let values = [1e-3; 81];
            for factor in &factors {
                for (i, &a) in factor.iter().enumerate() {
                    for &b in &factor[i..] {
                        let slot = system.slot(a, b);
                        system.add(slot, &values[..sizes[a] * sizes[b]]);
                    }
                }
            }
        });
        let damping = vec![1.0; system.unknowns()];
        let mut factor = timed("factor", || system.factorise(&damping)).expect("positive");
        timed("factor again", || {
            system.factorise_into(&damping, &mut factor)
        })
        .expect("positive");
        let mut sides = vec![1.0; 12 * system.unknowns()];
        timed("solve", || factor.solve(&mut sides[..system.unknowns()], 1));
        timed("12 solves", || factor.solve(&mut sides, 12));
        timed("length of 12", || factor.last_squared_length(&[1.0; 12]));
        timed("selected inverse", || factor.selected_inverse(|_| true));
        println!(
            "  {} unknowns, {:.1} M entries in L",
            system.unknowns(),
            system.factor_entries() as f64 / 1e6
        );
    }
}
