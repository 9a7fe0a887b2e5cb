//! The origin of a project that states none.

use crate::format;
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::project::{Motion, Project};

/// Origins are multiples of this, metres: a drive then lies within some kilometres of its origin, where even numbers in
/// single precision resolve less than a millimetre.
const STEP_M: f64 = 1000.0;

/// The project with an origin near its first position if it states none. Positions that cannot be read leave the origin
/// as it is, since the stage that needs them reports their error.
pub fn with_origin(project: &Project, progress: &dyn Progress) -> Project {
    let mut project = project.clone();
    if project.has_zero_origin || project.origin_m != Vec3::zeros() {
        return project;
    }
    if let Some(first_m) = first_position_m(&project) {
        // Adding zero removes the sign of a negative zero, which would be another number in a file.
        project.origin_m = first_m.map(|m| (m / STEP_M).round() * STEP_M + 0.0);
    }
    if project.origin_m != Vec3::zeros() {
        let [east, north, up] = project.origin_m.into();
        progress.warn(&format!(
            "the project states no origin: [{east:?}, {north:?}, {up:?}] m is used, near the first position; results \
             have the coordinates of the files"
        ));
    }
    project
}

/// The first position of the logs, or of the poses, in the world.
fn first_position_m(project: &Project) -> Option<Vec3> {
    let crs = project.crs.as_ref();
    match &project.motion {
        Motion::Logs(logs) => {
            let log = logs.positions.first()?;
            let read = format::read_projected_positions(&log.path, &log.observations, crs);
            Some(read.ok()?.fixes.first()?.position_m)
        }
        Motion::Poses(file) => {
            let path = file.paths().next()?;
            let read = format::read_projected_trajectory(path, project.axes, crs);
            Some(read.ok()?.first()?.world_from_body.translation_m)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    /// The origin for a drive with these first coordinates, in a project with this frame.
    fn origin_m(first: &str, frame: &str, is_log: bool) -> Vec3 {
        let folder = tempfile::tempdir().unwrap();
        let write =
            |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        let motion = if is_log {
            "[imu]\nfile = \"imu.csv\"\n[prism]\nfile = \"prism.csv\"\nlever_arm_m = [0, 0, 0]\n"
        } else {
            "[trajectory]\nfile = \"poses.csv\"\n"
        };
        write("project.toml", &format!("{frame}{motion}"));
        write(
            "prism.csv",
            &format!("time_s,east_m,north_m,up_m\n0,{first}\n"),
        );
        let columns = "time_s,east_m,north_m,up_m,qx,qy,qz,qw";
        write(
            "poses.csv",
            &format!("{columns}\n0,{first},0,0,0,1\n1,{first},0,0,0,1\n"),
        );
        let project = Project::read(&folder.path().join("project.toml")).unwrap();
        with_origin(&project, &Silent).origin_m
    }

    #[test]
    fn an_origin_that_is_not_stated_lies_near_the_first_position() {
        let utm_m = Vec3::new(350_000.0, 5_600_000.0, 0.0);
        for is_log in [true, false] {
            assert_eq!(origin_m("350123.4,5599876.5,-60.0", "", is_log), utm_m);
            let stated = "[frame]\norigin_m = [350100.0, 5599800.0, 1.0]\n";
            let stated_m = Vec3::new(350_100.0, 5_599_800.0, 1.0);
            assert_eq!(origin_m("350123.4,5599876.5,60", stated, is_log), stated_m);
            let zero = "[frame]\norigin_m = [0, 0, 0]\n";
            let zero_m = origin_m("350123.4,5599876.5,60", zero, is_log);
            assert_eq!(zero_m, Vec3::zeros());
            let local_m = origin_m("-12.5,499.0,60.0", "", is_log);
            assert!(local_m.iter().all(|m| m.to_bits() == 0), "{local_m}");
        }
    }

    #[test]
    fn positions_that_cannot_be_read_leave_the_origin_to_the_stage_that_reads_them() {
        assert_eq!(origin_m("east,5600000,60", "", true), Vec3::zeros());
    }
}
