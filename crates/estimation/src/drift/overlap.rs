//! The result of one drive: the relative mountings from the overlap of the scanners.

use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use super::step::perturbed;
use crate::calibration::ScannerFromScanner;

/// Names of the components: the position of a scanner along, and its rotation about, the axes of the first scanner.
pub const COMPONENTS: [&str; 6] = ["x", "y", "z", "about x", "about y", "about z"];

/// The mountings of the further scanners of a drive in the frame of the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Overlap {
    /// The first scanner.
    pub first: String,
    /// The others, in the order of the project.
    pub scanners: Vec<ScannerOverlap>,
}

/// The mounting of a scanner in the frame of the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScannerOverlap {
    /// The scanner.
    pub name: String,
    /// The scanner in the frame of the first, according to the mountings in use.
    pub in_use: ScannerFromScanner,
    /// Difference from the mounting in use: position along (metres) and rotation about (radians) the axes of the first
    /// scanner. Components that are not determined are meaningless.
    pub offset: Vector6<f64>,
    /// Covariance of the offset, metres and radians, row by row.
    pub covariance: Matrix6<f64>,
    /// Whether the ground determines each component.
    pub determined: [bool; 6],
    /// Number of blocks of the drive, from whose disagreement the covariance was computed.
    pub blocks: usize,
    /// Number of spots of the ground that it saw together with another scanner, in all grids of cells.
    pub spots: usize,
    /// Median time between the two scanners on a spot, seconds.
    pub lag_s: f64,
    /// Matrix M of the mean squared displacement δᵀ M δ of its points along the normal of the ground, for an offset δ,
    /// row by row.
    pub normal: Matrix6<f64>,
    /// The same for the upward displacement.
    pub vertical: Matrix6<f64>,
    /// The same for the total displacement.
    pub total: Matrix6<f64>,
}

impl ScannerOverlap {
    /// The scanner in the frame of the first, according to the ground.
    pub fn first_from_scanner(&self) -> ScannerFromScanner {
        perturbed(&self.in_use, self.offset.as_slice())
    }

    /// Degrees of freedom of the covariance.
    pub fn degrees(&self) -> f64 {
        self.blocks.saturating_sub(1) as f64
    }

    /// Standard deviations of the offset, metres and radians; `None` for components that the ground does not determine.
    pub fn sigma(&self) -> [Option<f64>; 6] {
        std::array::from_fn(|i| self.determined[i].then(|| self.covariance[(i, i)].sqrt()))
    }

    /// Names of the components that the ground does not determine.
    pub fn undetermined(&self) -> Vec<&'static str> {
        let named = COMPONENTS.iter().zip(self.determined);
        named
            .filter_map(|(name, known)| (!known).then_some(*name))
            .collect()
    }
}
