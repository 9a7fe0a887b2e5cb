//! Values that cannot be measurements: an axis of the IMU that stays at one value, coordinates that were rounded.
//!
//! Only the records of a moving body are examined, because there a value with noise differs from the one before.

use super::contradiction::{Contradiction, HeldAxis, ImuSensor, Log, RoundedPositions};
use super::differences::{VALUES, weights};
use super::logs::STATED_FACTOR;
use super::turns::stretches;
use crate::geometry::Vec3;
use crate::sensor::{ImuSample, PositionFix, Timed};
use crate::statistics::{SIGMAS_PER_MAD, median};
use crate::trajectory::{MotionLogs, PositionSettings, TrajectorySettings};

/// An axis is held if it stays at one value for this share of the samples of the moving body.
const HELD_SHARE: f64 = 0.5;
/// With noise whose standard deviation is half a step, one value in three lies on another step.
const NOISE_PER_STEP: f64 = 0.5;
/// Smallest number of values of the moving body by which a log is judged: the chance that half of them lie on
/// one step is then 1 in 10⁹.
const LEAST_VALUES: usize = 120;
/// Rounded values lie on a step to this share of a step; of other values, one in fifty does.
const ON_STEP: f64 = 0.01;
/// Rounding errors scatter like noise where values have noise of half a step (Widrow 1956); such values change by
/// this share of a step, 2/√π · ½, from one to the next. Where values change by less, rounding errors last.
const SCATTERING_CHANGE: f64 = 0.56;
/// Single precision has steps of 2⁻²³ of a power of two.
const SINGLE_PRECISION: f64 = (1 << 23) as f64;

/// Values that cannot be measurements; `file` names the file of a log.
pub fn unmeasured(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    file: &dyn Fn(Log) -> String,
) -> Vec<Contradiction> {
    let held = held_axes(logs, settings, &file(Log::Imu)).into_iter();
    let mut all: Vec<Contradiction> = held.map(Contradiction::Held).collect();
    for (i, (fixes, position)) in logs.positions.iter().zip(&settings.positions).enumerate() {
        let rounded = rounded(fixes, position, &file(Log::Position(i)));
        all.extend(rounded.map(Contradiction::Rounded));
    }
    all
}

/// Axes of the IMU that stay at one value while another axis of the same sensor, which has the same noise and is
/// written in the same steps, shows more noise than half a step.
fn held_axes(logs: &MotionLogs<'_>, settings: &TrajectorySettings, file: &str) -> Vec<HeldAxis> {
    let imu = while_moving(logs.imu, &logs.positions[0]);
    let times_s: Vec<f64> = imu.iter().map(Timed::time_s).collect();
    let interval_s = median(times_s.windows(2).map(|pair| pair[1] - pair[0])).unwrap_or(0.0);
    if imu.len() < LEAST_VALUES || interval_s <= 0.0 {
        return Vec::new();
    }
    let values = |part: fn(&ImuSample) -> Vec3| imu.iter().map(part).collect::<Vec<Vec3>>();
    let sensors = [
        Sensor {
            sensor: ImuSensor::Gyro,
            axes: axes(&values(|sample| sample.gyro_rad_s)),
            sigma: settings.imu.gyro_density / interval_s.sqrt(),
        },
        Sensor {
            sensor: ImuSensor::Accel,
            axes: axes(&values(|sample| sample.accel_m_s2)),
            sigma: settings.imu.accel_density / interval_s.sqrt(),
        },
    ];
    let held = sensors
        .iter()
        .flat_map(|sensor| sensor.held(&times_s, file));
    held.collect()
}

/// The three axes of a sensor of the IMU, while the body moves.
struct Sensor {
    sensor: ImuSensor,
    axes: [Vec<f64>; 3],
    /// Standard deviation of a sample, as the project gives it.
    sigma: f64,
}

