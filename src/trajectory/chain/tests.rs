use super::*;
use crate::trajectory::covariance::{PoseGradient, PosteriorCovariance};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A small chain with every shape of front, and the same normal equations assembled densely.
struct Case {
    layout: ChainLayout,
    steps: Vec<StepSystem>,
    walks: Vec<WalkSystem>,
    prior: PriorSystem,
    damping: [f64; TAIL],
    h: DMatrix<f64>,
    g: DVector<f64>,
}

impl Case {
    /// Steps of random full-rank normal equations; biases as listed.
    fn new(bias_of_step: &[u32], damping: f64) -> Self {
        let layout = ChainLayout {
            bias_of_step: bias_of_step.to_vec(),
        };
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut draw = || random.random_range(-1.0..1.0);
        let size = layout.nodes() * NODE + layout.biases() * BIAS;
        let mut h = DMatrix::zeros(size, size);
        let mut g = DVector::zeros(size);
        let node_at = |i: usize| i * NODE;
        let bias_at = |k: usize| layout.nodes() * NODE + k * BIAS;
        let steps = (0..layout.steps())
            .map(|i| {
                let rows = DMatrix::from_fn(12, STEP, |_, _| draw());
                let (step_h, step_g) = (
                    rows.transpose() * &rows,
                    DVector::from_fn(STEP, |_, _| draw()),
                );
                let place = |a: usize| match a {
                    a if a < 2 * NODE => node_at(i) + a,
                    a => bias_at(bias_of_step[i] as usize) + a - 2 * NODE,
                };
                let mut system = StepSystem::ZERO;
                for a in 0..STEP {
                    g[place(a)] += step_g[a];
                    system.g[a] = step_g[a];
                    for b in 0..STEP {
                        h[(place(a), place(b))] += step_h[(a, b)];
                        // Below the diagonal nothing may be read.
                        system.h[a][b] = if a <= b { step_h[(a, b)] } else { 1e30 };
                    }
                }
                system
            })
            .collect();
        let walks: Vec<_> = (1..layout.biases())
            .map(|new| {
                let walk = WalkSystem {
                    weight: std::array::from_fn(|_| 2.0 + draw()),
                    difference: std::array::from_fn(|_| draw()),
                };
                for i in 0..BIAS {
                    let (a, b, w) = (bias_at(new - 1) + i, bias_at(new) + i, walk.weight[i]);
                    h[(a, a)] += w;
                    h[(b, b)] += w;
                    h[(a, b)] -= w;
                    h[(b, a)] -= w;
                    g[a] += w * walk.difference[i];
                    g[b] -= w * walk.difference[i];
                }
                walk
            })
            .collect();
        let prior = PriorSystem {
            weight: std::array::from_fn(|_| 2.0 + draw()),
            g: std::array::from_fn(|_| draw()),
        };
        for a in 0..TAIL {
            let place = if a < NODE { a } else { bias_at(0) + a - NODE };
            h[(place, place)] += prior.weight[a];
            g[place] += prior.g[a];
        }
        let damping = std::array::from_fn(|i| damping * (1.0 + i as f64));
        for i in 0..layout.nodes() {
            (0..NODE).for_each(|a| h[(node_at(i) + a, node_at(i) + a)] += damping[a]);
        }
        for k in 0..layout.biases() {
            (0..BIAS).for_each(|a| h[(bias_at(k) + a, bias_at(k) + a)] += damping[NODE + a]);
        }
        Self {
            layout,
            steps,
            walks,
            prior,
            damping,
            h,
            g,
        }
    }

    fn factor(&self) -> Result<ChainFactor, NotPositive> {
        let mut factor = ChainFactor::new(self.layout.clone());
        factor.factorise(&ChainSystem {
            step: &|i: usize, system: &mut StepSystem| *system = self.steps[i].clone(),
            walk: &|k: usize| self.walks[k],
            prior: self.prior,
            damping: self.damping,
        })?;
        Ok(factor)
    }

    fn bias_at(&self, k: usize) -> usize {
        self.layout.nodes() * NODE + k * BIAS
    }
}

