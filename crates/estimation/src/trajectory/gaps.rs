//! Gaps of the IMU: bridged by samples that were not recorded, with the noise of unknown motion.

use super::settings::ImuNoise;
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::sensor::{ImuSample, MAX_IMU_INTERVAL_S, imu_time_unit};
use crate::statistics::median;

/// A longer gap between IMU samples is refused: two drives, or a log that lost its middle.
pub const MAX_IMU_GAP_S: f64 = 120.0;
/// No IMU samples at shorter intervals, seconds.
const MIN_IMU_INTERVAL_S: f64 = 1e-5;
/// Largest number of samples that may bridge gaps: this many for each recorded sample, and this many more.
/// Otherwise the gaps of a log whose stamps come in bursts would be filled with countless samples.
const MAX_BRIDGING: (usize, usize) = (10, 1_000_000);
/// An IMU interval longer than this many times the median has lost samples.
pub const GAP_INTERVALS: f64 = 2.5;
/// Correlation time of unrecorded motion, seconds: turns and pushes of a vehicle.
pub const MOTION_CORRELATION_S: f64 = 0.5;

pub fn median_interval_s(imu: &[ImuSample]) -> f64 {
    median(imu.windows(2).map(|w| w[1].time_s - w[0].time_s)).unwrap_or(f64::NAN)
}

/// Checks the time from sample to sample.
///
/// # Errors
/// Times that cannot be in seconds; the message names the unit that they seem to be in.
pub fn check_interval(interval_s: f64) -> Result<()> {
    if interval_s < MIN_IMU_INTERVAL_S {
        return Err(Error::data(
            format!("the IMU log's samples lie {interval_s:.1e} s apart"),
            "check the unit of its times, which must be in seconds",
        ));
    }
    if interval_s > MAX_IMU_INTERVAL_S {
        let unit = imu_time_unit(interval_s);
        let question = unit.map_or_else(String::new, |unit| format!(": are these {unit}?"));
        return Err(Error::data(
            format!("time steps of {interval_s} s between IMU samples{question}"),
            format!(
                "give the times of the IMU log in seconds, and at least {} samples a second",
                1.0 / MAX_IMU_INTERVAL_S
            ),
        ));
    }
    Ok(())
}

/// Checks that `bridging` samples are not too many for a log of `recorded`.
///
/// # Errors
/// The stamps leave more gaps than a log has.
pub fn check_bridging(bridging: usize, recorded: usize) -> Result<()> {
    let (per_sample, more) = MAX_BRIDGING;
    if bridging <= per_sample.saturating_mul(recorded).saturating_add(more) {
        return Ok(());
    }
    Err(Error::data(
        format!(
            "the gaps of the IMU log would take {bridging} samples or more to bridge, but it holds \
             {recorded}: its stamps come in bursts, or most of it is missing"
        ),
        "check the times of the IMU log",
    ))
}

/// The samples with gaps filled by linear interpolation, which of them fill gaps, and the gaps, seconds from
/// and to.
#[expect(clippy::type_complexity, reason = "read once, by the caller above")]
pub fn bridge(
    imu: &[ImuSample],
    interval_s: f64,
) -> Result<(Vec<ImuSample>, Vec<bool>, Vec<(f64, f64)>)> {
    let mut samples = Vec::with_capacity(imu.len());
    let mut bridged = Vec::with_capacity(imu.len());
    let mut gaps = Vec::new();
    let mut bridging = 0;
    for pair in imu.windows(2) {
        samples.push(pair[0]);
        bridged.push(false);
        let (from, to) = (pair[0].time_s, pair[1].time_s);
        if to - from <= GAP_INTERVALS * interval_s {
            continue;
        }
        if to - from > MAX_IMU_GAP_S {
            return Err(Error::data(
                format!(
                    "the IMU log has a gap of {:.3} s from {from:.3} s to {to:.3} s",
                    to - from
                ),
                format!(
                    "cut the drive there; gaps longer than {MAX_IMU_GAP_S} s cannot be bridged"
                ),
            ));
        }
        gaps.push((from + interval_s, to));
        bridging += bridging_samples(to - from, interval_s);
        check_bridging(bridging, imu.len())?;
        samples.extend(bridged_samples(&pair[0], &pair[1], interval_s));
        bridged.resize(samples.len(), true);
    }
    samples.extend(imu.last());
    bridged.push(false);
    Ok((samples, bridged, gaps))
}

/// How many samples bridge a gap between two samples that lie `gap_s` apart.
pub fn bridging_samples(gap_s: f64, interval_s: f64) -> usize {
    ((gap_s / interval_s).round() as usize).saturating_sub(1)
}

/// Samples at the interval of the log, interpolated linearly between two samples.
pub fn bridged_samples(
    from: &ImuSample,
    to: &ImuSample,
    interval_s: f64,
) -> impl Iterator<Item = ImuSample> {
    let (from, to) = (*from, *to);
    let gap_s = to.time_s - from.time_s;
    let pieces = bridging_samples(gap_s, interval_s) + 1;
    (1..pieces).map(move |piece| {
        let u = piece as f64 / pieces as f64;
        ImuSample {
            time_s: from.time_s + gap_s * u,
            gyro_rad_s: from.gyro_rad_s.lerp(&to.gyro_rad_s, u),
            accel_m_s2: from.accel_m_s2.lerp(&to.accel_m_s2, u),
        }
    })
}

/// Noise of a sample that was not recorded: the scatter of rates and forces over the drive, as the
/// density of white noise with the same effect over its correlation time.
pub fn bridge_noise(imu: &[ImuSample], noise: &ImuNoise) -> ImuNoise {
    let count = imu.len() as f64;
    let density = |part: fn(&ImuSample) -> Vec3| {
        let mean = imu.iter().map(part).sum::<Vec3>() / count;
        let square: f64 = imu.iter().map(|s| (part(s) - mean).norm_squared()).sum();
        (square / (3.0 * count) * 2.0 * MOTION_CORRELATION_S).sqrt()
    };
    ImuNoise {
        gyro_density: density(|s| s.gyro_rad_s).max(noise.gyro_density),
        accel_density: density(|s| s.accel_m_s2).max(noise.accel_density),
        ..*noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_filled_at_the_interval_of_the_log() {
        let sample = |time_s: f64| ImuSample {
            time_s,
            gyro_rad_s: Vec3::repeat(time_s),
            accel_m_s2: Vec3::zeros(),
        };
        let imu: Vec<ImuSample> = [0.0, 0.1, 0.2, 0.3, 0.8, 0.9].map(sample).into();
        let (samples, bridged, gaps) = bridge(&imu, 0.1).expect("a short gap");
        assert_eq!(samples.len(), 10);
        assert_eq!(bridged.iter().filter(|b| **b).count(), 4);
        for (k, s) in samples.iter().enumerate() {
            assert!((s.time_s - 0.1 * k as f64).abs() < 1e-12);
            assert!((s.gyro_rad_s.x - s.time_s).abs() < 1e-12);
        }
        assert_eq!(gaps.len(), 1);
        assert!((gaps[0].0 - 0.4).abs() < 1e-12 && gaps[0].1 == 0.8);
    }
}
