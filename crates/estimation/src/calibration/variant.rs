//! Calibrations of the same drive under other conditions, for comparison with the result.

use serde::{Deserialize, Serialize};

/// Difference from the calibration that gives the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Variant {
    /// The mountings after the trajectory, in two steps: the start of the joint adjustment.
    TwoStep,
    /// The same scanners without the reference.
    WithoutReference,
    /// The true poses, if they are known.
    ExactPoses,
    /// The paper's own method.
    Paper,
}
