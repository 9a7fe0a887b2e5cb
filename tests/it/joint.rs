//! The joint adjustment of simulated drives: some cases of `examples/joint`, with shorter drives.

use crate::common::joint_drive::{Run, Setup, bend};
use boresight::joint::{JointSettings, MountingMotion, Rung};
use boresight::nalgebra::DVector;
use boresight::simulation::Scenario;

#[test]
fn errors_match_their_sigmas_and_are_far_below_those_of_two_steps() {
    let mut scenario = Scenario::demo();
    // East, west and south-east over four boards.
    scenario.drives[0].passes.truncate(7);
    (scenario.profiles.rate_hz, scenario.profiles.width) = (20.0, 240);
    let mut setup = Setup::new(scenario);
    setup.project = Box::new(|project| project.calibration.voxel_sizes_m = vec![0.05, 0.02, 0.007]);
    let folder = tempfile::tempdir().unwrap();
    let run = Run::new(&setup, folder.path()).unwrap();
    let [two_steps, joint] = run.errors();
    let normalised = joint.component_div(&run.sigmas());
    let chi_square = run.chi_square().unwrap();
    let relative = run.relative_errors()[1].component_div(&run.relative_sigmas());
    println!("two steps {two_steps:.6}joint {joint:.6}normalised {normalised:.2}");
    println!("relative, normalised {relative:.2}chi-square {chi_square:.1}");
    println!(
        "poses {:.3} mm, points {:.3} mm, {} iterations, {:.1} and {:.1} s",
        run.one_piece.poses_m * 1e3,
        run.one_piece.points_m * 1e3,
        run.joint.iterations,
        run.two_steps.seconds,
        run.one_piece.seconds
    );
    assert!(run.refused.is_empty(), "{:?}", run.refused);
    assert!(normalised.amax() < 4.0 && relative.amax() < 4.0);
    // 12 parameters: 1 drive in 10,000 exceeds this.
    assert!(chi_square < 39.1, "{chi_square}");
    assert!(run.one_piece.poses_m < 0.0009 && run.one_piece.points_m < 0.0007);
    assert!(run.one_piece.points_m < 0.5 * run.two_steps.points_m);
    // Rotation about y is the tilt of the fan, which the poses of two steps determine worst. It is compared with the standard
    // deviations, which do not depend on how lucky the joint adjustment of one drive is.
    let about_y = |errors: &DVector<f64>| errors[4].hypot(errors[10]);
    assert!(about_y(&two_steps) > 3.0 * about_y(&run.sigmas()));
}

/// Smooth ground with a curvature of about 0.5 /m, and quiet scanners.
fn on_rolling_soil(mut scenario: Scenario) -> Scenario {
    scenario.soil.wavelengths_m = vec![2.5, 1.3, 0.8];
    scenario.soil.sigmas_m = vec![0.012, 0.008, 0.006];
    (scenario.profiles.rate_hz, scenario.profiles.width) = (20.0, 240);
    scenario.profiles.sigma_m = [6e-5; 2];
    scenario.reference.board_spacing_m = 0.004;
    scenario.reference.soil_spacing_m = 0.004;
    scenario
}

/// Runs a drive, prints its test of the IMU, and returns it with the ratio of the squares of the IMU's residuals to
/// their redundancy.
fn with_imu_ratio(setup: &Setup) -> (Run, f64) {
    let folder = tempfile::tempdir().unwrap();
    let run = Run::new(setup, folder.path()).unwrap();
    let imu = run.joint.groups.iter().find(|group| group.name == "imu");
    let imu = imu.unwrap();
    println!(
        "{:?}, points {:.3} mm, {imu:?}, {:.1} s",
        run.joint.rung,
        run.one_piece.points_m * 1e3,
        run.one_piece.seconds
    );
    assert!(run.refused.is_empty(), "{:?}", run.refused);
    let ratio = imu.ratio.unwrap();
    (run, ratio)
}

/// What planes leave of the ground must not look like a motion of the body.
#[test]
#[ignore = "just acceptance"]
fn a_rigid_drive_over_rolling_ground_stays_rigid() {
    let setup = Setup::new(on_rolling_soil(Scenario::demo()));
    let (run, ratio) = with_imu_ratio(&setup);
    assert_eq!(run.joint.rung, Rung::Rigid);
    assert!(ratio < 1.15 && run.one_piece.points_m < 0.0005);
}

