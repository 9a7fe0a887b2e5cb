//! The damping of Levenberg-Marquardt: which steps are accepted, and how much the next one is damped.

/// How the damping changes from step to step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DampingRule {
    /// Damping of the first step.
    pub initial: f64,
    /// A refused step multiplies the damping by this, an accepted one divides it.
    pub factor: f64,
    /// Least damping after a refused step.
    pub least_raised: f64,
    /// A lower damping than this after an accepted step is replaced by `floor`.
    pub least_lowered: f64,
    /// Damping below `least_lowered`; 0 gives Gauss-Newton steps.
    pub floor: f64,
    /// A step refused at more damping than this ends the search.
    pub largest: f64,
    /// Rise of the cost that rounding may cause, as a share of 1 + cost.
    pub rounding: f64,
}

impl DampingRule {
    /// Gauss-Newton steps until one is refused.
    pub const UNDAMPED: Self = Self {
        initial: 0.0,
        factor: 10.0,
        least_raised: 1e-2,
        least_lowered: 1e-2,
        floor: 0.0,
        largest: 1e9,
        rounding: 1e-9,
    };

    /// Whether a cost is lower than another by more than rounding.
    pub fn is_lower(&self, than: f64, cost: f64) -> bool {
        cost < than - self.rounding * (1.0 + than)
    }
}

/// The outcome of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The step is taken.
    Accepted,
    /// The step is not taken; one with more damping may be.
    Refused,
    /// The step is not taken, and the largest damping has been tried.
    GivenUp,
}

/// The current damping, adapted to the outcome of each step.
#[derive(Debug, Clone, Copy)]
pub struct Damping {
    rule: DampingRule,
    value: f64,
}

impl Damping {
    /// The damping before the first step.
    pub fn new(rule: DampingRule) -> Self {
        Self {
            rule,
            value: rule.initial,
        }
    }

    /// Damping of the next step.
    pub fn value(&self) -> f64 {
        self.value
    }

    /// Judges a step by the true cost before it (`cost`) and after it (`trial`). A step that could not be
    /// computed has a trial of NaN, which is never accepted.
    pub fn judge(&mut self, cost: f64, trial: f64) -> Verdict {
        let rule = &self.rule;
        if trial.is_finite() && trial <= cost + rule.rounding * (1.0 + cost) {
            let lowered = self.value / rule.factor;
            self.value = if lowered < rule.least_lowered {
                rule.floor
            } else {
                lowered
            };
            return Verdict::Accepted;
        }
        if self.value > rule.largest {
            return Verdict::GivenUp;
        }
        self.value = (self.value * rule.factor).max(rule.least_raised);
        Verdict::Refused
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RELATIVE: DampingRule = DampingRule {
        initial: 1e-6,
        factor: 10.0,
        least_raised: 1e-4,
        least_lowered: 1e-12,
        floor: 1e-12,
        largest: 1e10,
        rounding: 0.0,
    };

    /// Dampings tried when every step is refused, as powers of ten.
    fn tried(rule: DampingRule) -> Vec<i32> {
        let mut damping = Damping::new(rule);
        let mut all = Vec::new();
        loop {
            all.push(damping.value().log10().round() as i32);
            if damping.judge(1.0, 2.0) == Verdict::GivenUp {
                return all;
            }
        }
    }

    #[test]
    fn refused_steps_raise_the_damping_until_it_is_given_up() {
        let powers = |first: i32| (first..).take_while(|p| *p <= 10).collect::<Vec<_>>();
        assert_eq!(tried(DampingRule::UNDAMPED)[1..], powers(-2));
        let expected = [vec![-6], powers(-4), vec![11]].concat();
        assert_eq!(tried(RELATIVE), expected);
    }

    #[test]
    fn accepted_steps_lower_it_to_the_floor() {
        let mut damping = Damping::new(DampingRule::UNDAMPED);
        for _ in 0..3 {
            assert_eq!(damping.judge(1.0, 1.1), Verdict::Refused);
        }
        assert_eq!(damping.value(), 1.0);
        let lowered = [(); 3].map(|()| {
            assert_eq!(damping.judge(1.0, 0.5), Verdict::Accepted);
            damping.value()
        });
        assert_eq!(lowered[0], 0.1);
        assert_eq!(lowered[2], 0.0);
        let mut damping = Damping::new(RELATIVE);
        for _ in 0..10 {
            assert_eq!(damping.judge(1.0, 0.5), Verdict::Accepted);
        }
        assert_eq!(damping.value(), 1e-12);
    }

    #[test]
    fn a_cost_that_is_not_a_number_is_never_accepted() {
        for (cost, trial) in [
            (1.0, f64::NAN),
            (f64::NAN, 1.0),
            (f64::NAN, f64::NAN),
            (f64::INFINITY, f64::INFINITY),
            (1.0, f64::INFINITY),
        ] {
            let mut damping = Damping::new(DampingRule::UNDAMPED);
            assert_eq!(damping.judge(cost, trial), Verdict::Refused);
        }
        // Rounding may raise a cost slightly, and a step away from an infinite cost is accepted.
        let mut damping = Damping::new(DampingRule::UNDAMPED);
        assert_eq!(damping.judge(1.0, 1.0 + 1e-9), Verdict::Accepted);
        assert_eq!(damping.judge(f64::INFINITY, 1.0), Verdict::Accepted);
        assert_eq!(
            Damping::new(RELATIVE).judge(1.0, 1.0 + 1e-9),
            Verdict::Refused
        );
    }
}
