//! Calibration on real data: a parked truck in two opposite passes of a UAV (coin-or/Gravity,
//! LA-UR-20-28196), an unknown rotation between sensor and scanner, no reference.

use crate::common::demo_drive::calibrate;
use crate::common::truck::{KNOWN_DEG, project, project_with, truck};
use boresight::calibration::Calibration;
use boresight::cloud::NeighbourIndex;
use boresight::geometry::{BodyFromScanner, Vec3, so3};
use boresight::joint::{CorrectedPoses, JointDrive, JointInput, JointSettings, Scans, adjust};
use boresight::judgement::first_placement;
use boresight::pipeline::clouds::Mounted;
use boresight::pipeline::start::start;
use boresight::pipeline::{Extras, OpenProject, Options, Rig, analyse, clouds, stages};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::trajectory::Trajectory;

/// The known rotation is given to two decimals, and different starts end up to 0.02° apart.
const NEAR_DEG: f64 = 0.03;

fn calibrated(project: &Project) -> Calibration {
    let project = &OpenProject::new(project);
    let poses = stages::poses(project, &Silent).unwrap();
    calibrate(project, &project.calibration, &poses, &[]).unwrap()
}

fn rotation_deg(mounting: &BodyFromScanner) -> Vec3 {
    so3::log(&mounting.rotation).map(f64::to_degrees)
}

/// Largest difference to the known rotation on any axis, degrees.
fn error_deg(mounting: &BodyFromScanner) -> f64 {
    (rotation_deg(mounting) - Vec3::from(KNOWN_DEG)).amax()
}

/// Median distance in metres from a point of the second pass, which has 6,401 points, to the nearest
/// of the first, which has 20,013. In this direction the known rotation reduces it from 0.554 m to
/// 0.0455 m; in the other, the point spacing of the sparse pass, 0.066 m, would hide the effect.
fn gap_m(project: &Project, mounting: &BodyFromScanner) -> f64 {
    let project = &OpenProject::new(project);
    let poses = stages::poses(project, &Silent).unwrap();
    gap_with_m(project, poses.trajectory(), mounting)
}

/// The same with poses other than those of the file.
fn gap_with_m(project: &OpenProject, trajectory: &Trajectory, mounting: &BodyFromScanner) -> f64 {
    let rig = Rig::new(project).with_poses(&[*mounting]);
    let mounted = Mounted::rigid(&rig);
    let streamed = clouds::stream(project, trajectory, mounted, None, &Silent).unwrap();
    let placed = clouds::place(trajectory, mounted, &streamed);
    // The passes are 41 s apart.
    let middle_s = 0.5 * (trajectory.span_s().0 + trajectory.span_s().1);
    let split = streamed[0]
        .points
        .partition_point(|(_, point)| point.time_s < middle_s);
    let (first, second) = placed[0].split_at(split);
    let index = NeighbourIndex::new(first);
    let mut nearest = Vec::new();
    let mut gaps: Vec<f64> = second
        .iter()
        .map(|point| {
            index.nearest(point, 1, &mut nearest);
            (first[nearest[0] as usize] - point).norm()
        })
        .collect();
    gaps.sort_by(f64::total_cmp);
    gaps[gaps.len() / 2]
}

#[test]
fn a_start_at_zero_ends_at_the_known_rotation_and_the_passes_coincide() {
    let folder = tempfile::tempdir().unwrap();
    let project = project(Vec3::zeros(), folder.path());
    let calibration = calibrated(&project);
    let pose = calibration.mountings[0].body_from_scanner;
    let (before, after) = (
        gap_m(&project, &BodyFromScanner::identity()),
        gap_m(&project, &pose),
    );
    println!(
        "rotation vector {:?}°, gap {before:.3} m → {after:.3} m, sigmas {:?} rad",
        rotation_deg(&pose).as_slice(),
        calibration.sigmas(0, calibration.mountings[0].convention)
    );
    assert!(calibration.converged);
    assert!(error_deg(&pose) < NEAR_DEG, "{}", rotation_deg(&pose));
    assert_eq!(pose.translation_m, Vec3::zeros(), "the lever arm is held");
    assert!(before > 0.3 && after <= 0.05, "gap {before} m → {after} m");
}

