//! What a control chart says.

use serde::{Deserialize, Serialize};

use super::cost::Cost;
use super::limit::Estimate;
use crate::calibration::ScannerFromScanner;

/// How days are judged.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChartSettings {
    /// Share of campaigns without any drift in which a day leaves its limits by chance.
    pub false_alarm_rate: f64,
    /// Days whose mean the others are held against, where there is no calibration and after an alarm.
    pub base_days: usize,
    /// What a mounting does from day to day without having been knocked, one standard deviation along each axis,
    /// metres: it warms up and cools down.
    pub day_sigma_m: f64,
    /// The same about each axis, radians.
    pub day_sigma_rad: f64,
}

impl Default for ChartSettings {
    fn default() -> Self {
        Self {
            false_alarm_rate: 0.01,
            base_days: 5,
            // A metre of aluminium over 5 K.
            day_sigma_m: 1e-4,
            day_sigma_rad: 1e-4,
        }
    }
}

impl ChartSettings {
    /// With what mountings do from day to day.
    pub(super) fn loosened(&self, mut estimate: Estimate) -> Estimate {
        for i in 0..6 {
            estimate.covariance[(i, i)] += [self.day_sigma_m, self.day_sigma_rad][i / 3].powi(2);
        }
        estimate
    }
}

/// The control chart of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Chart {
    /// How days were judged.
    pub settings: ChartSettings,
    /// Whether the base is a calibration; else it is the mean of the first days.
    pub from_calibration: bool,
    /// The first scanner, against which the others are watched.
    pub first: String,
    /// The others.
    pub scanners: Vec<ScannerChart>,
}

/// The chart of one scanner against the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScannerChart {
    /// The scanner.
    pub name: String,
    /// Where offsets of the days are counted from: the calibration, or the mounting in use on the first day.
    pub origin: ScannerFromScanner,
    /// Days in their order.
    pub days: Vec<ChartDay>,
    /// Days on which it left its limits.
    pub alarms: Vec<Alarm>,
    /// Present where it now sits elsewhere than in the base.
    pub off: Option<Off>,
}

/// A day of one scanner.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChartDay {
    /// YYYY-MM-DD.
    pub date: String,
    /// Drives that were combined.
    pub drives: usize,
    /// Off the origin of the chart: position along (metres) and rotation about (radians) the axes of the first
    /// scanner; `None` where it is not determined.
    pub offset: [Option<f64>; 6],
    /// Standard deviations of these.
    pub sigma: [Option<f64>; 6],
    /// dᵀ S⁻¹ d against the state before; `None` on the first day of a chart without a calibration, and where nothing
    /// is determined.
    pub t2: Option<f64>,
    /// What T² exceeds by chance at the rate of the chart.
    pub limit: Option<f64>,
    /// Whether it is out of its limits.
    pub is_out: bool,
    /// How often the scanner has left its limits so far, this day included.
    pub state: usize,
}

/// A day on which a scanner left its limits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alarm {
    /// The first day out of limits.
    pub date: String,
    /// The last day of the state before that shows what has moved; `None` where there is none, as with a calibration
    /// that the first day is out of.
    pub last_within: Option<String>,
    /// T² of that day.
    pub t2: f64,
    /// Its limit.
    pub limit: f64,
    /// How far it moved from the state before: metres and radians; `None` where that is not determined.
    pub change: [Option<f64>; 6],
    /// Standard deviations of these.
    pub sigma: [Option<f64>; 6],
    /// What that does to the points of the scanner.
    pub cost: Cost,
}

/// A scanner that sits elsewhere than in the base.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Off {
    /// The first day from which it does without a break.
    pub since: String,
    /// How far, by all days of its present state: metres and radians; `None` where that is not determined.
    pub offset: [Option<f64>; 6],
    /// Standard deviations of these.
    pub sigma: [Option<f64>; 6],
    /// What that does to the points of the scanner.
    pub cost: Cost,
}