impl Sensor {
    fn held(&self, times_s: &[f64], file: &str) -> Vec<HeldAxis> {
        let runs = self.axes.iter().map(|values| longest_run(values));
        let least = HELD_SHARE * times_s.len() as f64;
        let held = runs.enumerate().filter(|(_, run)| run.len() as f64 > least);
        let held: Vec<(usize, &[f64])> = held.collect();
        if held.is_empty() {
            return Vec::new();
        }
        // A simulation without noise may well have an axis that does not move.
        let noisy = self.axes.iter().enumerate().find_map(|(axis, values)| {
            let noise = scatter(times_s, values);
            let least = NOISE_PER_STEP * step(values)?;
            (noise > least && noise > self.sigma / STATED_FACTOR).then_some((axis, noise))
        });
        let Some((noisy_axis, noise)) = noisy else {
            return Vec::new();
        };
        let held = held.into_iter().map(|(axis, run)| HeldAxis {
            file: file.to_owned(),
            sensor: self.sensor,
            axis,
            value: run[0],
            held: run.len(),
            samples: times_s.len(),
            noisy_axis,
            noise,
        });
        held.collect()
    }
}

/// Coordinates in steps that are many times their standard deviation, and that the body takes several fixes to cross.
fn rounded(
    fixes: &[PositionFix],
    position: &PositionSettings,
    file: &str,
) -> Option<RoundedPositions> {
    let fixes = while_moving(fixes, fixes);
    if fixes.len() < LEAST_VALUES {
        return None;
    }
    let sigma_m = |axis: usize| {
        let covariances = fixes.iter().filter_map(|fix| fix.covariance_m2);
        let logged_m = median(covariances.map(|covariance| covariance[(axis, axis)].sqrt()));
        logged_m.unwrap_or(position.sigma_m[axis])
    };
    let positions: Vec<Vec3> = fixes.iter().map(|fix| fix.position_m).collect();
    let steps = axes(&positions).map(|values| lasting_step(&values));
    let steps = steps.into_iter().enumerate();
    let steps = steps.filter_map(|(axis, step_m)| Some((step_m?, axis)));
    let coarse = steps.filter(|(step_m, axis)| {
        // Standard deviation of the rounding errors.
        step_m / 12f64.sqrt() > STATED_FACTOR * sigma_m(*axis)
    });
    let (step_m, axis) = coarse.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let exponent = step_m.log2();
    let is_single = (exponent - exponent.round()).abs() < ON_STEP;
    Some(RoundedPositions {
        file: file.to_owned(),
        position: position.name.clone(),
        axis,
        step_m,
        sigma_m: sigma_m(axis),
        single_from_m: is_single.then_some(step_m * SINGLE_PRECISION),
    })
}

/// The step to which values were rounded, where they change too little from one to the next for the rounding errors
/// to scatter.
fn lasting_step(values: &[f64]) -> Option<f64> {
    let step = step(values)?;
    let mut steps = values.iter().map(|value| (value - values[0]) / step);
    let is_rounded = steps.all(|steps| (steps - steps.round()).abs() < ON_STEP);
    let changes = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let change = changes.sum::<f64>() / (values.len() - 1) as f64;
    (is_rounded && change < SCATTERING_CHANGE * step).then_some(step)
}

/// The smallest difference between values that differ.
fn step(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let differences = sorted.windows(2).map(|pair| pair[1] - pair[0]);
    differences
        .filter(|difference| *difference > 0.0)
        .reduce(f64::min)
}

/// Standard deviation of a value about a smooth course.
fn scatter(times_s: &[f64], values: &[f64]) -> f64 {
    let windows = times_s.windows(VALUES).zip(values.windows(VALUES));
    let differences = windows.filter_map(|(times_s, values)| {
        let weights = weights(times_s.try_into().ok()?)?;
        let terms = weights.iter().zip(values);
        let sum: f64 = terms.map(|(weight, value)| weight * value).sum();
        Some(sum.abs())
    });
    SIGMAS_PER_MAD * median(differences).unwrap_or(0.0)
}

/// The longest run of equal values.
fn longest_run(values: &[f64]) -> &[f64] {
    let runs = values.chunk_by(|a, b| a == b);
    runs.max_by_key(|run| run.len()).unwrap_or_default()
}

/// The values of each axis.
fn axes(vectors: &[Vec3]) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|axis| vectors.iter().map(|vector| vector[axis]).collect())
}

