//! The innovation test: does a record agree with the prediction from all records before it?

use crate::adjustment::{FactorRows, Loss, NODE, TAIL, rejection_limit, square_scale};
use crate::statistics::median;
use nalgebra::{SMatrix, SVector};
use std::collections::VecDeque;

/// Number of innovations whose median shows whether a sensor's standard deviations are too small.
const RECENT: usize = 51;
/// After more refused records in a row than this, the estimate is lost, rather than the records wrong;
/// or after more than [`MIN_REFUSED`] over at least [`MAX_REFUSED_S`] seconds.
const MAX_REFUSED: usize = 10;
const MAX_REFUSED_S: f64 = 2.0;
const MIN_REFUSED: usize = 3;

/// rᵀ (I + J Σ Jᵀ)⁻¹ r of whitened rows, with the covariance Σ of node and bias.
pub fn innovation<const R: usize>(rows: &FactorRows<R>, sigma: &[[f64; TAIL]; TAIL]) -> f64 {
    let place = |a: usize| if a < NODE { a } else { a + NODE };
    let mut s = SMatrix::<f64, R, R>::identity();
    for (i, row) in rows.by_step.iter().enumerate() {
        let mut spread = [0.0; TAIL];
        for (a, line) in sigma.iter().enumerate() {
            let factor = row[place(a)];
            for (x, y) in spread.iter_mut().zip(line) {
                *x += factor * y;
            }
        }
        for (j, column) in rows.by_step.iter().enumerate() {
            s[(i, j)] += (0..TAIL).map(|a| spread[a] * column[place(a)]).sum::<f64>();
        }
    }
    let r = SVector::<f64, R>::from(rows.residual);
    // S is at least the identity: if it cannot be inverted, it is not finite, and the record is refused.
    s.try_inverse().map_or(f64::INFINITY, |inverse| {
        (r.transpose() * inverse * r)[(0, 0)]
    })
}

/// What to do with a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decision {
    Accept,
    Refuse,
    /// The records have contradicted the estimate for too long: it is lost and must follow them.
    Follow,
}

/// The test of one sensor.
#[derive(Debug, Clone)]
pub struct Gate {
    loss: Loss,
    components: f64,
    recent: VecDeque<f64>,
    refused: usize,
    refused_since_s: f64,
}

impl Gate {
    pub fn new(loss: Loss, components: f64) -> Self {
        Self {
            loss,
            components,
            recent: VecDeque::with_capacity(RECENT),
            refused: 0,
            refused_since_s: 0.0,
        }
    }

    /// Tests a record by its squared normalised innovation. As in the adjustment of whole drives,
    /// the limit grows where the median shows that the sensor's standard deviations are too small.
    pub fn test(&mut self, square: f64, time_s: f64) -> Decision {
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(square);
        if self.loss == Loss::None {
            return Decision::Accept;
        }
        if square <= self.limit() {
            self.refused = 0;
            return Decision::Accept;
        }
        if self.refused == 0 {
            self.refused_since_s = time_s;
        }
        self.refused += 1;
        let lasting = time_s - self.refused_since_s >= MAX_REFUSED_S;
        if self.refused > MAX_REFUSED || self.refused > MIN_REFUSED && lasting {
            self.refused = 0;
            return Decision::Follow;
        }
        Decision::Refuse
    }

    fn limit(&self) -> f64 {
        let median_square = median(self.recent.iter().copied()).unwrap_or(0.0);
        // The median of a few may itself be that of outliers.
        let scale = if self.recent.len() < RECENT {
            1.0
        } else {
            square_scale(self.components, median_square)
        };
        scale * rejection_limit(self.components)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_in_ten_thousand_is_refused_and_a_lost_estimate_follows() {
        let mut gate = Gate::new(Loss::Truncated, 3.0);
        // χ² of 3 degrees: 1e-4 of the probability lies above 21.108, by the approximation of
        // Wilson and Hilferty above 21.850.
        assert_eq!(gate.test(21.0, 0.0), Decision::Accept);
        assert_eq!(gate.test(22.0, 0.1), Decision::Refuse);
        assert_eq!(gate.test(1.0, 0.2), Decision::Accept);
        for k in 0..10 {
            assert_eq!(gate.test(1e4, 1.0 + 0.1 * f64::from(k)), Decision::Refuse);
        }
        assert_eq!(gate.test(1e4, 2.1), Decision::Follow);
        // Slow sensors do not wait for ten.
        let slow = [0.0, 1.0, 2.0, 3.0].map(|t| gate.test(1e4, 10.0 + t));
        assert_eq!(slow[2], Decision::Refuse);
        assert_eq!(slow[3], Decision::Follow);
        // Without a loss none is refused.
        assert_eq!(Gate::new(Loss::None, 3.0).test(1e9, 0.0), Decision::Accept);
    }

    #[test]
    fn innovations_are_normalised_by_the_uncertainty_of_the_prediction_too() {
        // A row that sees the second component of the position: σ² = 1 + 3.
        let mut rows = [[0.0; 24]; 1];
        rows[0][4] = 1.0;
        let mut sigma = [[0.0; TAIL]; TAIL];
        sigma[4][4] = 3.0;
        let square = |residual: f64, by_step, sigma: &[[f64; TAIL]; TAIL]| {
            innovation(&FactorRows::new([residual], by_step), sigma)
        };
        assert!((square(2.0, rows, &sigma) - 1.0).abs() < 1e-12);
        // And one that sees a gyro bias, correlated with it.
        rows[0][18] = 2.0;
        sigma[9][9] = 1.0;
        sigma[4][9] = 0.5;
        sigma[9][4] = 0.5;
        assert!((square(3.0, rows, &sigma) - 0.9).abs() < 1e-12);
    }
}
