//! Random chains, in fronts and as dense matrices.

use crate::adjustment::chain::{ChainFactor, ChainStep, ChainSystem, NotPositive};
use crate::adjustment::layout::{ChainLayout, NODE, SEGMENT, STEP, TAIL};
use crate::adjustment::prior::{BorderPrior, Prior};
use crate::adjustment::system::{BorderSystem, StepSystem};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A small chain with every shape of front, and the same normal equations assembled densely.
pub struct Case {
    pub layout: ChainLayout,
    pub steps: Vec<StepSystem>,
    pub borders: Vec<BorderSystem>,
    pub walks: Vec<Prior<SEGMENT>>,
    pub prior: Prior<TAIL>,
    pub damping: [f64; TAIL],
    pub border: BorderPrior,
    pub border_damping: Vec<f64>,
    pub h: DMatrix<f64>,
    pub g: DVector<f64>,
}

impl Case {
    /// Steps of random normal equations that touch a border of n columns; segments as listed.
    pub fn new(segment_of_step: &[u32], n: usize, damping: f64) -> Self {
        let layout = ChainLayout {
            segment_of_step: segment_of_step.to_vec(),
        };
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut draw = || random.random_range(-1.0..1.0);
        let chain_size = layout.nodes() * NODE + layout.segments() * SEGMENT;
        let size = chain_size + n;
        let mut h = DMatrix::zeros(size, size);
        let mut g = DVector::zeros(size);
        let node_at = |i: usize| i * NODE;
        let segment_at = |k: usize| layout.nodes() * NODE + k * SEGMENT;
        let (steps, borders) = (0..layout.steps())
            .map(|i| {
                let rows = DMatrix::from_fn(12, STEP + n, |_, _| draw());
                let (step_h, step_g) = (
                    rows.transpose() * &rows,
                    DVector::from_fn(STEP + n, |_, _| draw()),
                );
                let place = |a: usize| match a {
                    a if a < 2 * NODE => node_at(i) + a,
                    a if a < STEP => segment_at(segment_of_step[i] as usize) + a - 2 * NODE,
                    a => chain_size + a - STEP,
                };
                for a in 0..STEP + n {
                    g[place(a)] += step_g[a];
                    for b in 0..STEP + n {
                        h[(place(a), place(b))] += step_h[(a, b)];
                    }
                }
                // Entries below the diagonal must not be read.
                let upper = |a: usize, b: usize| if a <= b { step_h[(a, b)] } else { 1e30 };
                let system = StepSystem {
                    h: std::array::from_fn(|a| std::array::from_fn(|b| upper(a, b))),
                    g: std::array::from_fn(|a| step_g[a]),
                };
                let border = BorderSystem {
                    count: n,
                    h: (STEP..STEP + n)
                        .map(|c| std::array::from_fn(|a| step_h[(a, c)]))
                        .collect(),
                    c: (0..n * n)
                        .map(|at| upper(STEP + at / n, STEP + at % n))
                        .collect(),
                    g: step_g.as_slice()[STEP..].to_vec(),
                };
                (system, border)
            })
            .unzip();
        let walks: Vec<_> = (1..layout.segments())
            .map(|new| {
                let walk = Prior {
                    weight: std::array::from_fn(|_| 2.0 + draw()),
                    miss: std::array::from_fn(|_| draw()),
                };
                for i in 0..SEGMENT {
                    let (a, b, w) = (segment_at(new - 1) + i, segment_at(new) + i, walk.weight[i]);
                    h[(a, a)] += w;
                    h[(b, b)] += w;
                    h[(a, b)] -= w;
                    h[(b, a)] -= w;
                    g[a] += w * walk.miss[i];
                    g[b] -= w * walk.miss[i];
                }
                walk
            })
            .collect();
        let prior = Prior {
            weight: std::array::from_fn(|_| 2.0 + draw()),
            miss: std::array::from_fn(|_| draw()),
        };
        for a in 0..TAIL {
            let place = if a < NODE {
                a
            } else {
                segment_at(0) + a - NODE
            };
            h[(place, place)] += prior.weight[a];
            g[place] -= prior.weight[a] * prior.miss[a];
        }
        let border = BorderPrior {
            weight: (0..n).map(|_| 2.0 + draw()).collect(),
            miss: (0..n).map(|_| draw()).collect(),
        };
        let border_damping: Vec<f64> = (0..n).map(|c| damping * (2.0 + c as f64)).collect();
        for (c, damping) in border_damping.iter().enumerate() {
            let place = chain_size + c;
            h[(place, place)] += border.weight[c] + damping;
            g[place] -= border.weight[c] * border.miss[c];
        }
        let damping = std::array::from_fn(|i| damping * (1.0 + i as f64));
        for i in 0..layout.nodes() {
            (0..NODE).for_each(|a| h[(node_at(i) + a, node_at(i) + a)] += damping[a]);
        }
        for k in 0..layout.segments() {
            (0..SEGMENT)
                .for_each(|a| h[(segment_at(k) + a, segment_at(k) + a)] += damping[NODE + a]);
        }
        Self {
            layout,
            steps,
            borders,
            walks,
            prior,
            damping,
            border,
            border_damping,
            h,
            g,
        }
    }

    pub fn factor(&self) -> Result<ChainFactor, NotPositive> {
        let mut factor = ChainFactor::new(self.layout.clone(), self.count());
        factor.factorise(&ChainSystem {
            step: &|i: usize, system: &mut StepSystem, border: &mut BorderSystem| {
                assert_eq!(
                    *border,
                    BorderSystem::new(self.count()),
                    "handed out cleared"
                );
                *system = self.steps[i].clone();
                *border = self.borders[i].clone();
            },
            walk: &|k: usize| self.walks[k],
            prior: self.prior,
            damping: self.damping,
            border: self.border.clone(),
            border_damping: self.border_damping.clone(),
        })?;
        Ok(factor)
    }

    /// The solution.
    pub fn solve(&self) -> ChainStep {
        let factor = self.factor().expect("positive definite");
        let mut step = ChainStep::new(&self.layout, self.count());
        factor.back_substitute(&mut step);
        step
    }

    /// Columns of the border.
    pub fn count(&self) -> usize {
        self.border.weight.len()
    }

    /// Index of unknown `a` of step i in the dense system.
    pub fn place(&self, i: usize, a: usize) -> usize {
        if a < 2 * NODE {
            i * NODE + a
        } else {
            self.segment_at(self.layout.segment_of_step[i] as usize) + a - 2 * NODE
        }
    }

    pub fn segment_at(&self, k: usize) -> usize {
        self.layout.nodes() * NODE + k * SEGMENT
    }

    pub fn border_at(&self, c: usize) -> usize {
        self.segment_at(self.layout.segments()) + c
    }

    /// H⁻¹ by dense Cholesky.
    pub fn inverse(&self) -> DMatrix<f64> {
        let dense = self.h.clone().cholesky().expect("positive definite");
        dense.inverse()
    }
}
