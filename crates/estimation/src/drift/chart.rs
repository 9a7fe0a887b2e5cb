//! The control chart of a campaign: the mounting of each scanner in the frame of the first, day by day.

use std::collections::BTreeMap;

use super::base::Base;

use super::limit::{Estimate, mean};
use super::overlap::{Overlap, ScannerOverlap};
use super::result::{Chart, ChartSettings};
use super::step::offset;
use super::watch::{Day, Watch};
use crate::calibration::ScannerFromScanner;
use crate::error::{Error, Result};
use crate::format::day_number;

impl Chart {
    /// The chart of the drives of a campaign, each with its date, in any order; drives of one date are combined. The
    /// days are compared with the calibration in `base` or, if `base` is empty, with the mean of the first days.
    ///
    /// # Errors
    /// No drive; an invalid date; drives with different first scanners; an invalid rate or standard deviation.
    pub fn new(
        drives: &[(String, Overlap)],
        base: &[Base],
        settings: &ChartSettings,
    ) -> Result<Self> {
        check(drives, base, settings)?;
        let mut scanners = BTreeMap::<&str, BTreeMap<&str, Vec<&ScannerOverlap>>>::new();
        for (date, drive) in drives {
            for scanner in &drive.scanners {
                let dates = scanners.entry(&scanner.name).or_default();
                dates.entry(date).or_default().push(scanner);
            }
        }
        let tests: usize = scanners.values().map(BTreeMap::len).sum();
        // Šidák's correction: the rate holds for the whole chart.
        let probability = -((-settings.false_alarm_rate).ln_1p() / tests as f64).exp_m1();
        let charts = scanners.into_iter().map(|(name, dates)| {
            let base = base.iter().find(|base| base.name == name);
            let first = dates.values().next().and_then(|drives| drives.first());
            let in_use = first.map_or(ScannerFromScanner::identity(), |first| first.in_use);
            let origin = base.map_or(in_use, |base| base.first_from_scanner);
            let days = dates.into_iter().map(|(date, drives)| {
                let estimate = combined(&origin, &drives);
                Day {
                    sigma: estimate.covariance.diagonal().map(f64::sqrt),
                    estimate: settings.loosened(estimate),
                    date,
                    drives,
                }
            });
            let days: Vec<Day<'_>> = days.collect();
            let watch = Watch {
                base: base.map(|base| settings.loosened(base.estimate())),
                base_days: settings.base_days.max(1),
                probability,
            };
            watch.chart(name, origin, &days)
        });
        Ok(Self {
            settings: *settings,
            from_calibration: !base.is_empty(),
            first: drives[0].1.first.clone(),
            scanners: charts.collect(),
        })
    }
}

fn check(drives: &[(String, Overlap)], base: &[Base], settings: &ChartSettings) -> Result<()> {
    let Some((_, first)) = drives.first() else {
        return Err(Error::data(
            "a control chart without drives",
            "give the overlap of one drive or more",
        ));
    };
    if let Some((date, _)) = drives.iter().find(|(date, _)| day_number(date).is_none()) {
        return Err(Error::data(
            format!("`{date}` is not a date"),
            "give dates as YYYY-MM-DD",
        ));
    }
    let firsts = drives
        .iter()
        .map(|(date, drive)| (&drive.first, date.as_str()));
    let mut firsts = firsts.chain(base.iter().map(|base| (&base.first, "the calibration")));
    if let Some((other, place)) = firsts.find(|(name, _)| **name != first.first) {
        return Err(Error::data(
            format!(
                "the first scanner is `{}` on {} and `{other}` on {place}",
                first.first, drives[0].0
            ),
            "name the scanners in the same order in all projects",
        ));
    }
    let rate = settings.false_alarm_rate;
    if !(rate > 0.0 && rate < 1.0) {
        return Err(Error::data(
            format!("a false alarm rate of {rate}"),
            "give a share between 0 and 1, such as 0.01",
        ));
    }
    let (shift_m, turn_rad) = (settings.day_sigma_m, settings.day_sigma_rad);
    if [shift_m, turn_rad]
        .iter()
        .any(|sigma| !sigma.is_finite() || *sigma < 0.0)
    {
        return Err(Error::data(
            format!(
                "standard deviations of mountings from day to day of {shift_m} m and {turn_rad} rad"
            ),
            "give standard deviations of 0 or more",
        ));
    }
    Ok(())
}

