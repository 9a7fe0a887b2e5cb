//! Streams that never overlap and logs that contradict themselves are errors; the smoother does not
//! wait for more of them.

use super::{Online, OnlineOptions};
use crate::error::Result;
use crate::geometry::heading::heading_rad;
use crate::geometry::so3::exp;
use crate::geometry::{BodyAxes, Vec3};
use crate::sensor::{HeadingFix, ImuSample, PositionFix};
use crate::trajectory::settings::{
    HeadingSettings, ImuNoise, PositionSettings, TrajectorySettings,
};

const GRAVITY_M_S2: f64 = 9.81;
const RATE_RAD_S: f64 = 0.4;
const RADIUS_M: f64 = 2.0;

fn online() -> Online {
    let noise = ImuNoise {
        gyro_density: 1e-3,
        accel_density: 1e-2,
        gyro_bias_walk: 1e-5,
        accel_bias_walk: 1e-4,
    };
    let mut settings = TrajectorySettings::new(
        BodyAxes::Flu,
        noise,
        PositionSettings::prism(0.005, Vec3::zeros()),
        HeadingSettings::aligned(0.01),
    );
    settings.gravity_m_s2 = GRAVITY_M_S2;
    Online::new(&settings, OnlineOptions::default()).unwrap()
}

/// What the IMU, a prism and a compass measure of a drive in a circle.
fn sample(time_s: f64) -> ImuSample {
    ImuSample {
        time_s,
        gyro_rad_s: Vec3::z() * RATE_RAD_S,
        accel_m_s2: Vec3::new(0.0, RADIUS_M * RATE_RAD_S * RATE_RAD_S, GRAVITY_M_S2),
    }
}

fn fix(time_s: f64) -> PositionFix {
    let turned = exp(&(Vec3::z() * RATE_RAD_S * time_s));
    PositionFix::with_sigma(time_s, turned * (Vec3::y() * -RADIUS_M), None)
}

fn heading(time_s: f64) -> HeadingFix {
    let turned = exp(&(Vec3::z() * RATE_RAD_S * time_s));
    HeadingFix::new(time_s, heading_rad(&turned), None)
}

/// Passes in the records of a stretch of time, seconds, with prism and compass ahead of the IMU by these
/// times.
fn drive(
    online: &mut Online,
    from_s: f64,
    to_s: f64,
    [prism_s, compass_s]: [f64; 2],
) -> Result<()> {
    for k in (50.0 * from_s) as i32..(50.0 * to_s) as i32 {
        let now_s = 0.02 * f64::from(k);
        online.imu(sample(now_s))?;
        if k % 5 == 0 {
            let mut fix = fix(now_s);
            fix.time_s += prism_s;
            online.position(0, fix)?;
        }
        if k % 10 == 0 {
            let mut heading = heading(now_s);
            heading.time_s += compass_s;
            online.heading(heading)?;
        }
    }
    Ok(())
}

#[test]
fn streams_that_never_overlap_are_an_error() {
    for ahead_s in [3600.0, -3600.0] {
        for (name, ahead) in [
            ("prism log", [ahead_s, 0.0]),
            ("heading log", [0.0, ahead_s]),
        ] {
            let error = drive(&mut online(), 0.0, 10.0, ahead).expect_err(name);
            let error = error.to_string();
            assert!(
                error.contains(name) && error.contains("do not overlap"),
                "{error}"
            );
        }
    }
}

#[test]
fn a_prism_that_is_seen_long_before_the_imu_is_no_error() {
    let mut online = online();
    for k in 0..50 {
        online
            .position(0, fix(-400.0 + 0.1 * f64::from(k)))
            .unwrap();
    }
    drive(&mut online, 0.0, 5.0, [0.0; 2]).unwrap();
    assert!(online.is_running());
}

#[test]
fn an_imu_whose_clock_goes_back_is_an_error() {
    for before_s in [1.0, 5.0] {
        let mut online = online();
        drive(&mut online, 4000.0, 4000.0 + before_s, [0.0; 2]).unwrap();
        let error = drive(&mut online, 10.0, 12.0, [0.0; 2]).unwrap_err();
        assert!(error.to_string().contains("IMU log go back by"), "{error}");
    }
}

#[test]
fn stamps_in_bursts_are_an_error_before_the_start() {
    let mut online = online();
    let mut give = || -> Result<()> {
        for k in 0..3000 {
            let time_s = 0.02 * f64::from(k);
            for part in 0..3 {
                online.imu(sample(time_s + 2e-5 * f64::from(part)))?;
            }
        }
        Ok(())
    };
    let error = give().expect_err("bursts").to_string();
    assert!(error.contains("bursts"), "{error}");
}

#[test]
fn the_smoother_tells_why_it_has_not_started() {
    let mut online = online();
    assert_eq!(online.waits_for(), None);
    for k in 0..150 {
        online.imu(sample(0.02 * f64::from(k))).unwrap();
    }
    let why = online.waits_for().unwrap_or_default();
    assert!(why.contains("only 0 prism fixes"), "{why}");
    drive(&mut online, 3.0, 10.0, [0.0; 2]).unwrap();
    assert!(online.is_running() && online.waits_for().is_none());
}
