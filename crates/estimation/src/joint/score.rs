//! Estimates of values that the adjustment holds.

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::layout::UP;
use super::problem::JointProblem;
use super::row::RowBatch;
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

/// An estimate of a held value.
pub(super) struct Held {
    pub score: Score,
    /// The change of each unknown of each mounting with the value.
    by_mountings: Vec<[f64; 6]>,
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
        let up = self.layout.reference.map(|block| self.offset(block) + UP);
        let added = late.len() + scanners;
        let mut estimates = self.score(added, up, |visit| self.visit_with(state, &blocks, visit));
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
        let changes = held.by_mountings.iter().enumerate();
        let changes = changes.flat_map(|(scanner, by)| {
            // The unknowns are (δφ, δp).
            (0..6).map(move |i| (6 * scanner + (i + 3) % 6, by[i]))
        });
        let in_sigmas = changes.filter_map(|(parameter, by)| {
            let variance = covariance[(parameter, parameter)];
            let change = held.score.value * by;
            (variance > 0.0).then(|| change.abs() / variance.sqrt())
        });
        in_sigmas.fold(0.0, f64::max)
    }

    /// Estimates held values τ, each while the others stay held: so many whose places lie after all unknowns, and the
    /// unknown at the place `within`. Rows have derivatives d by τ and J by all unknowns x. Unknowns follow τ with
    /// x' = −H⁻¹ Jᵀ W d, rows with D = d + J x'. Then τ = −(Σ w D r)/(Σ w D²) with the variance 1/Σ w D².
    pub(super) fn score(
        &self,
        added: usize,
        within: Option<usize>,
        visit: impl Fn(&mut dyn FnMut(&RowBatch)),
    ) -> Vec<Option<Held>> {
        let unknowns = self.unknowns();
        let held_at = |place: usize| match place.checked_sub(unknowns) {
            Some(held) => Some(held),
            None => (Some(place) == within).then_some(added),
        };
        let count = added + usize::from(within.is_some());
        let Some(factor) = self.factor() else {
            return (0..count).map(|_| None).collect();
        };
        let mut sides = vec![0.0; count * unknowns];
        let (mut places, mut held) = (Vec::new(), Vec::new());
        visit(&mut |batch| {
            // A row that touches nothing else holds τ.
            for row in batch.rows().filter(|row| row.blocks.len() > 1) {
                self.places(&row, &mut places);
                let all = places.iter().zip(row.by);
                held.clear();
                held.extend(all.filter_map(|(place, by)| Some((held_at(*place)?, *by))));
                for &(value, d) in &held {
                    let side = &mut sides[value * unknowns..][..unknowns];
                    for (&place, by) in places.iter().zip(row.by) {
                        if place < unknowns {
                            side[place] -= row.weight * d * by;
                        }
                    }
                }
            }
        });
        // Held values do not follow.
        let hold = |sides: &mut [f64]| {
            if let Some(place) = within {
                (0..count).for_each(|value| sides[value * unknowns + place] = 0.0);
            }
        };
        hold(&mut sides);
        factor.solve(&mut sides, count);
        hold(&mut sides);
        // By unknown, so that what a row needs lies together.
        let mut follow = vec![0.0; count * unknowns];
        for (place, follow) in follow.chunks_exact_mut(count).enumerate() {
            for (value, follow) in follow.iter_mut().enumerate() {
                *follow = sides[value * unknowns + place];
            }
        }
        drop(sides);
        // Σ w D², Σ w D r, and D.
        let mut sums = vec![[0.0; 2]; count];
        let mut by_value = vec![0.0; count];
        visit(&mut |batch| {
            for row in batch.rows() {
                self.places(&row, &mut places);
                by_value.fill(0.0);
                for (&place, by) in places.iter().zip(row.by) {
                    match held_at(place) {
                        None => {
                            let follow = &follow[place * count..][..count];
                            for (sum, follow) in by_value.iter_mut().zip(follow) {
                                *sum += by * follow;
                            }
                        }
                        Some(value) if row.blocks.len() > 1 => by_value[value] += by,
                        Some(_) => {}
                    }
                }
                for ([information, against], by) in sums.iter_mut().zip(&by_value) {
                    *information += row.weight * by * by;
                    *against += row.weight * by * row.residual;
                }
            }
        });
        let estimates = sums.into_iter().enumerate();
        let estimates = estimates.map(|(value, [information, against])| {
            (information > 0.0).then(|| Held {
                score: Score {
                    value: -against / information,
                    sigma: information.sqrt().recip(),
                },
                by_mountings: (self.layout.mountings.iter())
                    .map(|&block| {
                        let first = self.offset(block);
                        std::array::from_fn(|i| follow[(first + i) * count + value])
                    })
                    .collect(),
            })
        });
        estimates.collect()
    }
}
