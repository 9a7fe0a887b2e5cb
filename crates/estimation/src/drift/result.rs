//! The result of a control chart.

use serde::{Deserialize, Serialize};

use super::cost::Cost;
use super::limit::Estimate;
use crate::calibration::ScannerFromScanner;

/// Settings by which days are judged.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ChartSettings {
    /// Probability that some day of a campaign without any drift leaves its limits by chance.
    pub false_alarm_rate: f64,
    /// Number of days whose mean is the base for the others, if there is no calibration and after an alarm.
    pub base_days: usize,
    /// Standard deviation of the changes of a mounting from day to day along each axis without any knock, metres: it
    /// warms up and cools down.
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
    /// The estimate with the variances of the mounting from day to day added.
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
    /// The settings by which days were judged.
    pub settings: ChartSettings,
    /// Whether the base is a calibration; otherwise it is the mean of the first days.
    pub from_calibration: bool,
    /// The first scanner, against which the others are watched.
    pub first: String,
    /// The charts of the other scanners.
    pub scanners: Vec<ScannerChart>,
}

/// The chart of one scanner against the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScannerChart {
    /// The scanner.
    pub name: String,
    /// Origin of the offsets of the days: the calibration, or the mounting in use on the first day.
    pub origin: ScannerFromScanner,
    /// The days in chronological order.
    pub days: Vec<ChartDay>,
    /// The days on which the scanner left its limits.
    pub alarms: Vec<Alarm>,
    /// The present deviation from the base, if it is significant.
    pub off: Option<Off>,
}

/// A day of one scanner.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChartDay {
    /// YYYY-MM-DD.
    pub date: String,
    /// Number of drives that were combined.
    pub drives: usize,
    /// Offset from the origin of the chart: position along (metres) and rotation about (radians) the axes of the first
    /// scanner; `None` for components that are not determined.
    pub offset: [Option<f64>; 6],
    /// Standard deviations of these.
    pub sigma: [Option<f64>; 6],
    /// T² = dᵀ S⁻¹ d of the difference d from the state before; `None` on the first day of a chart without a
    /// calibration, and if no component is determined.
    pub t2: Option<f64>,
    /// The limit that T² exceeds by chance at the rate of the chart.
    pub limit: Option<f64>,
    /// Whether the day is out of its limits.
    pub is_out: bool,
    /// Number of times that the scanner has left its limits so far, this day included.
    pub state: usize,
}

/// A day on which a scanner left its limits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alarm {
    /// The first day out of limits.
    pub date: String,
    /// The last day of the state before that determines a component of the change; `None` if there is none, for example
    /// if the first day already deviates from the calibration.
    pub last_within: Option<String>,
    /// T² of that day.
    pub t2: f64,
    /// Its limit.
    pub limit: f64,
    /// Change from the state before, metres and radians; `None` for components that are not determined.
    pub change: [Option<f64>; 6],
    /// Standard deviations of these.
    pub sigma: [Option<f64>; 6],
    /// Displacement of the scanner's points due to the change.
    pub cost: Cost,
}

/// The present deviation of a scanner from the base.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Off {
    /// The first day of the deviation, which has lasted without a break since.
    pub since: String,
    /// The deviation, from all days of the present state, metres and radians; `None` for components that are not
    /// determined.
    pub offset: [Option<f64>; 6],
    /// Standard deviations of these.
    pub sigma: [Option<f64>; 6],
    /// Displacement of the scanner's points due to the deviation.
    pub cost: Cost,
}
