//! Values that no sensor measured as they stand: an axis of the IMU that is held, coordinates that were rounded.
//!
//! Both are looked for while the body moves: then a value with noise is not the one before.

use super::Log;
use super::differences::{VALUES, weights};
use super::logs::STATED_FACTOR;
use super::turns::ways;
use crate::geometry::Vec3;
use crate::sensor::{ImuSample, PositionFix, Timed};
use crate::statistics::{SIGMAS_PER_MAD, median};
use crate::trajectory::{MotionLogs, PositionSettings, TrajectorySettings};
use crate::verdict::Verdict;

/// Fewest values by which a column is judged: where noise is at least as large as half a step, one value in three lies
/// in another step, and 60 in one step are no chance (1 in 10⁹).
const LEAST_VALUES: usize = 60;
const LEAST_NOISE_PER_STEP: f64 = 0.5;
/// An axis is held where it stays at one value for this share of the way.
const HELD_SHARE: f64 = 0.5;
/// Values on steps lie on them to this share of a step; of any others, one in fifty does.
const ON_STEP: f64 = 0.01;
/// Rounding is noise where values change by more than this share of a step from one to the next (Bennett 1948); where
/// they do not, its error lasts.
const SCATTERING_SHARE: f64 = 0.5;

/// What no sensor measured as it stands; `file` names the file of a log.
pub fn unmeasured(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    file: &dyn Fn(Log) -> String,
) -> Vec<Verdict> {
    let mut all = held_axes(logs, settings, &file(Log::Imu));
    for (i, (fixes, position)) in logs.positions.iter().zip(&settings.positions).enumerate() {
        all.extend(rounded(fixes, position, &file(Log::Position(i))));
    }
    all
}

/// Axes of the IMU that stay at one value for most of the way, while one beside them shows noise.
fn held_axes(logs: &MotionLogs<'_>, settings: &TrajectorySettings, file: &str) -> Vec<Verdict> {
    let imu: Vec<ImuSample> = while_moving(logs.imu, &logs.positions[0]);
    let times_s: Vec<f64> = imu.iter().map(|sample| sample.time_s).collect();
    let interval_s = median(times_s.windows(2).map(|pair| pair[1] - pair[0])).unwrap_or(0.0);
    if imu.len() < LEAST_VALUES || interval_s <= 0.0 {
        return Vec::new();
    }
    let gyro = columns(imu.iter().map(|sample| sample.gyro_rad_s));
    let accel = columns(imu.iter().map(|sample| sample.accel_m_s2));
    let noise = settings.imu;
    let mut all = Vec::new();
    for (sensor, unit, columns, density) in [
        ("gyro", "rad/s", gyro, noise.gyro_density),
        ("accel", "m/s²", accel, noise.accel_density),
    ] {
        let stated = density / interval_s.sqrt();
        // Axes of one sensor have the same noise, and are recorded in the same steps.
        let noise_shown = |values: &Vec<f64>| {
            let noise = scatter(&times_s, values);
            let is_shown = noise > stated / STATED_FACTOR
                && step(values).is_some_and(|step| noise > LEAST_NOISE_PER_STEP * step);
            is_shown.then_some(noise)
        };
        let axes = || columns.iter().zip(["x", "y", "z"]);
        let held = axes().map(|(values, axis)| (longest_run(values), axis));
        let held = held.filter(|(run, _)| run.len() as f64 > HELD_SHARE * imu.len() as f64);
        let held: Vec<(&[f64], &str)> = held.collect();
        if held.is_empty() {
            continue;
        }
        let beside = axes().find_map(|(values, axis)| Some((noise_shown(values)?, axis)));
        let Some((noise, beside)) = beside else {
            continue;
        };
        all.extend(held.iter().map(|(run, axis)| {
            let text = format!(
                "{file}: {sensor}_{axis} is {} {unit} in {} of the {} samples on the way, and {sensor}_{beside} scatters \
                 by {noise:.1e} {unit}: no sensor measured it. Record all three axes of the {sensor}.",
                run[0],
                run.len(),
                imu.len()
            );
            Verdict::fault("imu.held", text).with_value(run[0], None)
        }));
    }
    all
}

