//! Whether logs are of one drive: all parts of a rigid body turn at the same rate, whatever their axes and their places.

use std::collections::BTreeMap;

use crate::format::{self, Input};
use crate::geometry::Rotation;
use crate::sensor::{ImuSample, PoseRecord};
use crate::statistics::correlation;

/// Rates are averaged over this time, seconds: noise and vibrations then count for less than the turns of a drive.
const BIN_S: f64 = 1.0;
/// Fewer common bins say nothing.
const LEAST_BINS: usize = 10;
/// Logs of one body share the variance of their rates but for noise, those of two drives share none: half of it lies
/// between.
const SHARED: f64 = 0.5;

/// Mean rates at which a body turns, rad/s, by the number of the bin.
#[derive(Clone)]
pub struct Turning(BTreeMap<i64, f64>);

impl Turning {
    /// The rates of poses; `None` if the file has none.
    pub fn of_poses(input: &Input) -> Option<Self> {
        let format = format::detect(input).ok()?;
        if format.has_geographic_poses() {
            let poses = format::read_geographic_poses(input).ok()?;
            let rotations = poses
                .iter()
                .map(|pose| (pose.time_s, pose.angles.rotation()));
            return Some(Self::of_rotations(rotations.collect()));
        }
        let poses = format::read_trajectory(input).ok()?;
        let rotation = |pose: &PoseRecord| (pose.time_s, pose.world_from_body.rotation);
        Some(Self::of_rotations(poses.iter().map(rotation).collect()))
    }

    /// The rates of an IMU.
    pub fn of_imu(samples: &[ImuSample]) -> Self {
        let rates = samples
            .iter()
            .map(|sample| (sample.time_s, sample.gyro_rad_s.norm()));
        Self::averaged(rates)
    }

    fn of_rotations(rotations: Vec<(f64, Rotation)>) -> Self {
        let rates = rotations.windows(2).map(|pair| {
            let [(before_s, before), (after_s, after)] = [pair[0], pair[1]];
            let rate = before.angle_to(&after) / (after_s - before_s);
            ((before_s + after_s) / 2.0, rate)
        });
        Self::averaged(rates)
    }

    fn averaged(rates: impl Iterator<Item = (f64, f64)>) -> Self {
        let mut bins: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
        for (time_s, rate) in rates.filter(|(_, rate)| rate.is_finite()) {
            // `as` saturates, and times are below 1e11 s.
            let bin = bins.entry((time_s / BIN_S).floor() as i64).or_default();
            *bin = (bin.0 + rate, bin.1 + 1.0);
        }
        Self(
            bins.into_iter()
                .map(|(bin, (sum, count))| (bin, sum / count))
                .collect(),
        )
    }

    /// Whether two logs turn differently at the same times, as those of two drives do whose times start again.
    pub fn differs_from(&self, other: &Self) -> bool {
        let common = self.0.iter();
        let common = common.filter_map(|(bin, rate)| Some((*rate, *other.0.get(bin)?)));
        let (a, b): (Vec<f64>, Vec<f64>) = common.unzip();
        let coefficient = correlation(&a, &b);
        // A rate that does not vary has no coefficient.
        a.len() >= LEAST_BINS && coefficient != 0.0 && coefficient.abs() * coefficient < SHARED
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;

    /// The rates of a body that turns back and forth with this period, from an IMU with these axes and noise.
    fn turning(period_s: f64, axis: Vec3, noise: f64) -> Turning {
        let samples = (0..6000).map(|i| {
            let time_s = 0.01 * f64::from(i);
            let rate = (time_s / period_s * std::f64::consts::TAU).sin();
            let off = noise * (f64::from(i) * 12.9898).sin();
            ImuSample {
                time_s,
                gyro_rad_s: axis * (rate + off),
                accel_m_s2: Vec3::zeros(),
            }
        });
        Turning::of_imu(&samples.collect::<Vec<_>>())
    }

    #[test]
    fn parts_of_one_body_turn_alike_and_other_drives_do_not() {
        let first = turning(20.0, Vec3::z(), 0.1);
        assert!(!first.differs_from(&turning(20.0, -Vec3::x(), 0.2)));
        assert!(first.differs_from(&turning(17.0, Vec3::z(), 0.1)));
        // Poses of the same body.
        let poses = (0..600).map(|i| {
            let time_s = 0.1 * f64::from(i);
            let turned =
                -(time_s / 20.0 * std::f64::consts::TAU).cos() * 20.0 / std::f64::consts::TAU;
            (time_s, Rotation::from_axis_angle(&Vec3::y_axis(), turned))
        });
        let poses = Turning::of_rotations(poses.collect());
        assert!(!first.differs_from(&poses) && poses.differs_from(&turning(17.0, Vec3::z(), 0.1)));
        // Nothing can be said of a body that does not turn, and of logs that hardly overlap.
        let still = (0..600).map(|i| (0.1 * f64::from(i), Rotation::identity()));
        assert!(!first.differs_from(&Turning::of_rotations(still.collect())));
    }
}