/// Poses with errors of up to 2 cm and 0.05° over some seconds, corrected together with the rotation.
#[test]
#[ignore = "just acceptance"]
fn adjusting_the_poses_as_well_does_not_widen_the_gap_between_the_passes() {
    let folder = tempfile::tempdir().unwrap();
    let prior = "sigma_position_m = 0.02\nsigma_rotation_deg = 0.05";
    let project = project_with(prior, Vec3::zeros(), folder.path());
    let two_steps = calibrated(&project);
    let project = OpenProject::new(&project);
    let poses = stages::poses(&project, &Silent).unwrap();
    let rig = Rig::new(&project);
    let samples = stages::samples(&project, &rig, poses.trajectory(), &Silent).unwrap();
    let settings = JointSettings::default();
    let input = JointInput {
        mountings: two_steps.mountings.clone(),
        initial: &rig.mountings,
        held: &[],
        known: None,
        compliance: &[],
        estimate_latency: vec![false],
        drives: vec![JointDrive {
            name: "truck".into(),
            motion: Box::new(
                CorrectedPoses::new(poses.trajectory(), settings.correlation_s).unwrap(),
            ),
            scans: Scans {
                samples: samples.iter().collect(),
            },
            frame: None,
        }],
        reference: &[],
    };
    let surfel_m = settings.surfel_size_m(0.05);
    let adjusted = adjust(&input, &settings, surfel_m, &Silent).unwrap();
    let [before, after] =
        [&two_steps.mountings[0], &adjusted.mountings[0]].map(|m| m.body_from_scanner);
    let turn_deg = so3::log(&(before.rotation.inverse() * after.rotation)).map(f64::to_degrees);
    let fixed_m = gap_m(&project, &before);
    let adjusted_m = gap_with_m(&project, &adjusted.drives[0].trajectory, &after);
    let sigma_deg = |i: usize| adjusted.covariance[(i, i)].sqrt().to_degrees();
    println!(
        "turned by {:?}°, sigmas {:?}°, gap {fixed_m:.4} m → {adjusted_m:.4} m; {} surfels, {} rows, \
         {} iterations, {:?}",
        turn_deg.as_slice(),
        [3, 4, 5].map(sigma_deg),
        adjusted.surfels,
        adjusted.rows,
        adjusted.iterations,
        adjusted.groups
    );
    assert_eq!(after.translation_m, Vec3::zeros(), "the lever arm is held");
    // The errors of the poses, whose size the scans show, leave the rotation open by this.
    let is_explained = |axis: usize| turn_deg[axis].abs() < 3.0 * sigma_deg(3 + axis);
    assert!((0..3).all(is_explained), "{turn_deg}");
    assert!(adjusted_m <= fixed_m, "gap {fixed_m} m → {adjusted_m} m");
}

/// Standard deviations of given poses are guesses: from a fifth to twice of what the scans show, the result is as good on
/// the given poses, and the adjustment stays within its own standard deviations of the known rotation.
fn assert_result_suits_poses(position_m: f64, angle_deg: f64) {
    let folder = tempfile::tempdir().unwrap();
    let stated = format!("sigma_position_m = {position_m}\nsigma_rotation_deg = {angle_deg}");
    let mut project = project_with(&stated, Vec3::zeros(), folder.path());
    project.origin_m = Some(Vec3::new(582_587.0, 4_107_994.0, 1_261.0));
    let options = Options {
        out: folder.path().join("out"),
        seed: None,
        fresh: true,
        kept: Vec::new(),
    };
    let found = analyse(&project, &options, &Extras::default(), &Silent).unwrap();
    let calibrations = &found.calibrations;
    let two_steps = calibrations.two_steps().unwrap();
    let gaps_m = [&calibrations.result, two_steps]
        .map(|calibration| gap_m(&project, &calibration.mountings[0].body_from_scanner));
    let joint = calibrations.joint_found().expect("an adjustment");
    let off_deg = rotation_deg(&joint.poses()[0]) - Vec3::from(KNOWN_DEG);
    let sigma_deg = [3, 4, 5].map(|i| joint.covariance[(i, i)].sqrt().to_degrees());
    let errors = joint.drives[0].pose_errors.expect("poses from a file");
    println!(
        "stated {position_m} m, {angle_deg}°: gaps {gaps_m:?} m, joint off by {:?}° ± {sigma_deg:?}°, {errors:?}",
        off_deg.as_slice(),
    );
    assert!(gaps_m[0] <= gaps_m[1]);
    assert!((0..3).all(|axis| off_deg[axis].abs() < 3.0 * sigma_deg[axis]));
}

#[test]
fn a_result_suits_poses_worse_than_they_are_stated_to_be() {
    assert_result_suits_poses(0.01, 0.01);
}

#[test]
#[ignore = "just acceptance"]
fn a_result_suits_poses_better_than_they_are_stated_to_be() {
    assert_result_suits_poses(0.1, 0.1);
}

