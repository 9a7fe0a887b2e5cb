//! Times of day and of the week, continued past midnight and the end of the week.

use super::Timed;

/// A day and a week, seconds.
const PERIODS_S: [f64; 2] = [86_400.0, 604_800.0];
/// Longest pause of a log in which its clock starts again, seconds.
const LONGEST_PAUSE_S: f64 = 600.0;

/// The times of a log, one after the other. Where they start again near zero after they ended near 86,400 or 604,800 s,
/// they continue past that.
#[derive(Debug, Clone)]
pub struct Continued {
    /// As written.
    last_s: f64,
    /// What is added to it.
    added_s: f64,
}

impl Default for Continued {
    fn default() -> Self {
        Self {
            last_s: f64::NEG_INFINITY,
            added_s: 0.0,
        }
    }
}

impl Continued {
    /// The next time, continued.
    pub fn at(&mut self, time_s: f64) -> f64 {
        let is_end =
            |time_s: f64, period_s: f64| (period_s - LONGEST_PAUSE_S..=period_s).contains(&time_s);
        let is_start = |time_s: f64| (0.0..LONGEST_PAUSE_S).contains(&time_s);
        for period_s in PERIODS_S {
            if is_start(time_s) && is_end(self.last_s, period_s) {
                self.added_s += period_s;
            } else if is_start(self.last_s) && is_end(time_s, period_s) && self.added_s > 0.0 {
                // A record out of order, from before the clock started again.
                self.added_s -= period_s;
            }
        }
        self.last_s = time_s;
        time_s + self.added_s
    }

    /// The next time, continued, if it is no earlier than the one before.
    ///
    /// # Errors
    /// It is earlier: what was found, in words.
    pub fn in_order(&mut self, time_s: f64) -> Result<f64, String> {
        let before_s = self.last_s + self.added_s;
        let continued_s = self.at(time_s);
        if continued_s < before_s {
            return Err(format!("time {continued_s} s after {before_s} s"));
        }
        Ok(continued_s)
    }

    /// Whether there was no time yet.
    pub fn is_empty(&self) -> bool {
        self.last_s == f64::NEG_INFINITY
    }
}

/// Continues the times of a log past midnight and the end of the week.
pub fn continue_times<T: Timed>(records: &mut [T]) {
    let mut times = Continued::default();
    for record in records {
        let time_s = record.time_s_mut();
        *time_s = times.at(*time_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn continued(times_s: &[f64]) -> Vec<f64> {
        let mut times = Continued::default();
        times_s.iter().map(|time_s| times.at(*time_s)).collect()
    }

    #[test]
    fn times_continue_past_midnight_and_the_end_of_the_week() {
        assert_eq!(
            continued(&[86_399.9, 0.0, 0.1]),
            [86_399.9, 86_400.0, 86_400.1]
        );
        assert_eq!(continued(&[604_000.0 + 790.0, 5.0]), [604_790.0, 604_805.0]);
    }

    #[test]
    fn records_out_of_order_at_midnight_stay_where_they_belong() {
        let written = [86_399.8, 0.0, 86_399.9, 0.1];
        assert_eq!(
            continued(&written),
            [86_399.8, 86_400.0, 86_399.9, 86_400.1]
        );
    }

    #[test]
    fn other_times_that_go_backwards_stay_as_they_are() {
        for written in [[50_000.0, 0.0], [86_399.0, 40_000.0], [1.7e9, 5.0]] {
            assert_eq!(continued(&written), written);
        }
        assert!(Continued::default().in_order(2.0).is_ok());
        let mut times = Continued::default();
        times.in_order(2.0).unwrap();
        assert_eq!(times.in_order(1.0), Err("time 1 s after 2 s".into()));
    }
}
