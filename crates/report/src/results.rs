//! Results of the stages, before they are judged or shown.

use serde::{Deserialize, Serialize};

use crate::calibration::{Calibration, Method, Mounting, Variant};
use crate::comparison::{Agreements, MountingKind};
use crate::geometry::{BodyFromScanner, Vec3};
use crate::joint::{Joint, JointReport};
use crate::preflight::{LogFindings, Placed, View};
use crate::sensor::{PoseRecord, RejectedRow};
use crate::trajectory::Solution;

/// The results of a run that are judged.
#[derive(Debug, Clone, Copy, Default)]
pub struct Results<'a> {
    /// The calibration drive, then the others.
    pub drives: &'a [Drive],
    /// The first placement of the scans; `None` if none were placed.
    pub placement: Option<&'a FirstPlacement>,
    /// The calibration, with the values that it is compared with.
    pub calibrations: Option<&'a Calibrations>,
}

/// The first placement of the scans, before the calibration.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct FirstPlacement {
    /// The mountings of the project.
    pub project: Vec<Mounting>,
    /// Those with which the calibration starts.
    pub start: Vec<Mounting>,
    /// How well the scans fit together with these.
    pub placed: Placed,
    /// Scanners that see what they should not.
    pub views: Vec<View>,
}

/// A calibration, with the values that it is compared with. All lists hold the same scanners in the same order.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Calibrations {
    /// The body_from_scanner of each scanner for which clouds were compared: initial, final, and
    /// the truth if it is known (simulation).
    pub mountings: Vec<(MountingKind, Vec<BodyFromScanner>)>,
    /// The calibration that gives the result.
    pub result: Calibration,
    /// The joint adjustment of the run, accepted or refused; `None` if none was asked for.
    pub joint: Option<JointReport>,
    /// Calibrations of the same drive under other conditions.
    pub variants: Vec<(Variant, Calibration)>,
    /// The project's origin, metres; it is subtracted from all coordinates in these results.
    pub origin_m: Vec3,
}

impl Calibrations {
    /// The mountings of this kind, if there are any.
    pub fn mountings(&self, kind: MountingKind) -> Option<&[BodyFromScanner]> {
        let mut all = self.mountings.iter();
        all.find(|(other, _)| *other == kind)
            .map(|(_, poses)| poses.as_slice())
    }

    /// The calibration under these conditions, if there is one.
    pub fn variant(&self, variant: Variant) -> Option<&Calibration> {
        let mut all = self.variants.iter();
        all.find(|(other, _)| *other == variant)
            .map(|(_, calibration)| calibration)
    }

    /// The calibration in two steps, if there is one.
    pub fn two_steps(&self) -> Option<&Calibration> {
        let is_result = self.result.method == Method::TwoStep;
        let two_steps = is_result.then_some(&self.result);
        two_steps.or_else(|| self.variant(Variant::TwoStep))
    }

    /// The joint adjustment whose values are the result.
    pub fn accepted(&self) -> Option<&Joint> {
        self.joint.as_ref()?.accepted()
    }

    /// The result of the joint adjustment, whether its values are used or not.
    pub fn joint_found(&self) -> Option<&Joint> {
        self.joint.as_ref()?.result.as_ref()
    }

    /// The result of the joint adjustment if its values are not used.
    pub fn refused(&self) -> Option<&Joint> {
        let is_refused = self.accepted().is_none();
        self.joint_found().filter(|_| is_refused)
    }
}

/// Results of one drive.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Drive {
    /// Name.
    pub name: String,
    /// The poses in time order, the project's origin subtracted.
    pub poses: Vec<PoseRecord>,
    /// Result of the adjustment; `None` if the poses came from a file.
    pub solution: Option<Solution>,
    /// Rows of its logs without a measurement.
    pub rejected_rows: Vec<RejectedRow>,
    /// Agreement of its clouds.
    pub agreements: Agreements,
    /// What its logs contradict.
    pub log_findings: LogFindings,
}
