//! Estimates of values that the adjustment holds.

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::layout::UP;
use super::problem::JointProblem;
use super::row::{Row, RowBatch};
use super::state::State;

/// The value that would fit best, and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Seconds or metres, to first order.
    pub value: f64,
    /// Standard deviation of the value, with all unknowns free.
    pub sigma: f64,
}

impl Score {
    /// The absolute value in standard deviations.
    pub fn sigmas(&self) -> f64 {
        self.value.abs() / self.sigma
    }
}

/// What would be added to all ranges of a scanner.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RangeScore {
    /// Metres.
    pub added: Score,
    /// The largest change of a parameter of a mounting with it, in standard deviations of the parameter.
    pub moved_sigmas: f64,
}

/// An estimate of a held value, and the change of each unknown with the value.
struct Held {
    score: Score,
    follow: Vec<f64>,
}

/// Estimates of all values that are held.
#[derive(Debug, Clone)]
pub struct Scores {
    /// Latency of each requested scanner.
    pub late: Vec<Option<Score>>,
    /// What is added to the ranges of each scanner.
    pub range: Vec<Option<RangeScore>>,
    /// Height of the reference above the world of the poses.
    pub height: Option<Score>,
}

impl JointProblem<'_> {
    /// Estimates the latencies of these scanners, what is added to the ranges of each, and the height of the reference
    /// above the world of the poses, all of which are held, with the factor at a state. The covariance is that of (δp, δφ) of
    /// all mountings.
    pub fn scores(&self, state: &State, late: &[usize], covariance: &DMatrix<f64>) -> Scores {
        let mut blocks = self.layout.of_scanners.clone();
        let scanners = blocks.range.len();
        let mut next = self.layout.sizes.len()..;
        for &scanner in late {
            blocks.late[scanner] = next.next();
        }
        blocks.range.fill_with(|| next.next());
        let first = self.unknowns();
        let mut held: Vec<usize> = (first..first + late.len() + scanners).collect();
        let up = self.layout.reference.map(|block| self.offset(block) + UP);
        held.extend(up);
        let mut estimates = self.score(&held, |visit| self.visit_with(state, &blocks, visit));
        let height = up.and_then(|_| estimates.pop()?);
        let ranges = estimates.split_off(late.len()).into_iter();
        let range = ranges.map(|held| {
            held.map(|held| RangeScore {
                moved_sigmas: self.moved_sigmas(&held, covariance),
                added: held.score,
            })
        });
        let mut scores = Scores {
            late: vec![None; scanners],
            range: range.collect(),
            // The unknown is the correction of the reference, with the opposite sign.
            height: height.map(|held| Score {
                value: -held.score.value,
                ..held.score
            }),
        };
        for (&scanner, held) in late.iter().zip(estimates) {
            scores.late[scanner] = held.map(|held| held.score);
        }
        scores
    }

    /// The largest change of a parameter of a mounting with the estimate of a held value, in standard deviations of the
    /// parameter.
    fn moved_sigmas(&self, held: &Held, covariance: &DMatrix<f64>) -> f64 {
        let blocks = self.layout.mountings.iter().enumerate();
        let changes = blocks.flat_map(|(scanner, &block)| {
            // The unknowns are (δφ, δp).
            (0..6).map(move |i| (6 * scanner + (i + 3) % 6, self.offset(block) + i))
        });
        let in_sigmas = changes.filter_map(|(parameter, unknown)| {
            let variance = covariance[(parameter, parameter)];
            let change = held.score.value * held.follow[unknown];
            (variance > 0.0).then(|| change.abs() / variance.sqrt())
        });
        in_sigmas.fold(0.0, f64::max)
    }

    /// Estimates the value τ at each of these places, which may lie after all unknowns; the other held values stay
    /// held. Rows have derivatives d by τ and J by all unknowns x. Unknowns follow τ with x' = −H⁻¹ Jᵀ W d, rows with
    /// D = d + J x'. Then τ = −(Σ w D r)/(Σ w D²) with the variance 1/Σ w D².
    fn score(
        &self,
        held: &[usize],
        visit: impl Fn(&mut dyn FnMut(&RowBatch)),
    ) -> Vec<Option<Held>> {
        let Some(factor) = self.factor() else {
            return held.iter().map(|_| None).collect();
        };
        let unknowns = self.unknowns();
        let mut places = Vec::new();
        let mut follow = vec![vec![0.0; unknowns + held.len()]; held.len()];
        visit(&mut |batch| {
            for row in batch.rows() {
                self.places(&row, &mut places);
                for (follow, &held) in follow.iter_mut().zip(held) {
                    let d = derivative(&row, &places, held);
                    if d != 0.0 {
                        for (place, by) in places.iter().zip(row.by) {
                            follow[*place] -= row.weight * d * by;
                        }
                    }
                }
            }
        });
        for (follow, &held_here) in follow.iter_mut().zip(held) {
            // Held values do not follow.
            follow[held_here] = 0.0;
            factor.solve(&mut follow[..unknowns], 1);
            held.iter().for_each(|&place| follow[place] = 0.0);
        }
        let mut sums = vec![(0.0, 0.0); held.len()];
        visit(&mut |batch| {
            for row in batch.rows() {
                self.places(&row, &mut places);
                for ((follow, &held), sums) in follow.iter().zip(held).zip(&mut sums) {
                    let followed = places
                        .iter()
                        .zip(row.by)
                        .map(|(place, by)| by * follow[*place]);
                    let all = derivative(&row, &places, held) + followed.sum::<f64>();
                    sums.0 += row.weight * all * all;
                    sums.1 += row.weight * all * row.residual;
                }
            }
        });
        let scores = sums.into_iter().zip(follow);
        let scores = scores.map(|((information, against), follow)| {
            (information > 0.0).then(|| Held {
                score: Score {
                    value: -against / information,
                    sigma: information.sqrt().recip(),
                },
                follow,
            })
        });
        scores.collect()
    }
}

/// The derivative d of a row; zero for a row that touches nothing else, such as the one that holds τ.
fn derivative(row: &Row<'_>, places: &[usize], held: usize) -> f64 {
    let place = places.iter().position(|place| *place == held);
    match place {
        Some(place) if row.blocks.len() > 1 => row.by[place],
        _ => 0.0,
    }
}