/// The records that were taken while the body moved over the ground, according to `fixes`.
fn while_moving<T: Timed + Copy>(records: &[T], fixes: &[PositionFix]) -> Vec<T> {
    let stretches = stretches(fixes).into_iter();
    let mut spans_s: Vec<(f64, f64)> = stretches
        .map(|[start, end]| (start.time_s, end.time_s))
        .collect();
    spans_s.sort_by(|a, b| a.0.total_cmp(&b.0));
    let is_moving = |record: &&T| {
        let begun = spans_s.partition_point(|span_s| span_s.0 <= record.time_s());
        begun > 0 && record.time_s() <= spans_s[begun - 1].1
    };
    records.iter().filter(is_moving).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BodyAxes;
    use crate::trajectory::{HeadingSettings, ImuDatasheet, ImuNoise};

    const IMU_HZ: f64 = 50.0;
    const PRISM_HZ: f64 = 7.0;
    const SIGMA_M: f64 = 0.005;
    const SPAN_S: f64 = 120.0;

    struct Drive {
        imu: Vec<ImuSample>,
        positions: Vec<Vec<PositionFix>>,
        settings: TrajectorySettings,
    }

    /// Noise of unit standard deviation: Irwin and Hall's sum of twelve uniform numbers.
    struct Noise(u64);

    impl Noise {
        fn scalar(&mut self) -> f64 {
            let uniform = (0..12).map(|_| {
                let factor = 6_364_136_223_846_793_005;
                self.0 = self.0.wrapping_mul(factor).wrapping_add(1);
                (self.0 >> 11) as f64 / (1u64 << 53) as f64
            });
            uniform.sum::<f64>() - 6.0
        }

        fn vector(&mut self, sigma: f64) -> Vec3 {
            Vec3::new(self.scalar(), self.scalar(), self.scalar()) * sigma
        }
    }

    impl Drive {
        /// At rest until `start_s`, then round a circle at half a metre a second, with this share of the noise that
        /// the settings state.
        fn new(start_s: f64, noise_share: f64) -> Self {
            let (radius_m, speed_m_s) = (4.0, 0.5);
            let imu_noise = ImuNoise::from_datasheet(&ImuDatasheet::default());
            let mut noise = Noise(1);
            let driven_s = |time_s: f64| (time_s - start_s).max(0.0);
            let imu = (0..(SPAN_S * IMU_HZ) as u32).map(|i| {
                let time_s = f64::from(i) / IMU_HZ;
                let rate = f64::from(time_s > start_s) * speed_m_s / radius_m;
                let sigmas = [imu_noise.gyro_density, imu_noise.accel_density]
                    .map(|density| noise_share * density * IMU_HZ.sqrt());
                ImuSample {
                    time_s,
                    gyro_rad_s: Vec3::z() * rate + noise.vector(sigmas[0]),
                    accel_m_s2: Vec3::z() * -9.81 + noise.vector(sigmas[1]),
                }
            });
            let imu = imu.collect();
            let fixes = (0..(SPAN_S * PRISM_HZ) as u32).map(|i| {
                let time_s = f64::from(i) / PRISM_HZ;
                let angle = speed_m_s * driven_s(time_s) / radius_m;
                let place_m = Vec3::new(angle.cos(), angle.sin(), 0.5) * radius_m;
                let position_m = place_m + noise.vector(noise_share * SIGMA_M);
                PositionFix::with_sigma(time_s, position_m, None)
            });
            let positions = vec![fixes.collect()];
            let prism = PositionSettings::prism(SIGMA_M, Vec3::zeros());
            let heading = HeadingSettings::aligned(0.01);
            Self {
                imu,
                positions,
                settings: TrajectorySettings::new(BodyAxes::Frd, imu_noise, prism, heading),
            }
        }

        fn unmeasured(&self) -> Vec<Contradiction> {
            let logs = MotionLogs {
                imu: &self.imu,
                positions: &self.positions,
                heading: &[],
            };
            unmeasured(&logs, &self.settings, &|log| format!("{log:?}.csv"))
        }

        /// The only finding, which is an axis that is held.
        fn held(&self) -> HeldAxis {
            let found = self.unmeasured();
            let [Contradiction::Held(held)] = found.as_slice() else {
                panic!("{found:?}")
            };
            held.clone()
        }

        /// The only finding, which is a coordinate that was rounded.
        fn rounded(&self) -> RoundedPositions {
            let found = self.unmeasured();
            let [Contradiction::Rounded(rounded)] = found.as_slice() else {
                panic!("{found:?}")
            };
            rounded.clone()
        }

        fn with_imu(mut self, change: impl Fn(usize, &mut ImuSample)) -> Self {
            let samples = self.imu.iter_mut().enumerate();
            samples.for_each(|(i, sample)| change(i, sample));
            self
        }

        /// Coordinates as `write` rounds them, with `origin_m` subtracted when they were read.
        fn with_positions(mut self, origin_m: f64, write: impl Fn(f64) -> f64) -> Self {
            for fix in &mut self.positions[0] {
                let written = |metres: f64| write(metres + origin_m) - origin_m;
                fix.position_m = fix.position_m.map(written);
            }
            self
        }
    }

    fn in_steps(step: f64) -> impl Fn(f64) -> f64 {
        move |value| (value / step).round() * step
    }

    #[test]
    fn an_axis_that_is_held_during_motion_is_named_with_its_value() {
        for axis in 0..3 {
            let gyro = Drive::new(10.0, 1.0).with_imu(|_, sample| sample.gyro_rad_s[axis] = 0.0);
            let accel = Drive::new(10.0, 1.0).with_imu(|_, sample| sample.accel_m_s2[axis] = 0.25);
            for (drive, sensor, value) in [
                (gyro, ImuSensor::Gyro, 0.0),
                (accel, ImuSensor::Accel, 0.25),
            ] {
                let held = drive.held();
                assert_eq!(held.file, "Imu.csv");
                assert_eq!((held.sensor, held.axis, held.value), (sensor, axis, value));
            }
        }
        // An axis that sticks from some time on.
        let first = (0.4 * SPAN_S * IMU_HZ) as usize;
        let stuck = Drive::new(0.0, 1.0).with_imu(|i, sample| {
            if i >= first {
                sample.gyro_rad_s.y = 0.0125;
            }
        });
        assert_eq!(stuck.held().value, 0.0125);
    }

    #[test]
    fn an_imu_that_hardly_turns_or_rests_or_is_simulated_has_no_held_axis() {
        let gyro_sigma = Drive::new(0.0, 1.0).settings.imu.gyro_density * IMU_HZ.sqrt();
        // In steps of twice its noise, at rest for most of the log.
        let coarse = in_steps(2.0 * gyro_sigma);
        let resting = Drive::new(100.0, 1.0);
        let resting = resting.with_imu(|_, s| s.gyro_rad_s = s.gyro_rad_s.map(&coarse));
        // One axis stays at its value, but only at rest.
        let first = (100.0 * IMU_HZ) as usize;
        let idling = Drive::new(100.0, 1.0).with_imu(|i, sample| {
            if i < first {
                sample.gyro_rad_s.x = 0.0;
            }
        });
        let planar = Drive::new(0.0, 0.0);
        for drive in [Drive::new(0.0, 1.0), resting, idling, planar] {
            assert_eq!(drive.unmeasured(), []);
        }
    }

    #[test]
    fn coordinates_in_single_precision_are_named_where_their_steps_are_long() {
        let single = |value: f64| f64::from(value as f32);
        for (origin_m, step_m) in [(5_000_000.0, 0.5), (3_500_000.0, 0.25)] {
            let rounded = Drive::new(10.0, 1.0)
                .with_positions(origin_m, single)
                .rounded();
            assert_eq!(
                (rounded.file.as_str(), rounded.position.as_str()),
                ("Position(0).csv", "prism")
            );
            assert!((rounded.step_m - step_m).abs() < 1e-6, "{rounded:?}");
            assert!(rounded.single_from_m.is_some(), "{rounded:?}");
        }
        let rounded = Drive::new(10.0, 1.0)
            .with_positions(0.0, in_steps(0.1))
            .rounded();
        assert_eq!(rounded.single_from_m, None);
    }

    #[test]
    fn coordinates_rounded_to_a_centimetre_or_less_are_accepted() {
        let single = |value: f64| f64::from(value as f32);
        let local = Drive::new(10.0, 1.0).with_positions(1000.0, single);
        let millimetres = Drive::new(10.0, 1.0).with_positions(0.0, in_steps(0.001));
        let centimetres = Drive::new(10.0, 1.0).with_positions(0.0, in_steps(0.01));
        // Known to decimetres, as the project says.
        let mut gnss = Drive::new(10.0, 1.0).with_positions(0.0, in_steps(0.1));
        gnss.settings.positions[0].sigma_m = Vec3::repeat(0.1);
        let planar = Drive::new(0.0, 0.0).with_positions(0.0, in_steps(0.001));
        for drive in [local, millimetres, centimetres, gnss, planar] {
            assert_eq!(drive.unmeasured(), []);
        }
    }
}
