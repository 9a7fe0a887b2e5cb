//! What the data say about a value that the adjustment holds.

use super::layout::UP;
use super::problem::JointProblem;
use super::row::{Row, RowBatch};
use super::state::State;

/// The value that would fit best, and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Score {
    /// Seconds or metres, to first order.
    pub value: f64,
    /// Of the value, with all unknowns free.
    pub sigma: f64,
}

impl Score {
    /// The value in its standard deviations.
    pub fn sigmas(&self) -> f64 {
        self.value.abs() / self.sigma
    }
}

impl JointProblem<'_> {
    /// How late a scanner is whose latency is held.
    pub fn latency_score(&self, state: &State, scanner: usize) -> Option<Score> {
        let held = Held {
            problem: self,
            block: self.layout.sizes.len(),
            component: 0,
        };
        let mut late = self.layout.late.clone();
        late[scanner] = Some(held.block);
        held.score(|visit| self.visit_with(state, &late, visit))
    }

    /// How far the reference lies above the world of the poses, whose height is held.
    pub fn height_score(&self, state: &State) -> Option<Score> {
        let held = Held {
            problem: self,
            block: self.layout.reference?,
            component: UP,
        };
        let found = held.score(|visit| self.visit(state, visit))?;
        // The unknown is what is taken off the reference.
        Some(Score {
            value: -found.value,
            ..found
        })
    }
}

/// A value τ that is held: a component of a block, which may be beyond the unknowns.
struct Held<'a> {
    problem: &'a JointProblem<'a>,
    block: usize,
    component: usize,
}

impl Held<'_> {
    /// Rows have derivatives d by τ and J by all unknowns x. Unknowns follow τ with x' = −H⁻¹ Jᵀ W d, rows
    /// with D = d + J x'. Then τ = −(Σ w D r)/(Σ w D²) with the variance 1/Σ w D².
    fn score(&self, visit: impl Fn(&mut dyn FnMut(&RowBatch))) -> Option<Score> {
        let sizes = &self.problem.layout.sizes;
        let mut follow = vec![0.0; self.problem.unknowns()];
        visit(&mut |batch| {
            for row in batch.rows() {
                let d = self.derivative(&row);
                if d == 0.0 {
                    continue;
                }
                let mut start = 0;
                for &block in row.blocks {
                    let by = &row.by[start..start + self.size(block)];
                    start += by.len();
                    if (block as usize) < sizes.len() {
                        let first = self.problem.offset(block as usize);
                        let sums = follow[first..].iter_mut();
                        sums.zip(by).for_each(|(sum, x)| *sum -= row.weight * d * x);
                    }
                }
            }
        });
        self.hold(&mut follow);
        self.problem.factor()?.solve(&mut follow, 1);
        self.hold(&mut follow);
        let (mut information, mut against) = (0.0, 0.0);
        visit(&mut |batch| {
            for row in batch.rows() {
                let mut all = self.derivative(&row);
                let mut start = 0;
                for &block in row.blocks {
                    let by = &row.by[start..start + self.size(block)];
                    start += by.len();
                    if (block as usize) < sizes.len() {
                        let follow = &follow[self.problem.offset(block as usize)..];
                        all += by.iter().zip(follow).map(|(x, y)| x * y).sum::<f64>();
                    }
                }
                information += row.weight * all * all;
                against += row.weight * all * row.residual;
            }
        });
        (information > 0.0).then(|| Score {
            value: -against / information,
            sigma: information.sqrt().recip(),
        })
    }

    /// A value that is not among the unknowns has one component.
    fn size(&self, block: u32) -> usize {
        let sizes = &self.problem.layout.sizes;
        sizes.get(block as usize).copied().unwrap_or(1)
    }

    /// d; that of the row that holds τ does not count.
    fn derivative(&self, row: &Row<'_>) -> f64 {
        if row.blocks.len() < 2 {
            return 0.0;
        }
        let mut start = 0;
        for &block in row.blocks {
            if block as usize == self.block {
                return row.by[start + self.component];
            }
            start += self.size(block);
        }
        0.0
    }

    /// τ itself does not follow.
    fn hold(&self, follow: &mut [f64]) {
        if self.block < self.problem.layout.sizes.len() {
            follow[self.problem.offset(self.block) + self.component] = 0.0;
        }
    }
}
