//! Headings of the body before any adjustment: measured, or the direction of travel.

use super::neighbours::{ALIKE_SIGMAS, distances_from_neighbours};
use super::prism_motion::Motion;
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;
use crate::geometry::heading::wrap;
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::streams::Streams;

/// A heading, turned by the gyro, must agree with this many neighbours on either side: more than a run
/// of wrong headings has.
const HEADING_REACH: usize = 60;
/// Largest drift of the gyro in that time, radians.
const GYRO_DRIFT_RAD: f64 = 0.35;
/// Slower motion gives no direction of travel, m/s.
const MIN_SPEED_M_S: f64 = 0.05;
/// Without headings the prism must have moved this many standard deviations.
const MIN_MOVE_SIGMAS: f64 = 50.0;

/// A heading of the body that the attitude is pulled towards.
#[derive(Debug, Clone, Copy)]
pub struct HeadingPrior {
    pub time_s: f64,
    pub heading_rad: f64,
}

/// Headings of the body: those measured or, where there are none, the direction of travel. Also whether
/// they are the direction of travel.
pub fn heading_priors(
    streams: &Streams,
    motion: &[Motion],
    settings: &TrajectorySettings,
    gyro_bias: &Vec3,
) -> Result<(Vec<HeadingPrior>, bool)> {
    if !streams.heading.is_empty() {
        let priors = consistent_headings(streams, settings, gyro_bias);
        if priors.is_empty() {
            return Err(Error::data(
                format!(
                    "none of the {} headings within the IMU's span agrees with the gyro and \
                     the neighbouring headings",
                    streams.heading.len()
                ),
                "check the unit of the headings (degrees, clockwise from north), the axes of the \
                 IMU and the clocks, or leave the heading log out",
            ));
        }
        return Ok((priors, false));
    }
    let start = motion[0].position_m;
    let moved = motion
        .iter()
        .map(|m| (m.position_m - start).norm())
        .fold(0.0, f64::max);
    let needed = MIN_MOVE_SIGMAS * settings.positions[0].sigma_m.max();
    let priors: Vec<HeadingPrior> = motion
        .iter()
        .filter(|m| m.velocity_m_s.xy().norm() > MIN_SPEED_M_S)
        .map(|m| HeadingPrior {
            time_s: m.time_s,
            heading_rad: m.velocity_m_s.x.atan2(m.velocity_m_s.y),
        })
        .collect();
    if moved < needed || priors.is_empty() {
        return Err(Error::of(
            Problem::NotDetermined,
            format!(
                "there are no headings within the IMU's span, and the prism moves by only \
                 {moved:.3} m: the heading of the body is not determined"
            ),
            format!("add a heading log, or a drive of more than {needed:.2} m"),
        ));
    }
    Ok((priors, true))
}

/// The measured headings without those that contradict the gyro and the neighbouring headings, such as
/// those of a reversed baseline.
fn consistent_headings(
    streams: &Streams,
    settings: &TrajectorySettings,
    gyro_bias: &Vec3,
) -> Vec<HeadingPrior> {
    let antennas = &settings.heading;
    let up = settings.axes.up();
    // The heading turns clockwise, rates about the body's upward axis count counter-clockwise.
    let mut turned = 0.0;
    let mut sample = 0;
    let all: Vec<(HeadingPrior, Vec3)> = streams
        .heading
        .iter()
        .map(|fix| {
            let time_s = fix.value.time_s;
            while sample + 1 < streams.imu.len() && streams.imu[sample + 1].time_s <= time_s {
                let dt = streams.imu[sample + 1].time_s - streams.imu[sample].time_s;
                turned -= (streams.imu[sample].gyro_rad_s - gyro_bias).dot(&up) * dt;
                sample += 1;
            }
            let heading_rad = wrap(
                fix.value.heading_rad + antennas.mounting_offset_rad
                    - antennas.grid_convergence_rad,
            );
            let (sin, cos) = (heading_rad - turned).sin_cos();
            let prior = HeadingPrior {
                time_s,
                heading_rad,
            };
            (prior, Vec3::new(cos, sin, 0.0))
        })
        .collect();
    let directions: Vec<Vec3> = all.iter().map(|(_, direction)| *direction).collect();
    let limit = GYRO_DRIFT_RAD + ALIKE_SIGMAS * antennas.sigma_rad;
    let consistent = all
        .iter()
        .zip(distances_from_neighbours(&directions, HEADING_REACH))
        .filter(|(_, distance)| *distance <= limit);
    consistent.map(|((prior, _), _)| *prior).collect()
}
