//! What a whole run is given beside the project, and what it finds.

use crate::calibration::{Calibration, Variant};
use crate::comparison::MountingKind;
use crate::geometry::{BodyFromScanner, Vec3};
use crate::progress::StageSeconds;
use crate::report::content::Drive;
use crate::trajectory::Trajectory;

/// What a run does beside the plain work.
#[derive(Debug, Clone, Default)]
pub struct Extras {
    /// The command as typed, for the report.
    pub command: String,
    /// The seed of every random draw, where there is one.
    pub seed: Option<u64>,
    /// The truth, where it is known.
    pub truth: Option<Truth>,
    /// Scales at which the paper's own method is run beside ours; empty for none.
    pub paper_voxels_m: Vec<f64>,
}

/// What a simulated project knows beside its files.
#[derive(Debug, Clone)]
pub struct Truth {
    /// True mountings in the order of the project's scanners.
    pub mountings: Vec<BodyFromScanner>,
    /// True poses of the calibration drive.
    pub trajectory: Trajectory,
}

/// Everything a run found.
#[derive(Debug)]
pub struct Findings {
    /// The calibration: with the reference where there is one.
    pub calibration: Calibration,
    /// The same drive calibrated under other conditions.
    pub beside: Vec<(Variant, Calibration)>,
    /// The mountings that clouds were compared under, in the order of the project's scanners.
    pub mountings: Vec<(MountingKind, Vec<BodyFromScanner>)>,
    /// The calibration drive, then the evaluation drives.
    pub drives: Vec<Drive>,
    /// The reference, thinned for drawing, the project's origin subtracted.
    pub background_m: Vec<Vec3>,
    /// Run times in order.
    pub stages: Vec<StageSeconds>,
    /// What somebody should look at.
    pub warnings: Vec<String>,
}
