//! What the logs of the motion say about units, axes and signs.

use super::contradiction::{
    Contradiction, LEAST_COSINE, LateLog, Log, PositionNoise, VerticalAxis,
};
use super::differences::{self, VALUES};
use super::time_scales::{SAME_LATENCY_S, TimeScales};
use super::turns::{Turned, courses};
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::geometry::heading::wrap;
use crate::sensor::{HeadingFix, ImuSample, PositionFix};
use crate::statistics::{SIGMAS_PER_MAD, median};
use crate::trajectory::{MotionLogs, PositionSettings, TrajectorySettings};

/// A median specific force within this share of a unit's gravity is in that unit.
const GRAVITY_SHARE: f64 = 0.15;
/// The mean vector of the directions of an angle is at least this long where the angle stays the same.
const CONCENTRATED: f64 = 0.8;
/// Headings in radians taken for degrees turn by π/180 of what the gyro measures; no scale of a sensor is a tenth.
const IN_RADIANS_SLOPE: f64 = 0.1;
/// Nothing on the ground moves faster, m/s.
const FASTEST_M_S: f64 = 60.0;
/// Noise of positions beyond this many times their standard deviation means a wrong unit.
const NOISE_FACTOR: f64 = 100.0;

/// Settings that the logs contradict.
///
/// # Errors
/// Specific forces in g, angular rates in degrees, headings in radians, positions in millimetres.
pub fn logs(logs: &MotionLogs<'_>, settings: &TrajectorySettings) -> Result<Vec<Contradiction>> {
    if logs.imu.len() < 2 {
        return Ok(Vec::new());
    }
    let up = check_forces(logs.imu)?;
    let turned = Turned::new(logs.imu, &up);
    let mut all = Vec::new();
    let headings = angles_of(logs.heading);
    let by_heading = turned.compare(&headings);
    let turns_back = by_heading.is_some_and(|ratio| ratio.is_about(-1.0));
    if turns_back && up.dot(&settings.axes.up()) < -LEAST_COSINE {
        return Err(Error::data(
            "the accelerations point the wrong way: if they show gravity, the headings turn to the left where \
             the gyro turns to the right",
            "negate the accelerations: at rest, the specific force points upwards",
        ));
    }
    all.extend(axes(&up, settings).map(Contradiction::Axes));
    if let Some(ratio) = by_heading {
        let is_less =
            ratio.slope.abs() < IN_RADIANS_SLOPE && ratio.gyro_rms_rad < std::f64::consts::PI;
        if is_in_radians(logs.heading) && is_less {
            return Err(Error::data(
                "the headings lie between 0 and 6.3° while the body turns by more: they are in radians",
                "name the column heading_rad, then they are converted",
            ));
        } else if ratio.is_about(1f64.to_radians()) {
            return Err(gyro_in_degrees("the headings turn"));
        } else if turns_back {
            all.push(opposite_heading(&headings, &courses(&logs.positions[0])));
        }
    }
    for (fixes, position) in logs.positions.iter().zip(&settings.positions) {
        let name = position.name.as_str();
        check_position_unit(fixes, name, position.sigma_m.max())?;
        let courses = courses(fixes);
        if let Some(ratio) = turned.compare(&courses) {
            if by_heading.is_none() && ratio.is_about(1f64.to_radians()) {
                return Err(gyro_in_degrees(&format!("the course of `{name}` turns")));
            }
            if ratio.is_about(-1.0) {
                let position = position.name.clone();
                all.push(Contradiction::LeftHanded { position });
            }
        }
        if !turns_back {
            all.extend(driven_direction(&headings, &courses, name));
        }
    }
    Ok(all)
}

fn angles_of(headings: &[HeadingFix]) -> Vec<(f64, f64)> {
    let all = headings.iter();
    all.map(|fix| (fix.time_s, fix.heading_rad)).collect()
}

/// Logs that turn with the gyro, but seconds earlier or later than their stamps say.
pub fn late_logs(logs: &MotionLogs<'_>, settings: &TrajectorySettings) -> Vec<LateLog> {
    let Ok(up) = check_forces(logs.imu) else {
        return Vec::new();
    };
    let turned = Turned::new(logs.imu, &up);
    let mut streams = vec![(Log::Heading, "heading", angles_of(logs.heading))];
    for (i, (fixes, position)) in logs.positions.iter().zip(&settings.positions).enumerate() {
        streams.push((Log::Position(i), &position.name, courses(fixes)));
    }
    streams.retain(|(_, _, angles)| !angles.is_empty());
    let late = streams
        .iter()
        .filter_map(|(log, name, angles)| Some((*log, *name, turned.late_by(angles)?)));
    let late: Vec<(Log, &str, f64)> = late.collect();
    // If all other logs are late by the same time, the clock of the IMU is off.
    if let [(_, _, first_s), .., (_, _, last_s)] = late[..]
        && late.len() == streams.len()
        && (first_s - last_s).abs() < SAME_LATENCY_S
    {
        return vec![late_log(Log::Imu, "imu", -first_s)];
    }
    let late = late.into_iter();
    late.map(|(log, name, late_s)| late_log(log, name, late_s))
        .collect()
}

