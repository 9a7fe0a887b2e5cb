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
    /// The first time, as written.
    first_s: f64,
    /// The time of another log near which the first time lies.
    near_s: Option<f64>,
    /// The part of `added_s` that puts the log on the side of a start on which the other one is; `None` before that is
    /// known.
    side_s: Option<f64>,
    /// Whether the next records may begin with those from the second of the last ones on.
    is_windowed: bool,
}

impl Default for Continued {
    fn default() -> Self {
        Self {
            last_s: f64::NEG_INFINITY,
            added_s: 0.0,
            end_s: None,
            first_s: f64::NEG_INFINITY,
            near_s: None,
            side_s: None,
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
        if self.is_empty() {
            (self.first_s, self.last_s) = (time_s, time_s);
            if let Some(near_s) = self.near_s {
                self.settle(near_s);
            }
        }
        let least_s = self.side_s.unwrap_or(0.0).min(0.0);
        for period_s in PERIODS_S {
            if is_start(time_s) && is_end(self.last_s, period_s) {
                self.added_s += period_s;
                self.end_s.get_or_insert(self.last_s);
            } else if is_start(self.last_s) && is_end(time_s, period_s) && self.added_s > least_s {
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

    /// Puts the log on the side of a start on which another log is at this time, once for all its times; returns what is
    /// added to those that it has had, seconds. A log without times is settled by its first, beside the last time given
    /// here.
    pub fn join(&mut self, other_s: f64) -> f64 {
        if self.is_empty() {
            self.near_s = Some(other_s);
            return 0.0;
        }
        match self.side_s {
            Some(_) => 0.0,
            None => self.settle(other_s),
        }
    }

    fn settle(&mut self, other_s: f64) -> f64 {
        let span_s = [self.first_s, self.last_s + self.added_s];
        let shift_s = start_within_s(span_s, [other_s; 2], LONGEST_PAUSE_S);
        self.added_s += shift_s;
        self.side_s = Some(shift_s);
        shift_s
    }

    /// A sentence on a log on the other side of a start than the one that it joined; `None` if both are on the same.
    pub fn remark_on_side(&self) -> Option<String> {
        let shift_s = self.side_s.filter(|shift_s| *shift_s != 0.0)?;
        Some(on_both_sides(shift_s))
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

/// A sentence on a log to whose times this is added, seconds, because that of the IMU lies on the other side of a start.
pub fn on_both_sides(shift_s: f64) -> String {
    format!(
        "the log and that of the IMU lie on both sides of the start of a day or week: {shift_s} s are added to its \
         times"
    )
}

/// What to add to the times of a log from `first_s` to `last_s` so that they overlap `span_s`, if both are times of the
/// day or of the week and one of them begins after the clock started again; 0 if they overlap as they are or not at all.
pub fn start_between_s(log_s: [f64; 2], span_s: [f64; 2]) -> f64 {
    start_within_s(log_s, span_s, 0.0)
}

/// The same, where the log may also lie this far from the span, seconds.
fn start_within_s([first_s, last_s]: [f64; 2], span_s: [f64; 2], apart_s: f64) -> f64 {
    let overlaps = |shift_s: f64| {
        first_s + shift_s < span_s[1] + apart_s && last_s + shift_s > span_s[0] - apart_s
    };
    if overlaps(0.0) {
        return 0.0;
    }
    let is_within = |period_s: f64| {
        let times_s = [first_s, last_s, span_s[0], span_s[1]];
        times_s
            .iter()
            .all(|time_s| (-apart_s..2.0 * period_s).contains(time_s))
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
    fn a_log_joins_another_on_the_other_side_of_midnight() {
        // It begins after midnight, the other one before.
        let mut times = Continued::default();
        assert_eq!(times.join(86_395.0), 0.0);
        assert_eq!(times.join(86_405.0), 0.0);
        let continued = [3.0, 86_399.9, 4.0].map(|time_s| times.at(time_s));
        assert_eq!(continued, [86_403.0, 86_399.9, 86_404.0]);
        assert!(times.remark_on_side().is_some());
        // It begins before midnight and is continued, the other one after.
        let mut times = Continued::default();
        assert_eq!(
            [86_390.0, 5.0].map(|time_s| times.at(time_s)),
            [86_390.0, 86_405.0]
        );
        assert_eq!(times.join(6.0), -86_400.0);
        let continued = [6.0, 86_399.9, 7.0].map(|time_s| times.at(time_s));
        assert_eq!(continued, [6.0, 86_399.9 - 86_400.0, 7.0]);
        // What is settled stays so.
        assert_eq!(times.join(86_390.0), 0.0);
        // Both on the same side, or of clocks that have nothing in common.
        for (first_s, other_s) in [
            (5.0, 6.0),
            (86_390.0, 86_000.0),
            (1.7e9, 5.0),
            (40_000.0, 5.0),
        ] {
            let mut times = Continued::default();
            times.join(other_s);
            assert_eq!(times.at(first_s), first_s);
            assert!(times.remark_on_side().is_none());
        }
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
