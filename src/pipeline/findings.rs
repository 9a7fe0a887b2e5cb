//! Options and results of a whole run.

use std::path::PathBuf;

use super::rig::Rig;
use crate::error::Error;
use crate::geometry::{BodyFromScanner, Vec3};
use crate::judgement;
use crate::progress::StageSeconds;
use crate::report::content::InputFile;
use crate::report::scene::Scene;
use crate::results::{Calibrations, Drive, FirstPlacement, Results};
use crate::trajectory::Trajectory;
use crate::verdict::Verdict;

/// Options of a run beyond the project.
#[derive(Debug, Clone, Default)]
pub struct Extras {
    /// The command as typed, for the report.
    pub command: String,
    /// Seed of all random numbers, if there is one.
    pub seed: Option<u64>,
    /// The truth, if it is known.
    pub truth: Option<Truth>,
    /// Whether two steps are also run without the reference, for comparison.
    pub without_reference: bool,
    /// Scales at which the paper's method is run for comparison; empty for none.
    pub paper_voxels_m: Vec<f64>,
}

/// The truth of a simulated project.
#[derive(Debug, Clone)]
pub struct Truth {
    /// True mountings in the order of the project's scanners.
    pub mountings: Vec<BodyFromScanner>,
    /// True poses of the calibration drive.
    pub trajectory: Trajectory,
}

/// All results of a run.
#[derive(Debug)]
pub struct Findings {
    /// The scanners with the resulting values.
    pub rig: Rig,
    /// The calibration, with the values with which it is compared.
    pub calibrations: Calibrations,
    /// The calibration drive, then the evaluation drives.
    pub drives: Vec<Drive>,
    /// The clouds of each drive for the viewer.
    pub scenes: Vec<Option<Scene>>,
    /// The reference, thinned for drawing, with the project's origin subtracted.
    pub background_m: Vec<Vec3>,
    /// When the results were computed, seconds since 1970.
    pub made_s: f64,
    /// The files that were read.
    pub files: Vec<InputFile>,
    /// Run times in order.
    pub stages: Vec<StageSeconds>,
    /// The first placement of the scans.
    pub placement: FirstPlacement,
    /// Results that need attention.
    pub warnings: Vec<String>,
    /// The verdicts on the results, the gravest first.
    pub verdicts: Vec<Verdict>,
    /// The stages kept for later runs; `None` if they cannot be kept.
    pub kept_stages: Option<KeptStages>,
}

impl Findings {
    /// Marks the findings as those of a run that ended with this error before its last stage.
    pub fn end_early(&mut self, error: &Error) {
        self.verdicts.push(judgement::ended_early(error));
        judgement::attention_first(&mut self.verdicts);
    }

    /// The results to be judged.
    pub fn results(&self) -> Results<'_> {
        Results {
            drives: &self.drives,
            placement: Some(&self.placement),
            calibrations: Some(&self.calibrations),
        }
    }
}

/// Stages kept for later runs.
#[derive(Debug, Clone, PartialEq)]
pub struct KeptStages {
    /// Their folder, which may be removed.
    pub folder: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// The stages that an earlier run had finished, and this run reused.
    pub reused: Vec<String>,
}
