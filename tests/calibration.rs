//! Calibration on a simulated drive with known truth: the demo's first drive on three scales.

#![allow(clippy::unwrap_used)]

use std::sync::OnceLock;

use boresight::calibration::Calibration;
use boresight::calibration::{CalibrationSettings, Method};
use boresight::format;
use boresight::geometry::euler::euler_deg_from_rotation;
use boresight::geometry::{BodyFromScanner, EulerConvention, Vec3};
use boresight::pipeline::stages::{self, Poses};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::simulation::{Scenario, simulate};
use boresight::trajectory::Trajectory;
use tempfile::TempDir;

/// The simulated drive, read once for all tests.
struct Case {
    _folder: TempDir,
    project: Project,
    reference: Vec<Vec3>,
    own: Poses,
    exact: Poses,
    truth: Vec<BodyFromScanner>,
}

fn case() -> &'static Case {
    static CASE: OnceLock<Case> = OnceLock::new();
    CASE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let mut scenario = Scenario::demo();
        scenario.drives.truncate(1);
        let files = simulate(&scenario, folder.path(), &Silent).unwrap();
        let mut project = Project::read(&files.drives[0].project).unwrap();
        project.calibration.voxel_sizes_m = vec![0.05, 0.03, 0.02];
        let truth = files.drives[0].folder.join("truth/trajectory.csv");
        let exact = Trajectory::new(format::read_trajectory(&truth).unwrap()).unwrap();
        Case {
            reference: stages::reference(&project, &Silent).unwrap(),
            own: stages::poses(&project, &Silent).unwrap(),
            exact: Poses::from_file(exact),
            truth: scenario.true_mountings(),
            project,
            _folder: folder,
        }
    })
}

fn calibrate(poses: &Poses, reference: &[Vec3], settings: &CalibrationSettings) -> Calibration {
    let project = &case().project;
    let samples = stages::samples(project, &poses.trajectory, &Silent).unwrap();
    stages::calibration(project, settings, poses, &samples, reference, &Silent).unwrap()
}

/// Errors of tx ty tz (m) and α β γ (degrees, `bonn`) of a scanner.
fn errors(found: &Calibration, scanner: usize) -> [f64; 6] {
    let pose = &found.mountings[scanner].body_from_scanner;
    let truth = &case().truth[scanner];
    let shift = pose.translation_m - truth.translation_m;
    let angles =
        |pose: &BodyFromScanner| euler_deg_from_rotation(EulerConvention::Bonn, &pose.rotation);
    let (a, b) = (angles(pose), angles(truth));
    [
        shift.x,
        shift.y,
        shift.z,
        a[0] - b[0],
        a[1] - b[1],
        a[2] - b[2],
    ]
}

/// Errors must lie within 4 mm and 0.15°, the limits that poses of this grade set, and within 2.8
/// claimed sigmas: 22 numbers all stay within 2.8 nine times in ten, and one drive is one draw.
fn assert_honest(found: &Calibration, label: &str) {
    for scanner in 0..2 {
        let sigmas = found.sigmas(scanner, EulerConvention::Bonn);
        let errors = errors(found, scanner);
        println!("{label} {scanner}: errors {errors:?}, sigmas {sigmas:?}");
        for parameter in 0..6 {
            if !found.is_observable(scanner, parameter) {
                continue;
            }
            let sigma = sigmas[parameter].expect("what is determined has a sigma");
            let (limit, sigma) = if parameter < 3 {
                (0.004, sigma)
            } else {
                (0.15, sigma.to_degrees())
            };
            let error = errors[parameter].abs();
            assert!(
                error < limit && error < 2.8 * sigma,
                "{label} {scanner} {parameter}"
            );
        }
    }
    for scale in &found.scales {
        assert!(
            scale.iterations <= 12,
            "{label}: {} at {}",
            scale.iterations,
            scale.voxel_m
        );
    }
    assert!(found.converged);
}

#[test]
fn with_exact_poses_the_truth_is_found() {
    let case = case();
    let found = calibrate(&case.exact, &case.reference, &case.project.calibration);
    for scanner in 0..2 {
        let errors = errors(&found, scanner);
        println!("exact poses {scanner}: errors {errors:?}");
        assert!(errors[..3].iter().all(|e| e.abs() < 1e-4), "{errors:?}");
        assert!(errors[3..].iter().all(|e| e.abs() < 0.005), "{errors:?}");
    }
}

#[test]
fn with_own_poses_the_errors_are_those_claimed() {
    let case = case();
    let found = calibrate(&case.own, &case.reference, &case.project.calibration);
    assert!(found.observability.unobservable.is_empty());
    assert_honest(&found, "own poses");
    let constancy = found.constancy.unwrap();
    assert!(constancy.constant, "{} times expected", constancy.ratio);
}

