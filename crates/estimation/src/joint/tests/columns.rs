//! The points of surfels: surfaces in every position relative to the voxels.

use super::case::noise;
use crate::calibration::ScannerSample;
use crate::geometry::so3::exp;
use crate::geometry::{BodyFromScanner, Vec3, WorldFromBody};
use crate::joint::surfel::{Association, Gates, Grid, ReferenceCells, associate};
use crate::joint::{CorrectedPoses, Scans};
use crate::sensor::{PoseRecord, PoseSigma};
use crate::surface::{Profile, ProfilePoint};
use crate::trajectory::Trajectory;

pub const SIZE_M: f64 = 0.05;
pub const NOISE_M: f64 = 5e-4;
const PASSES: usize = 8;

/// The association of these points, which a scanner at rest sees on several passes, with voxels along the axes.
fn associated(passes: &[Vec<Vec3>], reference: &[Vec3]) -> Association {
    associated_in(&[Grid::aligned(SIZE_M)], passes, reference)
}

/// As [`associated`], with these voxels.
pub fn associated_in(grids: &[Grid], passes: &[Vec<Vec3>], reference: &[Vec3]) -> Association {
    let record = |time_s| PoseRecord {
        sigma: Some(PoseSigma {
            position_m: Vec3::repeat(1e-3),
            rotation_rad: Vec3::repeat(1e-3),
        }),
        ..PoseRecord::new(time_s, WorldFromBody::identity())
    };
    let poses = (0..=passes.len()).map(|pass| record(10.0 * pass as f64));
    let trajectory = Trajectory::new(poses.collect()).expect("poses");
    let mut sample = ScannerSample::default();
    for (pass, points) in passes.iter().enumerate() {
        sample.profiles.push(Profile {
            time_s: 10.0 * pass as f64 + 5.0,
            world_from_body: WorldFromBody::identity(),
        });
        let points = points.iter().map(|&position_m| ProfilePoint {
            profile: pass as u32,
            position_m,
            count: 1,
        });
        sample.points.extend(points);
    }
    let motion = CorrectedPoses::new(&trajectory, 5.0).expect("standard deviations");
    let scans = Scans {
        samples: vec![&sample],
    };
    let cells: Vec<_> = grids
        .iter()
        .map(|&grid| ReferenceCells::new(reference, grid, [0.0; 6]))
        .collect();
    associate(
        &[scans],
        &[Box::new(motion)],
        &[BodyFromScanner::identity()],
        None,
        &[0.0],
        &cells,
        &Gates {
            misfit_m: 5e-4,
            patch_m: 0.3,
            keyframe_steps: Vec::new(),
        },
    )
}

/// Points of a square plane through `origin_m` in each pass, 5 mm apart, with noise along its normal.
pub fn plane(origin_m: Vec3, u: Vec3, v: Vec3, half: i32) -> Vec<Vec<Vec3>> {
    let mut next = noise(5);
    let normal = u.cross(&v);
    let pass = |_| {
        (-half..half)
            .flat_map(|i| (-half..half).map(move |j| (f64::from(i) + 0.5, f64::from(j) + 0.5)))
            .map(|(i, j)| origin_m + (u * i + v * j) * 0.005 + normal * (NOISE_M * next()))
            .collect()
    };
    (0..PASSES).map(pass).collect()
}

/// Asserts that surfels lie on the plane, keep all of its noise and lose no points.
fn assert_whole(passes: &[Vec<Vec3>], origin_m: Vec3, normal: Vec3) {
    assert_whole_in(Grid::aligned(SIZE_M), passes, origin_m, normal);
}

/// As [`assert_whole`], with these voxels.
fn assert_whole_in(grid: Grid, passes: &[Vec<Vec3>], origin_m: Vec3, normal: Vec3) {
    let association = associated_in(&[grid], passes, &[]);
    // Voxels at the rim are not full.
    let is_inside = |point: &Vec3| (point - origin_m).norm() < 0.3 - 2.0 * SIZE_M;
    let points = passes.iter().flatten().filter(|point| is_inside(point));
    let rows = &association.drives[0];
    let held = rows.rows.iter().flat_map(|row| rows.points_of(row));
    let held = held.filter(|point| is_inside(&point.position_m)).count();
    let share = held as f64 / points.count() as f64;
    let (mut count, mut sum_m) = (0.0, 0.0);
    for row in &rows.rows {
        let surfel = &association.surfels[row.surfel as usize];
        let n = f64::from(row.count);
        count += n;
        sum_m += n * normal.dot(&(surfel.centre_m - origin_m));
    }
    println!(
        "{:?}: {} surfels hold {share} of the points",
        normal.as_slice(),
        association.surfels.len()
    );
    // Noise beyond four standard deviations is outside the gate, and slices of a few points in corners of
    // voxels are left over: they are cut off across the surface, not along it.
    assert!(share > 0.99, "{share} of the points are in rows");
    // If noise were cut in two, the planes of the halves would be off by 0.8 of it.
    let mean_m = sum_m / count;
    assert!(mean_m.abs() < 4.0 * NOISE_M / count.sqrt(), "{mean_m} m");
    for surfel in &association.surfels {
        let count: f64 = association.drives[0]
            .rows
            .iter()
            .filter(|row| std::ptr::eq(&association.surfels[row.surfel as usize], surfel))
            .map(|row| f64::from(row.count))
            .sum();
        let off_m = normal.dot(&(surfel.centre_m - origin_m)).abs();
        assert!(
            off_m < 5.0 * NOISE_M / count.sqrt(),
            "{off_m} m with {count} points"
        );
        // The variance of n points about a plane scatters by √(2/n).
        let ratio = (surfel.roughness_m / NOISE_M).powi(2);
        assert!(
            (ratio - 1.0).abs() < 5.0 * (2.0 / count).sqrt(),
            "{ratio} with {count} points"
        );
        let tilt = surfel.axes[0].cross(&normal).norm();
        assert!(
            tilt < 6.0 * NOISE_M / (count.sqrt() * 0.12 * SIZE_M),
            "{tilt}"
        );
    }
}

