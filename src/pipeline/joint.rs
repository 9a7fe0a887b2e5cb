//! The joint adjustment of the drives of a project.

use super::stages::Poses;
use crate::calibration::{Mounting, ScannerSample};
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::joint::{
    self, ChainMotion, CorrectedPoses, Joint, JointDrive, JointInput, JointSettings, Scans, adjust,
};
use crate::progress::Progress;
use crate::project::{Motion, Project};

/// One drive before the adjustment.
pub struct Drive<'a> {
    pub name: String,
    pub project: &'a Project,
    pub poses: &'a Poses,
    pub samples: &'a [ScannerSample],
}

impl<'a> Drive<'a> {
    fn joint(&self) -> Result<JointDrive<'a>> {
        let motion: Box<dyn joint::motion::Motion> =
            match (&self.poses.covariance, &self.project.motion) {
                (Some(covariance), Motion::Logs(logs)) => {
                    let names = logs.settings.positions.iter().map(|p| p.name.clone());
                    Box::new(ChainMotion::new(covariance, names.collect(), &[]))
                }
                _ => {
                    let motion = CorrectedPoses::new(&self.poses.trajectory, 5.0);
                    Box::new(motion.ok_or_else(|| {
                        Error::data(
                            "poses without standard deviations",
                            "give sigma_position_m and sigma_rotation_deg in [trajectory]",
                        )
                    })?)
                }
            };
        Ok(JointDrive {
            name: self.name.clone(),
            motion,
            scans: Scans {
                samples: self.samples.iter().collect(),
            },
        })
    }
}

/// Adjusts drives together, from these mountings.
///
/// # Errors
/// As for [`adjust`].
pub fn adjusted(
    drives: &[Drive<'_>],
    mountings: Vec<Mounting>,
    reference: &[Vec3],
    settings: &JointSettings,
    surfel_m: f64,
    progress: &dyn Progress,
) -> Result<Joint> {
    let input = JointInput {
        estimate_latency: vec![false; mountings.len()],
        mountings,
        known: None,
        drives: drives.iter().map(Drive::joint).collect::<Result<_>>()?,
        reference,
    };
    adjust(&input, settings, surfel_m, progress)
}
