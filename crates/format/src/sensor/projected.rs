//! Geographic positions and poses in a projected coordinate reference system.

use super::{GeographicFix, GeographicPose, NavigationAngles, PoseRecord, PoseSigma, PositionFix};
use crate::error::{Error, Result};
use crate::geometry::{Mat3, Misfit, Projection, Rotation, Vec3, WorldFromBody};

/// Projects positions to east, north and up of `system`, without a datum shift; up is the ellipsoidal
/// height. Standard deviations along true east and north become covariances along grid east and
/// north.
///
/// # Errors
/// A position outside the system, named with its time.
pub fn project_fixes(fixes: &[GeographicFix], system: &Projection) -> Result<Vec<PositionFix>> {
    let project = |fix: &GeographicFix| {
        let point = system
            .try_project(fix.latitude_rad, fix.longitude_rad)
            .map_err(|misfit| outside(fix.time_s, &misfit))?;
        let covariance_m2 = fix
            .sigma_m
            .map(|sigma| turned(&point.grid_from_true(), &sigma));
        Ok(PositionFix {
            time_s: fix.time_s,
            position_m: Vec3::new(point.east_m, point.north_m, fix.height_m),
            covariance_m2,
        })
    };
    fixes.iter().map(project).collect()
}

/// Projects poses to east, north and up of `system`, without a datum shift; up is the ellipsoidal height. Attitudes are
/// those of a body with x forward, y left, z up against grid north. Velocities are the derivatives of the projected
/// positions, so they have the scale of the projection.
///
/// # Errors
/// A position outside the system, named with its time.
pub fn project_poses(poses: &[GeographicPose], system: &Projection) -> Result<Vec<PoseRecord>> {
    let project = |pose: &GeographicPose| {
        project_pose(pose, system).map_err(|misfit| outside(pose.time_s, &misfit))
    };
    poses.iter().map(project).collect()
}

/// Projects a pose as [`project_poses`] does.
///
/// # Errors
/// A position outside the system.
fn project_pose(
    pose: &GeographicPose,
    system: &Projection,
) -> std::result::Result<PoseRecord, Misfit> {
    let point = system.try_project(pose.latitude_rad, pose.longitude_rad)?;
    let turn = point.grid_from_true();
    let place_m = Vec3::new(point.east_m, point.north_m, pose.height_m);
    let stretch = Vec3::new(point.scale, point.scale, 1.0);
    let velocity_m_s = pose.velocity_m_s;
    let sigma = pose.sigma.map(|sigma| {
        let angles = NavigationAngles {
            heading: pose.angles.heading - point.convergence_rad,
            ..pose.angles
        };
        PoseSigma {
            position_m: turned(&turn, &sigma.position_m).diagonal().map(f64::sqrt),
            ..angles.pose_sigma(&sigma)
        }
    });
    Ok(PoseRecord {
        velocity_m_s: velocity_m_s.map(|velocity| (turn * velocity).component_mul(&stretch)),
        sigma,
        ..PoseRecord::new(
            pose.time_s,
            WorldFromBody::new(turn * pose.angles.rotation(), place_m),
        )
    })
}

/// The error of a position outside a system.
fn outside(time_s: f64, misfit: &Misfit) -> Error {
    Error::data(
        format!("position at {time_s} s: {}", misfit.found),
        format!("use {}", misfit.expected),
    )
}

/// The covariance of independent values along true east, north and up with these standard deviations, along the axes of
/// the grid.
fn turned(grid_from_true: &Rotation, sigma: &Vec3) -> Mat3 {
    let turn = grid_from_true.to_rotation_matrix();
    let along_true = Mat3::from_diagonal(&sigma.component_mul(sigma));
    turn.matrix() * along_true * turn.matrix().transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_projected_and_their_covariances_turned() {
        let system = Projection::new("EPSG:25832").unwrap();
        let fix = GeographicFix {
            time_s: 3.5,
            latitude_rad: 50.7f64.to_radians(),
            longitude_rad: 6.2f64.to_radians(),
            height_m: 123.25,
            sigma_m: Some(Vec3::new(0.01, 0.03, 0.05)),
            quality: None,
        };
        let found = project_fixes(&[fix], &system).unwrap()[0];
        // pyproj 3.7.2, Proj("EPSG:25832")(6.2, 50.7).
        let expected = Vec3::new(302_276.343_692_3, 5_620_204.618_403_7, 123.25);
        assert!((found.position_m - expected).norm() < 1e-6, "{found:?}");
        assert_eq!(found.time_s, 3.5);
        let covariance = found.covariance_m2.unwrap();
        let point = system.project(fix.latitude_rad, fix.longitude_rad).unwrap();
        // The larger deviation is along true north, which lies east of grid north here.
        let north = point.grid_from_true() * Vec3::y();
        assert!(north.x > 0.03);
        assert!(((covariance * north) - north * 9e-4).norm() < 1e-15);
        assert!((covariance[(2, 2)] - 25e-4).abs() < 1e-15);
        let nowhere = GeographicFix {
            latitude_rad: 2.0,
            ..fix
        };
        let error = project_fixes(&[fix, nowhere], &system).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("position at 3.5 s: latitude 114.59"),
            "{error}"
        );
    }
}
