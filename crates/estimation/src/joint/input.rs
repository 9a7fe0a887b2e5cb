//! Input of the adjustment.

use super::bend::Compliance;
use super::motion::Motion;
use crate::calibration::{Mounting, ScannerSample};
use crate::geometry::Vec3;
use crate::sensor::FrameLog;
use nalgebra::{DMatrix, DVector};

/// The scans of one drive: a sample of each scanner in the order of the mountings.
#[derive(Debug, Clone)]
pub struct Scans<'a> {
    /// Thinned points with their profiles.
    pub samples: Vec<&'a ScannerSample>,
}

/// One drive.
pub struct JointDrive<'a> {
    /// Name of its results.
    pub name: String,
    /// Its motion before the adjustment.
    pub motion: Box<dyn Motion>,
    /// Its scans.
    pub scans: Scans<'a>,
    /// Log of quantities that mountings may follow besides load and time, with the same columns in all
    /// drives; `None` without a log.
    pub frame: Option<FrameLog>,
}

impl Clone for JointDrive<'_> {
    fn clone(&self) -> Self {
        Self {
            name: self.name.clone(),
            motion: self.motion.boxed(),
            scans: self.scans.clone(),
            frame: self.frame.clone(),
        }
    }
}

/// The data that are adjusted together.
#[derive(Clone)]
pub struct JointInput<'a> {
    /// Start values of the mountings, one per scanner.
    pub mountings: Vec<Mounting>,
    /// Initial values of the mountings: observations of these, with [`INITIAL_SIGMA`](crate::calibration::INITIAL_SIGMA).
    pub initial: &'a [Mounting],
    /// What is held of the mountings, because noise hides what scans say of it: the products of these with the change
    /// (δp, δφ) of all mountings from initial values, in standard deviations of these.
    pub held: &'a [DVector<f64>],
    /// Covariance (δp, δφ) of the start values of the mountings if another adjustment estimated them;
    /// `None` if they are not known.
    pub known: Option<&'a DMatrix<f64>>,
    /// Known compliance of the mountings; empty if they are rigid or not known.
    pub compliance: &'a [Compliance],
    /// Whether the latency of each scanner is estimated.
    pub estimate_latency: Vec<bool>,
    /// One or more drives.
    pub drives: Vec<JointDrive<'a>>,
    /// Points of the reference in the world, metres; empty without one.
    pub reference: &'a [Vec3],
}

impl JointInput<'_> {
    /// The log of each drive.
    pub fn frames(&self) -> Vec<Option<&FrameLog>> {
        let drives = self.drives.iter();
        drives.map(|drive| drive.frame.as_ref()).collect()
    }
}
