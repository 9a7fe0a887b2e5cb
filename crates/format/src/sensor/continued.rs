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
    /// The last time, as written, before the first start.
    end_s: Option<f64>,
    /// Whether the next records may begin with those from the second of the last ones on.
    is_windowed: bool,
}

impl Default for Continued {
    fn default() -> Self {
        Self {
            last_s: f64::NEG_INFINITY,
            added_s: 0.0,
            end_s: None,
            is_windowed: false,
        }
    }
}

impl Continued {
    /// The times of a log that is read in windows, each of which repeats a part of the one before.
    pub fn in_windows() -> Self {
        Self {
            is_windowed: true,
            ..Self::default()
        }
    }

    /// Continues the times of the next records of a log; returns a sentence on it if they have started again so far.
    pub fn continue_times<T: Timed>(&mut self, records: &mut [T]) -> Option<String> {
        let mut times = self.clone();
        let mut after_first = None;
        for record in records {
            let time_s = record.time_s_mut();
            *time_s = times.at(*time_s);
            after_first.get_or_insert_with(|| times.clone());
        }
        let remark = times.remark();
        // The next window begins near the beginning of this one, not at its end.
        *self = after_first.filter(|_| self.is_windowed).unwrap_or(times);
        remark
    }

    /// The next time, continued.
    pub fn at(&mut self, time_s: f64) -> f64 {
        let is_end =
            |time_s: f64, period_s: f64| (period_s - LONGEST_PAUSE_S..=period_s).contains(&time_s);
        let is_start = |time_s: f64| (0.0..LONGEST_PAUSE_S).contains(&time_s);
        for period_s in PERIODS_S {
            if is_start(time_s) && is_end(self.last_s, period_s) {
                self.added_s += period_s;
                self.end_s.get_or_insert(self.last_s);
            } else if is_start(self.last_s) && is_end(time_s, period_s) && self.added_s > 0.0 {
                // A record out of order, from before the clock started again.
                self.added_s -= period_s;
            }
        }
        self.last_s = time_s;
        time_s + self.added_s
    }

    /// The next time, continued, if it is no earlier than the one before; repeated times are in order.
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

    /// A sentence on times that started again; `None` if none did.
    pub fn remark(&self) -> Option<String> {
        let end_s = self.end_s?;
        Some(format!(
            "the times start again at 0 after {end_s} s, as at midnight or at the end of the GPS week: they are \
             continued past that"
        ))
    }

    /// Whether there was no time yet.
    pub fn is_empty(&self) -> bool {
        self.last_s == f64::NEG_INFINITY
    }
}

/// What to add to the times of a log from `first_s` to `last_s` so that they overlap `span_s`, if both are times of the
/// day or of the week and one of them begins after the clock started again; 0 if they overlap as they are or not at all.
pub fn start_between_s([first_s, last_s]: [f64; 2], span_s: [f64; 2]) -> f64 {
    let overlaps = |shift_s: f64| first_s + shift_s < span_s[1] && last_s + shift_s > span_s[0];
    if overlaps(0.0) {
        return 0.0;
    }
    let is_within = |period_s: f64| {
        let times_s = [first_s, last_s, span_s[0], span_s[1]];
        times_s
            .iter()
            .all(|time_s| (0.0..2.0 * period_s).contains(time_s))
    };
    let shifts = PERIODS_S
        .into_iter()
        .filter(|period_s| is_within(*period_s));
    let mut shifts = shifts.flat_map(|period_s| [period_s, -period_s]);
    shifts.find(|shift_s| overlaps(*shift_s)).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::HeadingFix;

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
    fn excerpts_and_windows_of_a_log_continue_each_other() {
        let fixes = |times_s: &[f64]| -> Vec<HeadingFix> {
            let fixes = times_s.iter();
            fixes.map(|t| HeadingFix::new(*t, 0.0, None)).collect()
        };
        let written: Vec<f64> = (0..40)
            .map(|k| (84_850.0 + 100.0 * f64::from(k)) % 86_400.0)
            .collect();
        let all = continued(&written);
        assert_eq!(all[39], 88_750.0);
        let (mut excerpts, mut windows) = (Continued::default(), Continued::in_windows());
        for end in 1..=40usize {
            let mut new = fixes(&written[end - 1..end]);
            let remark = excerpts.continue_times(&mut new);
            assert_eq!(new[0].time_s, all[end - 1]);
            assert_eq!(remark.is_some(), all[end - 1] >= 86_400.0);
            // The windows are longer than the time near midnight in which a log starts again.
            let begin = end.saturating_sub(10);
            let mut window = fixes(&written[begin..end]);
            windows.continue_times(&mut window);
            assert!(
                window
                    .iter()
                    .map(|fix| fix.time_s)
                    .eq(all[begin..end].iter().copied())
            );
        }
    }

    #[test]
    fn logs_on_both_sides_of_the_start_are_put_together() {
        let week_s = [604_700.0, 605_000.0];
        assert_eq!(start_between_s([20.0, 200.0], week_s), 604_800.0);
        assert_eq!(start_between_s(week_s, [20.0, 200.0]), -604_800.0);
        assert_eq!(
            start_between_s([86_000.0, 86_500.0], [5.0, 90.0]),
            -86_400.0
        );
        assert_eq!(start_between_s([604_750.0, 604_760.0], week_s), 0.0);
        assert_eq!(start_between_s([1000.0, 2000.0], week_s), 0.0);
        assert_eq!(start_between_s([1.7e9, 1.7e9 + 9.0], week_s), 0.0);
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
