//! Calibration on a simulated drive with known truth: the demo's first drive on three scales.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::LazyLock;

use crate::common::demo_drive::{DemoDrive, calibrate};
use crate::common::joint_drive::bend;
use crate::common::{files, simulated, write_files};
use boresight::calibration::{Calibration, CalibrationSettings, Method};
use boresight::geometry::euler::euler_deg_from_rotation;
use boresight::geometry::{BodyFromScanner, EulerConvention, Vec3};
use boresight::pipeline::OpenProject;
use boresight::pipeline::stages::{self, EstimatedPoses};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::simulation::Scenario;
use tempfile::TempDir;

/// The demo's first drive on three scales.
struct Case {
    drive: &'static DemoDrive,
    /// A project with a separate copy of the files.
    project: Project,
    _folder: TempDir,
}

/// Simulates and reads the drive only once, because poses and reference are the same for all tests.
fn case() -> Case {
    static DRIVE: LazyLock<(DemoDrive, BTreeMap<PathBuf, Vec<u8>>)> = LazyLock::new(|| {
        let folder = tempfile::tempdir().unwrap();
        let drive = DemoDrive::simulate(Scenario::demo(), folder.path()).unwrap();
        (drive, files(folder.path()))
    });
    let (drive, files) = &*DRIVE;
    let folder = tempfile::tempdir().unwrap();
    write_files(files, folder.path());
    let mut project = Project::read(&folder.path().join("drive-1/project.toml")).unwrap();
    project.calibration.voxel_sizes_m = vec![0.05, 0.03, 0.02];
    Case {
        drive,
        project,
        _folder: folder,
    }
}

/// The smallest drive, where the numbers do not matter, and the folder of its files.
fn tiny() -> (TempDir, Project) {
    let (temp, drive) = simulated();
    let project = Project::read(&drive.join("project.toml")).unwrap();
    (temp, project)
}

/// Calibrates with the settings of the project.
fn calibrated(project: &Project, poses: &EstimatedPoses, reference: &[Vec3]) -> Calibration {
    calibrate(project, &project.calibration, poses, reference).unwrap()
}