/// The estimate of one day from all of its drives.
fn combined(origin: &ScannerFromScanner, drives: &[&ScannerOverlap]) -> Estimate {
    let estimate = |drive: &&ScannerOverlap| Estimate {
        offset: offset(origin, &drive.first_from_scanner()),
        covariance: drive.covariance,
        determined: drive.determined,
        degrees: drive.degrees(),
    };
    let all: Vec<Estimate> = drives.iter().map(estimate).collect();
    mean(&all).unwrap_or(Estimate {
        determined: [false; 6],
        ..all[0]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drift::ScannerChart;
    use nalgebra::Matrix6;

    const SIGMA: f64 = 1e-4;

    /// The variance of the mean of this number of days, in variances of a day with 40 degrees of freedom and six
    /// components.
    fn variance_of_mean(days: f64) -> f64 {
        (1.0 + 2.0 * 7.0 / 40.0 * (1.0 - 1.0 / days)) / days
    }

    fn strict() -> ChartSettings {
        ChartSettings {
            day_sigma_m: 0.0,
            day_sigma_rad: 0.0,
            ..ChartSettings::default()
        }
    }

    /// A day with this offset.
    fn day(offset: [f64; 6]) -> Overlap {
        let scanner = ScannerOverlap {
            name: "right".into(),
            in_use: ScannerFromScanner::identity(),
            offset: offset.into(),
            covariance: Matrix6::identity() * SIGMA * SIGMA,
            determined: [true; 6],
            blocks: 41,
            spots: 1000,
            lag_s: 0.1,
            normal: Matrix6::identity(),
            vertical: Matrix6::identity() * 0.25,
            total: Matrix6::identity() * 4.0,
        };
        Overlap {
            first: "left".into(),
            scanners: vec![scanner],
        }
    }

    /// Days of May with offsets along x in sigmas.
    fn drives(x_sigmas: &[f64]) -> Vec<(String, Overlap)> {
        let all = x_sigmas.iter().zip(1..);
        let drive = |(x, number): (&f64, i32)| {
            let offset = [x * SIGMA, 0.0, 0.0, 0.0, 0.0, 0.0];
            (format!("2025-05-{number:02}"), day(offset))
        };
        all.map(drive).collect()
    }

    fn chart(x_sigmas: &[f64]) -> ScannerChart {
        let chart = Chart::new(&drives(x_sigmas), &[], &strict()).unwrap();
        chart.scanners.into_iter().next().unwrap()
    }

    fn alarms(chart: &ScannerChart) -> Vec<&str> {
        chart.alarms.iter().map(|alarm| &alarm.date[8..]).collect()
    }

    const BEFORE: [f64; 6] = [0.3, -0.5, 0.2, 0.6, -0.4, 0.1];

    #[test]
    fn after_an_alarm_the_chart_continues_from_the_new_state_and_reports_it_as_off() {
        let mut days = BEFORE.to_vec();
        days.extend([20.2, 19.6, 20.3, 19.9]);
        let scanner = chart(&days);
        assert_eq!(alarms(&scanner), ["07"]);
        let alarm = &scanner.alarms[0];
        assert_eq!(alarm.last_within.as_deref(), Some("2025-05-06"));
        // From the mean of the first five days.
        assert!((alarm.change[0].unwrap() / SIGMA - (20.2 - 0.04)).abs() < 1e-9);
        let expected = (1.0 + variance_of_mean(5.0)).sqrt();
        assert!((alarm.sigma[0].unwrap() / SIGMA - expected).abs() < 1e-9);
        // M = 4 in all, 1 along the normal.
        assert!((alarm.cost.total_m / SIGMA - 2.0 * 20.16).abs() < 1e-9);
        assert!((alarm.cost.normal_sigma_m / SIGMA - expected).abs() < 1e-9);
        assert!((alarm.cost.vertical_m / alarm.cost.normal_m - 0.5).abs() < 1e-12);
        let off = scanner.off.as_ref().unwrap();
        assert_eq!(off.since, "2025-05-07");
        assert!((off.offset[0].unwrap() / SIGMA - (20.0 - 0.04)).abs() < 1e-9);
        assert_eq!(scanner.days[0].t2, None);
        assert_eq!((scanner.days[5].state, scanner.days[6].state), (0, 1));
    }

    #[test]
    fn a_day_that_determines_nothing_is_not_the_last_day_within_limits() {
        let mut days = drives(&BEFORE);
        days[5].1.scanners[0].determined = [false; 6];
        days.extend(drives(&[0.0; 7]).into_iter().skip(6));
        days[6].1.scanners[0].offset[0] = 20.0 * SIGMA;
        let chart = Chart::new(&days, &[], &strict()).unwrap();
        let alarm = &chart.scanners[0].alarms[0];
        assert_eq!(alarm.date, "2025-05-07");
        assert_eq!(alarm.last_within.as_deref(), Some("2025-05-05"));
    }

    #[test]
    fn a_scanner_that_comes_back_is_not_off() {
        let mut days = BEFORE.to_vec();
        days.extend([20.0, 0.1, -0.2]);
        let scanner = chart(&days);
        assert_eq!(alarms(&scanner), ["07", "08"]);
        assert_eq!(scanner.off, None);
        assert_eq!(scanner.days[8].state, 2);
    }

    #[test]
    fn two_knocks_are_off_since_the_first() {
        let mut days = BEFORE.to_vec();
        days.extend([20.0, 20.1, 50.0, 50.2]);
        let scanner = chart(&days);
        assert_eq!(alarms(&scanner), ["07", "09"]);
        assert_eq!(scanner.off.unwrap().since, "2025-05-07");
    }

    #[test]
    fn a_calibration_is_a_base_from_the_first_day() {
        let base = Base {
            first: "left".into(),
            name: "right".into(),
            first_from_scanner: ScannerFromScanner::identity(),
            covariance: Matrix6::identity() * 1e-12,
            determined: [true; 6],
        };
        let settings = strict();
        let charts = Chart::new(&drives(&[20.0, 20.1]), &[base], &settings).unwrap();
        let scanner = &charts.scanners[0];
        assert_eq!(
            (alarms(scanner), &scanner.alarms[0].last_within),
            (vec!["01"], &None)
        );
        assert_eq!(scanner.off.as_ref().unwrap().since, "2025-05-01");
    }

    #[test]
    fn day_to_day_changes_of_mountings_raise_no_alarm() {
        // Mountings change by ten sigmas of a day from day to day: 20 sigmas are less than two standard deviations.
        let loose = ChartSettings {
            day_sigma_m: 10.0 * SIGMA,
            ..strict()
        };
        let mut days = BEFORE.to_vec();
        days.extend([20.0, 19.0, -11.0]);
        let charts = Chart::new(&drives(&days), &[], &loose).unwrap();
        let scanner = &charts.scanners[0];
        assert_eq!(alarms(scanner), Vec::<&str>::new());
        // (20 − 0.04)² over (100 + 1) (1 + a mean of five).
        let expected = 19.96_f64.powi(2) / (101.0 * (1.0 + variance_of_mean(5.0)));
        assert!((scanner.days[6].t2.unwrap() - expected).abs() < 1e-9);
        assert!((scanner.days[6].sigma[0].unwrap() / SIGMA - 1.0).abs() < 1e-9);
    }

    #[test]
    fn drives_of_a_day_are_combined_in_any_order() {
        let mut all = drives(&[0.0, 0.3, 1.0]);
        all.push((
            all[2].0.clone(),
            day([2.0 * SIGMA, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ));
        let settings = strict();
        let charts = Chart::new(&all, &[], &settings).unwrap();
        let last = &charts.scanners[0].days[2];
        assert_eq!(last.drives, 2);
        assert!((last.offset[0].unwrap() / SIGMA - 1.5).abs() < 1e-9);
        assert!((last.sigma[0].unwrap() / SIGMA - variance_of_mean(2.0).sqrt()).abs() < 1e-9);
        all.swap(0, 2);
        assert_eq!(Chart::new(&all, &[], &settings).unwrap(), charts);
    }

    #[test]
    fn overlaps_and_charts_survive_a_round_trip_through_json() {
        let all = drives(&[0.0, 0.3, 30.0, 30.0]);
        let text = serde_json::to_string(&all).unwrap();
        let read: Vec<(String, Overlap)> = serde_json::from_str(&text).unwrap();
        assert_eq!(read, all);
        let chart = Chart::new(&read, &[], &strict()).unwrap();
        let text = serde_json::to_string(&chart).unwrap();
        let back: Chart = serde_json::from_str(&text).unwrap();
        // The last bit of a number may be lost.
        let (scanner, expected) = (&back.scanners[0], &chart.scanners[0]);
        assert_eq!(alarms(scanner), ["03"]);
        assert_eq!((scanner.days.len(), back.settings), (4, chart.settings));
        let change = |chart: &ScannerChart| chart.alarms[0].change[0].unwrap();
        assert!((change(scanner) / change(expected) - 1.0).abs() < 1e-15);
        assert_eq!(scanner.off.as_ref().unwrap().since, "2025-05-03");
    }

    #[test]
    fn invalid_campaigns_are_refused() {
        let settings = strict();
        let refused = |drives: &[(String, Overlap)], settings: &ChartSettings| {
            Chart::new(drives, &[], settings).unwrap_err().to_string()
        };
        assert!(refused(&[], &settings).contains("without drives"));
        let mut all = drives(&[0.0, 0.0]);
        all[1].1.first = "right".into();
        assert!(refused(&all, &settings).contains("`right` on 2025-05-02"));
        all[1].0 = "2025-02-29".into();
        assert!(refused(&all, &settings).contains("`2025-02-29` is not a date"));
        let rate = ChartSettings {
            false_alarm_rate: 0.0,
            ..settings
        };
        assert!(refused(&drives(&[0.0]), &rate).contains("rate of 0"));
    }
}
