//! Moved boards, clods, leaves and other options of a scenario for its field.

use boresight::geometry::Vec3;
use boresight::simulation::{Drive, Pass, Profiler, Reference, Scenario, Scene, Surface};

use super::small;

#[test]
fn a_moved_board_is_scanned_at_its_new_place_and_surveyed_at_its_old_one() {
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
    // The strips of the first board follow 120 strips of soil.
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
fn clods_are_scanned_and_surveyed_but_do_not_move_the_wheels() {
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
    // A fifth of the ground, less the rims of the clods, plus the ground hidden behind them.
    let share = raised / soil;
    assert!(soil > 10_000.0 && (0.14..0.3).contains(&share), "{share}");
    let reference = Reference::new(&cloddy, &rough);
    for point in reference.strip(30) {
        // Six standard deviations, and as much again on the steepest rim.
        assert!(rough.distance_m(&point) < 0.003 + 0.003);
    }
}

#[test]
fn leaves_are_scanned_at_their_position_at_that_time() {
    let bare = small();
    let mut planted = small();
    planted.plants.count_per_m2 = 30.0;
    let (before, after) = (Scene::new(&bare), Scene::new(&planted));
    let drive = Drive::new(&planted, &after, 0, 0.0);
    let [without, with] =
        [(&bare, &before), (&planted, &after)].map(|(s, scene)| Profiler::new(s, scene, &drive, 0));
    let (mut leaves, mut rays, mut moved_m) = (0, 0, 0.0f64);
    for k in 0..with.count() {
        let time_s = with.time_s(0, k);
        let pose = drive.at(time_s).world_from_body * planted.true_mountings()[0];
        let beams = without.ideal(0, k).into_iter().zip(with.ideal(0, k));
        for (free, ray) in beams.filter_map(|(free, ray)| Some((free, ray?))) {
            let point = pose.map(&ray.point_m);
            rays += i32::from((0.0..7.5).contains(&point.x) && (0.0..6.0).contains(&point.y));
            if ray.hit.surface != Surface::Plant {
                // Soil and boards are as they were.
                assert_eq!(free, Some(ray));
                continue;
            }
            leaves += 1;
            assert!(free.is_none_or(|free| free.hit.range_m > ray.hit.range_m));
            // Within half a leaf's length of the centre of a leaf, which has moved on much later.
            let nearest = |time_s: f64| {
                let centres = after.plants.centres_m(time_s);
                centres.map(|c| (c - point).norm()).fold(f64::MAX, f64::min)
            };
            if leaves % 50 == 0 {
                assert!(nearest(time_s) <= 0.0250001);
                moved_m = moved_m.max(nearest(time_s + 20.0));
            }
        }
    }
    let share = f64::from(leaves) / f64::from(rays);
    println!("{leaves} of {rays}: {share:.3}");
    // 180 leaves of 10 cm² on a square metre, tilted, occluding each other, none near boards.
    assert!((0.04..0.15).contains(&share), "{share}");
    assert!(moved_m > 0.03, "{moved_m}");

    let [on_soil, on_leaves] = [(&bare, &before), (&planted, &after)].map(|(s, scene)| {
        let reference = Reference::new(s, scene);
        (0..reference.strips())
            .flat_map(|k| reference.strip(k))
            .collect::<Vec<_>>()
    });
    assert_eq!(on_soil.len(), on_leaves.len());
    let changed = on_soil.iter().zip(&on_leaves).filter(|(a, b)| a != b);
    let mut count = 0;
    for (a, b) in changed {
        // Seen from above, a leaf is nearer than the soil below it.
        assert!(b.z > a.z - 0.005 && before.distance_m(a) < 0.005);
        count += 1;
    }
    assert!((1000..4000).contains(&count), "{count}");
}

#[test]
fn passes_over_the_plain_field_scan_the_ground_in_both_directions() {
    let scenario = Scenario::load("plain").unwrap();
    scenario.check().unwrap();
    let scene = Scene::new(&scenario);
    let drive = Drive::new(&scenario, &scene, 0, 0.0);
    let profiler = Profiler::new(&scenario, &scene, &drive, 0);
    // Cells of 5 cm between the ends of the passes: seen heading west, seen heading east.
    let mut cells = vec![[false; 2]; 100 * 60];
    let mut straight = 0;
    for k in (0..profiler.count()).step_by(5) {
        for (scanner, mounting) in scenario.true_mountings().into_iter().enumerate() {
            let state = drive.at(profiler.time_s(scanner, k));
            let speed = state.velocity_m_s;
            // Elsewhere the robot turns.
            if speed.y.abs() > 0.02 || speed.norm() > 0.13 {
                continue;
            }
            straight += 1;
            for ray in profiler.ideal(scanner, k).iter().flatten() {
                let p = (state.world_from_body * mounting).map(&ray.point_m);
                let (i, j) = ((p.x - 1.25) / 0.05, (p.y - 1.5) / 0.05);
                if (0.0..100.0).contains(&i) && (0.0..60.0).contains(&j) {
                    cells[j as usize * 100 + i as usize][usize::from(speed.x > 0.0)] = true;
                }
            }
        }
    }
    let both = cells.iter().filter(|c| c[0] && c[1]).count() as f64 / cells.len() as f64;
    println!(
        "{:.0} s, {straight} profiles, both {both:.3}",
        drive.span_s.1
    );
    assert!(both > 0.95, "{both}");
}

#[test]
fn the_scanners_are_driven_from_the_start_to_the_end_of_a_line() {
    let mut scenario = small();
    let (from_m, to_m) = ([2.0, 1.0], [4.0, 2.5]);
    scenario.drives.truncate(1);
    scenario.drives[0].passes = vec![Pass::Line { from_m, to_m }];
    let scene = Scene::new(&scenario);
    let drive = Drive::new(&scenario, &scene, 0, 0.0);
    let mountings = scenario.true_mountings();
    // The scanners are mounted this far ahead of the IMU.
    let ahead_m = (mountings[0].translation_m.x + mountings[1].translation_m.x) / 2.0;
    let times_s = (0..(drive.span_s.1 * 100.0) as usize).map(|k| k as f64 * 0.01);
    let track: Vec<_> = times_s
        .map(|time_s| {
            let state = drive.at(time_s);
            (
                state.world_from_body.map(&(Vec3::x() * ahead_m)),
                state.velocity_m_s.norm(),
            )
        })
        .collect();
    for [east, north] in [from_m, to_m] {
        let distance = |p: &Vec3| (p.x - east).hypot(p.y - north);
        let nearest = track
            .iter()
            .min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)));
        let (point, speed) = nearest.unwrap();
        // The robot rolls and pitches.
        assert!(distance(point) < 0.05, "{point}");
        assert!((speed - 0.1).abs() < 0.05, "{speed}");
    }
}