/// Errors must lie within 4 mm and 0.15°, the limits with poses of this grade, and within 2.8 of the
/// reported sigmas: 22 normal numbers are all within 2.8 nine times in ten, and one drive is one draw.
fn assert_errors_match_sigmas(drive: &DemoDrive, calibration: &Calibration, label: &str) {
    for scanner in 0..2 {
        let sigmas = calibration.sigmas(scanner, EulerConvention::Bonn);
        let errors = drive.errors(calibration, scanner);
        println!("{label} {scanner}: errors {errors:?}, sigmas {sigmas:?}");
        for parameter in 0..6 {
            if !calibration.is_observable(scanner, parameter) {
                continue;
            }
            let sigma = sigmas[parameter].expect("an observable parameter has a sigma");
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
    for scale in &calibration.scales {
        assert!(
            scale.iterations <= 12,
            "{label}: {} at {}",
            scale.iterations,
            scale.voxel_m
        );
    }
    assert!(calibration.converged);
    let minimum = calibration.minimum.as_ref().unwrap();
    assert!(minimum.alternative.is_none(), "{label}");
    assert_eq!(minimum.back, minimum.starts, "{label}");
}

/// Started with the scanners exchanged, the calibration reaches no minimum, or one of several.
#[test]
#[ignore = "just acceptance"]
fn what_may_be_no_minimum_has_no_standard_deviations() {
    let case = case();
    let mut project = case.project.clone();
    let [left, right] = project.scanners.as_mut_slice() else {
        panic!("two scanners");
    };
    std::mem::swap(&mut left.body_from_scanner, &mut right.body_from_scanner);
    project.calibration.voxel_sizes_m = vec![0.05];
    let calibration = calibrated(&project, &case.drive.estimated, &case.drive.reference);
    assert!(!calibration.converged || calibration.minimum.unwrap().is_doubtful());
    assert!(calibration.covariance.is_none());
}

#[test]
#[ignore = "just acceptance"]
fn with_exact_poses_the_mountings_are_the_true_ones() {
    let case = case();
    let calibration = calibrated(&case.project, &case.drive.exact, &case.drive.reference);
    for scanner in 0..2 {
        let errors = case.drive.errors(&calibration, scanner);
        println!("exact poses {scanner}: errors {errors:?}");
        assert!(errors[..3].iter().all(|e| e.abs() < 1e-4), "{errors:?}");
        assert!(errors[3..].iter().all(|e| e.abs() < 0.005), "{errors:?}");
    }
}

#[test]
fn with_estimated_poses_the_errors_match_their_sigmas() {
    // With half of the points, which are enough for these scales.
    let mut scenario = Scenario::demo();
    (scenario.profiles.rate_hz, scenario.profiles.width) = (20.0, 200);
    let folder = tempfile::tempdir().unwrap();
    let mut drive = DemoDrive::simulate(scenario, folder.path()).unwrap();
    drive.project.calibration.voxel_sizes_m = vec![0.05, 0.03];
    let calibration = calibrated(&drive.project, &drive.estimated, &drive.reference);
    assert!(calibration.observability.unobservable.is_empty());
    assert_errors_match_sigmas(&drive, &calibration, "estimated poses");
    let constancy = calibration.constancy.unwrap();
    assert!(constancy.constant, "{} times expected", constancy.ratio);
    let gap = calibration.gap.unwrap();
    // Half of the limit.
    assert!(gap.constant && gap.ratio < 1.0, "{gap:?}");
}

#[test]
#[ignore = "just acceptance"]
fn without_a_reference_the_common_height_is_reported_and_held() {
    let case = case();
    let calibration = calibrated(&case.project, &case.drive.estimated, &[]);
    assert_eq!(calibration.observability.unobservable.len(), 1);
    assert_eq!(
        calibration.observability.unobservable[0].description,
        "all scanners' common height"
    );
    assert_eq!(calibration.unobservable(0), ["tz"]);
    assert_eq!(calibration.unobservable(1), ["tz"]);
    assert_eq!(calibration.sigmas(0, EulerConvention::Bonn)[2], None);
    assert_errors_match_sigmas(case.drive, &calibration, "no reference");
    // The mean height stays at the user's value; the difference is estimated.
    let height = |pose: &BodyFromScanner| pose.translation_m.z;
    let (left, right) = (&calibration.mountings[0], &calibration.mountings[1]);
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
fn the_height_of_a_single_scanner_without_a_reference_is_held_too() {
    let (_temp, mut project) = tiny();
    project.scanners.truncate(1);
    let poses = stages::poses(&OpenProject::new(&project), &Silent).unwrap();
    let mut calibration = calibrated(&project, &poses, &[]);
    assert_eq!(
        calibration.observability.unobservable[0].description,
        "the height of `left`"
    );
    assert_eq!(calibration.unobservable(0), ["tz"]);
    let height = calibration.mountings[0].body_from_scanner.translation_m.z;
    assert!((height - 0.5).abs() < 1e-6, "held at 0.5 m, found {height}");
    // The joint adjustment has a covariance of what it holds, for the distances between scanners.
    calibration.covariance = Some(nalgebra::DMatrix::identity(6, 6));
    let determined = calibration.determined_covariance().unwrap();
    let correlation = calibration.correlation().unwrap();
    for (row, column) in (0..6).flat_map(|row| (0..6).map(move |column| (row, column))) {
        let is_held = row == 2 || column == 2;
        assert_eq!(determined[(row, column)].is_nan(), is_held);
        assert_eq!(correlation[(row, column)].is_nan(), is_held);
    }
}

#[test]
fn fixed_parameters_stay_at_their_values() {
    let (_temp, mut project) = tiny();
    project.scanners.truncate(1);
    for scanner in &mut project.scanners {
        scanner.fixed = [true, false, true, false, true, false];
    }
    let open = OpenProject::new(&project);
    let poses = stages::poses(&open, &Silent).unwrap();
    let reference = stages::reference(&open, &Silent).unwrap();
    let calibration = calibrated(&project, &poses, &reference);
    for (scanner, before) in project.scanners.iter().enumerate() {
        let (a, b) = (
            &before.body_from_scanner,
            &calibration.mountings[scanner].body_from_scanner,
        );
        assert_eq!(a.translation_m.x, b.translation_m.x);
        assert_eq!(a.translation_m.z, b.translation_m.z);
        assert_ne!(a.translation_m.y, b.translation_m.y);
        let angle = |pose: &BodyFromScanner| {
            euler_deg_from_rotation(EulerConvention::Bonn, &pose.rotation)[1]
        };
        assert!((angle(a) - angle(b)).abs() < 1e-9);
        let sigmas = calibration.sigmas(scanner, EulerConvention::Bonn);
        let held: Vec<bool> = sigmas.iter().map(Option::is_none).collect();
        assert_eq!(held, before.fixed);
    }
}

#[test]
#[ignore = "just acceptance"]
fn the_papers_method_corrects_the_height_but_needs_more_iterations() {
    let case = case();
    let settings = CalibrationSettings {
        method: Method::Paper,
        voxel_sizes_m: vec![0.05],
        max_iterations: 20,
        ..case.project.calibration.clone()
    };
    let calibration = calibrate(
        &case.project,
        &settings,
        &case.drive.estimated,
        &case.drive.reference,
    )
    .unwrap();
    let scale = &calibration.scales[0];
    for scanner in 0..2 {
        let errors = case.drive.errors(&calibration, scanner);
        println!("paper {scanner}: errors {errors:?}");
        // The scanners start with height errors of 87 mm and 85 mm. The plain voxel filter and the
        // squares may leave a tenth of that at this scale, 17 % of the voxel.
        assert!(errors[2].abs() < 0.0087, "{errors:?}");
    }
    // The reweighted method converges after 5.
    assert_eq!(scale.iterations, 20);
    assert!(!calibration.converged);
}

#[test]
#[ignore = "just acceptance"]
fn a_bending_mounting_is_detected_from_the_pattern_of_residuals_along_the_drive() {
    let folder = tempfile::tempdir().unwrap();
    let mut scenario = Scenario::demo();
    scenario.deformation.enabled = true;
    let mut case = DemoDrive::simulate(scenario, folder.path()).unwrap();
    case.project.calibration.voxel_sizes_m = vec![0.05];
    let calibration = calibrated(&case.project, &case.estimated, &case.reference);
    let constancy = calibration.constancy.unwrap();
    println!(
        "{} mm, {} times expected, {:?}",
        constancy.rms_m * 1e3,
        constancy.ratio,
        constancy.strongest
    );
    // The bending is sized to leave the paper's 8 mm, of which pose errors explain less than 1 mm.
    assert!(!constancy.constant);
    assert!(constancy.ratio > 4.0, "{}", constancy.ratio);
    assert!(
        (0.004..0.012).contains(&constancy.rms_m),
        "{}",
        constancy.rms_m
    );
}

/// The residuals to the reference alone could be explained by pose errors.
#[test]
#[ignore = "just acceptance"]
fn a_randomly_moving_mounting_is_detected_from_the_gap_between_the_scanners() {
    let folder = tempfile::tempdir().unwrap();
    let mut scenario = Scenario::demo();
    bend(&mut scenario, 0.0);
    let deformation = &mut scenario.deformation;
    (deformation.walk_deg, deformation.walk_m) = (0.08, 0.0015);
    let mut case = DemoDrive::simulate(scenario, folder.path()).unwrap();
    case.project.calibration.voxel_sizes_m = vec![0.05, 0.02];
    for reference in [case.reference.as_slice(), &[]] {
        let calibration = calibrated(&case.project, &case.estimated, reference);
        let gap = calibration.gap.unwrap();
        println!(
            "{gap:?}, residuals {:?}",
            calibration.constancy.map(|constancy| constancy.ratio)
        );
        assert_eq!(gap.scanners, [0, 1]);
        // Changes are bounded: no block counts for more than six.
        assert!(!gap.constant && gap.ratio > 3.0, "{gap:?}");
    }
}
