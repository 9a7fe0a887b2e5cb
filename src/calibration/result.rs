//! The mountings found, and what they are worth.

use nalgebra::DMatrix;

use super::constancy::Constancy;
use super::observability::Observability;
use super::parameters::{Mounting, PARAMETER_NAMES, euler_jacobian_body, poses};
use super::scale::Ending;
use super::settings::Method;
use crate::geometry::{BodyFromScanner, EulerConvention};

/// The mountings found, and what they are worth.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// How they were found.
    pub method: Method,
    /// One a scanner.
    pub mountings: Vec<Mounting>,
    /// Whether every scale converged.
    pub converged: bool,
    /// Coarse to fine.
    pub scales: Vec<Scale>,
    /// Covariance of (δp, δφ) of all scanners, body axes, zero for what was held; `None` where the
    /// normal matrix is singular, and for the paper's method, which gives none.
    pub covariance: Option<DMatrix<f64>>,
    /// What the data determine.
    pub observability: Observability,
    /// Whether the mounting seems constant; `None` where that cannot be told.
    pub constancy: Option<Constancy>,
}

/// One scale as it went.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Scale {
    /// Edge of the voxels, metres.
    pub voxel_m: f64,
    /// Iterations.
    pub iterations: usize,
    /// Scanner points.
    pub points: usize,
    /// Reference points.
    pub reference_points: usize,
    /// Neighbourhoods in the cost.
    pub neighbourhoods: usize,
    /// The method's own cost before the first and after every iteration: Σ ln(λ₃ + s²) of the
    /// neighbourhoods, or the paper's Σσ² (m⁴).
    pub costs: Vec<f64>,
    /// The last of them.
    pub cost: f64,
    /// How it ended.
    pub ending: Ending,
    /// Run time.
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

    /// Whether the data determine this parameter; angles are those of the mounting's own convention.
    pub fn is_observable(&self, scanner: usize, parameter: usize) -> bool {
        self.is_observable_in(scanner, parameter, self.mountings[scanner].convention)
    }

    /// The same with the angles of `convention`.
    fn is_observable_in(
        &self,
        scanner: usize,
        parameter: usize,
        convention: EulerConvention,
    ) -> bool {
        let free = &self.observability.free;
        !free
            .iter()
            .any(|free| free.moves((scanner, parameter), convention, &self.mountings))
    }

    /// Standard deviations of tx, ty, tz (metres) and of the three Euler angles (radians) of
    /// `scanner` in `convention`; `None` for what was held.
    pub fn sigmas(&self, scanner: usize, convention: EulerConvention) -> [Option<f64>; 6] {
        let mounting = &self.mountings[scanner];
        let Some(covariance) = &self.covariance else {
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

    /// Poses of the scanners on the body.
    pub fn poses(&self) -> Vec<BodyFromScanner> {
        poses(&self.mountings)
    }
}
