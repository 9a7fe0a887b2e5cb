//! The mountings as `result.json` shows them.

use std::collections::BTreeMap;

use serde::Serialize;

use super::result::Calibration;
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::{BodyFromScanner, EulerConvention};

/// A number for each convention of Euler angles, degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct EulerDeg<T> {
    zyx: [T; 3],
    bonn: [T; 3],
}

impl<T> EulerDeg<T> {
    fn new(angles: impl Fn(EulerConvention) -> [T; 3]) -> Self {
        Self {
            zyx: angles(EulerConvention::Zyx),
            bonn: angles(EulerConvention::Bonn),
        }
    }
}

/// A mounting as quaternion and as Euler angles of both conventions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MountingForms {
    #[serde(flatten)]
    body_from_scanner: BodyFromScanner,
    euler_deg: EulerDeg<f64>,
}

impl From<&BodyFromScanner> for MountingForms {
    fn from(pose: &BodyFromScanner) -> Self {
        Self {
            body_from_scanner: *pose,
            euler_deg: EulerDeg::new(|convention| {
                euler_deg_from_rotation(convention, &pose.rotation)
            }),
        }
    }
}

/// Result of one scanner.
#[derive(Debug, Clone, Serialize)]
pub struct ScannerResult {
    body_from_scanner: MountingForms,
    sigma: Sigma,
    rotation_convention: EulerConvention,
    unobservable: Vec<&'static str>,
}

/// Standard deviations; null for fixed and unobservable parameters.
#[derive(Debug, Clone, Serialize)]
struct Sigma {
    translation_m: [Option<f64>; 3],
    /// In the mounting's own convention.
    rotation_deg: [Option<f64>; 3],
    euler_deg: EulerDeg<Option<f64>>,
}

impl Calibration {
    /// Results by the names of the scanners, for serialisation.
    pub fn scanners(&self) -> BTreeMap<&str, ScannerResult> {
        let scanner = |index: usize| {
            let mounting = &self.mountings[index];
            let sigmas = self.sigmas(index, mounting.convention);
            let degrees = |convention| {
                let [.., a, b, c] = self.sigmas(index, convention);
                [a, b, c].map(|sigma| sigma.map(f64::to_degrees))
            };
            ScannerResult {
                body_from_scanner: MountingForms::from(&mounting.body_from_scanner),
                sigma: Sigma {
                    translation_m: [sigmas[0], sigmas[1], sigmas[2]],
                    rotation_deg: degrees(mounting.convention),
                    euler_deg: EulerDeg::new(degrees),
                },
                rotation_convention: mounting.convention,
                unobservable: self.unobservable(index),
            }
        };
        let mountings = self.mountings.iter().enumerate();
        mountings
            .map(|(index, mounting)| (mounting.name.as_str(), scanner(index)))
            .collect()
    }
}