fn cases() -> Vec<Case> {
    vec![
        Case::new(&[0], 0.0),
        Case::new(&[0, 0, 1, 2, 2], 0.0),
        Case::new(&[0, 1, 1, 1, 2], 0.5),
    ]
}

/// More steps than a chunk.
fn long_case() -> Case {
    Case::new(
        &std::array::from_fn::<u32, { CHUNK + 9 }, _>(|i| i as u32 / 7),
        0.0,
    )
}

/// Rounding in well-conditioned systems of up to 1,400 unknowns.
const TOLERANCE: f64 = 1e-9;

#[test]
fn solution_agrees_with_dense_cholesky() {
    for case in cases().into_iter().chain([long_case()]) {
        let factor = case.factor().expect("positive definite");
        let dense = case
            .h
            .clone()
            .cholesky()
            .expect("positive definite")
            .solve(&case.g);
        let mut nodes = vec![[0.0; NODE]; case.layout.nodes()];
        let mut biases = vec![[0.0; BIAS]; case.layout.biases()];
        factor.back_substitute(&mut nodes, &mut biases);
        for (i, x) in nodes
            .as_flattened()
            .iter()
            .chain(biases.as_flattened())
            .enumerate()
        {
            assert!((x - dense[i]).abs() < TOLERANCE * dense.amax(), "{i}");
        }
        let decrement = case.g.dot(&dense);
        assert!((factor.decrement() - decrement).abs() < TOLERANCE * decrement);
    }
}

#[test]
fn marginals_agree_with_dense_inverse() {
    for case in cases() {
        let factor = case.factor().expect("positive definite");
        let dense = case
            .h
            .clone()
            .cholesky()
            .expect("positive definite")
            .inverse();
        let mut visited = 0;
        factor.marginals(|node, covariance| {
            visited += 1;
            let bias = case.bias_at(case.layout.bias_of_node(node));
            let place = |a: usize| {
                if a < NODE {
                    node * NODE + a
                } else {
                    bias + a - NODE
                }
            };
            for a in 0..TAIL {
                for b in 0..TAIL {
                    let expected = dense[(place(a), place(b))];
                    assert!((covariance[a][b] - expected).abs() < TOLERANCE * dense.amax());
                }
            }
        });
        assert_eq!(visited, case.layout.nodes());
    }
}

#[test]
fn functionals_of_distant_poses_agree_with_dense_inverse() {
    for case in cases() {
        let dense = case
            .h
            .clone()
            .cholesky()
            .expect("positive definite")
            .inverse();
        let nodes = case.layout.nodes();
        let mut random = ChaCha8Rng::seed_from_u64(9);
        let rows = 4;
        let mut gradient = PoseGradient::new(rows, nodes);
        let mut full = DMatrix::zeros(rows, case.g.len());
        for node in [nodes / 2, nodes - 1, nodes / 2] {
            let block: Vec<f64> = (0..rows * 6)
                .map(|_| random.random_range(-1.0..1.0))
                .collect();
            gradient.add(node, &block);
            for row in 0..rows {
                for a in 0..6 {
                    full[(row, node * NODE + a)] += block[row * 6 + a];
                }
            }
        }
        let expected = &full * &dense * full.transpose();
        let covariance = PosteriorCovariance::new(case.factor().expect("positive definite"));
        assert_eq!(covariance.nodes(), nodes);
        let found = covariance.of_functional(&gradient);
        assert!((&found - &expected).amax() < TOLERANCE * expected.amax());
        let nothing = covariance.of_functional(&PoseGradient::new(2, nodes));
        assert_eq!(nothing, DMatrix::zeros(2, 2));
    }
}

#[test]
fn one_thread_and_two_give_the_same_bits() {
    let case = long_case();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| case.factor().expect("positive definite").tail_rows)
    };
    assert_eq!(run(1), run(2));
}

#[test]
fn a_free_unknown_is_named_by_its_node() {
    let mut case = Case::new(&[0, 0, 0], 0.0);
    // Nothing but node 0 sees anything: step 1 starts from nothing and adds nothing.
    case.steps[1] = StepSystem::ZERO;
    case.steps[2] = StepSystem::ZERO;
    case.steps[0] = StepSystem::ZERO;
    assert_eq!(case.factor().err(), Some(NotPositive { node: 1 }));
}
