//! The mountings of the other scanners in the frame of the first. Errors that all mountings share, such as
//! those of poses, heading and lever arm, cancel in them.

use nalgebra::{DVector, Matrix6, SMatrix};
use serde::{Serialize, Serializer};

use super::observability::LEVER_M;
use super::result::Calibration;
use crate::geometry::{BodyFromScanner, Scanner, Transform, so3};

/// An unobservable direction moves a relative parameter if it changes it by more than this share of the
/// direction's largest component; the same share as for the parameters that a direction moves.
const MOVED_SHARE: f64 = 1.0 / 3.0;

/// A scanner in the frame of another.
pub type ScannerFromScanner = Transform<Scanner, Scanner>;

/// The mounting of a scanner in the frame of the first.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativeMounting {
    /// The scanner.
    pub name: String,
    /// The first scanner.
    pub first: String,
    /// The scanner in the frame of the first.
    pub first_from_scanner: ScannerFromScanner,
    /// Standard deviations of the position (metres) and of the rotation about the axes of the first
    /// scanner (radians); `None` if the data do not determine them.
    pub sigma: [Option<f64>; 6],
}

impl Calibration {
    /// The mountings of all other scanners in the frame of the first.
    pub fn relative(&self) -> Vec<RelativeMounting> {
        let Some((first, others)) = self.mountings.split_first() else {
            return Vec::new();
        };
        let relative = others.iter().enumerate().map(|(i, other)| {
            let (base, pose) = (&first.body_from_scanner, &other.body_from_scanner);
            RelativeMounting {
                name: other.name.clone(),
                first: first.name.clone(),
                first_from_scanner: relative(base, pose),
                sigma: self.relative_sigmas(i + 1),
            }
        });
        relative.collect()
    }

    /// Covariance of (δp, δφ) of the mounting of a scanner in the frame of the first, along and about the axes of the
    /// first, metres and radians; `None` if the calibration has no covariance.
    pub fn relative_covariance(&self, scanner: usize) -> Option<Matrix6<f64>> {
        let covariance = self.covariance.as_ref()?;
        let by = self.relative_derivatives(scanner);
        let mut relative = Matrix6::zeros();
        for (a, left) in [0, scanner].into_iter().zip(&by) {
            for (b, right) in [0, scanner].into_iter().zip(&by) {
                let block = covariance.fixed_view::<6, 6>(6 * a, 6 * b);
                relative += left * block * right.transpose();
            }
        }
        Some(relative)
    }

    fn relative_derivatives(&self, scanner: usize) -> [Matrix6<f64>; 2] {
        let [first, other] = [0, scanner].map(|i| &self.mountings[i].body_from_scanner);
        derivatives(first, other)
    }

    fn relative_sigmas(&self, scanner: usize) -> [Option<f64>; 6] {
        let Some(variance) = self.relative_covariance(scanner) else {
            return [None; 6];
        };
        let by = self.relative_derivatives(scanner);
        let directions = self.observability.unobservable.iter();
        let unobservable: Vec<[bool; 6]> = directions
            .map(|free| moved(&free.direction, scanner, &by))
            .collect();
        std::array::from_fn(|i| {
            let variance: f64 = variance[(i, i)];
            let is_unobservable = unobservable.iter().any(|moved| moved[i]);
            (variance > 0.0 && !is_unobservable).then(|| variance.sqrt())
        })
    }
}

/// The scanner `other` in the frame of `first`: R₀ᵀ Rᵢ, R₀ᵀ (tᵢ − t₀).
pub fn relative(first: &BodyFromScanner, other: &BodyFromScanner) -> ScannerFromScanner {
    let rotation = first.rotation.inverse() * other.rotation;
    Transform::new(rotation, first.map_back(&other.translation_m))
}

/// Derivatives of (δp, δφ) of the relative mounting, about and along the axes of the first scanner,
/// by (δp, δφ) of both mountings: δp = R₀ᵀ (δpᵢ − δp₀ + (tᵢ − t₀) × δφ₀), δφ = R₀ᵀ (δφᵢ − δφ₀).
fn derivatives(first: &BodyFromScanner, other: &BodyFromScanner) -> [Matrix6<f64>; 2] {
    let turn = *first.rotation.inverse().to_rotation_matrix().matrix();
    let arm = so3::hat(&(other.translation_m - first.translation_m));
    let mut by_other = Matrix6::zeros();
    for first in [0, 3] {
        by_other
            .fixed_view_mut::<3, 3>(first, first)
            .copy_from(&turn);
    }
    let mut by_first = -by_other;
    by_first
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(turn * arm));
    [by_first, by_other]
}

/// Whether a direction of all mountings moves each parameter of the relative mounting notably.
fn moved(direction: &DVector<f64>, scanner: usize, by: &[Matrix6<f64>; 2]) -> [bool; 6] {
    let metres = |i: usize, amount: f64| match i % 6 {
        0..3 => amount.abs(),
        _ => LEVER_M * amount.abs(),
    };
    let all = direction.iter().enumerate();
    let largest = all
        .map(|(i, amount)| metres(i, *amount))
        .fold(0.0, f64::max);
    let part = |scanner: usize| -> SMatrix<f64, 6, 1> {
        direction.fixed_rows::<6>(6 * scanner).into_owned()
    };
    let change = by[0] * part(0) + by[1] * part(scanner);
    std::array::from_fn(|i| metres(i, change[i]) > MOVED_SHARE * largest)
}

