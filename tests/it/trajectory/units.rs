//! Times in units other than seconds, and logs whose stamps would fill the memory: refused with a
//! message, before any work that grows with the time they span.

use super::Logs;
use super::rover::rover_drive;
use boresight::geometry::{BodyFromScanner, Vec3, WorldFromBody};
use boresight::georeference::Georeferencer;
use boresight::sensor::{PoseRecord, ScanPoint};
use boresight::trajectory::{Online, OnlineOptions, Trajectory};

const UNITS: [(f64, &str); 3] = [
    (1e3, "milliseconds?"),
    (1e6, "microseconds?"),
    (1e9, "nanoseconds?"),
];

fn assert_refused(logs: &Logs, words: &[&str]) {
    let message = logs.try_estimate().expect_err("refused").to_string();
    for word in words {
        assert!(message.contains(word), "no '{word}' in: {message}");
    }
}

#[test]
fn the_unit_of_every_log_is_named() {
    for (factor, unit) in UNITS {
        let scaled = |imu: bool, prism: bool, heading: bool| {
            let mut logs = rover_drive(1).0;
            let by = |chosen: bool| if chosen { factor } else { 1.0 };
            logs.imu.iter_mut().for_each(|s| s.time_s *= by(imu));
            logs.prism.iter_mut().for_each(|f| f.time_s *= by(prism));
            logs.heading
                .iter_mut()
                .for_each(|h| h.time_s *= by(heading));
            logs
        };
        assert_refused(&scaled(true, true, true), &["between IMU samples", unit]);
        assert_refused(&scaled(true, false, false), &["between IMU samples", unit]);
        assert_refused(&scaled(false, true, false), &["prism log", unit]);
        assert_refused(&scaled(false, false, true), &["heading log", unit]);
    }
    let mut logs = rover_drive(1).0;
    logs.imu.iter_mut().for_each(|s| s.time_s *= 1e3);
    assert_refused(
        &logs,
        &["time steps of 20 s between IMU samples: are these milliseconds?"],
    );
    // Counted from 1970, the streams do not even overlap.
    let mut logs = rover_drive(1).0;
    logs.imu.iter_mut().for_each(|s| s.time_s += 1.7e9);
    for fix in &mut logs.prism {
        fix.time_s = 1e3 * (1.7e9 + fix.time_s);
    }
    assert_refused(
        &logs,
        &["do not overlap", "the times of prism log milliseconds"],
    );
}

#[test]
fn the_online_smoother_names_the_unit_after_a_few_samples() {
    for (factor, unit) in UNITS {
        let logs = rover_drive(1).0;
        let mut online = Online::new(&logs.settings, OnlineOptions::default()).unwrap();
        let refused = logs.imu.iter().take(100).find_map(|sample| {
            let mut sample = *sample;
            sample.time_s *= factor;
            online.imu(sample).err()
        });
        let message = refused.expect("refused").to_string();
        assert!(message.contains(unit), "{message}");
    }
}

#[test]
fn stamps_in_bursts_are_refused_before_their_gaps_are_filled() {
    let mut logs = rover_drive(1).0;
    let doubled = logs.imu.iter().flat_map(|sample| {
        let mut twin = *sample;
        twin.time_s += 2e-5;
        let mut third = *sample;
        third.time_s += 4e-5;
        [*sample, twin, third]
    });
    logs.imu = doubled.collect();
    assert_refused(
        &logs,
        &["samples or more to bridge", "holds 9000", "bursts"],
    );
}

#[test]
fn headings_that_all_contradict_each_other_are_refused() {
    let mut logs = rover_drive(1).0;
    for (index, heading) in logs.heading.iter_mut().enumerate() {
        heading.heading_rad = (index as f64 * 120.0).to_radians();
    }
    let count = logs.heading.len();
    assert_refused(
        &logs,
        &[&format!("none of the {count} headings"), "degrees"],
    );
}

/// Places points with pose and point times multiplied by these factors.
fn place(pose_factor: f64, point_factor: f64) -> boresight::Result<()> {
    let pose = |k: i32| PoseRecord {
        time_s: pose_factor * 0.01 * f64::from(k),
        world_from_body: WorldFromBody::identity(),
        velocity_m_s: None,
        bias: None,
        sigma: None,
    };
    let trajectory = Trajectory::new((0..=6000).map(pose).collect())?;
    let mut place = Georeferencer::new(&trajectory, BodyFromScanner::identity(), 0.0);
    for k in 0..3000 {
        place.place(&ScanPoint {
            time_s: point_factor * 0.02 * f64::from(k),
            position_m: Vec3::x(),
            intensity: 0.0,
        });
    }
    place.check("left")
}

#[test]
fn poses_and_profiles_in_different_units_are_refused() {
    assert!(place(1.0, 1.0).is_ok());
    for (factor, unit) in UNITS {
        let message = place(factor, 1.0).unwrap_err().to_string();
        assert!(
            message.contains(unit) && message.contains("between poses"),
            "{message}"
        );
        let message = place(1.0, factor).unwrap_err().to_string();
        assert!(
            message.contains(unit) && message.contains("scanner `left`"),
            "{message}"
        );
    }
}
