//! The size of surfels by what they leave of the ground.

use super::columns::{NOISE_M, SIZE_M, associated_in, plane};
use crate::geometry::Vec3;
use crate::joint::surfel::Grid;

/// Points on ground of this height (a function of east and north) that a fan along east sees strip by strip, each 2 cm
/// wide and at its own time.
fn ground(height_m: impl Fn(f64, f64) -> f64) -> Vec<Vec<Vec3>> {
    let mut strips = Vec::new();
    for mut pass in plane(Vec3::zeros(), Vec3::x(), Vec3::y(), 100) {
        pass.sort_by(|a, b| a.y.total_cmp(&b.y));
        pass.iter_mut()
            .for_each(|point| point.z += height_m(point.x, point.y));
        let strip = |point: &Vec3| (point.y / 0.02).floor();
        strips.extend(
            pass.chunk_by(|a, b| strip(a) == strip(b))
                .map(<[Vec3]>::to_vec),
        );
    }
    strips
}

/// The sizes of the surfels of this ground, without those at the rim.
fn sizes_m(passes: &[Vec<Vec3>]) -> Vec<f64> {
    let grid = Grid::across(&[Vec3::x()], SIZE_M);
    let association = associated_in(&[grid, grid.with_size(0.5 * SIZE_M)], passes, &[]);
    let inside = association
        .surfels
        .iter()
        .filter(|surfel| surfel.centre_m.norm() < 0.4);
    inside.map(|surfel| surfel.size_m).collect()
}

/// Crumbs of 4 cm in the eastern half.
fn crumbs_in_the_east(east_m: f64, north_m: f64) -> f64 {
    let wave = |along_m: f64| (std::f64::consts::TAU * along_m / 0.08).sin();
    let height_m = 10.0 * NOISE_M * wave(east_m) * wave(north_m);
    if east_m > 0.0 { height_m } else { 0.0 }
}

#[test]
fn flat_ground_keeps_its_large_surfels() {
    let sizes_m = sizes_m(&ground(|_, _| 0.0));
    assert!(sizes_m.len() > 150 && sizes_m.iter().all(|&size_m| size_m == SIZE_M));
}

#[test]
fn ground_that_bends_less_than_its_noise_keeps_its_large_surfels() {
    // A curvature of 0.5 /m lifts the rim of a surfel by 0.16 mm, noise is 0.5 mm.
    let sizes_m = sizes_m(&ground(|_, north_m| 0.25 * north_m * north_m));
    assert!(sizes_m.iter().all(|&size_m| size_m == SIZE_M));
}

#[test]
fn rough_ground_is_followed_by_small_surfels_and_flat_ground_beside_it_by_large_ones() {
    let passes = ground(crumbs_in_the_east);
    let grid = Grid::across(&[Vec3::x()], SIZE_M);
    let association = associated_in(&[grid, grid.with_size(0.5 * SIZE_M)], &passes, &[]);
    let of_side = |side: f64| {
        // Regions are 40 cm wide.
        let there = association
            .surfels
            .iter()
            .filter(move |surfel| side * surfel.centre_m.x > 0.0);
        let large = there
            .clone()
            .filter(|surfel| surfel.size_m == SIZE_M)
            .count();
        (large, there.count() - large)
    };
    let (flat, rough) = (of_side(-1.0), of_side(1.0));
    println!("flat {flat:?} rough {rough:?}");
    assert!(flat.0 > 2 * flat.1 && rough.1 > 20 * rough.0);
}

#[test]
fn no_point_has_two_rows_where_sizes_meet() {
    let passes = ground(crumbs_in_the_east);
    let grid = Grid::across(&[Vec3::x()], SIZE_M);
    let association = associated_in(&[grid, grid.with_size(0.5 * SIZE_M)], &passes, &[]);
    let rows = &association.drives[0];
    let mut held: Vec<[u64; 3]> = rows
        .rows
        .iter()
        .flat_map(|row| rows.points_of(row))
        .map(|point| [point.position_m.x, point.position_m.y, point.position_m.z].map(f64::to_bits))
        .collect();
    let all = held.len();
    held.sort_unstable();
    held.dedup();
    let twice = all - held.len();
    println!("{twice} of {all} points twice");
    assert!(twice < all / 1000);
}
