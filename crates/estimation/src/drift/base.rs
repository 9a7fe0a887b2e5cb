//! A calibration as the base with which a chart compares its days.

use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use super::limit::{Estimate, KNOWN};
use crate::calibration::{Calibration, ScannerFromScanner};

/// The calibrated mounting of a scanner in the frame of the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Base {
    /// The first scanner.
    pub first: String,
    /// The scanner.
    pub name: String,
    /// The scanner in the frame of the first.
    pub first_from_scanner: ScannerFromScanner,
    /// Covariance of (δp, δφ) along and about the axes of the first scanner, metres and radians, row by row.
    pub covariance: Matrix6<f64>,
    /// Whether the calibration determines each component.
    pub determined: [bool; 6],
}

impl Base {
    /// The bases of all scanners but the first; empty if the calibration has no covariance.
    pub fn from_calibration(calibration: &Calibration) -> Vec<Self> {
        let relative = calibration.relative().into_iter().enumerate();
        let bases = relative.filter_map(|(i, relative)| {
            Some(Self {
                covariance: calibration.relative_covariance(i + 1)?,
                determined: relative.sigma.map(|sigma| sigma.is_some()),
                first: relative.first,
                name: relative.name,
                first_from_scanner: relative.first_from_scanner,
            })
        });
        bases.collect()
    }

    pub(super) fn estimate(&self) -> Estimate {
        Estimate {
            offset: nalgebra::Vector6::zeros(),
            covariance: self.covariance,
            determined: self.determined,
            degrees: KNOWN,
        }
    }
}
