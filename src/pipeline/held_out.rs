//! Which of two results predicts scans better that neither has seen: a doubtful joint adjustment, or two steps.

use super::joint_input::{Drive, surfel_m};
use super::placed::{on_adjusted_poses, on_given_poses};
use super::rig::PASS_CELL_VOXELS;
use super::stages;
use crate::calibration::{Calibration, CalibrationSettings, ScannerSample};
use crate::comparison::{PassCells, TimedPoint};
use crate::error::{Result, unless_cancelled};
use crate::geometry::Vec3;
use crate::joint::{HeldOut, Joint, JointInput, adjust, misfit};
use crate::progress::Progress;

/// Blocks of the drive, of which every second is held out, seconds.
const BLOCK_S: f64 = 10.0;

/// Repeats both calibrations, in two steps and the doubtful joint one, with every second block of the drive's scans, and
/// places the others with each: how far passes, or passes and the reference, then lie apart. `None` if the rest of the
/// scans is too little for one of them, or no ground was seen twice.
///
/// # Errors
/// [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn compare(
    drive: &Drive<'_>,
    two_steps: &Calibration,
    doubtful: &Joint,
    input: JointInput<'_>,
    progress: &dyn Progress,
) -> Result<Option<HeldOut>> {
    progress.say("comparing both results on scans that neither has seen");
    let begin_s = drive.poses.trajectory().span_s().0;
    let is_held_out = |time_s: f64| ((time_s - begin_s) / BLOCK_S) as i64 % 2 == 1;
    let [seen, held_out] = [false, true].map(|held_out| {
        let samples = drive.samples.iter();
        let part = |sample: &ScannerSample| sample.within(|time_s| is_held_out(time_s) == held_out);
        samples.map(part).collect::<Vec<_>>()
    });
    let finest_m = drive.rig.finest_m();
    let settings = CalibrationSettings {
        voxel_sizes_m: vec![finest_m],
        ..drive.rig.settings(drive.project)
    };
    let (begin, poses, reference) = (&two_steps.mountings, drive.poses, input.reference);
    let by_two_steps = stages::calibration(
        drive.project,
        begin,
        &settings,
        poses,
        &seen,
        reference,
        progress,
    );
    let Some(by_two_steps) = unless_cancelled(by_two_steps)? else {
        return Ok(None);
    };
    let mut input = input;
    input.drives[0].scans.samples = seen.iter().collect();
    let joint = adjust(&input, &drive.project.joint, surfel_m(drive), progress);
    let Some(joint) = unless_cancelled(joint)? else {
        return Ok(None);
    };
    let scanners = drive.samples.len();
    let [by_two_steps, by_joint] = [
        on_given_poses(&held_out, &by_two_steps.poses()),
        on_adjusted_poses(&held_out, &joint),
    ]
    .map(|mut points| {
        points.extend(before_all_passes(reference, scanners, begin_s));
        points
    });
    let cells = PassCells::new(&by_two_steps, PASS_CELL_VOXELS * finest_m);
    let distances = [&by_two_steps, &by_joint].map(|points| cells.distances(points));
    let [Some(of_two_steps), Some(of_joint)] = distances else {
        return Ok(None);
    };
    Ok(Some(HeldOut {
        two_steps_m: of_two_steps.rms_m,
        joint_m: of_joint.rms_m,
        joint_is_better: of_two_steps.is_worse_than(&of_joint) == Some(true),
        misfit: misfit(doubtful),
    }))
}

/// The reference as a pass of each scanner before the drive: the longest time between two points of a cell then
/// separates it from all passes.
fn before_all_passes(
    reference: &[Vec3],
    scanners: usize,
    begin_s: f64,
) -> impl Iterator<Item = TimedPoint> {
    /// Longer than any drive.
    const BEFORE_S: f64 = 1e9;
    (0..scanners).flat_map(move |scanner| {
        reference.iter().map(move |point| TimedPoint {
            scanner,
            time_s: begin_s - BEFORE_S,
            position_m: Some(*point),
        })
    })
}
