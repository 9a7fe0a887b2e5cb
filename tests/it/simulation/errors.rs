//! Errors that a scenario may add to the logs.

use boresight::geometry::{Vec3, heading};
use boresight::progress::Silent;
use boresight::sensor::PositionFix;
use boresight::simulation::{
    Drive, Profiler, Scenario, Scene, simulate, simulate_heading, simulate_imu, simulate_prism,
};

use super::small;

/// The scene, and its first drive cut to this number of passes.
fn short(scenario: &mut Scenario, passes: usize) -> (Scene, Drive) {
    scenario.drives.truncate(1);
    scenario.drives[0].passes.truncate(passes);
    let scene = Scene::new(scenario);
    let drive = Drive::new(scenario, &scene, 0, 100.0);
    (scene, drive)
}

/// Mean of the products of values `lag` steps apart.
fn autocovariance(values: &[f64], lag: usize) -> f64 {
    let pairs = values.iter().zip(&values[lag..]);
    pairs.map(|(a, b)| a * b).sum::<f64>() / (values.len() - lag) as f64
}

/// Compares autocovariances with σ² exp(−lag / correlation); lags and correlation length in steps.
///
/// A mean over `n` values of a process with correlation length τ scatters by σ² √(2 τ / n).
fn assert_gauss_markov(values: &[f64], sigma: f64, correlation: f64) {
    let scatter = sigma * sigma * (2.0 * correlation / values.len() as f64).sqrt();
    for share in [0.0, 0.5, 1.0, 2.0] {
        let lag = (share * correlation) as usize;
        let estimate = autocovariance(values, lag);
        let expected = sigma * sigma * (-(lag as f64) / correlation).exp();
        assert!(
            (estimate - expected).abs() < 4.0 * scatter,
            "{lag}: {estimate:e}, not {expected:e}"
        );
    }
}

#[test]
fn correlated_errors_decay_exponentially_and_leave_the_white_noise_unchanged() {
    let mut scenario = small();
    // About a thousand correlation lengths in a drive of half a minute.
    scenario.prism.rate_hz = 1000.0;
    scenario.heading.rate_hz = 1000.0;
    let (_, drive) = short(&mut scenario, 1);
    let mut with = scenario.clone();
    (with.prism.sigma_correlated_m, with.prism.correlation_s) = (0.003, 0.02);
    (
        with.heading.sigma_correlated_deg,
        with.heading.correlation_s,
    ) = (0.5, 0.05);

    let white = simulate_prism(&scenario, &drive, 0);
    let both = simulate_prism(&with, &drive, 0);
    for axis in 0..3 {
        let fixes = white.iter().zip(&both);
        let added: Vec<f64> = fixes
            .map(|(a, b)| b.position_m[axis] - a.position_m[axis])
            .collect();
        assert_gauss_markov(&added, 0.003, 20.0);
    }
    let white = simulate_heading(&scenario, &drive, 0);
    let both = simulate_heading(&with, &drive, 0);
    let fixes = white.iter().zip(&both);
    let added = fixes.map(|(a, b)| heading::wrap(b.heading_rad - a.heading_rad).to_degrees());
    assert_gauss_markov(&added.collect::<Vec<_>>(), 0.5, 50.0);
}

#[test]
fn records_with_late_stamps_hold_earlier_measurements() {
    let mut scenario = small();
    // The robot turns between the passes.
    let (scene, drive) = short(&mut scenario, 3);
    let mut late = scenario.clone();
    late.scanners[1].latency_s = 0.02;
    let (on_time, behind) = (
        Profiler::new(&scenario, &scene, &drive, 0),
        Profiler::new(&late, &scene, &drive, 0),
    );
    for (scanner, latency_s) in [(0, 0.0), (1, 0.02)] {
        let (a, b) = (on_time.profile(scanner, 40), behind.profile(scanner, 40));
        assert_eq!(a.points, b.points);
        assert!((b.time_s - a.time_s - latency_s).abs() < 1e-9);
    }

    late.heading.sigma_deg = 0.0;
    late.heading.latency_s = 0.4;
    let mut turned = 0.0f64;
    for fix in simulate_heading(&late, &drive, 0) {
        let at = |time_s| heading::heading_rad(&drive.at(time_s).world_from_body.rotation);
        assert!(heading::wrap(fix.heading_rad - at(fix.time_s - 0.4)).abs() < 1e-12);
        turned = turned.max(heading::wrap(fix.heading_rad - at(fix.time_s)).abs());
    }
    assert!(turned > 0.01, "{turned}");
}

