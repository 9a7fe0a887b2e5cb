//! How an adjustment ended and what it left.

use crate::geometry::Vec3;
use std::fmt;

/// Why the adjustment stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// The last step was below 5 % of a posterior standard deviation.
    Converged,
    /// The most iterations allowed were used.
    IterationLimit,
    /// No step, however small, lowers the cost.
    NoBetterStep,
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::IterationLimit => "stopped at the iteration limit",
            Self::NoBetterStep => "stopped as no step lowers the cost",
        })
    }
}

/// What one sensor's residuals look like after the adjustment.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct SensorResiduals {
    /// Records used.
    pub count: usize,
    /// Records outside the IMU's span.
    pub ignored: usize,
    /// Root mean square per component: prism m, heading rad, gyro rad/s, accelerometer m/s².
    pub rms_raw: f64,
    /// The same, each divided by its standard deviation. Near 1 for prism and heading where the
    /// sigmas fit; far below 1 for the IMU, whose noise the nodes take up.
    pub rms_normalised: f64,
}

impl SensorResiduals {
    pub(super) fn new(tally: &Tally, components: usize, ignored: usize) -> Self {
        let n = tally.count.max(1) as f64;
        Self {
            count: tally.count / components,
            ignored,
            rms_raw: (tally.raw / n).sqrt(),
            rms_normalised: (tally.normalised / n).sqrt(),
        }
    }
}

/// Sums of squares.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    count: usize,
    raw: f64,
    normalised: f64,
}

impl Tally {
    pub fn add(&mut self, residual: f64, sigma: f64) {
        self.count += 1;
        self.raw += residual * residual;
        self.normalised += (residual / sigma).powi(2);
    }

    pub fn add_vector(&mut self, residual: &Vec3, sigma: f64) {
        residual.iter().for_each(|r| self.add(*r, sigma));
    }
}

/// How the adjustment ended and what it left.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Solution {
    /// Steps tried, refused ones included.
    pub iterations: usize,
    /// Whether `stop` is [`StopReason::Converged`].
    pub converged: bool,
    /// Why it stopped.
    pub stop: StopReason,
    /// Half the sum of squared normalised residuals at the start values.
    pub cost_initial: f64,
    /// The same at the solution.
    pub cost_final: f64,
    /// Prism, metres.
    pub prism: SensorResiduals,
    /// Heading, radians.
    pub heading: SensorResiduals,
    /// Gyro, rad/s.
    pub gyro: SensorResiduals,
    /// Accelerometer, m/s².
    pub accel: SensorResiduals,
}

impl Solution {
    pub(super) fn new(
        iterations: usize,
        stop: StopReason,
        cost_initial: f64,
        cost_final: f64,
    ) -> Self {
        Self {
            iterations,
            converged: stop == StopReason::Converged,
            stop,
            cost_initial,
            cost_final,
            prism: SensorResiduals::default(),
            heading: SensorResiduals::default(),
            gyro: SensorResiduals::default(),
            accel: SensorResiduals::default(),
        }
    }
}

impl fmt::Display for Solution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} after {} iterations; residuals: prism {:.1} mm ({:.2} sigma)",
            self.stop,
            self.iterations,
            self.prism.rms_raw * 1e3,
            self.prism.rms_normalised
        )?;
        if self.heading.count > 0 {
            let degrees = self.heading.rms_raw.to_degrees();
            write!(
                f,
                ", heading {degrees:.2}° ({:.2} sigma)",
                self.heading.rms_normalised
            )?;
        }
        Ok(())
    }
}