#[test]
fn the_smooth_error_of_the_reference_is_along_normals_and_of_the_given_size() {
    let exact = small();
    let mut scenario = small();
    scenario.reference.surface_error_m = 0.0004;
    let scene = Scene::new(&scenario);
    let points = |scenario: &Scenario| -> Vec<Vec3> {
        let reference = Reference::new(scenario, &scene);
        (0..reference.strips())
            .flat_map(|k| reference.strip(k))
            .collect()
    };
    let pairs: Vec<(Vec3, Vec3)> = points(&exact).into_iter().zip(points(&scenario)).collect();
    let added = pairs.iter().map(|(a, b)| (b - a).norm());
    let rms = (added.map(|d| d * d).sum::<f64>() / pairs.len() as f64).sqrt();
    // About 500 patches of 0.3 m, each with an independent error.
    assert!((rms / 0.0004 - 1.0).abs() < 0.15, "{rms}");
    // On a board, the errors of neighbours differ little, and all are along its normal.
    let board = &scene.boards[3];
    let on_board: Vec<_> = pairs
        .iter()
        .filter(|(a, _)| board.coordinates_m(a)[2].abs() < 0.003 && board.covers(a.x, a.y, 0.0))
        .collect();
    assert!(on_board.len() > 2300);
    let along = |(a, b): &(Vec3, Vec3)| (b - a).dot(&board.normal);
    for pair in on_board.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        assert!((along(a).abs() - (a.1 - a.0).norm()).abs() < 1e-9);
        // A slope of two standard deviations within a quarter wavelength is exceeded rarely.
        let apart = (a.0 - b.0).norm();
        assert!((along(a) - along(b)).abs() < 0.0004 * 6.0 * apart / 0.075);
    }
}