#[test]
fn without_a_reference_the_common_height_is_named_and_held() {
    let case = case();
    let found = calibrate(&case.own, &[], &case.project.calibration);
    assert_eq!(found.observability.unobservable.len(), 1);
    assert_eq!(
        found.observability.unobservable[0].description,
        "all scanners' common height"
    );
    assert_eq!(found.unobservable(0), ["tz"]);
    assert_eq!(found.unobservable(1), ["tz"]);
    assert_eq!(found.sigmas(0, EulerConvention::Bonn)[2], None);
    assert_honest(&found, "no reference");
    // The mean height stays where the user put it; the difference is found.
    let height = |pose: &BodyFromScanner| pose.translation_m.z;
    let (left, right) = (&found.mountings[0], &found.mountings[1]);
    let mean = 0.5 * (height(&left.body_from_scanner) + height(&right.body_from_scanner));
    assert!(
        (mean - 0.5).abs() < 1e-3,
        "initial heights are 0.5 m, found {mean}"
    );
    let difference = height(&left.body_from_scanner) - height(&right.body_from_scanner);
    assert!(
        (difference - 0.002).abs() < 0.001,
        "0.587 m − 0.585 m, found {difference}"
    );
}

#[test]
fn the_height_of_a_single_scanner_is_not_invented_either() {
    let case = case();
    let mut project = case.project.clone();
    project.scanners.truncate(1);
    project.calibration.voxel_sizes_m = vec![0.05];
    let samples = stages::samples(&project, &case.own.trajectory, &Silent).unwrap();
    let settings = &project.calibration;
    let found = stages::calibration(&project, settings, &case.own, &samples, &[], &Silent).unwrap();
    assert_eq!(
        found.observability.unobservable[0].description,
        "the height of `left`"
    );
    assert_eq!(found.unobservable(0), ["tz"]);
    let height = found.mountings[0].body_from_scanner.translation_m.z;
    assert!((height - 0.5).abs() < 1e-6, "held at 0.5 m, found {height}");
}

#[test]
fn held_parameters_stay_to_the_last_bit() {
    let case = case();
    let mut project = case.project.clone();
    for scanner in &mut project.scanners {
        scanner.fixed = [true, false, true, false, true, false];
    }
    let samples = stages::samples(&project, &case.own.trajectory, &Silent).unwrap();
    let settings = CalibrationSettings {
        voxel_sizes_m: vec![0.05],
        ..project.calibration.clone()
    };
    let reference = &case.reference;
    let found =
        stages::calibration(&project, &settings, &case.own, &samples, reference, &Silent).unwrap();
    for (scanner, before) in project.scanners.iter().enumerate() {
        let (a, b) = (
            &before.body_from_scanner,
            &found.mountings[scanner].body_from_scanner,
        );
        assert_eq!(a.translation_m.x, b.translation_m.x);
        assert_eq!(a.translation_m.z, b.translation_m.z);
        assert_ne!(a.translation_m.y, b.translation_m.y);
        let angle = |pose: &BodyFromScanner| {
            euler_deg_from_rotation(EulerConvention::Bonn, &pose.rotation)[1]
        };
        assert!((angle(a) - angle(b)).abs() < 1e-9);
        let sigmas = found.sigmas(scanner, EulerConvention::Bonn);
        let held: Vec<bool> = sigmas.iter().map(Option::is_none).collect();
        assert_eq!(held, before.fixed);
    }
}

#[test]
fn the_papers_method_lifts_the_scanners_and_needs_more() {
    let case = case();
    let settings = CalibrationSettings {
        method: Method::Paper,
        voxel_sizes_m: vec![0.05],
        max_iterations: 20,
        ..case.project.calibration.clone()
    };
    let found = calibrate(&case.own, &case.reference, &settings);
    let scale = &found.scales[0];
    for scanner in 0..2 {
        let errors = errors(&found, scanner);
        println!("paper {scanner}: errors {errors:?}");
        // The scanners start 87 mm and 85 mm too high. A tenth of that is what the plain voxel
        // filter and the squares may leave at this scale, 17 % of the voxel.
        assert!(errors[2].abs() < 0.0087, "{errors:?}");
    }
    assert!(scale.costs[20] < 0.6 * scale.costs[0], "{:?}", scale.costs);
    // Where the reweighted method has converged after 5.
    assert_eq!(scale.iterations, 20);
    assert!(!found.converged);
}

#[test]
fn a_mounting_that_bends_is_noticed_from_the_pattern_along_the_drive() {
    let folder = tempfile::tempdir().unwrap();
    let mut scenario = Scenario::demo();
    scenario.drives.truncate(1);
    scenario.deformation.enabled = true;
    let files = simulate(&scenario, folder.path(), &Silent).unwrap();
    let mut project = Project::read(&files.drives[0].project).unwrap();
    project.calibration.voxel_sizes_m = vec![0.05];
    let reference = stages::reference(&project, &Silent).unwrap();
    let poses = stages::poses(&project, &Silent).unwrap();
    let samples = stages::samples(&project, &poses.trajectory, &Silent).unwrap();
    let settings = &project.calibration;
    let found =
        stages::calibration(&project, settings, &poses, &samples, &reference, &Silent).unwrap();
    let constancy = found.constancy.unwrap();
    println!(
        "{} mm, {} times expected, {:?}",
        constancy.rms_m * 1e3,
        constancy.ratio,
        constancy.strongest
    );
    // Sized to leave the paper's 8 mm, where poses explain less than 1 mm.
    assert!(!constancy.constant);
    assert!(constancy.ratio > 4.0, "{}", constancy.ratio);
    assert!(
        (0.004..0.012).contains(&constancy.rms_m),
        "{}",
        constancy.rms_m
    );
}
