//! Input of the adjustment.

use super::bend::Compliance;
use super::motion::Motion;
use crate::calibration::{Mounting, ScannerSample};
use crate::geometry::Vec3;
use crate::sensor::FrameLog;
use nalgebra::DMatrix;

/// The scans of one drive: a sample of each scanner in the order of the mountings.
#[derive(Debug, Clone)]
pub struct Scans<'a> {
    /// Thinned points with their profiles.
    pub samples: Vec<&'a ScannerSample>,
}

/// One drive.
pub struct JointDrive<'a> {
    /// As its results are called.
    pub name: String,
    /// Its motion before the adjustment.
    pub motion: Box<dyn Motion>,
    /// Its scans.
    pub scans: Scans<'a>,
    /// What mountings may follow beside the load and time, with the same columns in all drives; `None`
    /// without a log.
    pub frame: Option<FrameLog>,
}

/// What is adjusted together.
pub struct JointInput<'a> {
    /// Start values of the mountings, one a scanner.
    pub mountings: Vec<Mounting>,
    /// Covariance of the mountings about their start values where another adjustment found them:
    /// (δp, δφ) of each; `None` where nothing is known.
    pub known: Option<&'a DMatrix<f64>>,
    /// How mountings that are known follow the load; empty where they are rigid or nothing is known.
    pub compliance: &'a [Compliance],
    /// Whether the latency of each scanner is estimated.
    pub estimate_latency: Vec<bool>,
    /// One or more drives.
    pub drives: Vec<JointDrive<'a>>,
    /// Points of the reference in the world, metres; empty without one.
    pub reference: &'a [Vec3],
}

impl JointInput<'_> {
    /// What mountings may follow in each drive.
    pub fn frames(&self) -> Vec<Option<&FrameLog>> {
        let drives = self.drives.iter();
        drives.map(|drive| drive.frame.as_ref()).collect()
    }
}
