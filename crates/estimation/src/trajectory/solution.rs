//! How an adjustment ended, and the residuals, rejections and constants it leaves.

pub use crate::adjustment::StopReason;
use serde::{Deserialize, Serialize};

use crate::statistics::chi_square_bounds_95;
use std::fmt;

/// Why a record is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RejectionReason {
    /// Its time is out of order with those of the records around it.
    TimeOrder,
    /// It lies before or after the IMU's log.
    OutsideImu,
    /// It repeats the position before it.
    Repeated,
    /// Its residual exceeds the limit of the test.
    Outlier,
    /// It arrived after the online smoother had moved on.
    Late,
}

impl fmt::Display for RejectionReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TimeOrder => "time out of order",
            Self::OutsideImu => "outside the IMU's span",
            Self::Repeated => "repeats the position before it",
            Self::Outlier => "outlier",
            Self::Late => "too late for the online smoother",
        })
    }
}

/// A record that is not used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rejection {
    /// `imu`, `heading`, or the name of the position sensor.
    pub sensor: String,
    /// Number of the record in the log, from 1.
    pub record: usize,
    /// Seconds.
    pub time_s: f64,
    /// Why it is not used.
    pub reason: RejectionReason,
    /// Length of the residual in standard deviations, for outliers.
    pub normalised: Option<f64>,
}

/// One record's residual.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Number of the record in the log, from 1.
    pub record: usize,
    /// Seconds.
    pub time_s: f64,
    /// Predicted − measured: east, north, up in metres, or one angle in radians.
    pub values: Vec<f64>,
    /// The same in standard deviations of the measurement.
    pub normalised: Vec<f64>,
    /// In standard deviations of the residual, σ √r with the redundancy r of the component: the
    /// test quantity of data snooping (Baarda 1968). 0 where nothing checks the component.
    pub tests: Vec<f64>,
    /// Weight that the loss left, 0 to 1; 0 is rejected.
    pub weight: f64,
}

/// Statistics of one sensor's residuals after the adjustment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SensorDiagnostics {
    /// `heading`, `pitch`, `rest`, `gyro`, `accelerometer`, `bias_walk`, or the name of the position sensor.
    pub name: String,
    /// Unit of the raw residuals; empty where they mix units.
    pub unit: String,
    /// Records used.
    pub count: usize,
    /// Records rejected by the test.
    pub rejected: usize,
    /// Records outside the IMU's span, out of time order, or repeated.
    pub ignored: usize,
    /// Root mean square per component of the records used.
    pub rms_raw: f64,
    /// The same in standard deviations of the measurement.
    pub rms_normalised: f64,
    /// r: how many of the observations check the others, Σ (1 − jᵀ Σ j / σ²).
    pub redundancy: f64,
    /// Ω = Σ (v/σ)².
    pub chi_square: f64,
    /// Where Ω lies in 95 of 100 drives if the standard deviations are right.
    pub chi_square_bounds_95: [f64; 2],
    /// Ω / r: 1 where the standard deviations are right; else its square root is the factor that they
    /// need. `None` where nothing checks the sensor.
    pub variance_component: Option<f64>,
}

impl SensorDiagnostics {
    /// From the sums over the records used.
    pub(super) fn new(name: impl Into<String>, unit: &str, sums: &Tally) -> Self {
        let n = sums.components.max(1) as f64;
        let redundancy = sums.redundancy.max(0.0);
        Self {
            name: name.into(),
            unit: unit.into(),
            count: sums.records,
            rejected: 0,
            ignored: 0,
            rms_raw: (sums.raw / n).sqrt(),
            rms_normalised: (sums.normalised / n).sqrt(),
            redundancy,
            chi_square: sums.normalised,
            chi_square_bounds_95: chi_square_bounds_95(redundancy),
            variance_component: (redundancy > 1.0).then(|| sums.normalised / redundancy),
        }
    }

    /// Whether Ω lies within its bounds.
    pub fn passes(&self) -> bool {
        let [low, high] = self.chi_square_bounds_95;
        (low..=high).contains(&self.chi_square)
    }
}

/// Sums over the records of a sensor.
#[derive(Debug, Clone, Copy, Default)]
pub struct Tally {
    pub records: usize,
    pub components: usize,
    pub raw: f64,
    pub normalised: f64,
    pub redundancy: f64,
}

/// A constant that was estimated along with the trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EstimatedConstant {
    /// As in the project, with the component: `prism.lever_arm.x`.
    pub name: String,
    /// Unit of the values.
    pub unit: String,
    /// The value of the project.
    pub start: f64,
    /// The value estimated from the drive.
    pub value: f64,
    /// Its standard deviation; `None` where the drive does not determine it: the value is then
    /// that of the project.
    pub sigma: Option<f64>,
}

impl EstimatedConstant {
    /// The factor that converts it to the unit in which it is shown, and that unit: angles in degrees,
    /// times in milliseconds.
    pub fn shown_in(&self) -> (f64, &str) {
        match self.unit.as_str() {
            "rad" => (1f64.to_degrees(), "°"),
            "s" => (1e3, "ms"),
            unit => (1.0, unit),
        }
    }
}

