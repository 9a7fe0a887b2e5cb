//! The clock of a log: times of day, and the days that dates give them.

use crate::format::text::civil::DAY_S;
use crate::statistics::median;

/// A time: the day, counted from the first day of the log, and the second of the day.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    day: i64,
    pub(super) second_s: f64,
}

/// The clock of a log.
#[derive(Debug, Default)]
pub(super) struct Clock {
    last: Option<Moment>,
    /// Days from 1970 to day 0, once known.
    day_0: Option<i64>,
}

/// If a time of day is this much later than the previous time, it is a late one of the previous day.
const LATE_S: f64 = 23.0 * 3600.0;
/// A date so many days from that of most records is one that the receiver shows before it knows the date, such as
/// 1980-01-06. No drive pauses for so long.
const LONGEST_PAUSE_DAYS: f64 = 30.0;

impl Clock {
    /// The moment of the next time of day in the log.
    pub(super) fn at(&mut self, second_s: f64) -> Moment {
        let day = self.last.map_or(0, |last| match second_s - last.second_s {
            step_s if step_s < -0.5 * DAY_S => last.day + 1,
            step_s if step_s > LATE_S => last.day - 1,
            _ => last.day,
        });
        let moment = Moment { day, second_s };
        self.last = Some(moment);
        moment
    }

    /// Like [`at`](Self::at), with a known date in days since 1970.
    pub(super) fn at_date(&mut self, second_s: f64, date: i64) -> Moment {
        let mut moment = self.at(second_s);
        let day_0 = *self.day_0.get_or_insert(date - moment.day);
        moment.day = date - day_0;
        self.last = Some(moment);
        moment
    }

    /// Like [`at_date`](Self::at_date) if the date is known, else like [`at`](Self::at).
    pub(super) fn at_maybe(&mut self, second_s: f64, date: Option<i64>) -> Moment {
        match date {
            Some(date) => self.at_date(second_s, date),
            None => self.at(second_s),
        }
    }

    fn time_s(&self, moment: Moment) -> f64 {
        (self.day_0.unwrap_or(0) + moment.day) as f64 * DAY_S + moment.second_s
    }

    /// The records with their times, without those whose date cannot be that of the drive; their number is added to
    /// `undated`.
    pub(super) fn date<T>(
        &self,
        mut records: Vec<(Moment, T)>,
        undated: &mut u64,
    ) -> Vec<(f64, T)> {
        let days = records.iter().map(|(moment, _)| moment.day as f64);
        let day = median(days).unwrap_or_default();
        let all = records.len();
        records.retain(|(moment, _)| (moment.day as f64 - day).abs() <= LONGEST_PAUSE_DAYS);
        *undated += (all - records.len()) as u64;
        let records = records.into_iter();
        records
            .map(|(moment, record)| (self.time_s(moment), record))
            .collect()
    }
}
