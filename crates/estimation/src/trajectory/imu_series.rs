//! The IMU's samples in time order with gaps bridged, shared by everything that integrates them.

use super::gaps::{bridge, bridge_noise};
use super::settings::ImuNoise;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::sensor::ImuSample;
use std::ops::Deref;

/// Times closer than this are the same instant: the rounding of seconds since 1970 in f64.
pub const SAME_INSTANT_S: f64 = 1e-6;

/// Samples with their noise. Each holds from its time to the next one's, the last for the median
/// interval.
#[derive(Debug, Clone)]
pub struct ImuSeries {
    samples: Vec<ImuSample>,
    /// Which samples bridge a gap.
    bridged: Vec<bool>,
    noise: ImuNoise,
    /// Noise of the samples that bridge gaps: unrecorded motion.
    bridge_noise: ImuNoise,
    /// Gaps, seconds from and to.
    pub gaps_s: Vec<(f64, f64)>,
    /// Median interval, seconds.
    pub interval_s: f64,
}

/// A stretch of time in which one sample holds.
#[derive(Debug, Clone, Copy)]
pub struct Piece<'a> {
    pub sample: &'a ImuSample,
    pub duration_s: f64,
    pub noise: &'a ImuNoise,
}

impl ImuSeries {
    /// Takes samples in time order and bridges their gaps.
    ///
    /// # Errors
    /// A gap of minutes.
    pub fn new(samples: Vec<ImuSample>, interval_s: f64, noise: &ImuNoise) -> Result<Self> {
        let (samples, bridged, gaps_s) = bridge(&samples, interval_s)?;
        Ok(Self {
            bridge_noise: bridge_noise(&samples, noise),
            samples,
            bridged,
            noise: *noise,
            gaps_s,
            interval_s,
        })
    }

    /// Appends a sample that is later than all before it.
    pub fn push(&mut self, sample: ImuSample, bridged: bool) {
        self.samples.push(sample);
        self.bridged.push(bridged);
    }

    /// Divides the rates about each axis by a factor.
    pub fn divide_rates(&mut self, factor: &Vec3) {
        for sample in &mut self.samples {
            sample.gyro_rad_s.component_div_assign(factor);
        }
    }

    /// Sets the noise of the samples that bridge gaps.
    pub fn set_bridge_noise(&mut self, noise: ImuNoise) {
        self.bridge_noise = noise;
    }

    /// First and last time, seconds.
    pub fn span_s(&self) -> (f64, f64) {
        (self.samples[0].time_s, self.end_s(self.samples.len() - 1))
    }

    /// Whether a sample bridges a gap.
    pub fn is_bridged(&self, sample: usize) -> bool {
        self.bridged[sample]
    }

    /// Noise of a sample: that of the datasheet, or of unknown motion where it bridges a gap.
    pub fn noise_of(&self, sample: usize) -> &ImuNoise {
        if self.bridged[sample] {
            &self.bridge_noise
        } else {
            &self.noise
        }
    }

    /// The sample that holds at `time_s`.
    pub fn at(&self, time_s: f64) -> usize {
        let after = self
            .samples
            .partition_point(|s| s.time_s <= time_s + SAME_INSTANT_S);
        after.saturating_sub(1)
    }

    /// The time until which a sample holds.
    fn end_s(&self, sample: usize) -> f64 {
        match self.samples.get(sample + 1) {
            Some(next) => next.time_s,
            None => self.samples[sample].time_s + self.interval_s,
        }
    }

    /// The samples from `from_s` to `to_s`, cut at both ends.
    pub fn pieces(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = Piece<'_>> {
        let last = self.samples.len() - 1;
        let mut sample = self.at(from_s);
        let mut at_s = from_s;
        std::iter::from_fn(move || {
            if to_s - at_s <= SAME_INSTANT_S {
                return None;
            }
            let end_s = self.end_s(sample);
            let end_s = if end_s >= to_s - SAME_INSTANT_S || sample == last {
                to_s
            } else {
                end_s
            };
            let piece = Piece {
                sample: &self.samples[sample],
                duration_s: end_s - at_s,
                noise: self.noise_of(sample),
            };
            at_s = end_s;
            sample = (sample + 1).min(last);
            Some(piece)
        })
    }
}

impl Deref for ImuSeries {
    type Target = [ImuSample];

    fn deref(&self) -> &[ImuSample] {
        &self.samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_the_samples_cut_at_both_ends() {
        let sample = |k: i32| ImuSample {
            time_s: f64::from(k) * 0.1,
            gyro_rad_s: Vec3::zeros(),
            accel_m_s2: Vec3::zeros(),
        };
        let noise = ImuNoise {
            gyro_density: 1e-3,
            accel_density: 1e-2,
            gyro_bias_walk: 1e-5,
            accel_bias_walk: 1e-4,
        };
        let samples = (0..5).map(sample).collect();
        let series = ImuSeries::new(samples, 0.1, &noise).expect("no gap");
        let pieces = |from, to| -> Vec<(i32, i32)> {
            let hundredths = |s: f64| (s * 100.0).round() as i32;
            let pieces = series.pieces(from, to);
            pieces
                .map(|p| (hundredths(p.sample.time_s), hundredths(p.duration_s)))
                .collect()
        };
        assert_eq!(pieces(0.0, 0.25), [(0, 10), (10, 10), (20, 5)]);
        assert_eq!(pieces(0.25, 0.5), [(20, 5), (30, 10), (40, 10)]);
        assert_eq!(pieces(0.25, 0.27), [(20, 2)]);
        assert_eq!(pieces(0.25, 0.25), []);
        assert_eq!((series.at(0.5), series.span_s().0), (4, 0.0));
        assert!((series.span_s().1 - 0.5).abs() < 1e-12);
    }
}
