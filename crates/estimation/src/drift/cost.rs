//! What a mounting that is off costs: how far points on the ground move.

use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

use super::overlap::ScannerOverlap;

/// How far the points of a scanner on the ground move, root mean square over those that another scanner saw as well,
/// metres; with standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// In all.
    pub total_m: f64,
    /// Of that.
    pub total_sigma_m: f64,
    /// Along the normal of the ground.
    pub normal_m: f64,
    /// Of that.
    pub normal_sigma_m: f64,
    /// Upwards.
    pub vertical_m: f64,
    /// Of that.
    pub vertical_sigma_m: f64,
}

/// Mean squares δᵀ M δ of how far points move in all, along the normal, and upwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    total: Matrix6<f64>,
    normal: Matrix6<f64>,
    vertical: Matrix6<f64>,
}

impl Moments {
    /// Of several drives, by their spots.
    pub fn of(drives: &[&ScannerOverlap]) -> Self {
        let all: f64 = drives.iter().map(|drive| drive.spots as f64).sum();
        let mean = |of: fn(&ScannerOverlap) -> Matrix6<f64>| {
            let parts = drives.iter().map(|drive| of(drive) * drive.spots as f64);
            parts.sum::<Matrix6<f64>>() / all.max(1.0)
        };
        Self {
            total: mean(|drive| drive.total),
            normal: mean(|drive| drive.normal),
            vertical: mean(|drive| drive.vertical),
        }
    }

    /// Of an offset with its covariance, both zero where it is not determined.
    pub fn cost(&self, offset: &Vector6<f64>, covariance: &Matrix6<f64>) -> Cost {
        let of = |moment: &Matrix6<f64>| {
            let rms = offset.dot(&(moment * offset)).max(0.0).sqrt();
            let by = moment * offset / rms;
            let sigma = match rms > 0.0 {
                true => by.dot(&(covariance * by)).max(0.0).sqrt(),
                false => 0.0,
            };
            (rms, sigma)
        };
        let (total_m, total_sigma_m) = of(&self.total);
        let (normal_m, normal_sigma_m) = of(&self.normal);
        let (vertical_m, vertical_sigma_m) = of(&self.vertical);
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
