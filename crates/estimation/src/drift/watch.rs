//! One scanner day by day: when it leaves its limits, and what it is held against then.

use nalgebra::Vector6;

use super::cost::Moments;
use super::limit::{Difference, Estimate, mean};
use super::overlap::ScannerOverlap;
use super::result::{Alarm, ChartDay, Off, ScannerChart};
use crate::calibration::ScannerFromScanner;

/// One scanner on one day.
pub struct Day<'a> {
    pub date: &'a str,
    pub drives: Vec<&'a ScannerOverlap>,
    /// With what mountings do from day to day.
    pub estimate: Estimate,
    /// Standard deviations without that.
    pub sigma: Vector6<f64>,
}

/// What the days of a scanner are held against.
pub struct Watch {
    /// A calibration, which stays the base until the first alarm.
    pub base: Option<Estimate>,
    pub base_days: usize,
    pub probability: f64,
}

impl Watch {
    /// The chart of the days of a scanner.
    pub fn chart(&self, name: &str, origin: ScannerFromScanner, days: &[Day<'_>]) -> ScannerChart {
        // The days of each state, the present one last.
        let mut states: Vec<Vec<Estimate>> = vec![Vec::new()];
        let mut chart = ScannerChart {
            name: name.into(),
            origin,
            days: Vec::new(),
            alarms: Vec::new(),
            off: None,
        };
        for (number, day) in days.iter().enumerate() {
            let state = states.len() - 1;
            let before = self.base_of(&states, state);
            let found = before.and_then(|before| Difference::of(&day.estimate, &before));
            let limit = found.as_ref().map(|found| found.limit(self.probability));
            let out = found
                .as_ref()
                .zip(limit)
                .filter(|(found, limit)| found.t2 > *limit);
            if let Some((found, limit)) = out {
                chart.alarms.push(Alarm {
                    date: day.date.into(),
                    last_within: last_within(&days[..number], &found.determined),
                    t2: found.t2,
                    limit,
                    change: known(&found.offset, &found.determined),
                    sigma: found.sigma(),
                    cost: Moments::of(&day.drives).cost(&found.offset, &found.covariance),
                });
                states.push(Vec::new());
            }
            let state = states.len() - 1;
            states[state].push(day.estimate);
            chart.days.push(ChartDay {
                date: day.date.into(),
                drives: day.drives.len(),
                offset: known(&day.estimate.offset, &day.estimate.determined),
                sigma: known(&day.sigma, &day.estimate.determined),
                t2: found.as_ref().map(|found| found.t2),
                limit,
                is_out: out.is_some(),
                state,
            });
        }
        chart.off = self.off(&states, &chart.alarms, days);
        chart
    }

    /// What a state is held against: the calibration, or the mean of its first days.
    fn base_of(&self, states: &[Vec<Estimate>], state: usize) -> Option<Estimate> {
        let own = self.base.filter(|_| state == 0);
        let days = &states[state];
        own.or_else(|| mean(&days[..days.len().min(self.base_days)]))
    }

    /// Whether the present state is another than the first, and since when.
    fn off(&self, states: &[Vec<Estimate>], alarms: &[Alarm], days: &[Day<'_>]) -> Option<Off> {
        let base = self.base_of(states, 0)?;
        let is_off = |state: usize| {
            let found = Difference::of(&mean(&states[state])?, &base)?;
            (found.t2 > found.limit(self.probability)).then_some(found)
        };
        let now = is_off(states.len() - 1).filter(|_| states.len() > 1)?;
        let mut since = states.len() - 1;
        while since > 1 && is_off(since - 1).is_some() {
            since -= 1;
        }
        Some(Off {
            since: alarms[since - 1].date.clone(),
            offset: known(&now.offset, &now.determined),
            sigma: now.sigma(),
            cost: Moments::of(&days.last()?.drives).cost(&now.offset, &now.covariance),
        })
    }
}

/// The last of these days on which a component of a difference is determined.
fn last_within(days: &[Day<'_>], determined: &[bool; 6]) -> Option<String> {
    let shows = |day: &&Day<'_>| (0..6).any(|i| determined[i] && day.estimate.determined[i]);
    Some(days.iter().rfind(shows)?.date.into())
}

fn known(all: &Vector6<f64>, determined: &[bool; 6]) -> [Option<f64>; 6] {
    std::array::from_fn(|i| determined[i].then_some(all[i]))
}