#[test]
fn fixes_are_missing_while_the_prism_is_lost_and_the_others_are_unchanged() {
    let mut scenario = small();
    let (_, drive) = short(&mut scenario, 1);
    let all = simulate_prism(&scenario, &drive, 0);
    scenario.prism.lost_s = vec![[3.0, 5.5], [10.0, 12.0]];
    let seen = simulate_prism(&scenario, &drive, 0);
    let is_seen = |fix: &PositionFix| {
        let elapsed_s = fix.time_s - 100.0;
        !(3.0..=5.5).contains(&elapsed_s) && !(10.0..=12.0).contains(&elapsed_s)
    };
    let expected: Vec<_> = all.into_iter().filter(is_seen).collect();
    assert_eq!(seen, expected);
}

#[test]
fn positions_are_displaced_within_a_span_and_stamped_by_a_clock_of_another_rate() {
    let mut scenario = small();
    let (_, drive) = short(&mut scenario, 1);
    let clean = simulate_prism(&scenario, &drive, 0);
    let displaced_m = [0.03, -0.01, 0.02];
    (scenario.prism.displaced_m, scenario.prism.displaced_s) = (displaced_m, [4.0, 9.0]);
    scenario.prism.clock_ppm = 200.0;
    let with = simulate_prism(&scenario, &drive, 0);
    assert_eq!(with.len(), clean.len());
    for (a, b) in clean.iter().zip(&with) {
        let elapsed_s = a.time_s - 100.0;
        let is_displaced = (4.0..=9.0).contains(&elapsed_s);
        let expected_m = if is_displaced { displaced_m } else { [0.0; 3] };
        assert!((b.position_m - a.position_m - Vec3::from(expected_m)).norm() < 1e-12);
        assert!((b.time_s - a.time_s - 2e-4 * elapsed_s).abs() < 1e-9);
    }
}

#[test]
fn ranges_of_one_scanner_and_rates_of_turn_are_off_by_what_is_stated() {
    let mut scenario = small();
    scenario.imu.noise = false;
    let (scene, drive) = short(&mut scenario, 3);
    let clean = (
        Profiler::new(&scenario, &scene, &drive, 0).profile(1, 40),
        simulate_imu(&scenario, &drive, 0),
    );
    let mut faulty = scenario.clone();
    faulty.scanners[1].range_offset_m = 0.004;
    faulty.imu.gyro_scale = -0.01;
    let profiler = Profiler::new(&faulty, &scene, &drive, 0);
    let range_m = |(x, z): (f64, f64)| x.hypot(z);
    let mut compared = 0;
    let points = clean.0.points.iter().zip(profiler.profile(1, 40).points);
    for (a, b) in points.filter_map(|(a, b)| Some((a.as_ref()?, b?))) {
        assert!((range_m((b.0, b.1)) - range_m((a.0, a.1)) - 0.004).abs() < 1e-9);
        compared += 1;
    }
    assert!(compared > 30, "{compared}");
    let rates = clean.1.samples.iter();
    for (a, b) in rates.zip(simulate_imu(&faulty, &drive, 0).samples) {
        assert!((b.gyro_rad_s - a.gyro_rad_s * 0.99).norm() < 1e-12);
        assert_eq!(b.accel_m_s2, a.accel_m_s2);
    }
}

