//! The effect of a wrong mounting: the displacement of points on the ground.

use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use super::overlap::ScannerOverlap;

/// Displacement of a scanner's points on the ground, root mean square over the spots that another scanner saw as
/// well, metres; with standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Length of the displacement.
    pub total_m: f64,
    /// Standard deviation of the length.
    pub total_sigma_m: f64,
    /// Component along the normal of the ground.
    pub normal_m: f64,
    /// Standard deviation of this component.
    pub normal_sigma_m: f64,
    /// Vertical component.
    pub vertical_m: f64,
    /// Standard deviation of the vertical component.
    pub vertical_sigma_m: f64,
}

/// Matrices M of the mean squared displacement δᵀ M δ of points: in total, along the normal, and upwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    total: Matrix6<f64>,
    normal: Matrix6<f64>,
    vertical: Matrix6<f64>,
}

impl Moments {
    /// The mean over several drives, weighted by their numbers of spots.
    pub fn mean(drives: &[&ScannerOverlap]) -> Self {
        let all: f64 = drives.iter().map(|drive| drive.spots as f64).sum();
        let mean = |moment: fn(&ScannerOverlap) -> Matrix6<f64>| {
            let parts = drives
                .iter()
                .map(|drive| moment(drive) * drive.spots as f64);
            parts.sum::<Matrix6<f64>>() / all.max(1.0)
        };
        Self {
            total: mean(|drive| drive.total),
            normal: mean(|drive| drive.normal),
            vertical: mean(|drive| drive.vertical),
        }
    }

    /// The displacement due to an offset with its covariance; both are zero in components that are not determined.
    pub fn cost(&self, offset: &Vector6<f64>, covariance: &Matrix6<f64>) -> Cost {
        let rms_and_sigma = |moment: &Matrix6<f64>| {
            let rms = offset.dot(&(moment * offset)).max(0.0).sqrt();
            let by = moment * offset / rms;
            let sigma = if rms > 0.0 {
                by.dot(&(covariance * by)).max(0.0).sqrt()
            } else {
                0.0
            };
            (rms, sigma)
        };
        let (total_m, total_sigma_m) = rms_and_sigma(&self.total);
        let (normal_m, normal_sigma_m) = rms_and_sigma(&self.normal);
        let (vertical_m, vertical_sigma_m) = rms_and_sigma(&self.vertical);
        Cost {
            total_m,
            total_sigma_m,
            normal_m,
            normal_sigma_m,
            vertical_m,
            vertical_sigma_m,
        }
    }
}
