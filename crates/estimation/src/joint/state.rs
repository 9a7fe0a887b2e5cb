//! Values of all unknowns.

use super::bend::{Bends, Rung};
use super::layout::REFERENCE;
use super::motion::Motion;
use crate::calibration::Mounting;
use crate::geometry::{BodyFromScanner, Vec3};

/// Values of all unknowns.
pub struct State {
    pub motions: Vec<Box<dyn Motion>>,
    pub mountings: Vec<Mounting>,
    /// Motion of the mountings; `None` if they are rigid.
    pub bends: Option<Bends>,
    pub late_s: Vec<f64>,
    /// (a, b, c) of each surfel.
    pub shapes: Vec<Vec3>,
    /// Offsets of the reference's patches, metres.
    pub patches: Vec<f64>,
    /// Slopes (p, q) of the planes in which several surfels lie.
    pub planes: Vec<[f64; 2]>,
    /// Correction of the reference: shift (metres) and rotation vector (radians) about its centre.
    pub reference: [f64; REFERENCE],
}

impl Clone for State {
    fn clone(&self) -> Self {
        Self {
            motions: self.motions.iter().map(|motion| motion.boxed()).collect(),
            mountings: self.mountings.clone(),
            bends: self.bends.clone(),
            late_s: self.late_s.clone(),
            shapes: self.shapes.clone(),
            patches: self.patches.clone(),
            planes: self.planes.clone(),
            reference: self.reference,
        }
    }
}

impl State {
    /// How much mountings may move.
    pub fn rung(&self) -> Rung {
        self.bends.as_ref().map_or(Rung::Rigid, |bends| bends.rung)
    }

    pub fn poses(&self) -> Vec<BodyFromScanner> {
        self.mountings.iter().map(|m| m.body_from_scanner).collect()
    }
}