fn late_log(log: Log, name: &str, late_s: f64) -> LateLog {
    LateLog {
        log,
        name: name.to_owned(),
        late_s,
        scales: TimeScales::that_differ_by(late_s),
    }
}

/// A standard deviation is stated wrongly if neighbouring fixes scatter by more than this factor times it.
pub const STATED_FACTOR: f64 = 4.0;

/// Fixes over a longer time are not neighbours: their motion would count as noise, seconds.
const NEIGHBOURS_S: f64 = 1.2;

/// The noise of neighbouring fixes without a covariance, where it is much larger than stated on an axis. The noise is that of fourth
/// differences, which remove a smooth motion.
pub fn position_noise(fixes: &[PositionFix], position: &PositionSettings) -> Option<PositionNoise> {
    let is_unstated = |fix: &PositionFix| fix.covariance_m2.is_none();
    let unstated = fixes.iter().filter(|fix| is_unstated(fix)).count();
    let windows = fixes.windows(VALUES);
    let windows = windows.filter(|window| window.iter().all(is_unstated));
    let differences: Vec<Vec3> = windows.filter_map(fourth_difference).collect();
    if unstated == 0 || differences.len() < unstated / 2 {
        return None;
    }
    let mut factors = Vec3::repeat(1.0);
    for axis in 0..3 {
        let noise_m = SIGMAS_PER_MAD * median(differences.iter().map(|d| d[axis].abs()))?;
        factors[axis] = (noise_m / position.sigma_m[axis]).max(1.0);
    }
    if factors.max() < STATED_FACTOR {
        return None;
    }
    Some(PositionNoise {
        position: position.name.clone(),
        factors,
        sigma_m: factors.component_mul(&position.sigma_m),
    })
}

/// The scatter of [`VALUES`] fixes, see [`differences`]; `None` where they are not neighbours.
fn fourth_difference(fixes: &[PositionFix]) -> Option<Vec3> {
    let fixes: &[PositionFix; VALUES] = fixes.try_into().ok()?;
    let times_s = fixes.map(|fix| fix.time_s);
    let is_near = times_s[VALUES - 1] - times_s[0] <= NEIGHBOURS_S;
    let weights = differences::weights(times_s).filter(|_| is_near)?;
    let terms = fixes.iter().zip(weights);
    Some(terms.map(|(fix, weight)| fix.position_m * weight).sum())
}

/// The direction of the mean specific force in the body.
///
/// # Errors
/// Its median length shows another unit than m/s².
fn check_forces(imu: &[ImuSample]) -> Result<Vec3> {
    let length = median(imu.iter().map(|sample| sample.accel_m_s2.norm())).unwrap_or(f64::NAN);
    let is_about = |gravity: f64| (length / gravity - 1.0).abs() < GRAVITY_SHARE;
    for (gravity, unit) in [(1.0, "g"), (1000.0, "mg")] {
        if is_about(gravity) {
            return Err(Error::data(
                format!(
                    "the median specific force of the IMU is {length:.4} m/s²: the log is in {unit}"
                ),
                format!(
                    "name the columns accel_x_{unit}, accel_y_{unit}, accel_z_{unit}, then they are converted; if the \
                     log has no columns, as a recording of ROS, write accel_unit = \"{unit}\" in [imu] of the project"
                ),
            ));
        }
    }
    let mean = imu.iter().map(|sample| sample.accel_m_s2).sum::<Vec3>();
    Ok(mean.try_normalize(0.0).unwrap_or_else(Vec3::z))
}

fn gyro_in_degrees(what: &str) -> Error {
    Error::data(
        format!("{what} by 1/57 of what the gyro says: the gyro's log is in degrees per second"),
        "name the columns gyro_x_deg_s, gyro_y_deg_s, gyro_z_deg_s, then they are converted; if the log has no columns, \
         as a recording of ROS, write gyro_unit = \"deg_s\" in [imu] of the project",
    )
}

/// The vertical axis, where the specific force contradicts the project's.
fn axes(up: &Vec3, settings: &TrajectorySettings) -> Option<VerticalAxis> {
    let cosine = up.dot(&settings.axes.up());
    if cosine > LEAST_COSINE {
        return None;
    }
    Some(VerticalAxis {
        given: settings.axes,
        axis: up.iamax(),
        cosine,
    })
}

