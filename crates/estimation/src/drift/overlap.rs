//! What the overlap of one drive shows.

use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use super::step::perturbed;
use crate::calibration::ScannerFromScanner;

/// Names of the components: the position of a scanner along, and its rotation about, the axes of the first scanner.
pub const COMPONENTS: [&str; 6] = ["x", "y", "z", "about x", "about y", "about z"];

/// How the further scanners of a drive sit in the frame of the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Overlap {
    /// The first scanner.
    pub first: String,
    /// The others, in the order of the project.
    pub scanners: Vec<ScannerOverlap>,
}

/// How a scanner sits in the frame of the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScannerOverlap {
    /// The scanner.
    pub name: String,
    /// In the frame of the first by the mountings in use.
    pub in_use: ScannerFromScanner,
    /// How far it sits off that: position along (metres) and rotation about (radians) the axes of the first scanner.
    /// A component that is not determined is no result.
    pub offset: Vector6<f64>,
    /// Covariance of the offset, metres and radians, row by row.
    pub covariance: Matrix6<f64>,
    /// Which components the ground determines.
    pub determined: [bool; 6],
    /// Blocks of the drive whose disagreement made the covariance.
    pub blocks: usize,
    /// Spots of the ground that it saw together with another, in all grids of cells.
    pub spots: usize,
    /// Time from one scanner to the other on a spot, median, seconds.
    pub lag_s: f64,
    /// Mean squares of how far its points on the ground move with an offset δ along the normal of the ground,
    /// δᵀ M δ, row by row.
    pub normal: Matrix6<f64>,
    /// The same upwards.
    pub vertical: Matrix6<f64>,
    /// The same in all.
    pub total: Matrix6<f64>,
}

impl ScannerOverlap {
    /// Where it sits in the frame of the first, as the ground shows it.
    pub fn first_from_scanner(&self) -> ScannerFromScanner {
        perturbed(&self.in_use, self.offset.as_slice())
    }

    /// Degrees of freedom of the covariance.
    pub fn degrees(&self) -> f64 {
        self.blocks.saturating_sub(1) as f64
    }

    /// Standard deviations of the offset, metres and radians; `None` where the ground does not determine it.
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
