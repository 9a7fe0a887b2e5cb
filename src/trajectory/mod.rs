//! The trajectory: from logs to poses with standard deviations, and poses at any time between.

mod interpolate;

pub use interpolate::{PoseCursor, Trajectory};

/// Stub.
#[derive(Debug)]
pub struct PosteriorCovariance;
/// Stub.
#[derive(Debug)]
pub struct PoseGradient;
impl PoseGradient {
    /// Stub.
    pub fn new(_m: usize, _n: usize) -> Self {
        Self
    }
    /// Stub.
    pub fn add(&mut self, _row: usize, _node: usize, _axis: usize, _value: f64) {}
}
impl PosteriorCovariance {
    /// Stub.
    pub fn of_functional(&self, _g: &PoseGradient) -> nalgebra::DMatrix<f64> {
        nalgebra::DMatrix::zeros(0, 0)
    }
}
