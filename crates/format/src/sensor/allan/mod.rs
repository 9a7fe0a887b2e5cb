//! Noise figures of an inertial sensor at rest, from the Allan deviation of a static log.
//!
//! With θ the integral of the rate, N + 1 values at the interval τ₀, and τ = m τ₀, the overlapping
//! Allan variance is
//!
//! σ²(τ) = Σₖ (θₖ₊₂ₘ − 2 θₖ₊ₘ + θₖ)² / (2 τ² (N − 2m + 1)), k = 0 … N − 2m.
//!
//! White noise of density n appears as n²/τ, a bias random walk of density w as w² τ / 3, flicker
//! noise of instability b as the floor b² · 2 ln 2 / π = (0.664 b)².

mod rest;
#[cfg(test)]
mod tests;

use super::ImuSample;
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;

/// Deviation of flicker noise in units of its instability, √(2 ln 2 / π).
const FLICKER_FLOOR: f64 = 0.664_282;
/// Fewest degrees of freedom of a point that determines a noise figure: its deviation is then known
/// to 1/√18 = 24 %.
const DECIDING_DOF: f64 = 9.0;
/// Fewest degrees of freedom of a point that is listed: its deviation is known to 41 %.
const LISTED_DOF: f64 = 3.0;
/// Tolerance of the slope of a segment of the variance, in addition to chance: it allows for a
/// second noise beside the dominant one.
const SLOPE_SLACK: f64 = 0.2;
/// Tolerance for chance, in standard deviations.
const CHANCE_SIGMAS: f64 = 2.0;
/// Fewest points (an octave apart) at which white noise must dominate.
const FEWEST_WHITE_POINTS: usize = 4;
/// Fewest points that must follow a bias random walk, and how many standard deviations each may be
/// off.
const FEWEST_WALK_POINTS: usize = 3;
const OUTLYING_SIGMAS: f64 = 3.0;
/// Fewest samples analysed: with fewer, [`FEWEST_WHITE_POINTS`] cannot be reached.
const FEWEST_SAMPLES: usize = 128;

/// One point of an Allan curve.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct AllanPoint {
    /// Averaging time τ, seconds.
    pub tau_s: f64,
    /// Allan deviation in the unit of the values.
    pub deviation: f64,
    /// Equivalent degrees of freedom of the variance, whose relative standard deviation is √(2 /
    /// this).
    #[serde(rename = "freedom")]
    pub dof: f64,
}

impl AllanPoint {
    fn variance(&self) -> f64 {
        self.deviation * self.deviation
    }

    /// Standard deviation of ln σ².
    fn log_sigma(&self) -> f64 {
        (2.0 / self.dof).sqrt()
    }

    /// Relative standard deviation of the deviation.
    pub fn relative_sigma(&self) -> f64 {
        0.5 * self.log_sigma()
    }
}

/// A noise figure, as far as a log determines it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case", tag = "known")]
pub enum Figure {
    /// The log determines it.
    Determined {
        /// The figure.
        value: f64,
        /// Its standard deviation.
        sigma: f64,
    },
    /// The log is too short to determine it: it lies below this with 97.5 % confidence.
    AtMost {
        /// The bound.
        value: f64,
    },
    /// The log does not constrain it.
    #[serde(rename = "no")]
    Undetermined,
}

impl Figure {
    /// The value if it is determined.
    pub fn determined(&self) -> Option<f64> {
        match *self {
            Self::Determined { value, .. } => Some(value),
            _ => None,
        }
    }

    /// The same figure in another unit.
    pub fn scaled(self, factor: f64) -> Self {
        match self {
            Self::Determined { value, sigma } => Self::Determined {
                value: value * factor,
                sigma: sigma * factor,
            },
            Self::AtMost { value } => Self::AtMost {
                value: value * factor,
            },
            Self::Undetermined => Self::Undetermined,
        }
    }
}

/// Noise figures of one axis from its Allan curve. For values in u: densities in u/√Hz and u/√s,
/// instability in u.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct AxisNoise {
    /// Points an octave apart, from the sampling interval up.
    pub curve: Vec<AllanPoint>,
    /// Density of the white noise, u/√Hz.
    pub white: Figure,
    /// Bias instability: the first minimum of the deviation over 0.664, u.
    pub instability: Figure,
    /// Density of the bias random walk, where the deviation rises as √τ, u/√s.
    pub walk: Figure,
}

/// Noise figures of an IMU from a log at rest; rad/s for the gyro, m/s² for the accelerometer.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ImuNoiseEstimate {
    /// First and last time used, seconds.
    pub span_s: [f64; 2],
    /// Mean interval between the samples used, seconds.
    pub interval_s: f64,
    /// Samples used.
    pub samples: usize,
    /// x, y, z.
    pub gyro: [AxisNoise; 3],
    /// x, y, z.
    pub accel: [AxisNoise; 3],
    /// Reasons to doubt the figures.
    pub warnings: Vec<String>,
}

