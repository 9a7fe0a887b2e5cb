//! A project in work: beside it, what a run finds out about it.

use std::collections::BTreeMap;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::format::{self, Input};
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::project::{Motion, Project};

/// Origins are multiples of this, metres: a drive then lies within some kilometres of its origin, where even numbers in
/// single precision resolve less than a millimetre.
const STEP_M: f64 = 1000.0;

/// A project whose files are read, with the origin in use. The format of a file is detected, and a compressed file is
/// unpacked, once for the project and its other drives.
#[derive(Debug)]
pub struct OpenProject {
    project: Project,
    /// Stated by the project, or chosen; `None`: zero.
    origin_m: Option<Vec3>,
    inputs: Arc<Mutex<BTreeMap<PathBuf, Input>>>,
}

impl Deref for OpenProject {
    type Target = Project;

    fn deref(&self) -> &Project {
        &self.project
    }
}

impl OpenProject {
    /// A project with the origin that it states, or none.
    pub fn new(project: &Project) -> Self {
        Self {
            project: project.clone(),
            origin_m: project.origin_m,
            inputs: Arc::default(),
        }
    }

    /// A project with an origin near its first position if it states none. Positions that cannot be read leave the origin
    /// at zero, since the stage that needs them reports their error.
    pub fn with_origin(project: &Project, progress: &dyn Progress) -> Self {
        let mut open = Self::new(project);
        if open.origin_m.is_some() {
            return open;
        }
        // Adding zero removes the sign of a negative zero, which would be another number in a file.
        let near = |first_m: Vec3| first_m.map(|m| (m / STEP_M).round() * STEP_M + 0.0);
        let origin_m = open.first_position_m().map(near);
        open.origin_m = origin_m.filter(|origin_m| *origin_m != Vec3::zeros());
        if let Some(origin_m) = open.origin_m {
            let [east, north, up] = origin_m.into();
            progress.warn(&format!(
                "the project states no origin: [{east:?}, {north:?}, {up:?}] m is used, near the first position; results \
                 have the coordinates of the files"
            ));
        }
        open
    }

    /// Another drive of this project, in the same world.
    pub fn drive(&self, project: Project) -> Self {
        Self {
            project,
            origin_m: self.origin_m,
            inputs: self.inputs.clone(),
        }
    }

    /// What is subtracted from world coordinates on reading and added on writing, metres.
    pub fn origin_m(&self) -> Vec3 {
        self.origin_m.unwrap_or_default()
    }

    /// The project with the origin in use, which as a file gives the same results.
    pub fn as_used(&self) -> Project {
        Project {
            origin_m: self.origin_m,
            ..self.project.clone()
        }
    }

    /// A file for one reading.
    pub fn input(&self, path: &Path) -> Input {
        let inputs = self.inputs.lock();
        let mut inputs = inputs.unwrap_or_else(PoisonError::into_inner);
        let input = inputs.entry(path.to_owned());
        input.or_insert_with(|| Input::from(path)).again()
    }

    /// The first position of the logs, or of the poses, in the world.
    fn first_position_m(&self) -> Option<Vec3> {
        let crs = self.crs.as_ref();
        match &self.motion {
            Motion::Logs(logs) => {
                let log = logs.positions.first()?;
                let input = self.input(&log.path);
                let read = format::read_projected_positions(&input, &log.observations, crs);
                Some(read.ok()?.fixes.first()?.position_m)
            }
            Motion::Poses(file) => {
                let input = self.input(file.paths().next()?);
                let read = format::read_projected_trajectory(&input, self.axes, crs);
                Some(read.ok()?.first()?.world_from_body.translation_m)
            }
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
        OpenProject::with_origin(&project, &Silent).origin_m()
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

    #[test]
    fn the_format_of_a_file_is_detected_once_for_all_drives_and_readings() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.csv");
        let project = folder.path().join("project.toml");
        std::fs::write(&project, "[trajectory]\nfile = \"poses.csv\"\n").unwrap();
        std::fs::write(&path, "time_s,east_m,north_m,up_m\n0,1,2,3\n").unwrap();
        let project = Project::read(&project).unwrap();
        let open = OpenProject::new(&project);
        let first = format::detect(open.input(&path)).unwrap();
        std::fs::write(&path, "time_s,heading_deg\n0,1\n").unwrap();
        assert!(format::detect(&path).unwrap().id() != first.id());
        for open in [&open, &open.drive(project.clone())] {
            assert_eq!(format::detect(open.input(&path)).unwrap().id(), first.id());
        }
        // Remarks belong to a reading.
        open.input(&path).remark("a row without a value");
        assert!(open.input(&path).remarks().is_empty());
    }
}