/// Coordinates in steps that are many times their standard deviation, and that the body takes several fixes to cross.
fn rounded(fixes: &[PositionFix], position: &PositionSettings, file: &str) -> Option<Verdict> {
    let fixes = while_moving(fixes, fixes);
    if fixes.len() < LEAST_VALUES {
        return None;
    }
    let columns = columns(fixes.iter().map(|fix| fix.position_m));
    let stated = |axis: usize| {
        let given = fixes.iter().filter_map(|fix| fix.covariance_m2);
        let given = median(given.map(|covariance| covariance[(axis, axis)].sqrt()));
        given.unwrap_or(position.sigma_m[axis])
    };
    let coarse = columns.iter().enumerate().filter_map(|(axis, values)| {
        let (step_m, sigma_m) = (lasting_step(values)?, stated(axis));
        let error_m = step_m / 12f64.sqrt();
        (error_m > STATED_FACTOR * sigma_m).then_some((step_m, sigma_m, axis))
    });
    let (step_m, sigma_m, axis) = coarse.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let axis = ["east", "north", "up"][axis];
    let name = &position.name;
    let likely = match step_m.log2().fract().abs() < 1e-6 {
        true => ", as coordinates of a few thousand kilometres in single precision are",
        false => "",
    };
    let text = format!(
        "{file}: {axis} of `{name}` comes in steps of {step_m:.4} m{likely}, and its standard deviation is to be \
         {sigma_m:.4} m: the rest was lost by rounding. Write the log anew with all digits (double precision), to a \
         millimetre or less."
    );
    Some(Verdict::fault(format!("{name}.rounded"), text).with_value(step_m, None))
}

/// The step of values that were rounded to it, where they change too little from one to the next for its errors to
/// scatter.
fn lasting_step(values: &[f64]) -> Option<f64> {
    let step = step(values)?;
    let changes = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let change = changes.sum::<f64>() / (values.len() - 1) as f64;
    let mut steps = values.iter().map(|value| (value - values[0]) / step);
    let is_rounded = steps.all(|steps| (steps - steps.round()).abs() < ON_STEP);
    (is_rounded && change < SCATTERING_SHARE * step).then_some(step)
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

/// The standard deviation of one value beside a smooth course.
fn scatter(times_s: &[f64], values: &[f64]) -> f64 {
    let windows = times_s.windows(VALUES).zip(values.windows(VALUES));
    let differences = windows.filter_map(|(times_s, values)| {
        let weights = weights(times_s.try_into().ok()?)?;
        let terms = weights.iter().zip(values);
        Some(terms.map(|(weight, value)| weight * value).sum::<f64>().abs())
    });
    SIGMAS_PER_MAD * median(differences).unwrap_or(0.0)
}

/// The most values in succession that are the same.
fn longest_run(values: &[f64]) -> &[f64] {
    let runs = values.chunk_by(|a, b| a == b);
    runs.max_by_key(|run| run.len()).unwrap_or_default()
}

/// Each axis of vectors.
fn columns(vectors: impl Iterator<Item = Vec3> + Clone) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|axis| vectors.clone().map(|vector| vector[axis]).collect())
}

/// The records on the ways of `fixes` over the ground.
fn while_moving<T: Timed + Copy>(records: &[T], fixes: &[PositionFix]) -> Vec<T> {
    let mut ways: Vec<(f64, f64)> = ways(fixes)
        .iter()
        .map(|[start, end]| (start.time_s, end.time_s))
        .collect();
    ways.sort_by(|a, b| a.0.total_cmp(&b.0));
    let is_on_way = |record: &&T| {
        let after = ways.partition_point(|way| way.0 <= record.time_s());
        after > 0 && record.time_s() <= ways[after - 1].1
    };
    records.iter().filter(is_on_way).copied().collect()
}