/// Whether the headings, read as degrees, all lie within 2π and vary.
fn is_in_radians(headings: &[HeadingFix]) -> bool {
    let degrees = || headings.iter().map(|fix| fix.heading_rad.to_degrees());
    let most = degrees().fold(f64::NEG_INFINITY, f64::max);
    let least = degrees().fold(f64::INFINITY, f64::min);
    let turn = std::f64::consts::TAU;
    most - least > 0.5 && least > -0.51 * turn && most < 1.01 * turn && most - least < 1.01 * turn
}

/// Headings that turn against the gyro.
fn opposite_heading(headings: &[(f64, f64)], courses: &[(f64, f64)]) -> Contradiction {
    // Counted from east, counter-clockwise: heading = 90° − course.
    let sums = pairs(headings, courses).map(|(heading, course)| heading + course);
    let are_from_east = direction(sums).is_some_and(|(mean, length)| {
        length > CONCENTRATED && wrap(mean - std::f64::consts::FRAC_PI_2).abs() < 0.5
    });
    Contradiction::OppositeHeadings { are_from_east }
}

/// Between ahead and aside, degrees: antennas are mounted along the body or across, and on slopes bodies drift by less.
const ASIDE_DEG: f64 = 45.0;

/// A body that does not drive where its headings point.
fn driven_direction(
    headings: &[(f64, f64)],
    courses: &[(f64, f64)],
    name: &str,
) -> Option<Contradiction> {
    let differences = pairs(headings, courses).map(|(heading, course)| heading - course);
    let (off_rad, length) = direction(differences)?;
    let is_off = length > CONCENTRATED && off_rad.to_degrees().abs() > ASIDE_DEG;
    is_off.then(|| Contradiction::DrivenDirection {
        position: name.to_owned(),
        off_rad,
    })
}

/// Headings and courses at nearly the same times.
fn pairs(
    headings: &[(f64, f64)],
    courses: &[(f64, f64)],
) -> impl Iterator<Item = (f64, f64)> + Clone {
    const NEAR_S: f64 = 0.5;
    courses.iter().filter_map(move |&(time_s, course)| {
        let next = headings.partition_point(|h| h.0 < time_s);
        let near = headings.get(next)?;
        ((near.0 - time_s).abs() < NEAR_S).then_some((near.1, course))
    })
}

/// Mean direction of angles and the length of their mean vector; `None` with fewer than ten.
fn direction(angles: impl Iterator<Item = f64> + Clone) -> Option<(f64, f64)> {
    let count = angles.clone().count();
    let (sin, cos) = angles.fold((0.0, 0.0), |(sin, cos), a| (sin + a.sin(), cos + a.cos()));
    (count >= 10).then(|| (sin.atan2(cos), sin.hypot(cos) / count as f64))
}

/// Checks that positions are in metres.
///
/// # Errors
/// Positions that jump about as only millimetres can.
fn check_position_unit(fixes: &[PositionFix], name: &str, sigma_m: f64) -> Result<()> {
    let pairs = fixes
        .windows(2)
        .filter(|pair| pair[1].time_s > pair[0].time_s);
    let speed = median(pairs.map(|pair| {
        (pair[1].position_m - pair[0].position_m).norm() / (pair[1].time_s - pair[0].time_s)
    }));
    // Second differences: the noise, whatever the speed.
    let noise_m =
        median(fixes.windows(3).map(|w| {
            (w[0].position_m - w[1].position_m * 2.0 + w[2].position_m).norm() / 6f64.sqrt()
        }));
    match (speed, noise_m) {
        (Some(speed), Some(noise_m)) if speed > FASTEST_M_S && noise_m > NOISE_FACTOR * sigma_m => {
            Err(Error::data(
                format!(
                    "`{name}` moves at {speed:.0} m/s with a noise of {noise_m:.1} m: its log is in \
                     millimetres"
                ),
                "name the columns east_mm, north_mm, up_mm, then they are converted",
            ))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::STANDARD_GRAVITY_M_S2;

    #[test]
    fn forces_in_g_are_refused_and_others_give_the_vertical() {
        let samples = |force: Vec3| {
            (0..100)
                .map(|i| ImuSample {
                    time_s: 0.01 * f64::from(i),
                    gyro_rad_s: Vec3::zeros(),
                    accel_m_s2: force,
                })
                .collect::<Vec<_>>()
        };
        let up = check_forces(&samples(Vec3::new(0.0, 0.0, -STANDARD_GRAVITY_M_S2))).unwrap();
        assert_eq!(up, -Vec3::z());
        for (force, unit) in [(-1.0, "accel_x_g"), (1000.0, "accel_x_mg")] {
            let error = check_forces(&samples(Vec3::new(0.0, 0.0, force))).unwrap_err();
            let text = format!("{error}");
            assert!(text.contains("the log is in"), "{text}");
            assert!(format!("{error:?}").contains(unit), "{error:?}");
        }
    }
}
