//! Days of a simulated campaign: a short drive over cloddy soil each, with its own ground, motion and noise, poses
//! from IMU, heading and positions as good as those of RTK; and the truth.
#![allow(dead_code)] // tests and examples use their parts

use std::path::Path;

use boresight::Result;
use boresight::calibration::{ScannerFromScanner, relative};
use boresight::drift::Overlap;
use boresight::geometry::euler::euler_deg_from_rotation;
use boresight::geometry::{BodyFromScanner, EulerConvention, Vec3, so3};
use boresight::pipeline::{overlap, stages};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::simulation::{Scenario, simulate};

/// What knocks the right scanner: metres and degrees along and about the axes of the body.
#[derive(Debug, Clone, Copy)]
pub struct Knock {
    pub shift_m: [f64; 3],
    pub turn_deg: [f64; 3],
}

/// The mounting in use is so far from the true one from the beginning: what a calibration leaves.
const LEFT: ([f64; 3], [f64; 3]) = ([2e-4, -3e-4, 2e-4], [2e-4, -1e-4, 2e-4]);

/// Positions are so good, metres, and so many a second.
const RTK: (f64, f64) = (0.012, 5.0);

/// One day.
pub struct FieldDay {
    pub project: Project,
    /// How far the right scanner truly sits off the mounting in use, in the frame of the left one: metres, radians.
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
    /// Simulates a day into a folder, after a knock or before.
    pub fn new(mut scenario: Scenario, knock: Option<&Knock>, folder: &Path) -> Result<Self> {
        let convention = EulerConvention::Bonn;
        let in_use = {
            let mut mountings = scenario.true_mountings();
            let [shift, turn] = [LEFT.0, LEFT.1].map(Vec3::from);
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
            project: stages::with_mountings(&project, &in_use),
            truth: offset(&right_in_left(&in_use), &truth),
        })
    }

    pub fn overlap(&self) -> Result<Overlap> {
        overlap(&self.project, &Silent)
    }
}

pub fn right_in_left(mountings: &[BodyFromScanner]) -> ScannerFromScanner {
    relative(&mountings[0], &mountings[1])
}

/// From one to the other: metres and radians along and about the axes of the left scanner.
pub fn offset(from: &ScannerFromScanner, to: &ScannerFromScanner) -> [f64; 6] {
    let shift = to.translation_m - from.translation_m;
    let turn = so3::log(&(to.rotation * from.rotation.inverse()));
    [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
}

/// A date in May and June.
pub fn date(day: u64) -> String {
    match day {
        1..=31 => format!("2025-05-{day:02}"),
        _ => format!("2025-06-{:02}", day - 31),
    }
}
