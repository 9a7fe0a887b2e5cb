//! The chart of one scanner: days out of limits, and the states with which the days are compared.

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
    /// The estimate of the day, including the variances of the mounting from day to day.
    pub estimate: Estimate,
    /// Standard deviations without these variances.
    pub sigma: Vector6<f64>,
}

/// The base with which the days of a scanner are compared, and the rate of false alarms.
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
            let difference = before.and_then(|before| Difference::new(&day.estimate, &before));
            let limit = difference.as_ref().map(|d| d.limit(self.probability));
            let out = difference
                .as_ref()
                .zip(limit)
                .filter(|(difference, limit)| difference.t2 > *limit);
            if let Some((difference, limit)) = out {
                chart.alarms.push(Alarm {
                    date: day.date.into(),
                    last_within: last_within(&days[..number], &difference.determined),
                    t2: difference.t2,
                    limit,
                    change: known(&difference.offset, &difference.determined),
                    sigma: difference.sigma(),
                    cost: Moments::mean(&day.drives)
                        .cost(&difference.offset, &difference.covariance),
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
                t2: difference.as_ref().map(|difference| difference.t2),
                limit,
                is_out: out.is_some(),
                state,
            });
        }
        chart.off = self.off(&states, &chart.alarms, days);
        chart
    }

    /// The base of a state: the calibration, or the mean of its first days.
    fn base_of(&self, states: &[Vec<Estimate>], state: usize) -> Option<Estimate> {
        let calibration = self.base.filter(|_| state == 0);
        let days = &states[state];
        calibration.or_else(|| mean(&days[..days.len().min(self.base_days)]))
    }

    /// The deviation of the present state from the base, and its first day; `None` if it is not significant.
    fn off(&self, states: &[Vec<Estimate>], alarms: &[Alarm], days: &[Day<'_>]) -> Option<Off> {
        let base = self.base_of(states, 0)?;
        let deviation = |state: usize| {
            let difference = Difference::new(&mean(&states[state])?, &base)?;
            (difference.t2 > difference.limit(self.probability)).then_some(difference)
        };
        let present = deviation(states.len() - 1).filter(|_| states.len() > 1)?;
        let mut since = states.len() - 1;
        while since > 1 && deviation(since - 1).is_some() {
            since -= 1;
        }
        Some(Off {
            since: alarms[since - 1].date.clone(),
            offset: known(&present.offset, &present.determined),
            sigma: present.sigma(),
            cost: Moments::mean(&days.last()?.drives).cost(&present.offset, &present.covariance),
        })
    }
}

/// The last of these days that determines a component of the difference.
fn last_within(days: &[Day<'_>], determined: &[bool; 6]) -> Option<String> {
    let shows = |day: &&Day<'_>| (0..6).any(|i| determined[i] && day.estimate.determined[i]);
    Some(days.iter().rfind(shows)?.date.into())
}

/// The determined components of a vector.
fn known(all: &Vector6<f64>, determined: &[bool; 6]) -> [Option<f64>; 6] {
    std::array::from_fn(|i| determined[i].then_some(all[i]))
}
