//! Whether a log is that of an IMU at rest, and without gaps.

use super::super::ImuSample;
use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// Blocks over which rates and gravity are averaged and variances taken.
const BLOCK_S: f64 = 1.0;
/// Fewest samples in a block: of 16, a variance is known to 37 %.
const FEWEST_IN_BLOCK: usize = 16;
/// An interval longer than this many medians is a gap.
const GAP_INTERVALS: f64 = 1.5;
/// The rate of no block of a resting IMU differs by this from that of the others: it is far above
/// the noise of a mean over a second, and the slowest turn of a robot.
const MOVING_RATE_RAD_S: f64 = 1.0 / 180.0 * std::f64::consts::PI;
/// Nor the direction of gravity, in which a bias of 17 mg would show as much.
const MOVING_TILT_RAD: f64 = 1.0 / 180.0 * std::f64::consts::PI;
/// A resting IMU measures gravity, but for its bias and scale.
const GRAVITY_M_S2: std::ops::Range<f64> = 9.3..10.3;
/// A turning table, or a bias that no IMU has.
const LARGEST_MEAN_RATE_RAD_S: f64 = 5.0 / 180.0 * std::f64::consts::PI;
/// A block whose variance is this many times the median was shaken: chance makes one of four
/// million blocks of 16 samples so.
const SHAKEN_VARIANCE: f64 = 4.0;

/// The longest part of the log without a gap.
pub(super) fn longest_stretch(imu: &[ImuSample]) -> &[ImuSample] {
    let mut intervals: Vec<f64> = imu.windows(2).map(|w| w[1].time_s - w[0].time_s).collect();
    if intervals.is_empty() {
        return imu;
    }
    let longest_s = GAP_INTERVALS * median(&mut intervals);
    imu.chunk_by(|a, b| b.time_s - a.time_s <= longest_s)
        .max_by_key(|stretch| stretch.len())
        .unwrap_or(imu)
}

/// Refuses a log that moves; warns of one that was shaken.
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
    let middle = |pick: fn(&Block) -> Vec3| {
        let of =
            |axis: usize| median(&mut blocks.iter().map(|b| pick(b)[axis]).collect::<Vec<_>>());
        Vec3::new(of(0), of(1), of(2))
    };
    let (rate, force) = (middle(|b| b.rate), middle(|b| b.force));
    let moving = |what: String| {
        Err(Error::data(
            format!("the IMU is not at rest: {what}"),
            "give a log in which nothing moves, or the part of one",
        ))
    };
    if !GRAVITY_M_S2.contains(&force.norm()) {
        return moving(format!(
            "its specific force is {:.3} m/s², not that of gravity",
            force.norm()
        ));
    }
    if rate.norm() > LARGEST_MEAN_RATE_RAD_S {
        return moving(format!("it turns by {:.1} °/s", rate.norm().to_degrees()));
    }
    for block in &blocks {
        let tilt = block.force.angle(&force);
        if tilt > MOVING_TILT_RAD {
            return moving(format!(
                "at {:.3} s gravity comes from a direction {:.1}° off the usual one",
                block.time_s,
                tilt.to_degrees()
            ));
        }
        let turn = (block.rate - rate).norm();
        if turn > MOVING_RATE_RAD_S {
            return moving(format!(
                "at {:.3} s it turns by {:.1} °/s",
                block.time_s,
                turn.to_degrees()
            ));
        }
    }
    Ok(shaken(&blocks))
}

fn shaken(blocks: &[Block]) -> Vec<String> {
    let usual: [f64; 6] = std::array::from_fn(|i| {
        median(&mut blocks.iter().map(|b| b.variance[i]).collect::<Vec<_>>())
    });
    let is_shaken = |b: &&Block| (0..6).any(|i| b.variance[i] > SHAKEN_VARIANCE * usual[i]);
    let shaken: Vec<&Block> = blocks.iter().filter(is_shaken).collect();
    shaken
        .first()
        .map(|first| {
            format!(
                "{} of {} seconds are noisier than the rest, the first at {:.3} s: was the IMU \
                 touched, or did it stand on something that shakes?",
                shaken.len(),
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
    /// Of gyro x, y, z and accelerometer x, y, z about their means.
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

/// The upper median of values that are not empty.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
