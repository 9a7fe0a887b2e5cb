//! What else a scenario may put on the field.

use boresight::geometry::Vec3;
use boresight::simulation::{Drive, Profiler, Reference, Scene, Surface};

use super::small;

#[test]
fn a_moved_board_is_scanned_where_it_stands_and_surveyed_where_it_stood() {
    let surveyed = small();
    let mut scenario = small();
    scenario.boards[0].moved_m = [0.02, -0.01, 0.015];
    let scene = Scene::new(&scenario);
    let drive = Drive::new(&scenario, &scene, 0, 0.0);
    let profiler = Profiler::new(&scenario, &scene, &drive, 0);
    let stood = Scene::new(&surveyed).boards.swap_remove(0);
    let shift_m = stood.normal.dot(&Vec3::from(scenario.boards[0].moved_m));
    let mut hits = 0;
    for k in 0..profiler.count() {
        for (scanner, mounting) in scenario.true_mountings().into_iter().enumerate() {
            let pose = drive.at(profiler.time_s(scanner, k)).world_from_body * mounting;
            for ray in profiler.ideal(scanner, k).iter().flatten() {
                if ray.hit.surface == Surface::Board(0) {
                    let [_, _, above_m] = stood.coordinates_m(&pose.map(&ray.point_m));
                    assert!((above_m - shift_m).abs() < 1e-9);
                    hits += 1;
                }
            }
        }
    }
    assert!(hits > 1000, "{hits}");

    let reference = Reference::new(&scenario, &scene);
    // After 120 strips of soil come those of the first board.
    let unmoved = Reference::new(&surveyed, &scene);
    assert_eq!(reference.strip(130), unmoved.strip(130));
    let points = (0..reference.strips()).flat_map(|k| reference.strip(k));
    let on_board = points.filter(|p| {
        let [u, v, w] = stood.coordinates_m(p);
        u.abs() < 0.5 && v.abs() < 0.5 && w.abs() < 0.003
    });
    // One square metre at 2 cm.
    assert!(on_board.count() > 2300);
}

#[test]
fn clods_are_part_of_the_ground_that_both_see_and_wheels_do_not_feel() {
    let plain = small();
    let mut cloddy = small();
    cloddy.soil.clod_height_m = 0.02;
    let (flat, rough) = (Scene::new(&plain), Scene::new(&cloddy));
    let drives = [(&plain, &flat), (&cloddy, &rough)]
        .map(|(scenario, scene)| Drive::new(scenario, scene, 0, 0.0));
    assert_eq!(drives[0].at(30.0), drives[1].at(30.0));
    let profiler = Profiler::new(&cloddy, &rough, &drives[1], 0);
    let (mut soil, mut raised) = (0.0, 0.0);
    for k in 0..profiler.count() {
        let pose = drives[1].at(profiler.time_s(0, k)).world_from_body * cloddy.true_mountings()[0];
        for ray in profiler.ideal(0, k).iter().flatten() {
            if ray.hit.surface == Surface::Soil {
                let point = pose.map(&ray.point_m);
                assert!(rough.distance_m(&point) < 1e-5);
                soil += 1.0;
                raised += f64::from(u8::from(
                    point.z - flat.soil.height_m(point.x, point.y) > 0.005,
                ));
            }
        }
    }
    // A fifth of the ground, less the rims of the clods, more what hides behind them.
    let share = raised / soil;
    assert!(soil > 10_000.0 && (0.14..0.3).contains(&share), "{share}");
    let reference = Reference::new(&cloddy, &rough);
    for point in reference.strip(30) {
        // Six standard deviations, and on the steepest rim their share along the slope.
        assert!(rough.distance_m(&point) < 0.003 + 0.003);
    }
}
