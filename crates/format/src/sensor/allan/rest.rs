//! Checks that a log is that of an IMU at rest and has no gaps.

use super::super::ImuSample;
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::statistics::median;

/// Length of the blocks over which rates and gravity are averaged and variances computed.
const BLOCK_S: f64 = 1.0;
/// Fewest samples in a block: 16 samples give a variance to 37 %.
const FEWEST_IN_BLOCK: usize = 16;
/// An interval longer than this many medians is a gap.
const GAP_INTERVALS: f64 = 1.5;
/// Largest deviation of a block's mean rate from the median for an IMU at rest: far above the noise of
/// a one-second mean, and the slowest turn of a robot.
const MOVING_RATE_RAD_S: f64 = 1.0 / 180.0 * std::f64::consts::PI;
/// Tolerance of the direction of gravity; a bias of 17 mg tilts it by this much.
const MOVING_TILT_RAD: f64 = 1.0 / 180.0 * std::f64::consts::PI;
/// Specific force of an IMU at rest: gravity, apart from bias and scale.
const GRAVITY_M_S2: std::ops::Range<f64> = 9.3..10.3;
/// Above this, the IMU is on a turntable or has an implausible bias.
const LARGEST_MEAN_RATE_RAD_S: f64 = 5.0 / 180.0 * std::f64::consts::PI;
/// A block whose variance is this many times the median was disturbed: by chance, one in four
/// million blocks of 16 samples exceeds it.
const DISTURBED_VARIANCE: f64 = 4.0;

/// The longest part of the log without a gap.
pub(super) fn longest_stretch(imu: &[ImuSample]) -> &[ImuSample] {
    let intervals = imu.windows(2).map(|w| w[1].time_s - w[0].time_s);
    let longest_s = GAP_INTERVALS * median(intervals).unwrap_or(0.0);
    imu.chunk_by(|a, b| b.time_s - a.time_s <= longest_s)
        .max_by_key(|stretch| stretch.len())
        .unwrap_or(imu)
}

/// Refuses a log with motion; warns of disturbances.
pub(super) fn check(imu: &[ImuSample], interval_s: f64) -> Result<Vec<String>> {
    let length = ((BLOCK_S / interval_s).round() as usize).max(FEWEST_IN_BLOCK);
    let blocks: Vec<Block> = imu.chunks_exact(length).map(Block::new).collect();
    if blocks.is_empty() {
        return Err(Error::data(
            format!(
                "the log spans {:.2e} s without a gap",
                interval_s * imu.len() as f64
            ),
            "noise figures need some seconds at rest; check the unit of the times: seconds",
        ));
    }
    let median_of = |pick: fn(&Block) -> Vec3| {
        Vec3::from_fn(|axis, _| median(blocks.iter().map(|b| pick(b)[axis])).unwrap_or(f64::NAN))
    };
    let (rate, force) = (median_of(|b| b.rate), median_of(|b| b.force));
    let moving = |motion: String| {
        Err(Error::data(
            format!("the IMU is not at rest: {motion}"),
            "use a log recorded at rest, or only its part at rest",
        ))
    };
    if !GRAVITY_M_S2.contains(&force.norm()) {
        return moving(format!(
            "its specific force is {:.3} m/s², not that of gravity",
            force.norm()
        ));
    }
    if rate.norm() > LARGEST_MEAN_RATE_RAD_S {
        return moving(format!("it turns at {:.1} °/s", rate.norm().to_degrees()));
    }
    for block in &blocks {
        let tilt = block.force.angle(&force);
        if tilt > MOVING_TILT_RAD {
            return moving(format!(
                "at {:.3} s the direction of gravity is {:.1}° off the median",
                block.time_s,
                tilt.to_degrees()
            ));
        }
        let turn = (block.rate - rate).norm();
        if turn > MOVING_RATE_RAD_S {
            return moving(format!(
                "at {:.3} s it turns at {:.1} °/s",
                block.time_s,
                turn.to_degrees()
            ));
        }
    }
    Ok(disturbed(&blocks))
}

/// A warning if some blocks are much noisier than the median.
fn disturbed(blocks: &[Block]) -> Vec<String> {
    let medians: [f64; 6] =
        std::array::from_fn(|i| median(blocks.iter().map(|b| b.variance[i])).unwrap_or(f64::NAN));
    let is_disturbed = |b: &&Block| (0..6).any(|i| b.variance[i] > DISTURBED_VARIANCE * medians[i]);
    let disturbed: Vec<&Block> = blocks.iter().filter(is_disturbed).collect();
    disturbed
        .first()
        .map(|first| {
            format!(
                "{} of {} seconds are noisier than the rest, the first at {:.3} s: was the IMU \
                 touched, or was its support vibrating?",
                disturbed.len(),
                blocks.len(),
                first.time_s
            )
        })
        .into_iter()
        .collect()
}

/// About a second of the log.
struct Block {
    time_s: f64,
    rate: Vec3,
    force: Vec3,
    /// Variances of gyro x, y, z and accelerometer x, y, z.
    variance: [f64; 6],
}

impl Block {
    fn new(samples: &[ImuSample]) -> Self {
        let n = samples.len() as f64;
        let rate = samples.iter().map(|s| s.gyro_rad_s).sum::<Vec3>() / n;
        let force = samples.iter().map(|s| s.accel_m_s2).sum::<Vec3>() / n;
        let mut variance = [0.0; 6];
        for sample in samples {
            let (w, f) = (sample.gyro_rad_s - rate, sample.accel_m_s2 - force);
            for axis in 0..3 {
                variance[axis] += w[axis] * w[axis] / (n - 1.0);
                variance[axis + 3] += f[axis] * f[axis] / (n - 1.0);
            }
        }
        Self {
            time_s: samples[0].time_s,
            rate,
            force,
            variance,
        }
    }
}
