//! How the mountings are found.

/// How the mounting is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Reweighted least squares with analytic derivatives, one point a voxel, scanner and pass.
    #[default]
    Reweighted,
    /// As the paper: numeric Jacobian of the omnivariances, one point a voxel, Gauss-Newton.
    Paper,
}

/// Settings of the calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationSettings {
    /// Coarse to fine, metres.
    pub voxel_sizes_m: Vec<f64>,
    /// Neighbours in each neighbourhood (k).
    pub neighbours: usize,
    /// How.
    pub method: Method,
    /// Most iterations a scale.
    pub max_iterations: usize,
    /// A point of the same scanner and voxel this much later belongs to another pass, seconds.
    pub pass_gap_s: f64,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        Self {
            voxel_sizes_m: vec![0.05, 0.04, 0.03, 0.02, 0.01, 0.005],
            neighbours: 50,
            method: Method::Reweighted,
            max_iterations: 50,
            pass_gap_s: 3.0,
        }
    }
}

/// Names of the six parameters of a mounting: translation, then rotation about the body's axes.
pub const PARAMETER_NAMES: [&str; 6] = ["tx", "ty", "tz", "rx", "ry", "rz"];
