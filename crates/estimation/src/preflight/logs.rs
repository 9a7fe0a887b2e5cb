//! What the logs of the motion say about units, axes and signs.

use super::TIME_SCALES_S;
use super::differences::{self, VALUES};
use super::turns::{Turned, courses};
use crate::error::{Error, Result};
use crate::geometry::heading::wrap;
use crate::geometry::{BodyAxes, Vec3};
use crate::sensor::{HeadingFix, ImuSample, PositionFix};
use crate::statistics::{SIGMAS_PER_MAD, median};
use crate::trajectory::{MotionLogs, PositionSettings, TrajectorySettings};
use crate::verdict::Verdict;

/// A median specific force within this share of a unit's gravity is in that unit.
const GRAVITY_SHARE: f64 = 0.15;
/// The cosine between the mean specific force and the body's upward axis is at least this, or the axes are
/// not those of the project.
const LEAST_COSINE: f64 = 0.7;
/// The mean vector of the directions of an angle is at least this long where the angle stays the same.
const CONCENTRATED: f64 = 0.8;
/// Headings in radians taken for degrees turn by π/180 of what the gyro measures; no scale of a sensor is a tenth.
const IN_RADIANS_SLOPE: f64 = 0.1;
/// Nothing on the ground moves faster, m/s.
const FASTEST_M_S: f64 = 60.0;
/// Noise of positions beyond this many times their standard deviation means a wrong unit.
const NOISE_FACTOR: f64 = 100.0;

/// Code of the verdict on headings that turn the wrong way and cannot be used.
pub const HEADING_SIGN: &str = "heading.sign";

/// Verdicts on settings that the logs contradict.
///
/// # Errors
/// Specific forces in g, angular rates in degrees, headings in radians, positions in millimetres.
pub fn logs(logs: &MotionLogs<'_>, settings: &TrajectorySettings) -> Result<Vec<Verdict>> {
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
    all.extend(axes(&up, settings));
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
                all.push(Verdict::fault(
                    format!("{name}.axes"),
                    format!(
                        "The course of `{name}` turns to the left where the gyro turns to the right: its \
                         coordinates are left-handed. Are east and north exchanged, or one of them \
                         negated?"
                    ),
                ));
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

/// A log of the motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Log {
    /// Rates and specific forces.
    Imu,
    /// One of the position logs.
    Position(usize),
    /// Headings.
    Heading,
}

/// A log whose clock is seconds off.
#[derive(Debug, Clone, PartialEq)]
pub struct LateLog {
    /// The log.
    pub log: Log,
    /// By how much its stamps are late, seconds.
    pub late_s: f64,
    /// The verdict on it.
    pub verdict: Verdict,
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
        return vec![LateLog::new(Log::Imu, "imu", -first_s)];
    }
    let late = late.into_iter();
    late.map(|(log, name, late_s)| LateLog::new(log, name, late_s))
        .collect()
}

/// Latencies that differ by less are the same, seconds.
const SAME_LATENCY_S: f64 = 0.5;

impl LateLog {
    fn new(log: Log, name: &str, late_s: f64) -> Self {
        let near = |(seconds, _): &&(f64, &str)| (late_s.abs() - seconds).abs() < SAME_LATENCY_S;
        let scales = TIME_SCALES_S.iter().find(near);
        let why = scales.map_or(String::new(), |(seconds, scales)| {
            format!(" ({scales} differ by {seconds} s)")
        });
        let text = format!(
            "Judging by its turns, `{name}` is {:.1} s {} than the other logs{why}: a run corrects it. Add {:+.1} to \
             [{name}] time_offset_s.",
            late_s.abs(),
            if late_s > 0.0 { "later" } else { "earlier" },
            -late_s
        );
        let verdict = Verdict::care(format!("{name}.time_offset"), text);
        Self {
            log,
            late_s,
            verdict: verdict.with_value(-late_s, None),
        }
    }
}

/// A standard deviation is stated wrongly if neighbouring fixes scatter by more than this factor times it.
pub const STATED_FACTOR: f64 = 4.0;

/// Fixes over a longer time are not neighbours: their motion would count as noise, seconds.
const NEIGHBOURS_S: f64 = 1.2;

