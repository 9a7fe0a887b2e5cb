//! Acceptance of Levenberg-Marquardt steps, and damping of the next step.

/// Initial damping, relative to the diagonal of the normal matrix.
const INITIAL: f64 = 1e-6;

/// Largest damping: steps with more would move points by less than rounding errors.
const LARGEST: f64 = 1e11;

/// Damping relative to the diagonal of the normal matrix.
#[derive(Debug, Clone, Copy)]
pub struct Damping(f64);

impl Default for Damping {
    fn default() -> Self {
        Self(INITIAL)
    }
}

impl Damping {
    /// The share of the diagonal that is added to the diagonal.
    pub fn share(self) -> f64 {
        self.0
    }

    /// Returns whether a step that lowers the cost by `lowered` is accepted: not if the cost rises
    /// or is not finite. Accepted steps reduce the damping, rejected ones increase it.
    pub fn accepts(&mut self, lowered: f64) -> bool {
        let is_accepted = lowered >= 0.0;
        self.0 = if is_accepted {
            (self.0 * 0.1).max(1e-12)
        } else {
            (self.0 * 10.0).max(1e-4)
        };
        is_accepted
    }

    /// Increases the damping of a matrix that cannot be factorised; false if it is exhausted.
    pub fn raise(&mut self) -> bool {
        self.0 = (self.0 * 100.0).max(1e-9);
        !self.is_exhausted()
    }

    /// Whether the damping has reached its largest value.
    pub fn is_exhausted(self) -> bool {
        self.0 > LARGEST
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cost_that_is_not_finite_is_rejected() {
        let mut damping = Damping::default();
        for rejected in [f64::NAN, f64::NEG_INFINITY, -1e-300] {
            let before = damping.share();
            assert!(!damping.accepts(rejected) && damping.share() > before);
        }
        let before = damping.share();
        assert!(damping.accepts(0.0) && damping.share() < before);
        // Repeated rejections exhaust the damping.
        assert!((0..30).any(|_| !damping.accepts(f64::NAN) && damping.is_exhausted()));
    }
}