#[test]
fn a_surface_on_the_face_of_voxels_is_not_cut() {
    for up_m in [0.0, 1e-4, -3e-4, 0.012, 0.025] {
        let origin_m = Vec3::new(0.0, 0.0, up_m);
        assert_whole(
            &plane(origin_m, Vec3::x(), Vec3::y(), 60),
            origin_m,
            Vec3::z(),
        );
    }
}

#[test]
fn a_vertical_wall_is_not_cut() {
    for axis in [Vec3::x(), Vec3::y()] {
        let across = axis.cross(&Vec3::z());
        let origin_m = axis * 0.05;
        let normal = across.cross(&Vec3::z());
        assert_whole(&plane(origin_m, across, Vec3::z(), 60), origin_m, normal);
    }
}

#[test]
fn tilted_planes_are_not_cut() {
    for tilt_deg in [30.0_f64, 45.0, 55.0] {
        for turn_deg in [0.0_f64, 20.0, 45.0] {
            let turn = exp(&(Vec3::z() * turn_deg.to_radians()))
                * exp(&(Vec3::y() * tilt_deg.to_radians()));
            let [u, v, normal] = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| turn * axis);
            println!("{tilt_deg}° {turn_deg}°");
            assert_whole(&plane(Vec3::zeros(), u, v, 60), Vec3::zeros(), normal);
        }
    }
}

#[test]
fn turned_voxels_do_not_cut_floors_and_walls() {
    let grid = Grid::across(&[Vec3::x(), Vec3::z()], SIZE_M);
    for [u, v] in [
        [Vec3::x(), Vec3::y()],
        [Vec3::y(), Vec3::z()],
        [Vec3::z(), Vec3::x()],
    ] {
        for up_m in [0.0, 0.01, 0.03] {
            let normal = u.cross(&v);
            let origin_m = normal * up_m;
            assert_whole_in(grid, &plane(origin_m, u, v, 60), origin_m, normal);
        }
    }
}

#[test]
fn degenerate_points_form_no_surfels() {
    for passes in [
        vec![Vec::new(); PASSES],
        vec![vec![Vec3::repeat(0.01); 50]; PASSES],
    ] {
        let association = associated(&passes, &[]);
        assert!(association.surfels.is_empty() && association.drives[0].rows.is_empty());
    }
    // A line has no normal.
    let line: Vec<Vec3> = (0..200).map(|i| Vec3::x() * 1e-3 * f64::from(i)).collect();
    assert!(associated(&vec![line; PASSES], &[]).surfels.is_empty());
}

/// Soil, and a board above it that ends within a voxel.
fn step_edge(board_m: f64) -> Vec<Vec<Vec3>> {
    let soil = plane(Vec3::new(0.0, 0.0, 0.02), Vec3::x(), Vec3::y(), 60);
    let raise = |point: Vec3| {
        let on_board = point.x > 0.025;
        Vec3::new(
            point.x,
            point.y,
            point.z + if on_board { board_m } else { 0.0 },
        )
    };
    let pass = |points: Vec<Vec3>| points.into_iter().map(raise).collect();
    soil.into_iter().map(pass).collect()
}

#[test]
fn a_board_above_soil_has_surfels_of_its_own_up_to_its_edge() {
    for board_m in [0.05, 0.10, 0.15] {
        let association = associated(&step_edge(board_m), &[]);
        // The columns of the edge: x from 0 to 50 mm.
        let at_edge = |s: &&crate::joint::surfel::Surfel| (0.0..0.05).contains(&s.centre_m.x);
        let heights_m: Vec<f64> = association
            .surfels
            .iter()
            .filter(at_edge)
            .map(|surfel| surfel.centre_m.z)
            .collect();
        let near = |z: f64| heights_m.iter().filter(|h| (*h - z).abs() < 1e-3).count();
        println!(
            "board {board_m} m: {} of {}",
            near(0.02) + near(0.02 + board_m),
            heights_m.len()
        );
        // Twelve columns along the edge, two surfels in each.
        assert_eq!(
            (near(0.02), near(0.02 + board_m)),
            (12, 12),
            "board {board_m} m"
        );
        assert_eq!(heights_m.len(), 24, "nothing in between");
    }
}

#[test]
fn a_low_step_within_a_voxel_counts_as_rough() {
    // A step of two centimetres in a voxel of five looks like a ramp; its rows get a matching noise.
    let association = associated(&step_edge(0.02), &[]);
    for surfel in &association.surfels {
        let off_m = [0.02, 0.04].map(|z| (surfel.centre_m.z - z).abs());
        let on_either = off_m[0] < 1e-3 || off_m[1] < 1e-3;
        assert!(on_either || surfel.scatter_m > 0.004, "{surfel:?}");
    }
}