impl Serialize for RelativeMounting {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Sigma {
            translation_m: [Option<f64>; 3],
            rotation_deg: [Option<f64>; 3],
        }
        #[derive(Serialize)]
        struct Written<'a> {
            first: &'a str,
            #[serde(flatten)]
            first_from_scanner: &'a ScannerFromScanner,
            sigma: Sigma,
        }
        let [x, y, z, turn @ ..] = self.sigma;
        Written {
            first: &self.first,
            first_from_scanner: &self.first_from_scanner,
            sigma: Sigma {
                translation_m: [x, y, z],
                rotation_deg: turn.map(|sigma| sigma.map(f64::to_degrees)),
            },
        }
        .serialize(serializer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::observability::UnobservableDirection;
    use crate::calibration::{Method, Mounting, Observability};
    use crate::geometry::Vec3;
    use nalgebra::{DMatrix, Vector6};

    fn poses() -> [BodyFromScanner; 2] {
        [
            BodyFromScanner::new(
                so3::exp(&Vec3::new(-2.1, 0.4, 0.7)),
                Vec3::new(1.2, -0.5, 0.6),
            ),
            BodyFromScanner::new(
                so3::exp(&Vec3::new(1.9, -0.3, 1.4)),
                Vec3::new(1.25, 0.65, 0.55),
            ),
        ]
    }

    fn calibration(covariance: DMatrix<f64>) -> Calibration {
        let names = ["left", "right"].into_iter().zip(poses());
        Calibration {
            method: Method::Joint,
            mountings: names.map(|(n, pose)| Mounting::new(n, pose)).collect(),
            converged: true,
            scales: Vec::new(),
            covariance: Some(covariance),
            observability: Observability {
                shares: Vec::new(),
                unobservable: Vec::new(),
            },
            origin_sigma_m: 0.0,
            minimum: None,
            constancy: None,
            gap: None,
        }
    }

    #[test]
    fn derivatives_are_those_of_finite_differences() {
        const STEP: f64 = 1e-6;
        let [first, other] = poses();
        let by = derivatives(&first, &other);
        let moved = |pose: &BodyFromScanner, i: usize, by: f64| {
            let mut step = Vector6::zeros();
            step[i] = by;
            let (dp, dphi) = (step.fixed_rows::<3>(0), step.fixed_rows::<3>(3));
            pose.perturbed(&dphi.into(), &dp.into())
        };
        for (which, by) in by.iter().enumerate() {
            for i in 0..6 {
                let at = |step: f64| match which {
                    0 => relative(&moved(&first, i, step), &other),
                    _ => relative(&first, &moved(&other, i, step)),
                };
                let (before, after) = (at(-STEP), at(STEP));
                let dp = (after.translation_m - before.translation_m) / (2.0 * STEP);
                let turn = after.rotation * before.rotation.inverse();
                let dphi = so3::log(&turn) / (2.0 * STEP);
                for axis in 0..3 {
                    // Central differences: rounding of 1e-16 over the step, and its square.
                    assert!((by[(axis, i)] - dp[axis]).abs() < 1e-8, "{which} {i}");
                    assert!((by[(3 + axis, i)] - dphi[axis]).abs() < 1e-8, "{which} {i}");
                }
            }
        }
    }

    #[test]
    fn errors_that_both_scanners_share_cancel() {
        // The body's frame is known to 1 mm and 1 mrad only, the scanners are rigid against it.
        let poses = poses();
        let mut common = DMatrix::zeros(12, 6);
        for (i, pose) in poses.iter().enumerate() {
            let arm = -so3::hat(&pose.translation_m);
            common.view_mut((6 * i, 0), (6, 6)).fill_with_identity();
            common.view_mut((6 * i, 3), (3, 3)).copy_from(&arm);
        }
        let shared = &common * common.transpose() * 1e-6;
        let separate = DMatrix::identity(12, 12) * 1e-12;
        let relative = calibration(shared + separate).relative().remove(0);
        for sigma in relative.sigma {
            // Two scanners of 1e-6, and the arm of 1.15 m between them.
            assert!((1e-6..3e-6).contains(&sigma.unwrap()), "{relative:?}");
        }
        assert!((relative.first_from_scanner.translation_m.norm() - 1.1521).abs() < 1e-3);
    }

    #[test]
    fn an_error_of_the_origin_moves_all_alike() {
        let held = |row: usize| if row == 8 { 0.0 } else { 1e-6 };
        let before = calibration(DMatrix::from_fn(
            12,
            12,
            |i, j| if i == j { held(i) } else { 0.0 },
        ));
        let after = before.clone().with_origin_sigma(2e-3);
        let covariance = after.covariance.as_ref().unwrap();
        assert!((covariance[(0, 0)] - 5e-6).abs() < 1e-18 && covariance[(0, 6)] == 4e-6);
        assert_eq!((covariance[(2, 8)], covariance[(8, 8)]), (0.0, 0.0));
        assert_eq!(covariance[(3, 3)], 1e-6);
        let [x_before, x_after] = [&before, &after].map(|c| c.relative()[0].sigma[3].unwrap());
        assert!((x_before - x_after).abs() < 1e-12);
    }

    #[test]
    fn a_common_height_leaves_the_relative_mounting_determined_and_one_height_does_not() {
        let mut calibration = calibration(DMatrix::identity(12, 12) * 1e-6);
        let mut hold = |heights: [f64; 2]| {
            let direction = DVector::from_fn(12, |i, _| match i {
                2 => heights[0],
                8 => heights[1],
                _ => 0.0,
            });
            let held = UnobservableDirection::of(&direction, &calibration.mountings, 0.0);
            calibration.observability.unobservable = vec![held];
            calibration.relative().remove(0).sigma
        };
        assert!(hold([1.0, 1.0]).iter().all(Option::is_some));
        assert!(hold([0.0, 1.0]).iter().any(Option::is_none));
    }
}