/// A clock that was set during recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClockJump {
    /// `imu`, `heading`, or the name of the position sensor.
    pub sensor: String,
    /// The first record with the new setting, from 1.
    pub record: usize,
    /// Its time as logged, seconds.
    pub time_s: f64,
    /// By how much the clock was advanced, seconds.
    pub size_s: f64,
}

/// How an adjustment ended and what it leaves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Solution {
    /// Steps tried, refused ones included.
    pub iterations: usize,
    /// Whether more steps would not have changed the solution: [`StopReason::is_converged`].
    pub converged: bool,
    /// Why it stopped.
    pub stop: StopReason,
    /// Half the sum of squared normalised residuals at the start values.
    pub cost_initial: f64,
    /// The same at the solution.
    pub cost_final: f64,
    /// Nodes of the graph.
    pub nodes: usize,
    /// One for each sensor: position sensors, heading, pitch, rest, gyro, accelerometer, bias walk.
    pub sensors: Vec<SensorDiagnostics>,
    /// Constants estimated along with the trajectory.
    pub constants: Vec<EstimatedConstant>,
    /// Records that are not used.
    pub rejections: Vec<Rejection>,
    /// Clocks that were set during recording, corrected.
    pub clock_jumps: Vec<ClockJump>,
    /// Times without IMU, bridged with the sigma of unknown motion, seconds from and to.
    pub imu_gaps_s: Vec<(f64, f64)>,
    /// Times during which the body rested and its velocity was held at zero, seconds.
    pub rests_s: Vec<(f64, f64)>,
    /// Residuals of every record, per position sensor, heading and pitch, in the order of
    /// `sensors`.
    pub residuals: Vec<Vec<Residual>>,
}

impl Solution {
    /// The diagnostics of the sensor with this name.
    pub fn sensor(&self, name: &str) -> Option<&SensorDiagnostics> {
        self.sensors.iter().find(|sensor| sensor.name == name)
    }

    /// The records that fail the test of data snooping worst: sensor name and residual, by the
    /// largest test quantity of a component.
    pub fn worst(&self, count: usize) -> Vec<(&str, &Residual)> {
        let size = |r: &Residual| r.tests.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
        let mut all: Vec<(&str, &Residual)> = self
            .sensors
            .iter()
            .zip(&self.residuals)
            .flat_map(|(sensor, residuals)| {
                residuals.iter().map(move |r| (sensor.name.as_str(), r))
            })
            .collect();
        all.sort_by(|a, b| size(b.1).total_cmp(&size(a.1)));
        all.truncate(count);
        all
    }
}

impl fmt::Display for Solution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} after {} iterations over {} nodes; residuals:",
            self.stop, self.iterations, self.nodes
        )?;
        let measured =
            |s: &&SensorDiagnostics| s.count > 0 && matches!(s.unit.as_str(), "m" | "rad");
        for (i, sensor) in self.sensors.iter().filter(measured).enumerate() {
            let comma = if i > 0 { "," } else { "" };
            let rms = if sensor.unit == "m" {
                format!("{:.1} mm", sensor.rms_raw * 1e3)
            } else {
                format!("{:.2}°", sensor.rms_raw.to_degrees())
            };
            write!(
                f,
                "{comma} {} {rms} ({:.2} sigma)",
                sensor.name, sensor.rms_normalised
            )?;
        }
        Ok(())
    }
}

/// The IMU's noise is larger than expected where its residuals exceed it by more than this many standard
/// deviations of the variance component.
const NOISE_SIGMAS: f64 = 3.0;
/// The estimated constant that is this factor.
pub(super) const NOISE_SCALE: &str = "imu.noise_scale";

impl Solution {
    /// The factor on the standard deviations of the IMU that its residuals ask for, if it is significant;
    /// otherwise 1.
    pub fn imu_noise_factor(&self) -> f64 {
        let (square, redundancy) = self.imu_square_and_redundancy();
        let ratio: f64 = square / redundancy;
        let notable = ratio > 1.0 + NOISE_SIGMAS * (2.0 / redundancy).sqrt();
        if redundancy > 1.0 && notable {
            ratio.sqrt()
        } else {
            1.0
        }
    }

    /// r ln s²: what −2 ln L rises by where the IMU's standard deviations are scaled by s, with its redundancy r.
    pub(super) fn noise_penalty(&self) -> f64 {
        let (_, redundancy) = self.imu_square_and_redundancy();
        let scale = self
            .constants
            .iter()
            .find(|constant| constant.name == NOISE_SCALE);
        scale.map_or(0.0, |scale| redundancy * (scale.value * scale.value).ln())
    }

    fn imu_square_and_redundancy(&self) -> (f64, f64) {
        let is_imu = |name: &str| name == "gyro" || name == "accelerometer";
        let sensors = self.sensors.iter().filter(|s| is_imu(&s.name));
        sensors.fold((0.0, 0.0), |(square, redundancy), sensor| {
            (square + sensor.chi_square, redundancy + sensor.redundancy)
        })
    }
}