#[test]
fn outliers_are_displaced_by_the_given_length_in_all_directions() {
    let mut scenario = small();
    scenario.prism.rate_hz = 100.0;
    let (_, drive) = short(&mut scenario, 1);
    let clean = simulate_prism(&scenario, &drive, 0);
    (scenario.prism.outlier_share, scenario.prism.outlier_m) = (0.05, 0.2);
    let (mut outliers, mut sum) = (0.0, Vec3::zeros());
    for (a, b) in clean.iter().zip(simulate_prism(&scenario, &drive, 0)) {
        let displacement = b.position_m - a.position_m;
        if displacement.norm() > 0.0 {
            assert!((displacement.norm() - 0.2).abs() < 1e-9);
            outliers += 1.0;
            sum += displacement / 0.2;
        }
    }
    let expected = 0.05 * clean.len() as f64;
    // Binomial within four standard deviations; the sum of n unit vectors is √n long.
    assert!(
        (outliers - expected).abs() < 4.0 * expected.sqrt(),
        "{outliers}, not {expected}"
    );
    assert!(sum.norm() < 3.0 * outliers.sqrt(), "{sum}");
}

#[test]
fn the_truth_files_list_the_errors_that_the_project_hides() {
    let mut scenario = small();
    short(&mut scenario, 1);
    scenario.profiles.rate_hz = 0.5;
    scenario.prism.lost_s = vec![[3.0, 5.5]];
    scenario.scanners[1].latency_s = 0.02;
    scenario.scanners[0].range_offset_m = 0.003;
    (scenario.prism.displaced_m, scenario.prism.displaced_s) = ([0.0, 0.02, 0.0], [7.0, 9.0]);
    scenario.prism.clock_ppm = 50.0;
    scenario.imu.gyro_scale = 0.01;
    scenario.reference.surface_error_m = 0.0003;
    scenario.boards[1].moved_m = [0.0, 0.0, 0.01];
    scenario.soil.clod_height_m = 0.02;
    scenario.plants.count_per_m2 = 1.0;
    let folder = tempfile::tempdir().unwrap();
    simulate(&scenario, folder.path(), &Silent).unwrap();
    let text = std::fs::read_to_string(folder.path().join("drive-1/truth/errors.toml")).unwrap();
    let errors: toml::Table = text.parse().unwrap();
    let imu = std::fs::read_to_string(folder.path().join("drive-1/imu.csv")).unwrap();
    let start_s: f64 = imu
        .lines()
        .nth(1)
        .unwrap()
        .split(',')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert_eq!(
        errors["prism"]["lost_s"][0][1].as_float(),
        Some(start_s + 5.5)
    );
    assert_eq!(errors["prism"]["displaced_m"][1].as_float(), Some(0.02));
    assert_eq!(
        errors["prism"]["displaced_s"][0].as_float(),
        Some(start_s + 7.0)
    );
    assert_eq!(errors["prism"]["clock_ppm"].as_float(), Some(50.0));
    assert_eq!(errors["imu"]["gyro_scale"].as_float(), Some(0.01));
    assert_eq!(errors["scanner"][0]["name"].as_str(), Some("left"));
    assert_eq!(
        errors["scanner"][0]["range_offset_m"].as_float(),
        Some(0.003)
    );
    assert_eq!(errors["scanner"][1]["name"].as_str(), Some("right"));
    assert_eq!(errors["scanner"][1]["latency_s"].as_float(), Some(0.02));
    assert!(!errors.contains_key("heading"));
    assert_eq!(
        errors["reference"]["surface_error_m"].as_float(),
        Some(0.0003)
    );
    let text = std::fs::read_to_string(folder.path().join("drive-1/truth/scene.toml")).unwrap();
    let scene: toml::Table = text.parse().unwrap();
    assert_eq!(scene["soil"]["clod_height_m"].as_float(), Some(0.02));
    assert_eq!(scene["plants"]["count_per_m2"].as_float(), Some(1.0));
    assert_eq!(scene["board"][1]["moved_m"][2].as_float(), Some(0.01));
    assert_eq!(scene["board"][1]["center_m"][2].as_float(), Some(0.51));
    assert!(scene["board"][0].get("moved_m").is_none());
    let text = std::fs::read_to_string(folder.path().join("scenario.toml")).unwrap();
    assert_eq!(toml::from_str::<Scenario>(&text).unwrap(), scenario);
}
