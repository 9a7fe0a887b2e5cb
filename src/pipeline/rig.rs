//! The scanners with the values that a run uses.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::calibration::{CalibrationSettings, Mounting};
use crate::error::Result;
use crate::geometry::BodyFromScanner;
use crate::georeference::Georeferencer;
use crate::joint::Compliance;
use crate::project::{Project, Scanner};
use crate::trajectory::Trajectory;

/// Edge of the cells in which passes are compared, in finest voxels of the calibration: that of a surfel, which holds
/// enough points for its slopes.
pub const PASS_CELL_VOXELS: f64 = 10.0;

/// The scanners of a drive with the values that a run uses, in the order of its project, and the scales that suit their
/// points. A run begins with the values of the project; each stage then uses the results of earlier stages.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    /// The mountings.
    pub mountings: Vec<Mounting>,
    /// Common time = scanner time + this, seconds.
    pub time_offsets_s: Vec<f64>,
    /// The change of each mounting with the load on the frame, if it is known.
    pub compliance: Vec<Option<Compliance>>,
    /// Scales of the calibration from coarse to fine, metres.
    pub voxel_sizes_m: Vec<f64>,
}

impl Rig {
    /// The values of a project.
    pub fn new(project: &Project) -> Self {
        Self::of(&project.scanners, project)
    }

    /// The values of a project, with the values of its scanners from a `calibration.toml`.
    ///
    /// # Errors
    /// See [`Project::calibrated_scanners`].
    pub fn calibrated(project: &Project, calibration: &Path) -> Result<Self> {
        Ok(Self::of(
            &project.calibrated_scanners(calibration)?,
            project,
        ))
    }

    fn of(scanners: &[Scanner], project: &Project) -> Self {
        let mounting = |scanner: &Scanner| Mounting {
            name: scanner.name.clone(),
            body_from_scanner: scanner.body_from_scanner,
            convention: scanner.convention,
            fixed: scanner.fixed,
        };
        Self {
            mountings: scanners.iter().map(mounting).collect(),
            time_offsets_s: scanners.iter().map(|s| s.time_offset_s).collect(),
            compliance: scanners.iter().map(|s| s.compliance).collect(),
            voxel_sizes_m: project.calibration.voxel_sizes_m.clone(),
        }
    }

    /// The values of the project of another drive, with the scales of this one.
    pub fn of_drive(&self, other: &Project) -> Self {
        Self {
            voxel_sizes_m: self.voxel_sizes_m.clone(),
            ..Self::new(other)
        }
    }

    /// A copy with these poses of the scanners on the body.
    pub fn with_poses(&self, poses: &[BodyFromScanner]) -> Self {
        let mut rig = self.clone();
        for (mounting, pose) in rig.mountings.iter_mut().zip(poses) {
            mounting.body_from_scanner = *pose;
        }
        rig
    }

    /// Poses of the scanners on the body.
    pub fn poses(&self) -> Vec<BodyFromScanner> {
        let mountings = self.mountings.iter();
        mountings.map(|m| m.body_from_scanner).collect()
    }

    /// Places points of the scanner with this number on a trajectory.
    pub fn georeferencer<'a>(
        &self,
        scanner: usize,
        trajectory: &'a Trajectory,
    ) -> Georeferencer<'a> {
        let pose = self.mountings[scanner].body_from_scanner;
        Georeferencer::new(trajectory, pose, self.time_offsets_s[scanner])
    }

    /// The settings of a project's calibration with these scales.
    pub fn settings(&self, project: &Project) -> CalibrationSettings {
        CalibrationSettings {
            voxel_sizes_m: self.voxel_sizes_m.clone(),
            ..project.calibration.clone()
        }
    }

    /// The finest scale, metres.
    pub fn finest_m(&self) -> f64 {
        let sizes = self.voxel_sizes_m.iter().copied();
        sizes.fold(f64::INFINITY, f64::min)
    }

    /// The scanners of a project with these values, for a project file.
    pub fn scanners(&self, project: &Project) -> Vec<Scanner> {
        let scanners = project.scanners.iter().enumerate();
        let known = scanners.map(|(number, scanner)| Scanner {
            body_from_scanner: self.mountings[number].body_from_scanner,
            convention: self.mountings[number].convention,
            time_offset_s: self.time_offsets_s[number],
            compliance: self.compliance[number],
            ..scanner.clone()
        });
        known.collect()
    }
}