/// Noise figures from a log of an IMU at rest. If samples are missing, the longest stretch without
/// a gap is used.
///
/// # Errors
/// Values that are not finite, times that do not increase, fewer than 128 consecutive samples, an
/// IMU that is not at rest.
pub fn allan(imu: &[ImuSample]) -> Result<ImuNoiseEstimate> {
    let finite = |v: &Vec3| v.iter().all(|x| x.is_finite());
    if let Some(bad) = imu
        .iter()
        .find(|s| !(s.time_s.is_finite() && finite(&s.gyro_rad_s) && finite(&s.accel_m_s2)))
    {
        return Err(Error::data(
            format!(
                "the sample at {} s contains a value that is not finite",
                bad.time_s
            ),
            "remove the sample",
        ));
    }
    if let Some(pair) = imu.windows(2).find(|w| w[1].time_s <= w[0].time_s) {
        return Err(Error::data(
            format!(
                "time {} s follows {} s: times must increase strictly",
                pair[1].time_s, pair[0].time_s
            ),
            "sort the log by time and remove repeated samples",
        ));
    }
    let used = rest::longest_stretch(imu);
    if used.len() < FEWEST_SAMPLES {
        return Err(Error::of(
            Problem::TooFew,
            format!("the log has {} samples without a gap", used.len()),
            format!(
                "record at least {FEWEST_SAMPLES} at rest for noise figures, an hour or more for a \
                 bias instability"
            ),
        ));
    }
    let (first, last) = (used[0].time_s, used[used.len() - 1].time_s);
    let interval_s = (last - first) / (used.len() - 1) as f64;
    let mut warnings = rest::check(used, interval_s)?;
    if interval_s > super::MAX_IMU_INTERVAL_S
        && let Some(unit) = super::imu_time_unit(interval_s)
    {
        warnings.push(format!(
            "time steps of {interval_s:.6} s between IMU samples: are these {unit}?"
        ));
    }
    if used.len() < imu.len() {
        warnings.push(format!(
            "the log has gaps: only the {} samples from {first:.3} s to {last:.3} s are used",
            used.len()
        ));
    }
    let axis = |pick: fn(&ImuSample) -> Vec3, i: usize| {
        let values: Vec<f64> = used.iter().map(|s| pick(s)[i]).collect();
        axis_noise(allan_curve(&values, interval_s))
    };
    Ok(ImuNoiseEstimate {
        span_s: [first, last],
        interval_s,
        samples: used.len(),
        gyro: std::array::from_fn(|i| axis(|s| s.gyro_rad_s, i)),
        accel: std::array::from_fn(|i| axis(|s| s.accel_m_s2, i)),
        warnings,
    })
}

/// The overlapping Allan deviation of `values`, means over consecutive intervals of `interval_s`
/// seconds, at τ of 1, 2, 4, … intervals, as long as three degrees of freedom remain.
pub fn allan_curve(values: &[f64], interval_s: f64) -> Vec<AllanPoint> {
    // Removing the mean keeps the integral small, so that rounding loses nothing.
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let mut integral = Vec::with_capacity(values.len() + 1);
    let mut sum = 0.0;
    integral.push(sum);
    for value in values {
        sum += (value - mean) * interval_s;
        integral.push(sum);
    }
    std::iter::successors(Some(1), |m| Some(2 * m))
        .take_while(|&m| 2 * m <= values.len())
        .map(|m| AllanPoint {
            tau_s: m as f64 * interval_s,
            deviation: overlapping_variance(&integral, m, interval_s).sqrt(),
            dof: equivalent_dof(integral.len(), m),
        })
        .take_while(|point| point.dof >= LISTED_DOF)
        .collect()
}

fn overlapping_variance(integral: &[f64], m: usize, interval_s: f64) -> f64 {
    let terms = integral.len() - 2 * m;
    let squares: f64 = (0..terms)
        .map(|k| (integral[k + 2 * m] - 2.0 * integral[k + m] + integral[k]).powi(2))
        .sum();
    let tau_s = m as f64 * interval_s;
    squares / (2.0 * tau_s * tau_s * terms as f64)
}

/// Equivalent degrees of freedom of the overlapping Allan variance from n integrated values at m
/// intervals: the smaller of those for white and for flicker noise (Riley, Handbook of Frequency
/// Stability Analysis, NIST SP 1065, table 5; white and flicker FM).
fn equivalent_dof(n: usize, m: usize) -> f64 {
    let (n, m) = (n as f64, m as f64);
    let white =
        (3.0 * (n - 1.0) / (2.0 * m) - 2.0 * (n - 2.0) / n) * 4.0 * m * m / (4.0 * m * m + 5.0);
    let flicker = if m == 1.0 {
        2.0 * (n - 2.0).powi(2) / (2.3 * n - 4.9)
    } else {
        5.0 * n * n / (4.0 * m * (n + 3.0 * m))
    };
    white.min(flicker)
}

/// Derives the noise figures from a curve.
fn axis_noise(curve: Vec<AllanPoint>) -> AxisNoise {
    let white = white(&curve);
    let (instability, walk) = match white.determined() {
        Some(density) => bias(&curve, density),
        None => (Figure::Undetermined, Figure::Undetermined),
    };
    AxisNoise {
        curve,
        white,
        instability,
        walk,
    }
}

