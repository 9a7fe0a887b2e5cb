//! What the data say about a value that the adjustment holds.

use super::layout::UP;
use super::problem::JointProblem;
use super::row::{Row, RowBatch};
use super::state::State;
use crate::stored::stored;

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
    /// How late a scanner is whose latency is held, by the factor at a state.
    pub fn latency_score(&self, state: &State, scanner: usize) -> Option<Score> {
        let mut late = self.layout.late.clone();
        late[scanner] = Some(self.layout.sizes.len());
        self.score(self.unknowns(), |visit| {
            self.visit_with(state, &late, visit)
        })
    }

    /// How far the reference lies above the world of the poses, whose height is held,
    /// by the factor at a state.
    pub fn height_score(&self, state: &State) -> Option<Score> {
        let up = self.offset(self.layout.reference?) + UP;
        let found = self.score(up, |visit| self.visit(state, visit))?;
        // The unknown is what is taken off the reference.
        Some(Score {
            value: -found.value,
            ..found
        })
    }

    /// Of the value τ at this place, which may come after all unknowns. Rows have derivatives d by τ and J by
    /// all unknowns x. Unknowns follow τ with x' = −H⁻¹ Jᵀ W d, rows with D = d + J x'. Then
    /// τ = −(Σ w D r)/(Σ w D²) with the variance 1/Σ w D².
    fn score(&self, held: usize, visit: impl Fn(&mut dyn FnMut(&RowBatch))) -> Option<Score> {
        let unknowns = self.unknowns();
        let mut places = Vec::new();
        let mut follow = vec![0.0; unknowns + 1];
        visit(&mut |batch| {
            for row in batch.rows() {
                self.places(&row, &mut places);
                let d = derivative(&row, &places, held);
                if d != 0.0 {
                    for (place, by) in places.iter().zip(row.by) {
                        follow[*place] -= row.weight * d * by;
                    }
                }
            }
        });
        // τ itself does not follow.
        follow[held] = 0.0;
        self.factor()?.solve(&mut follow[..unknowns], 1);
        follow[held] = 0.0;
        let (mut information, mut against) = (0.0, 0.0);
        visit(&mut |batch| {
            for row in batch.rows() {
                self.places(&row, &mut places);
                let followed = places
                    .iter()
                    .zip(row.by)
                    .map(|(place, by)| by * follow[*place]);
                let all = derivative(&row, &places, held) + followed.sum::<f64>();
                information += row.weight * all * all;
                against += row.weight * all * row.residual;
            }
        });
        (information > 0.0).then(|| Score {
            value: -against / information,
            sigma: information.sqrt().recip(),
        })
    }
}

/// d; that of a row that touches nothing else, as the one that holds τ, does not count.
fn derivative(row: &Row<'_>, places: &[usize], held: usize) -> f64 {
    let place = places.iter().position(|place| *place == held);
    match place {
        Some(place) if row.blocks.len() > 1 => row.by[place],
        _ => 0.0,
    }
}

stored!(struct Score { value, sigma });