/// The factors on the standard deviations of a position log, east, north, up, that the noise of neighbouring
/// fixes without a covariance asks for, where one of them is much larger than stated. The noise is that of fourth
/// differences, which remove a smooth motion.
pub fn position_noise(
    fixes: &[PositionFix],
    position: &PositionSettings,
) -> Option<(Vec3, Verdict)> {
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
    let name = &position.name;
    let [east, north, up] = factors.component_mul(&position.sigma_m).into();
    let text = format!(
        "Neighbouring fixes of `{name}` scatter up to {:.0} times as much as its standard deviations say: a \
         run raises them. Write sigma_m = [{east:.4}, {north:.4}, {up:.4}].",
        factors.max()
    );
    let verdict = Verdict::care(format!("{name}.noise"), text);
    Some((factors, verdict.with_value(factors.max(), None)))
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

/// The verdict on axes of the body whose upward axis the specific force contradicts.
fn axes(up: &Vec3, settings: &TrajectorySettings) -> Option<Verdict> {
    let cosine = up.dot(&settings.axes.up());
    if cosine > LEAST_COSINE {
        return None;
    }
    let (given, other, points) = match settings.axes {
        BodyAxes::Frd => ("FRD", "FLU", "up"),
        BodyAxes::Flu => ("FLU", "FRD", "down"),
    };
    let is_opposite = cosine < -LEAST_COSINE;
    let text = if is_opposite {
        format!(
            "According to gravity, the z axis of the IMU points {points}, but frame.body is \"{given}\": write \
             body = \"{other}\"."
        )
    } else {
        let axis = up.iamax();
        format!(
            "According to gravity, the {} axis of the IMU is vertical, but with frame.body = \"{given}\" it is z: \
             are the columns of the IMU exchanged, or is it mounted on its side? Rotate its log into body \
             axes.",
            ["x", "y", "z"][axis]
        )
    };
    // Only the start values of the trajectory depend on the project's axes.
    let verdict = if is_opposite {
        Verdict::care("frame.body", text)
    } else {
        Verdict::fault("frame.body", text)
    };
    Some(verdict.with_value(cosine, None))
}

/// Whether the headings, read as degrees, all lie within 2π and vary.
fn is_in_radians(headings: &[HeadingFix]) -> bool {
    let degrees = || headings.iter().map(|fix| fix.heading_rad.to_degrees());
    let most = degrees().fold(f64::NEG_INFINITY, f64::max);
    let least = degrees().fold(f64::INFINITY, f64::min);
    let turn = std::f64::consts::TAU;
    most - least > 0.5 && least > -0.51 * turn && most < 1.01 * turn && most - least < 1.01 * turn
}

/// The verdict on headings that turn against the gyro.
fn opposite_heading(headings: &[(f64, f64)], courses: &[(f64, f64)]) -> Verdict {
    // Counted from east, counter-clockwise: heading = 90° − course.
    let sums = pairs(headings, courses).map(|(heading, course)| heading + course);
    let from_east = direction(sums).is_some_and(|(mean, length)| {
        length > CONCENTRATED && wrap(mean - std::f64::consts::FRAC_PI_2).abs() < 0.5
    });
    let likely = if from_east {
        "they count counter-clockwise from east: write 90 − heading"
    } else {
        "they count counter-clockwise: negate them"
    };
    Verdict::care(
        HEADING_SIGN,
        format!(
            "The headings turn to the left where the gyro turns to the right: {likely}. A run leaves \
             them out."
        ),
    )
}

/// Between ahead and aside, degrees: antennas are mounted along the body or across, and on slopes bodies drift by less.
const ASIDE_DEG: f64 = 45.0;

/// The verdict on a body that does not drive where its headings point.
fn driven_direction(
    headings: &[(f64, f64)],
    courses: &[(f64, f64)],
    name: &str,
) -> Option<Verdict> {
    let differences = pairs(headings, courses).map(|(heading, course)| heading - course);
    let (mean, length) = direction(differences)?;
    let off_deg = mean.to_degrees();
    (length > CONCENTRATED && off_deg.abs() > ASIDE_DEG).then(|| {
        let text = format!(
            "According to its headings, the body drives {off_deg:.0}° off the direction in which it points \
             (course of `{name}`): are the antennas exchanged or across, or does it drive backwards?"
        );
        let text = text.replace('-', "−");
        Verdict::care("heading.direction", text).with_value(mean, None)
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
