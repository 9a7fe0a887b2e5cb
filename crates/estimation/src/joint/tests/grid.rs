//! The orientation of the surfels' voxels.

use crate::geometry::Vec3;
use crate::geometry::so3::exp;
use crate::joint::surfel::Grid;

const SIZE_M: f64 = 0.05;

#[test]
fn profiles_cross_voxels_obliquely() {
    // Fans across and along the field, on walls, and on all diagonals.
    let turned = |deg: f64| exp(&(Vec3::z() * deg.to_radians())) * Vec3::x();
    for headings_deg in [
        vec![0.0],
        vec![0.0, 90.0],
        vec![20.0, 110.0],
        vec![0.0, 53.0, 90.0, 127.0],
    ] {
        let mut profiles: Vec<Vec3> = headings_deg.iter().map(|&deg| turned(deg)).collect();
        profiles.push(Vec3::z());
        let grid = Grid::across(&profiles, SIZE_M);
        for profile in &profiles {
            let layers = grid.place(profile) / SIZE_M;
            // One orientation for up to five directions: nearly a whole voxel along each axis.
            assert!(layers.iter().all(|layers| layers.abs() > 0.8));
            assert!((grid.world(&grid.place(profile)) - profile).norm() < 1e-12);
        }
    }
}
