//! The same days evaluated by two other methods: two steps with the first scanner fixed, and the joint adjustment
//! with the first scanner known.

use std::time::Instant;

use boresight::Result;
use boresight::calibration::Calibration;
use boresight::nalgebra::{DMatrix, DVector};
use boresight::pipeline::joint::{Drive, with_known_mountings};
use boresight::pipeline::{OpenProject, stages};
use boresight::progress::Silent;

use super::field_days::{FieldDay, offset, right_in_left};

/// Standard deviations of the mountings of the first scanner and of the other scanner: metres, radians.
const FIRST: f64 = 1e-6;
const OTHER: f64 = 0.02;

pub fn compare(field: &FieldDay, day: u64) -> Result<()> {
    let (project, mut rig) = (&OpenProject::new(&field.project), field.rig.clone());
    let in_use = right_in_left(&rig.poses());
    rig.mountings[0].fixed = [true; 6];
    let poses = stages::poses(project, &Silent)?;
    let samples = stages::samples(project, &rig, poses.trajectory(), &Silent)?;
    let show = |name: &str, seconds: f64, found: &Calibration| {
        let at = offset(&in_use, &right_in_left(&found.poses()));
        let covariance = found.relative_covariance(1).unwrap_or_default();
        let text = (0..6).map(|i| {
            let unit = super::unit(i);
            let sigma = covariance[(i, i)].sqrt() * unit;
            format!("{:+.3} ({sigma:.3})", (at[i] - field.truth[i]) * unit)
        });
        let text: Vec<String> = text.collect();
        println!("day {day} {name}: {} {seconds:.1} s", text.join(" "));
    };
    let begun = Instant::now();
    let mut found = stages::calibration(
        project,
        &rig.mountings,
        &project.calibration,
        &poses,
        &samples,
        &[],
        &Silent,
    )?;
    show("two steps", begun.elapsed().as_secs_f64(), &found);
    let drive = Drive {
        name: "day",
        project,
        rig: &rig,
        poses: &poses,
        samples: &samples,
    };
    let sigma = |i: usize, _| if i < 6 { FIRST } else { OTHER };
    let known = DMatrix::from_diagonal(&DVector::from_fn(12, sigma).map(|s| s * s));
    let begun = Instant::now();
    match with_known_mountings(&drive, &known, &Silent) {
        Ok(joint) => {
            found.mountings = joint.mountings;
            found.covariance = Some(joint.covariance);
            show("joint", begun.elapsed().as_secs_f64(), &found);
        }
        Err(error) => println!("day {day} joint: {error}"),
    }
    Ok(())
}