/// Whether ln σ² rises by `exponent` ln 2 over the octave from `a` to `b`.
fn has_slope(a: &AllanPoint, b: &AllanPoint, exponent: f64) -> bool {
    let slope = (b.variance() / a.variance()).log2();
    let chance = CHANCE_SIGMAS * a.log_sigma().hypot(b.log_sigma()) / std::f64::consts::LN_2;
    (slope - exponent).abs() <= SLOPE_SLACK + chance
}

/// The white noise from the longest run of octaves with σ² ∝ 1/τ, which excludes short τ dominated
/// by a filter or the resolution of the sensor and long τ dominated by the bias. ln(τ σ²) is
/// averaged with the degrees of freedom as weights, so that the shortest τ of the run dominate.
fn white(curve: &[AllanPoint]) -> Figure {
    let decide = |p: &&AllanPoint| p.dof >= DECIDING_DOF && p.deviation > 0.0;
    let curve: Vec<AllanPoint> = curve.iter().take_while(decide).copied().collect();
    let mut longest: &[AllanPoint] = &[];
    for run in curve.chunk_by(|a, b| has_slope(a, b, -1.0)) {
        if run.len() > longest.len() {
            longest = run;
        }
    }
    if longest.len() < FEWEST_WHITE_POINTS {
        return Figure::Undetermined;
    }
    let weights: f64 = longest.iter().map(|p| p.dof).sum();
    let mean = longest
        .iter()
        .map(|p| p.dof * (p.tau_s * p.variance()).ln())
        .sum::<f64>()
        / weights;
    let value = (0.5 * mean).exp();
    // The points of a run share the same samples: only the best of them counts.
    let best = longest.iter().map(|p| p.dof).fold(0.0, f64::max);
    Figure::Determined {
        value,
        sigma: value / (2.0 * best).sqrt(),
    }
}

/// Bias instability and bias random walk of a curve with white noise of this density.
fn bias(curve: &[AllanPoint], density: f64) -> (Figure, Figure) {
    let deciding: Vec<&AllanPoint> = curve.iter().take_while(|p| p.dof >= DECIDING_DOF).collect();
    // The first minimum, after which the curve rises by more than chance: a bias with finite memory
    // averages out at long τ, where the curve is lower.
    let mut at = 0;
    for (i, point) in deciding.iter().enumerate() {
        let rise = (point.variance() / deciding[at].variance()).ln();
        if rise < 0.0 {
            at = i;
        } else if rise > CHANCE_SIGMAS * point.log_sigma().hypot(deciding[at].log_sigma()) {
            break;
        }
    }
    let Some(lowest) = deciding.get(at) else {
        return (Figure::Undetermined, Figure::Undetermined);
    };
    // White noise alone also reaches the floor where the log ends: the bias must exceed it, and the
    // curve must have stopped falling before the end.
    let over_white = lowest.variance() * lowest.tau_s / (density * density);
    let seen = over_white.ln() > CHANCE_SIGMAS * lowest.log_sigma() && at + 1 < deciding.len();
    if !seen {
        let highest = lowest.deviation * (CHANCE_SIGMAS * lowest.relative_sigma()).exp();
        let value = highest / FLICKER_FLOOR;
        return (Figure::AtMost { value }, Figure::Undetermined);
    }
    let value = lowest.deviation / FLICKER_FLOOR;
    let instability = Figure::Determined {
        value,
        sigma: value * lowest.relative_sigma(),
    };
    (instability, walk(&deciding[at + 1..], density))
}

/// The bias random walk from the curve beyond its minimum, where the deviation, less the white
/// noise, rises as √τ over two octaves or more.
fn walk(beyond: &[&AllanPoint], density: f64) -> Figure {
    // ln w² of every point, white noise subtracted, and its standard deviation.
    let walks: Vec<(f64, f64)> = beyond
        .iter()
        .map(|p| {
            let rest = p.variance() - density * density / p.tau_s;
            let log_sigma = p.log_sigma() * p.variance() / rest;
            ((3.0 * rest / p.tau_s).ln(), log_sigma)
        })
        .collect();
    if walks.len() < FEWEST_WALK_POINTS || walks.iter().any(|(log, _)| !log.is_finite()) {
        return Figure::Undetermined;
    }
    let weights: f64 = walks.iter().map(|(_, s)| s.powi(-2)).sum();
    let mean = walks.iter().map(|(log, s)| log * s.powi(-2)).sum::<f64>() / weights;
    let follows_walk = walks
        .iter()
        .all(|(log, s)| (log - mean).abs() <= OUTLYING_SIGMAS * s);
    // A flat floor must not explain the same points.
    let (first, last) = (beyond[0], beyond[beyond.len() - 1]);
    let rise = (last.variance() / first.variance()).ln();
    let rises = rise > CHANCE_SIGMAS * first.log_sigma().hypot(last.log_sigma());
    if !(follows_walk && rises) {
        return Figure::Undetermined;
    }
    let value = (0.5 * mean).exp();
    let best = walks.iter().map(|(_, s)| *s).fold(f64::INFINITY, f64::min);
    Figure::Determined {
        value,
        sigma: 0.5 * value * best,
    }
}
