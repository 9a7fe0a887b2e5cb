//! The same drive calibrated under other conditions, to hold the result against.

/// What is different from the calibration that gives the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variant {
    /// The scanners alone, where there is a reference.
    WithoutReference,
    /// The true poses, where they are known.
    ExactPoses,
    /// The paper's own method.
    Paper,
}
