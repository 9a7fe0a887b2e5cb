//! A lidar beside the profile scanners.

use std::collections::BTreeMap;

use boresight::format;
use boresight::progress::Silent;
use boresight::simulation::{
    Drive, Lidar, Profiler, ScannerKind, ScannerSettings, Scenario, Scene, Surface, simulate,
};

use super::small;

/// A short drive with a lidar that looks ahead and down, listed before the profile scanners.
fn with_lidar() -> Scenario {
    let mut scenario = small();
    scenario.drives.truncate(1);
    scenario.drives[0].passes.truncate(1);
    scenario.lidar.rate_hz = 2.0;
    scenario.lidar.columns = 90;
    let lidar = ScannerSettings {
        name: "top".into(),
        kind: ScannerKind::Lidar,
        translation_m: [0.4, 0.0, -0.3],
        rotation_deg: [180.0, -35.0, 0.0],
        initial_translation_m: [0.4, 0.0, -0.3],
        initial_rotation_deg: [180.0, -35.0, 0.0],
        latency_s: 0.0,
        range_offset_m: 0.0,
    };
    scenario.scanners.insert(0, lidar);
    scenario
}

#[test]
fn lidar_points_have_their_own_times_and_lie_on_soil_and_boards() {
    let mut scenario = with_lidar();
    scenario.lidar.sigma_m = 0.0;
    let scene = Scene::new(&scenario);
    let folder = tempfile::tempdir().unwrap();
    let files = simulate(&scenario, folder.path(), &Silent).unwrap();
    let drive = Drive::new(&scenario, &scene, 0, 36_000.0);
    let mut reader = format::open_profiles(&files.drives[0].folder.join("top.csv")).unwrap();
    let (mut chunk, mut count, mut farthest_m) = (Vec::new(), 0, 0.0f64);
    let mut times: BTreeMap<u64, u32> = BTreeMap::new();
    while reader.next_chunk(&mut chunk).unwrap() {
        for point in &chunk {
            let body = drive.at(point.time_s).world_from_body;
            let world = body * scenario.true_mountings()[0];
            let distance_m = scene.distance_m(&world.map(&point.position_m));
            // Rounded to 0.1 mm.
            assert!(distance_m < 2e-4, "{distance_m}");
            farthest_m = farthest_m.max(point.position_m.norm());
            *times.entry((point.time_s * 1e6) as u64).or_default() += 1;
            count += 1;
        }
    }
    assert!((8.0..10.0).contains(&farthest_m), "{farthest_m}");
    // About half of the 16 rays of each of 90 directions meet the ground.
    let lidar = Lidar::new(&scenario, &scene, &drive, 0);
    assert!(times.values().all(|&n| n <= 16) && times.len() > 40 * lidar.count());
    assert!(count > 8 * 40 * lidar.count(), "{count}");
    let rays = (0..lidar.count()).flat_map(|k| (0..90).flat_map(move |c| [(k, c)]));
    let hits = rays.flat_map(|(k, c)| lidar.ideal(0, k, c)).flatten();
    let (boards, all) = hits.fold((0, 0), |(boards, all), ray| {
        (
            boards + usize::from(matches!(ray.hit.surface, Surface::Board(_))),
            all + 1,
        )
    });
    assert!(boards > 500, "{boards}");
    // Three in a thousand are lost.
    assert!((all as f64 * 0.996..all as f64 * 0.998).contains(&(count as f64)));

    let project = std::fs::read_to_string(&files.drives[0].project).unwrap();
    assert!(project.contains("profiles = \"top.csv\"") && project.contains("\"left.bin\""));
}

#[test]
fn lidar_noise_is_along_the_ray_and_stamps_may_be_late() {
    let mut scenario = with_lidar();
    scenario.lidar.dropout = 0.0;
    scenario.scanners[0].latency_s = 0.03;
    let scene = Scene::new(&scenario);
    let drive = Drive::new(&scenario, &scene, 0, 0.0);
    let lidar = Lidar::new(&scenario, &scene, &drive, 0);
    let (mut sum, mut count) = (0.0, 0.0);
    for k in (0..lidar.count()).step_by(4) {
        let rays = (0..90).flat_map(|c| {
            let rays = lidar.ideal(0, k, c).into_iter().flatten();
            rays.map(move |ray| (c, ray.point_m))
        });
        for ((column, ideal), (stamp_s, point)) in rays.zip(lidar.revolution(0, k)) {
            assert!((stamp_s - lidar.time_s(k, column) - 0.03).abs() < 1e-9);
            assert!(point.cross(&ideal).norm() < 1e-9);
            sum += (point.norm() - ideal.norm()).powi(2);
            count += 1.0;
        }
    }
    let sigma_m = (sum / count).sqrt();
    // The sigma of about 10,000 values scatters by 0.7 %.
    assert!((sigma_m / 0.005 - 1.0).abs() < 0.04, "{sigma_m}");
}

#[test]
fn profile_scanners_record_the_same_with_and_without_a_lidar() {
    let with = with_lidar();
    let mut without = with.clone();
    without.scanners.remove(0);
    let scene = Scene::new(&with);
    let drive = Drive::new(&with, &scene, 0, 0.0);
    assert_eq!(
        drive.at(40.0),
        Drive::new(&without, &scene, 0, 0.0).at(40.0)
    );
    let [a, b] = [&with, &without].map(|scenario| Profiler::new(scenario, &scene, &drive, 0));
    for k in [10, 50] {
        assert_eq!(a.profile(1, k), b.profile(0, k));
        assert_eq!(a.profile(2, k), b.profile(1, k));
    }
}
