//! The scatter of the IMU samples so far, which gives the noise of samples that bridge a gap.

use crate::geometry::{self, Vec3};
use crate::sensor::ImuSample;
use crate::trajectory::gaps::MOTION_CORRELATION_S;
use crate::trajectory::settings::ImuNoise;

pub fn is_finite(sample: &ImuSample) -> bool {
    let vectors = [&sample.gyro_rad_s, &sample.accel_m_s2];
    sample.time_s.is_finite() && vectors.into_iter().all(geometry::is_finite)
}

/// Mean and scatter of rates and forces so far (Welford 1962).
#[derive(Debug, Clone, Copy, Default)]
pub struct Scatter {
    count: f64,
    gyro: (Vec3, f64),
    accel: (Vec3, f64),
}

impl Scatter {
    pub fn add(&mut self, sample: &ImuSample) {
        self.count += 1.0;
        let count = self.count;
        for ((mean, square), value) in [
            (&mut self.gyro, sample.gyro_rad_s),
            (&mut self.accel, sample.accel_m_s2),
        ]
        .map(|(sums, value)| ((&mut sums.0, &mut sums.1), value))
        {
            let off = value - *mean;
            *mean += off / count;
            *square += off.dot(&(value - *mean));
        }
    }

    /// How many samples there were.
    pub fn count(&self) -> usize {
        self.count as usize
    }

    /// Noise of a sample that was not recorded, as for whole drives.
    pub fn bridge_noise(&self, noise: &ImuNoise) -> ImuNoise {
        let density =
            |square: f64| (square / (3.0 * self.count) * 2.0 * MOTION_CORRELATION_S).sqrt();
        ImuNoise {
            gyro_density: density(self.gyro.1).max(noise.gyro_density),
            accel_density: density(self.accel.1).max(noise.accel_density),
            ..*noise
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scatter_is_that_of_all_samples() {
        let samples: Vec<ImuSample> = (0..50)
            .map(|k| ImuSample {
                time_s: f64::from(k),
                gyro_rad_s: Vec3::new(f64::from(k).sin(), 0.3, 0.01 * f64::from(k)),
                accel_m_s2: Vec3::new(0.0, f64::from(k % 7), 9.81),
            })
            .collect();
        let mut scatter = Scatter::default();
        samples.iter().for_each(|s| scatter.add(s));
        let noise = ImuNoise {
            gyro_density: 1e-3,
            accel_density: 1e-2,
            gyro_bias_walk: 1e-5,
            accel_bias_walk: 1e-4,
        };
        let whole = crate::trajectory::gaps::bridge_noise(&samples, &noise);
        let online = scatter.bridge_noise(&noise);
        assert!((online.gyro_density / whole.gyro_density - 1.0).abs() < 1e-12);
        assert!((online.accel_density / whole.accel_density - 1.0).abs() < 1e-12);
    }
}
