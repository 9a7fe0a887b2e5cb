//! Which steps Levenberg-Marquardt accepts, and how strongly it damps the next.

/// Damping at the start, relative to the diagonal of the normal matrix.
const INITIAL: f64 = 1e-6;

/// Damping above which no step is worth trying: it would move points by less than rounding.
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
    /// The share of the diagonal that is added to it.
    pub fn share(self) -> f64 {
        self.0
    }

    /// Whether a step that lowers the cost by `lowered` is taken: not where the cost rises or is no
    /// number. The next step is damped less after one that is, more after one that is not.
    pub fn accepts(&mut self, lowered: f64) -> bool {
        let is_accepted = lowered >= 0.0;
        self.0 = if is_accepted {
            (self.0 * 0.1).max(1e-12)
        } else {
            (self.0 * 10.0).max(1e-4)
        };
        is_accepted
    }

    /// Damps a matrix more that cannot be factorised; false where that is no use.
    pub fn raise(&mut self) -> bool {
        self.0 = (self.0 * 100.0).max(1e-9);
        !self.is_exhausted()
    }

    /// Whether no step is left to try.
    pub fn is_exhausted(self) -> bool {
        self.0 > LARGEST
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cost_that_is_no_number_is_refused() {
        let mut damping = Damping::default();
        for refused in [f64::NAN, f64::NEG_INFINITY, -1e-300] {
            let before = damping.share();
            assert!(!damping.accepts(refused) && damping.share() > before);
        }
        let before = damping.share();
        assert!(damping.accepts(0.0) && damping.share() < before);
        // From any damping, refusals end.
        assert!((0..30).any(|_| !damping.accepts(f64::NAN) && damping.is_exhausted()));
    }
}
