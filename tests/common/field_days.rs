//! Days of a simulated campaign, with their truth: each is a short drive over cloddy soil, with different ground,
//! motion and noise, and poses from IMU, heading and positions of RTK quality.
#![allow(dead_code)] // tests and examples use their parts

use std::path::Path;

use boresight::Result;
use boresight::calibration::{ScannerFromScanner, relative};
use boresight::drift::Overlap;
use boresight::geometry::euler::euler_deg_from_rotation;
use boresight::geometry::{BodyFromScanner, EulerConvention, Vec3, so3};
use boresight::pipeline::{Rig, overlap};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::simulation::{Scenario, simulate};

/// A knock of the right scanner: metres and degrees along and about the axes of the body.
#[derive(Debug, Clone, Copy)]
pub struct Knock {
    pub shift_m: [f64; 3],
    pub turn_deg: [f64; 3],
}

/// Initial error of the mounting in use, as a calibration leaves it: metres and radians.
const CALIBRATION_ERROR: ([f64; 3], [f64; 3]) = ([2e-4, -3e-4, 2e-4], [2e-4, -1e-4, 2e-4]);

/// Standard deviation of positions, metres, and their rate, Hz.
const RTK: (f64, f64) = (0.012, 5.0);

/// One day.
pub struct FieldDay {
    pub project: Project,
    /// The scanners with the mountings in use.
    pub rig: Rig,
    /// True offset of the right scanner from the mounting in use, in the frame of the left one: metres, radians.
    pub truth: [f64; 6],
}

/// The field of a day; `passes` of five metres, 0.6 m apart.
pub fn scenario(seed: u64, day: u64, passes: usize) -> Scenario {
    let mut scenario = Scenario::plain();
    scenario.seed = 1000 * seed + day;
    scenario.drives[0].passes.truncate(passes);
    scenario.field.margin_m = 3.0;
    scenario.field.size_m = [7.5, 2.0 + 0.6 * passes as f64];
    (scenario.prism.sigma_m, scenario.prism.rate_hz) = RTK;
    (
        scenario.reference.board_spacing_m,
        scenario.reference.soil_spacing_m,
    ) = (0.1, 0.1);
    scenario
}

impl FieldDay {
    /// Simulates a day into a folder, after a knock if there is one.
    pub fn new(mut scenario: Scenario, knock: Option<&Knock>, folder: &Path) -> Result<Self> {
        let convention = EulerConvention::Bonn;
        let in_use = {
            let mut mountings = scenario.true_mountings();
            let [shift, turn] = [CALIBRATION_ERROR.0, CALIBRATION_ERROR.1].map(Vec3::from);
            mountings[1] = mountings[1].perturbed(&turn, &shift);
            mountings
        };
        if let Some(knock) = knock {
            let turn = Vec3::from(knock.turn_deg).map(f64::to_radians);
            let knocked = scenario.true_mountings()[1].perturbed(&turn, &knock.shift_m.into());
            scenario.scanners[1].translation_m = knocked.translation_m.into();
            scenario.scanners[1].rotation_deg =
                euler_deg_from_rotation(convention, &knocked.rotation);
        }
        let files = simulate(&scenario, folder, &Silent)?;
        let project = Project::read(&files.drives[0].project)?;
        let truth = right_in_left(&scenario.true_mountings());
        Ok(Self {
            rig: Rig::new(&project).with_poses(&in_use),
            project,
            truth: offset(&right_in_left(&in_use), &truth),
        })
    }

    pub fn overlap(&self) -> Result<Overlap> {
        overlap(&self.project, &self.rig, &Silent)
    }
}

pub fn right_in_left(mountings: &[BodyFromScanner]) -> ScannerFromScanner {
    relative(&mountings[0], &mountings[1])
}

/// Difference of two mountings: metres and radians along and about the axes of the left scanner.
pub fn offset(from: &ScannerFromScanner, to: &ScannerFromScanner) -> [f64; 6] {
    let shift = to.translation_m - from.translation_m;
    let turn = so3::log(&(to.rotation * from.rotation.inverse()));
    [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
}

/// The date of a day, from 1 May 2025 on.
pub fn date(day: u64) -> String {
    match day {
        1..=31 => format!("2025-05-{day:02}"),
        _ => format!("2025-06-{:02}", day - 31),
    }
}
