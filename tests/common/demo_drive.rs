//! A drive of the demo, simulated and read, with known truth, and its calibration; shared by tests and
//! examples.

use std::path::Path;

use boresight::calibration::{Calibration, CalibrationSettings};
use boresight::geometry::euler::euler_deg_from_rotation;
use boresight::geometry::{BodyFromScanner, EulerConvention, Vec3};
use boresight::pipeline::stages::{self, EstimatedPoses};
use boresight::pipeline::{OpenProject, Rig};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::simulation::{Scenario, simulate};
use boresight::trajectory::Trajectory;
use boresight::{Result, format};

pub struct DemoDrive {
    pub project: Project,
    pub reference: Vec<Vec3>,
    /// Poses estimated from the logs of the drive.
    pub estimated: EstimatedPoses,
    pub exact: EstimatedPoses,
    /// True mountings.
    pub truth: Vec<BodyFromScanner>,
}

impl DemoDrive {
    /// The first drive of a scenario; its files are written into a folder.
    pub fn simulate(mut scenario: Scenario, folder: &Path) -> Result<Self> {
        scenario.drives.truncate(1);
        let files = simulate(&scenario, folder, &Silent)?;
        let project = Project::read(&files.drives[0].project)?;
        let truth = files.drives[0].folder.join("truth/trajectory.csv");
        let exact = Trajectory::new(format::read_trajectory(&truth)?)?;
        let open = &OpenProject::new(&project);
        Ok(Self {
            reference: stages::reference(open, &Silent)?,
            estimated: stages::poses(open, &Silent)?,
            exact: EstimatedPoses::from_file(exact),
            truth: scenario.true_mountings(),
            project,
        })
    }

    /// Errors of tx ty tz (m) and α β γ (degrees, `bonn`) of a scanner.
    pub fn errors(&self, calibration: &Calibration, scanner: usize) -> [f64; 6] {
        let pose = &calibration.mountings[scanner].body_from_scanner;
        let truth = &self.truth[scanner];
        let shift = pose.translation_m - truth.translation_m;
        let angles =
            |pose: &BodyFromScanner| euler_deg_from_rotation(EulerConvention::Bonn, &pose.rotation);
        let (a, b) = (angles(pose), angles(truth));
        let turn: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
        [shift.x, shift.y, shift.z, turn[0], turn[1], turn[2]]
    }
}

/// The mountings from poses and the profiles of a project, under other settings than those of the project.
pub fn calibrate(
    project: &Project,
    settings: &CalibrationSettings,
    poses: &EstimatedPoses,
    reference: &[Vec3],
) -> Result<Calibration> {
    let project = &OpenProject::new(project);
    let rig = Rig::new(project);
    let samples = stages::samples(project, &rig, poses.trajectory(), &Silent)?;
    let start = &rig.mountings;
    stages::calibration(
        project, start, settings, poses, &samples, reference, &Silent,
    )
}
