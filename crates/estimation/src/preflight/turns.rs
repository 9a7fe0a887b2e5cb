//! How much the body turned, by the gyro and by other sensors.

use crate::geometry::Vec3;
use crate::geometry::heading::wrap;
use crate::sensor::{ImuSample, PositionFix};

/// Turns are compared over spans of this length, seconds: short enough for the gyro's bias to stay small, long
/// enough for the course to change.
const SPAN_S: f64 = 3.0;
/// A course is taken over a stretch of this length, metres: several times the noise of its ends.
const COURSE_STRETCH_M: f64 = 0.3;
/// A course over a longer time says little about where the body pointed, seconds.
const COURSE_SPAN_S: f64 = 6.0;
/// Least root mean square of the turns for a comparison, radians.
const LEAST_TURN_RAD: f64 = 0.1;
/// Largest and smallest latency that is looked for, seconds; smaller ones are estimated with the trajectory.
const MAX_LATE_S: f64 = 60.0;
const LEAST_LATE_S: f64 = 2.0;
/// Smallest correlation with the right latency, and largest without it.
const CLEAR: f64 = 0.9;
const UNCLEAR: f64 = 0.7;
/// By how much the correlation with the right latency exceeds that with any other.
const UNIQUE: f64 = 0.05;
/// Fewest spans.
const MIN_SPANS: usize = 20;

/// The integral of the rate about the upward axis, clockwise seen from above.
pub struct Turned {
    times_s: Vec<f64>,
    clockwise_rad: Vec<f64>,
}

impl Turned {
    /// Integrates the gyro about `up` (body axes, unit length).
    pub fn new(imu: &[ImuSample], up: &Vec3) -> Self {
        let mut clockwise_rad = Vec::with_capacity(imu.len());
        let mut sum = 0.0;
        for pair in imu.windows(2) {
            clockwise_rad.push(sum);
            sum -= up.dot(&pair[0].gyro_rad_s) * (pair[1].time_s - pair[0].time_s);
        }
        clockwise_rad.push(sum);
        Self {
            times_s: imu.iter().map(|sample| sample.time_s).collect(),
            clockwise_rad,
        }
    }

    /// The angle turned up to `time_s`, radians clockwise; `None` outside the log.
    fn at(&self, time_s: f64) -> Option<f64> {
        let next = self.times_s.partition_point(|t| *t < time_s);
        (self.times_s[0] <= time_s)
            .then(|| self.clockwise_rad.get(next).copied())
            .flatten()
    }

    /// By how much the stamps of angles are late, seconds, where they turn with the gyro at that latency
    /// and not without it.
    pub fn late_by(&self, angles: &[(f64, f64)]) -> Option<f64> {
        let now = self.compare(angles)?.correlation.abs();
        let best = |from_s: f64, to_s: f64, step_s: f64| {
            let steps = ((to_s - from_s) / step_s).round() as i32;
            let all = (0..=steps).map(|i| from_s + step_s * f64::from(i));
            let all = all.filter_map(|late_s| Some((late_s, self.compare_late(angles, late_s)?)));
            let all = all.filter(|(_, ratio)| ratio.is_about(1.0));
            let mut all: Vec<(f64, Ratio)> = all.collect();
            all.sort_by(|a, b| b.1.correlation.total_cmp(&a.1.correlation));
            let first = *all.first()?;
            // The turns at the ends of a field's rows are alike: another latency may fit as well.
            let mut others = all
                .iter()
                .filter(|(late_s, _)| (late_s - first.0).abs() > LEAST_LATE_S);
            let is_unique =
                others.all(|(_, other)| other.correlation < first.1.correlation - UNIQUE);
            is_unique.then_some(first)
        };
        let (coarse_s, ratio) = best(-MAX_LATE_S, MAX_LATE_S, 0.5)?;
        let is_clear = coarse_s.abs() > LEAST_LATE_S && ratio.correlation > CLEAR && now < UNCLEAR;
        let (late_s, _) = best(coarse_s - 0.5, coarse_s + 0.5, 0.05).filter(|_| is_clear)?;
        Some(late_s)
    }

    /// Compares the turns of angles at times (seconds, radians clockwise) with those of the gyro.
    pub fn compare(&self, angles: &[(f64, f64)]) -> Option<Ratio> {
        self.compare_late(angles, 0.0)
    }

    /// The same with angles whose stamps are late by `late_s`.
    fn compare_late(&self, angles: &[(f64, f64)], late_s: f64) -> Option<Ratio> {
        let (mut gg, mut gh, mut hh, mut spans) = (0.0, 0.0, 0.0, 0);
        let mut from = 0;
        for (to, &(time_s, angle)) in angles.iter().enumerate() {
            if time_s - angles[from].0 < SPAN_S {
                continue;
            }
            let ends = [angles[from].0, time_s].map(|time_s| self.at(time_s - late_s));
            if let [Some(start), Some(end)] = ends
                && time_s - angles[from].0 < 2.0 * SPAN_S
            {
                let (gyro, heading) = (end - start, wrap(angle - angles[from].1));
                gg += gyro * gyro;
                gh += gyro * heading;
                hh += heading * heading;
                spans += 1;
            }
            from = to;
        }
        let rms = |sum: f64| (sum / f64::from(spans.max(1))).sqrt();
        let turns = spans as usize >= MIN_SPANS && rms(gg).max(rms(hh)) > LEAST_TURN_RAD;
        turns.then(|| Ratio {
            slope: gh / gg,
            correlation: gh / (gg * hh).sqrt(),
            gyro_rms_rad: rms(gg),
        })
    }
}

/// The turns of another sensor compared with those of the gyro.
#[derive(Debug, Clone, Copy)]
pub struct Ratio {
    /// Turns of the sensor over those of the gyro: 1 where both agree.
    pub slope: f64,
    /// Correlation of the turns of both.
    pub correlation: f64,
    /// Root mean square of the turns by the gyro, radians.
    pub gyro_rms_rad: f64,
}

/// Least correlation of turns that measure the same: half of their variance is then common.
const SAME_CORRELATION: f64 = 0.7;
/// Ratios that differ by a third of one are told apart: the mistakes that are looked for (signs, degrees, halves) differ
/// by more, and scales of sensors by much less.
const SAME_SLOPE: f64 = 1.0 / 3.0;

impl Ratio {
    /// Whether the slope is about this.
    pub fn is_about(&self, slope: f64) -> bool {
        self.correlation.abs() > SAME_CORRELATION && (self.slope / slope - 1.0).abs() < SAME_SLOPE
    }
}

/// Stretches of [`COURSE_STRETCH_M`] over the ground, as the fixes at their ends, where positions move.
pub fn stretches(fixes: &[PositionFix]) -> Vec<[&PositionFix; 2]> {
    let mut stretches = Vec::new();
    let mut from = 0;
    for (to, fix) in fixes.iter().enumerate() {
        let start = &fixes[from];
        if (fix.position_m - start.position_m).xy().norm() > COURSE_STRETCH_M {
            if fix.time_s - start.time_s < COURSE_SPAN_S {
                stretches.push([start, fix]);
            }
            from = to;
        }
    }
    stretches
}

/// Courses over the ground, radians clockwise from north, at the middle times of stretches over which
/// positions move.
pub fn courses(fixes: &[PositionFix]) -> Vec<(f64, f64)> {
    let course = |[start, end]: [&PositionFix; 2]| {
        let stretch_m = end.position_m - start.position_m;
        (
            0.5 * (start.time_s + end.time_s),
            stretch_m.x.atan2(stretch_m.y),
        )
    };
    stretches(fixes).into_iter().map(course).collect()
}
