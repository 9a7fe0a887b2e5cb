//! Estimates of values that the adjustment holds.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::layout::{ScannerBlocks, UP};
use super::problem::JointProblem;
use super::row::RowBatch;
use super::state::State;

/// A scanner is late if its latency is more than this many standard deviations and more than `LEAST_LATENCY_S`, seconds.
const LATE_SIGMAS: f64 = 5.0;
const LEAST_LATENCY_S: f64 = 0.002;

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

    /// Whether this latency, or the estimate of one that was held, says that a scanner is late.
    pub fn is_late(&self) -> bool {
        self.value.abs() > LEAST_LATENCY_S && self.sigmas() > LATE_SIGMAS
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

/// Held values τ and what the rows say about them, if everything else follows them as it fits best.
pub struct HeldValues {
    /// Σ w D Dᵀ.
    pub information: DMatrix<f64>,
    /// −Σ w D r.
    pub gradient: DVector<f64>,
    /// The change of each unknown (column) with each value (row).
    pub follow: DMatrix<f64>,
}

impl HeldValues {
    /// The estimate of a value, while the others stay held: g/I with the variance 1/I.
    pub fn score(&self, value: usize) -> Option<Score> {
        let information = self.information[(value, value)];
        (information > 0.0).then(|| Score {
            value: self.gradient[value] / information,
            sigma: information.sqrt().recip(),
        })
    }
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
    /// Estimates the latencies that are held, what is added to the ranges of each scanner, and the height of the reference
    /// above the world of the poses, all of which are held, with the factor at a state. The covariance is that of (δp, δφ) of
    /// all mountings.
    pub fn scores(&self, state: &State, covariance: &DMatrix<f64>) -> Scores {
        let late = self.held_latencies();
        let mut blocks = self.with_latencies(&late);
        let scanners = blocks.range.len();
        let mut next = self.layout.sizes.len() + late.len()..;
        blocks.range.fill_with(|| next.next());
        let up = self.layout.reference.map(|block| self.offset(block) + UP);
        let added = late.len() + scanners;
        let mut scores = Scores {
            late: vec![None; scanners],
            range: vec![None; scanners],
            height: None,
        };
        let visit = |visit: &mut dyn FnMut(&RowBatch)| self.visit_with(state, &blocks, visit);
        let Some(held) = self.held_values(added, up, visit) else {
            return scores;
        };
        for (value, &scanner) in late.iter().enumerate() {
            scores.late[scanner] = held.score(value);
        }
        for (scanner, range) in scores.range.iter_mut().enumerate() {
            let value = late.len() + scanner;
            *range = held.score(value).map(|added| RangeScore {
                moved_sigmas: self.moved_sigmas(&held, value, added.value, covariance),
                added,
            });
        }
        // The unknown is the correction of the reference, with the opposite sign.
        let down = up.and_then(|_| held.score(added));
        scores.height = down.map(|down| Score {
            value: -down.value,
            ..down
        });
        scores
    }

    /// Whether the latency of a scanner is held that the rows contradict, with the factor at a state nearby.
    pub fn is_a_scanner_late(&self, state: &State) -> bool {
        let held = self.held_latencies();
        if held.is_empty() {
            return false;
        }
        let blocks = self.with_latencies(&held);
        let visit = |visit: &mut dyn FnMut(&RowBatch)| self.visit_with(state, &blocks, visit);
        self.held_values(held.len(), None, visit)
            .is_some_and(|values| {
                let mut scores = (0..held.len()).filter_map(|value| values.score(value));
                scores.any(|score| score.is_late())
            })
    }

    /// The scanners whose latencies are held and tested: with known mountings, none.
    fn held_latencies(&self) -> Vec<usize> {
        if self.input.known.is_some() {
            return Vec::new();
        }
        let late = self.layout.of_scanners.late.iter().enumerate();
        let held = late.filter(|(_, place)| place.is_none());
        held.map(|(scanner, _)| scanner).collect()
    }

    /// The blocks of all scanners, with latencies that are held at the first places after all unknowns.
    fn with_latencies(&self, held: &[usize]) -> ScannerBlocks {
        let mut blocks = self.layout.of_scanners.clone();
        for (&scanner, place) in held.iter().zip(self.layout.sizes.len()..) {
            blocks.late[scanner] = Some(place);
        }
        blocks
    }

    /// The largest change of a parameter of a mounting with a held value, in standard deviations of the parameter.
    fn moved_sigmas(
        &self,
        held: &HeldValues,
        value: usize,
        estimate: f64,
        covariance: &DMatrix<f64>,
    ) -> f64 {
        let mountings = self.layout.mountings.iter().enumerate();
        let changes = mountings.flat_map(|(scanner, &block)| {
            let first = self.offset(block);
            // The unknowns are (δφ, δp).
            (0..6).map(move |i| (6 * scanner + (i + 3) % 6, first + i))
        });
        let in_sigmas = changes.filter_map(|(parameter, unknown)| {
            let variance = covariance[(parameter, parameter)];
            let change = estimate * held.follow[(value, unknown)];
            (variance > 0.0).then(|| change.abs() / variance.sqrt())
        });
        in_sigmas.fold(0.0, f64::max)
    }

    /// What the rows say about held values τ: so many whose places lie after all unknowns, and last the unknown at the
    /// place `within`. Rows have derivatives d by τ and J by all unknowns x. Unknowns follow τ with x' = −H⁻¹ Jᵀ W d,
    /// rows with D = d + J x'. `None` without a factor.
    pub(super) fn held_values(
        &self,
        added: usize,
        within: Option<usize>,
        visit: impl Fn(&mut dyn FnMut(&RowBatch)),
    ) -> Option<HeldValues> {
        let unknowns = self.unknowns();
        let held_at = |place: usize| match place.checked_sub(unknowns) {
            Some(held) => Some(held),
            None => (Some(place) == within).then_some(added),
        };
        let count = added + usize::from(within.is_some());
        let factor = self.factor()?;
        let mut sides = DMatrix::zeros(unknowns, count);
        let (mut places, mut held) = (Vec::new(), Vec::new());
        visit(&mut |batch| {
            // A row that touches nothing else holds τ.
            for row in batch.rows().filter(|row| row.blocks.len() > 1) {
                self.places(&row, &mut places);
                let all = places.iter().zip(row.by);
                held.clear();
                held.extend(all.filter_map(|(place, by)| Some((held_at(*place)?, *by))));
                for &(value, d) in &held {
                    let mut side = sides.column_mut(value);
                    for (&place, by) in places.iter().zip(row.by) {
                        if place < unknowns {
                            side[place] -= row.weight * d * by;
                        }
                    }
                }
            }
        });
        // Held values do not follow.
        let hold = |sides: &mut DMatrix<f64>| {
            if let Some(place) = within {
                sides.row_mut(place).fill(0.0);
            }
        };
        hold(&mut sides);
        factor.solve(sides.as_mut_slice(), count);
        hold(&mut sides);
        // By unknown, so that what a row needs lies together.
        let follow = sides.transpose();
        drop(sides);
        let mut information = DMatrix::zeros(count, count);
        let mut gradient = DVector::zeros(count);
        let mut by_value = DVector::zeros(count);
        visit(&mut |batch| {
            for row in batch.rows() {
                self.places(&row, &mut places);
                by_value.fill(0.0);
                for (&place, &by) in places.iter().zip(row.by) {
                    match held_at(place) {
                        None => by_value.axpy(by, &follow.column(place), 1.0),
                        Some(value) if row.blocks.len() > 1 => by_value[value] += by,
                        Some(_) => {}
                    }
                }
                information.syger(row.weight, &by_value, &by_value, 1.0);
                gradient.axpy(-row.weight * row.residual, &by_value, 1.0);
            }
        });
        information.fill_upper_triangle_with_lower_triangle();
        Some(HeldValues {
            information,
            gradient,
            follow,
        })
    }
}
