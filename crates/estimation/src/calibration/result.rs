//! Result of the calibration.

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::constancy::Constancy;
use super::gap::Gap;
use super::minimum::Minimum;
use super::observability::Observability;
use super::parameters::{Mounting, PARAMETER_NAMES, euler_jacobian_body, poses};
use super::scale::Ending;
use super::settings::Method;
use crate::geometry::{BodyFromScanner, EulerConvention};

/// The calibrated mountings and their quality.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Calibration {
    /// Estimation method.
    pub method: Method,
    /// One mounting per scanner.
    pub mountings: Vec<Mounting>,
    /// Whether every scale converged.
    pub converged: bool,
    /// Scales from coarse to fine.
    pub scales: Vec<Scale>,
    /// Covariance of (δp, δφ) of all scanners, body axes, zero for fixed parameters and, after two steps, for
    /// unobservable ones; `None` if the normal matrix is singular, and for the paper's method, which has no covariance.
    pub covariance: Option<DMatrix<f64>>,
    /// Standard deviation of the body's origin along each axis, which the covariance includes, metres.
    pub origin_sigma_m: f64,
    /// What the data determine.
    pub observability: Observability,
    /// Whether the mountings came back after they were moved away; `None` if this was not tested.
    pub minimum: Option<Minimum>,
    /// Test of a constant mounting; `None` if it is not possible.
    pub constancy: Option<Constancy>,
    /// Whether the scanners keep their distance; `None` if no two scanners saw enough of the same surface.
    pub gap: Option<Gap>,
}

/// Course of the adjustment of one scale.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Scale {
    /// Edge of the voxels, metres.
    pub voxel_m: f64,
    /// Number of iterations.
    pub iterations: usize,
    /// Number of scanner points.
    pub points: usize,
    /// Number of reference points.
    pub reference_points: usize,
    /// Number of neighbourhoods in the cost.
    pub neighbourhoods: usize,
    /// The method's own cost before the first and after every iteration, as a mean over the neighbourhoods:
    /// ln(λ₃ + s²), or the paper's σ² (m⁴). Of a scale that only [aligns](Ending::Aligned), that before every step.
    pub costs: Vec<f64>,
    /// The last cost.
    pub cost: f64,
    /// How it ended.
    pub ending: Ending,
    /// Run time, seconds.
    pub seconds: f64,
    /// Mountings after this scale.
    pub mountings: Vec<Mounting>,
}

