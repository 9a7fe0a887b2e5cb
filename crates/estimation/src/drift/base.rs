//! What a chart may hold its days against: a calibration.

use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use super::limit::{Estimate, KNOWN};
use crate::calibration::{Calibration, ScannerFromScanner};

/// A scanner in the frame of the first by a calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Base {
    /// The first scanner.
    pub first: String,
    /// The scanner.
    pub name: String,
    /// In the frame of the first.
    pub first_from_scanner: ScannerFromScanner,
    /// Covariance of (δp, δφ) along and about the axes of the first scanner, metres and radians, row by row.
    pub covariance: Matrix6<f64>,
    /// Which of these the calibration determines.
    pub determined: [bool; 6],
}

impl Base {
    /// Every scanner but the first; empty where the calibration has no covariance.
    pub fn of(calibration: &Calibration) -> Vec<Self> {
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
