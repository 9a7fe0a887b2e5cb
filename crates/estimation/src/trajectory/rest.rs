//! When the body rests, according to IMU, positions and headings together.

use super::settings::TrajectorySettings;
use super::streams::Streams;
use crate::geometry::Vec3;
use crate::geometry::heading::wrap;

/// Length of the blocks examined, seconds.
pub const REST_BLOCK_S: f64 = 1.0;
/// Shortest rest, blocks.
pub const REST_BLOCKS: usize = 2;
/// Within a resting block gyro and accelerometer scatter by less than this many times their
/// datasheet noise plus the allowance below.
const NOISE_FACTOR: f64 = 3.0;
/// Allowance for an idling engine, rad/s and m/s².
const ENGINE_RAD_S: f64 = 0.01;
const ENGINE_M_S2: f64 = 0.1;
/// Positions and headings of a resting body stay within this many standard deviations.
const REACH_SIGMAS: f64 = 4.0;
/// A line through the positions of a rest has a slope of less than this many of its standard deviations.
const SLOPE_SIGMAS: f64 = 3.0;
/// This much of a rest is discarded at both ends, seconds: the blocks are coarse, and a robot creeps to a
/// halt. Where a log begins at rest, the halt was before it, and nothing is discarded there.
const MARGIN_S: f64 = 1.0;

/// A time of rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest {
    pub from_s: f64,
    pub to_s: f64,
    /// Mean angular rate that the gyro shows: its bias, rad/s.
    pub gyro_rad_s: Vec3,
    /// What is discarded at its beginning, seconds.
    margin_s: f64,
}

impl Rest {
    /// Standard deviation of the velocity of a body at rest on soft ground with its engine on, m/s.
    pub const SIGMA_M_S: f64 = 0.002;

    pub fn holds_at(&self, time_s: f64) -> bool {
        (self.from_s + self.margin_s..=self.to_s - MARGIN_S).contains(&time_s)
    }
}

/// All rests in time order: runs of blocks in which gyro and accelerometer scatter by their noise
/// while positions and headings stay where they are.
pub fn rests(streams: &Streams, settings: &TrajectorySettings) -> Vec<Rest> {
    let (start, end) = streams.span_s();
    let blocks = ((end - start) / REST_BLOCK_S).floor() as usize;
    let mut rests = Vec::new();
    let mut run = 0;
    for block in 0..=blocks {
        let from = start + block as f64 * REST_BLOCK_S;
        if block < blocks && is_still(streams, settings, from) {
            run += 1;
            continue;
        }
        if run >= REST_BLOCKS {
            let from_s = from - run as f64 * REST_BLOCK_S;
            rests.extend(checked_rest(streams, settings, from_s, from));
        }
        run = 0;
    }
    rests
}

fn between<T>(records: &[T], time_s: impl Fn(&T) -> f64, from_s: f64, to_s: f64) -> &[T] {
    let first = records.partition_point(|r| time_s(r) < from_s);
    let last = records.partition_point(|r| time_s(r) < to_s);
    &records[first..last]
}

/// Whether nothing moves in the block from `from_s` on.
pub fn is_still(streams: &Streams, settings: &TrajectorySettings, from_s: f64) -> bool {
    let to_s = from_s + REST_BLOCK_S;
    let samples = between(&streams.imu, |s| s.time_s, from_s, to_s);
    let first = streams.imu.partition_point(|s| s.time_s < from_s);
    if samples.len() < 2 || streams.imu.is_bridged(first) {
        return false;
    }
    let count = samples.len() as f64;
    let scatter = |values: &mut dyn Iterator<Item = Vec3>| {
        let values: Vec<Vec3> = values.collect();
        let mean = values.iter().sum::<Vec3>() / count;
        let square: f64 = values.iter().map(|v| (v - mean).norm_squared()).sum();
        (square / (3.0 * count)).sqrt()
    };
    let root_rate = (count / REST_BLOCK_S).sqrt();
    let gyro = scatter(&mut samples.iter().map(|s| s.gyro_rad_s));
    let accel = scatter(&mut samples.iter().map(|s| s.accel_m_s2));
    let mut seen = 0;
    let positions_stay = streams.positions.iter().enumerate().all(|(sensor, fixes)| {
        let fixes = between(fixes, |f| f.value.time_s, from_s, to_s);
        seen += fixes.len();
        let mean =
            fixes.iter().map(|f| f.value.position_m).sum::<Vec3>() / fixes.len().max(1) as f64;
        let reach = settings.positions[sensor].sigma_m * REACH_SIGMAS;
        fixes.iter().all(|f| {
            let sigma = f
                .value
                .covariance_m2
                .map_or(reach, |c| c.diagonal().map(|x| x.sqrt() * REACH_SIGMAS));
            (f.value.position_m - mean).abs() < sigma
        })
    });
    gyro < NOISE_FACTOR * settings.imu.gyro_density * root_rate + ENGINE_RAD_S
        && accel < NOISE_FACTOR * settings.imu.accel_density * root_rate + ENGINE_M_S2
        && positions_stay
        && seen >= 2
}

/// A run of still blocks as a rest, if neither headings nor positions drift during it.
pub fn checked_rest(
    streams: &Streams,
    settings: &TrajectorySettings,
    from_s: f64,
    to_s: f64,
) -> Option<Rest> {
    let headings = between(&streams.heading, |h| h.value.time_s, from_s, to_s);
    let first = headings.first().map_or(0.0, |h| h.value.heading_rad);
    let reach = 2.0 * REACH_SIGMAS * settings.heading.sigma_rad;
    let turned = |h: f64| wrap(h - first).abs();
    if headings.iter().any(|h| turned(h.value.heading_rad) > reach) {
        return None;
    }
    for (sensor, fixes) in streams.positions.iter().enumerate() {
        let fixes = between(fixes, |f| f.value.time_s, from_s, to_s);
        let count = fixes.len() as f64;
        let middle_s = fixes.iter().map(|f| f.value.time_s).sum::<f64>() / count.max(1.0);
        let spread: f64 = fixes
            .iter()
            .map(|f| (f.value.time_s - middle_s).powi(2))
            .sum();
        let slope: Vec3 = fixes
            .iter()
            .map(|f| f.value.position_m * (f.value.time_s - middle_s))
            .sum();
        let sigma = settings.positions[sensor].sigma_m * spread.sqrt();
        if fixes.len() >= 2 && slope.abs().zip_map(&sigma, |v, s| v > SLOPE_SIGMAS * s) != NONE {
            return None;
        }
    }
    let samples = between(&streams.imu, |s| s.time_s, from_s, to_s);
    let sum = samples.iter().map(|s| s.gyro_rad_s).sum::<Vec3>();
    Some(Rest {
        from_s,
        to_s,
        gyro_rad_s: sum / samples.len() as f64,
        margin_s: if from_s > streams.span_s().0 {
            MARGIN_S
        } else {
            0.0
        },
    })
}

const NONE: nalgebra::Vector3<bool> = nalgebra::Vector3::new(false, false, false);