impl Calibration {
    /// Names of the parameters of scanner `scanner` that the data do not determine.
    pub fn unobservable(&self, scanner: usize) -> Vec<&'static str> {
        (0..6)
            .filter(|&parameter| !self.is_observable(scanner, parameter))
            .map(|parameter| PARAMETER_NAMES[parameter])
            .collect()
    }

    /// Whether the data determine this parameter; angles are those of the mounting's own
    /// convention.
    pub fn is_observable(&self, scanner: usize, parameter: usize) -> bool {
        self.is_observable_in(scanner, parameter, self.mountings[scanner].convention)
    }

    /// As [`Self::is_observable`], with the angles of `convention`.
    fn is_observable_in(
        &self,
        scanner: usize,
        parameter: usize,
        convention: EulerConvention,
    ) -> bool {
        let directions = &self.observability.unobservable;
        !directions
            .iter()
            .any(|direction| direction.moves((scanner, parameter), convention, &self.mountings))
    }

    /// Whether what the scans seem to say about the mountings is no more than noise: a minimum was reached that is not one
    /// of several, and parameters are free, but there is no covariance.
    pub fn is_noise(&self) -> bool {
        let is_doubtful = self.minimum.as_ref().is_some_and(Minimum::is_doubtful);
        let determined = self.observability.shares.len() > self.observability.unobservable.len();
        let has_none = self.covariance.is_none() && determined;
        has_none && self.method == Method::TwoStep && self.converged && !is_doubtful
    }

    /// Standard deviations of tx, ty, tz (metres) and of the three Euler angles (radians) of
    /// `scanner` in `convention`; `None` for fixed and unobservable parameters.
    pub fn sigmas(&self, scanner: usize, convention: EulerConvention) -> [Option<f64>; 6] {
        let mounting = &self.mountings[scanner];
        let Some(covariance) = self.covariance_with_held() else {
            return [None; 6];
        };
        let block = covariance.fixed_view::<6, 6>(6 * scanner, 6 * scanner);
        let jacobian = euler_jacobian_body(convention, &mounting.body_from_scanner);
        let rotation = block.fixed_view::<3, 3>(3, 3).into_owned();
        let angles = jacobian * rotation * jacobian.transpose();
        std::array::from_fn(|parameter| {
            let held = convention == mounting.convention && mounting.fixed[parameter];
            let held = held || (parameter < 3 && mounting.fixed[parameter]);
            if held || !self.is_observable_in(scanner, parameter, convention) {
                return None;
            }
            let variance: f64 = if parameter < 3 {
                block[(parameter, parameter)]
            } else {
                angles[(parameter - 3, parameter - 3)]
            };
            (variance > 0.0).then(|| variance.sqrt())
        })
    }

    /// Adds an error of the body's origin to the covariance of the free parameters: a standard deviation
    /// along each axis, metres. The error shifts all mountings alike.
    pub fn with_origin_sigma(mut self, sigma_m: f64) -> Self {
        self.origin_sigma_m = sigma_m;
        let Some(covariance) = &mut self.covariance else {
            return self;
        };
        for axis in 0..3 {
            let rows = (0..self.mountings.len()).map(|scanner| 6 * scanner + axis);
            let is_free = |row: &usize| {
                let is_fixed = self.mountings[row / 6].fixed[axis];
                !is_fixed && covariance[(*row, *row)] > 0.0
            };
            let free: Vec<usize> = rows.filter(is_free).collect();
            for &row in &free {
                for &column in &free {
                    covariance[(row, column)] += sigma_m * sigma_m;
                }
            }
        }
        self
    }

    /// The covariance with the errors of initial values along the directions that are held at them. They move all
    /// parameters, some so little that these still have a standard deviation. In a joint adjustment initial values are
    /// observations like others, whose errors are in the covariance.
    fn covariance_with_held(&self) -> Option<DMatrix<f64>> {
        if self.method == Method::Joint {
            return self.covariance.clone();
        }
        let held = self.observability.unobservable.iter();
        held.fold(self.covariance.clone(), |covariance, direction| {
            let error = direction.initial_error();
            covariance.map(|all| all + &error * error.transpose())
        })
    }

    /// The covariance with NaN for fixed and unobservable parameters: what is held has no standard deviation, though
    /// the distances between scanners that are held together have one.
    pub fn determined_covariance(&self) -> Option<DMatrix<f64>> {
        let covariance = self.covariance_with_held()?;
        let size = covariance.nrows();
        let directions = &self.observability.unobservable;
        let is_determined = |row: usize| {
            let is_held = directions.iter().any(|direction| direction.moves_row(row));
            covariance[(row, row)] > 0.0 && !is_held
        };
        let determined: Vec<bool> = (0..size).map(is_determined).collect();
        Some(DMatrix::from_fn(size, size, |i, j| {
            if determined[i] && determined[j] {
                covariance[(i, j)]
            } else {
                f64::NAN
            }
        }))
    }

    /// Correlations of (δp, δφ) of all scanners, NaN for fixed and unobservable parameters.
    pub fn correlation(&self) -> Option<DMatrix<f64>> {
        let covariance = self.determined_covariance()?;
        let size = covariance.nrows();
        Some(DMatrix::from_fn(size, size, |i, j| {
            covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt()
        }))
    }

    /// Poses of the scanners on the body.
    pub fn poses(&self) -> Vec<BodyFromScanner> {
        poses(&self.mountings)
    }
}
