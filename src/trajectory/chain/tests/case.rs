//! Random chains, as fronts and dense.

use super::*;

/// A small chain with every shape of front, and the same normal equations assembled densely.
pub struct Case {
    pub layout: ChainLayout,
    pub steps: Vec<StepSystem>,
    pub borders: Vec<Border>,
    pub walks: Vec<WalkSystem>,
    pub prior: PriorSystem,
    pub damping: [f64; TAIL],
    pub constants: ConstantsSystem,
    pub h: DMatrix<f64>,
    pub g: DVector<f64>,
}

impl Case {
    /// Steps of random normal equations that touch n constants; biases as listed.
    pub fn new(bias_of_step: &[u32], n: usize, damping: f64) -> Self {
        let layout = ChainLayout {
            bias_of_step: bias_of_step.to_vec(),
        };
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut draw = || random.random_range(-1.0..1.0);
        let chain_size = layout.nodes() * NODE + layout.biases() * BIAS;
        let size = chain_size + n;
        let mut h = DMatrix::zeros(size, size);
        let mut g = DVector::zeros(size);
        let node_at = |i: usize| i * NODE;
        let bias_at = |k: usize| layout.nodes() * NODE + k * BIAS;
        let (steps, borders) = (0..layout.steps())
            .map(|i| {
                let rows = DMatrix::from_fn(12, STEP + n, |_, _| draw());
                let (step_h, step_g) = (
                    rows.transpose() * &rows,
                    DVector::from_fn(STEP + n, |_, _| draw()),
                );
                let place = |a: usize| match a {
                    a if a < 2 * NODE => node_at(i) + a,
                    a if a < STEP => bias_at(bias_of_step[i] as usize) + a - 2 * NODE,
                    a => chain_size + a - STEP,
                };
                for a in 0..STEP + n {
                    g[place(a)] += step_g[a];
                    for b in 0..STEP + n {
                        h[(place(a), place(b))] += step_h[(a, b)];
                    }
                }
                // Below the diagonal nothing may be read.
                let upper = |a: usize, b: usize| if a <= b { step_h[(a, b)] } else { 1e30 };
                let system = StepSystem {
                    h: std::array::from_fn(|a| std::array::from_fn(|b| upper(a, b))),
                    g: std::array::from_fn(|a| step_g[a]),
                };
                let border = Border {
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
        let constants = ConstantsSystem {
            weight: (0..n).map(|_| 2.0 + draw()).collect(),
            g: (0..n).map(|_| draw()).collect(),
            damping: (0..n).map(|c| damping * (2.0 + c as f64)).collect(),
        };
        for c in 0..n {
            let place = chain_size + c;
            h[(place, place)] += constants.weight[c] + constants.damping[c];
            g[place] += constants.g[c];
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
            borders,
            walks,
            prior,
            damping,
            constants,
            h,
            g,
        }
    }

    pub fn factor(&self) -> Result<ChainFactor, NotPositive> {
        let mut factor = ChainFactor::new(self.layout.clone(), self.count());
        factor.factorise(&ChainSystem {
            step: &|i: usize, system: &mut StepSystem, border: &mut Border| {
                assert_eq!(*border, Border::new(self.count()), "handed out cleared");
                *system = self.steps[i].clone();
                *border = self.borders[i].clone();
            },
            walk: &|k: usize| self.walks[k],
            prior: self.prior,
            damping: self.damping,
            constants: self.constants.clone(),
        })?;
        Ok(factor)
    }

    /// Number of constants.
    pub fn count(&self) -> usize {
        self.constants.weight.len()
    }

    /// Where unknown `a` of step i stands in the dense system.
    pub fn place(&self, i: usize, a: usize) -> usize {
        if a < 2 * NODE {
            i * NODE + a
        } else {
            self.bias_at(self.layout.bias_of_step[i] as usize) + a - 2 * NODE
        }
    }

    pub fn bias_at(&self, k: usize) -> usize {
        self.layout.nodes() * NODE + k * BIAS
    }

    pub fn constant_at(&self, c: usize) -> usize {
        self.bias_at(self.layout.biases()) + c
    }

    /// H⁻¹ by dense Cholesky.
    pub fn inverse(&self) -> DMatrix<f64> {
        let dense = self.h.clone().cholesky().expect("positive definite");
        dense.inverse()
    }
}