#[test]
#[ignore = "just acceptance"]
fn a_frame_that_bends_over_rolling_ground_follows_its_load() {
    let mut scenario = on_rolling_soil(Scenario::demo());
    bend(&mut scenario, 0.25);
    let (run, ratio) = with_imu_ratio(&Setup::new(scenario));
    assert_eq!(run.joint.rung, Rung::Compliance);
    assert!(ratio < 1.15 && run.one_piece.points_m < 0.0007);
}

/// Neither boards nor a reference: only relief down to clods of 8 cm determines where the scanners sit along the drive.
#[test]
#[ignore = "just acceptance"]
fn a_rigid_drive_over_cloddy_soil_needs_no_boards_and_no_reference() {
    let mut scenario = on_rolling_soil(Scenario::plain());
    scenario.soil.wavelengths_m.extend([0.3, 0.15, 0.08]);
    scenario.soil.sigmas_m.extend([0.003, 0.0015, 0.0008]);
    let setup = Setup {
        reference: None,
        ..Setup::new(scenario)
    };
    let (run, ratio) = with_imu_ratio(&setup);
    let [two_steps, joint] = run.errors();
    let normalised = joint.component_div(&run.sigmas());
    println!("two steps {two_steps:.5}joint {joint:.5}normalised {normalised:.2}");
    assert_eq!(run.joint.rung, Rung::Rigid);
    assert!(ratio < 1.15 && normalised.amax() < 4.0);
    // Along the drive: two steps are centimetres off.
    assert!(joint[0].abs() < 0.002 && two_steps[0].abs() > 0.01);
}

/// Only overlapping soil, without boards and reference, and a frame that bends by millimetres with roll, pitch and
/// acceleration, and creeps by centimetres.
#[test]
#[ignore = "just acceptance"]
fn the_bending_of_a_known_mounting_is_estimated_without_a_reference() {
    let mut scenario = Scenario::plain();
    scenario.drives[0].passes.truncate(4);
    scenario.deformation.enabled = true;
    let setup = Setup {
        reference: None,
        known: Some([2e-4, 1e-4]),
        ..Setup::new(scenario)
    };
    let folder = tempfile::tempdir().unwrap();
    let run = Run::new(&setup, folder.path()).unwrap();
    let [before, after] = [&run.two_steps, &run.one_piece];
    println!(
        "points {:.3} {:.3} gap {:.3} {:.3} mm, {:?}, {:?}, {:.1} s",
        before.points_m * 1e3,
        after.points_m * 1e3,
        before.gap_m * 1e3,
        after.gap_m * 1e3,
        run.joint.rung,
        run.refused,
        after.seconds
    );
    assert!(run.refused.is_empty(), "{:?}", run.refused);
    assert_eq!(run.joint.rung, Rung::Compliance);
    assert!(before.points_m > 0.004 && before.gap_m > 0.003);
    // On such a short drive the prism determines positions only to a millimetre.
    assert!(after.points_m < 0.4 * before.points_m && after.gap_m < 1e-4);
}

/// A frame that warms up in the sun, with and without a temperature log.
#[test]
#[ignore = "just acceptance"]
fn a_frame_follows_the_temperature_of_its_log() {
    let mut scenario = Scenario::demo();
    scenario.drives[0].passes.truncate(7);
    bend(&mut scenario, 0.0);
    let deformation = &mut scenario.deformation;
    (deformation.warming_deg, deformation.warming_m) = (0.2, 0.008);
    let folder = tempfile::tempdir().unwrap();
    let adjusted = |logged: bool| {
        let setup = Setup {
            project: Box::new(move |project| {
                assert!(project.bending.is_some());
                project.bending = project.bending.take().filter(|_| logged);
            }),
            joint: JointSettings {
                mounting: MountingMotion {
                    least: Rung::Compliance,
                    most: Rung::Compliance,
                },
                ..Setup::new(scenario.clone()).joint
            },
            ..Setup::new(scenario.clone())
        };
        let name = format!("logged-{logged}");
        let run = Run::new(&setup, &folder.path().join(name)).unwrap();
        println!(
            "logged {logged}: points {:.3} {:.3} mm, {:?}",
            run.two_steps.points_m * 1e3,
            run.one_piece.points_m * 1e3,
            run.refused
        );
        run
    };
    let run = adjusted(true);
    assert!(run.refused.is_empty(), "{:?}", run.refused);
    // As accurate as on a rigid frame.
    assert!(run.one_piece.points_m < 0.0007 && run.two_steps.points_m > 0.001);
    // A line in time does not explain it.
    assert!(!adjusted(false).refused.is_empty());
}