/// With the fine scales alone, a start at zero ends in a local minimum of 1.71e-3. Coarse scales lead
/// past it, and not only by luck: every corner of a cube of ± 2° around zero, up to 4.5° from the
/// solution, ends at the solution too.
#[test]
#[ignore = "just acceptance"]
fn coarse_scales_lead_past_the_local_minimum_from_every_start() {
    for corner in 0..8 {
        let sign = |bit: i32| if corner >> bit & 1 == 0 { -2.0 } else { 2.0 };
        let start = Vec3::new(sign(0), sign(1), sign(2));
        let folder = tempfile::tempdir().unwrap();
        let calibration = calibrated(&project(start, folder.path()));
        let mounting = calibration.mountings[0].body_from_scanner;
        println!(
            "from {:?}: {:?}",
            start.as_slice(),
            rotation_deg(&mounting).as_slice()
        );
        assert!(
            error_deg(&mounting) < NEAR_DEG,
            "from {start}: {}",
            rotation_deg(&mounting)
        );
    }
}

#[test]
fn poses_stored_with_the_points_reproduce_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let project = OpenProject::new(&project(Vec3::zeros(), folder.path()));
    let poses = stages::poses(&project, &Silent).unwrap();
    let rig = Rig::new(&project).with_poses(&[BodyFromScanner::identity()]);
    let mounted = Mounted::rigid(&rig);
    let streamed = clouds::stream(&project, poses.trajectory(), mounted, None, &Silent).unwrap();
    let placed = clouds::place(poses.trajectory(), mounted, &streamed);
    let mut file: Vec<[i64; 3]> = boresight::format::read_cloud(&truck())
        .unwrap()
        .points
        .iter()
        .map(millimetres)
        .collect();
    let mut ours: Vec<[i64; 3]> = placed[0].iter().map(millimetres).collect();
    file.sort_unstable();
    ours.sort_unstable();
    assert_eq!(ours, file);
}

/// Rounded to the resolution of the file.
fn millimetres(point: &Vec3) -> [i64; 3] {
    [point.x, point.y, point.z].map(|x| (x * 1e3).round() as i64)
}

/// The calibration as the commands run it: coarser scales come first where the passes lie farther
/// apart than the project's scales reach.
fn calibrated_from_the_misfit(project: &Project) -> (Calibration, Vec<f64>) {
    let project = &OpenProject::new(project);
    let poses = stages::poses(project, &Silent).unwrap();
    let rig = Rig::new(project);
    let samples = stages::samples(project, &rig, poses.trajectory(), &Silent).unwrap();
    let start = start(project, &rig, poses.trajectory(), &samples, &[], &Silent);
    let verdicts = first_placement(&start.first);
    assert!(
        verdicts
            .iter()
            .all(|v| v.code == "mounting.start" || !v.severity.is_marked()),
        "{verdicts:?}"
    );
    let (start, settings) = (&start.rig.mountings, start.rig.settings(project));
    let calibration =
        stages::calibration(project, start, &settings, &poses, &samples, &[], &Silent).unwrap();
    (calibration, settings.voxel_sizes_m)
}

fn assert_ends_at_the_known_rotation(start: Vec3, sizes_m: &[f64]) {
    let folder = tempfile::tempdir().unwrap();
    let mut project = project(start, folder.path());
    project.calibration.voxel_sizes_m = sizes_m.to_vec();
    let (calibration, sizes_m) = calibrated_from_the_misfit(&project);
    let mounting = calibration.mountings[0].body_from_scanner;
    println!(
        "from {:?} with {sizes_m:?}: {:?}, off {}",
        start.as_slice(),
        rotation_deg(&mounting).as_slice(),
        error_deg(&mounting)
    );
    assert!(error_deg(&mounting) < NEAR_DEG);
}

const COARSE_TO_FINE_M: [f64; 6] = [2.0, 1.0, 0.5, 0.25, 0.1, 0.05];

#[test]
fn a_start_ten_degrees_off_or_too_fine_scales_end_at_the_known_rotation() {
    assert_ends_at_the_known_rotation(Vec3::new(0.0, -10.0, 0.0), &COARSE_TO_FINE_M);
    assert_ends_at_the_known_rotation(Vec3::zeros(), &[0.2, 0.1, 0.05]);
}

#[test]
#[ignore = "just acceptance"]
fn every_start_ten_degrees_off_ends_at_the_known_rotation() {
    for axis in 0..3 {
        for angle_deg in [-10.0, 10.0] {
            let mut start = Vec3::zeros();
            start[axis] = angle_deg;
            assert_ends_at_the_known_rotation(start, &COARSE_TO_FINE_M);
        }
    }
}
