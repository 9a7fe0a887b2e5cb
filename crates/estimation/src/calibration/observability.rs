//! Observability of the parameters.
//!
//! The normal matrix is scaled by the information the points would have on each parameter if the
//! planes of the neighbourhoods did not move ([`NormalEquations::uncentred`]). An eigenvalue is
//! then the share of that information that remains when the planes move with the points: near zero
//! for a direction in which the mountings move without any neighbourhood getting thicker. Such a
//! direction is held at its initial value: the sum of the parameters that it mainly moves, weighted
//! by the direction, stays constant. Rotations are converted to metres by [`LEVER_M`].

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::cost::NormalEquations;
use super::parameters::{Mounting, PARAMETER_NAMES, euler_jacobian_body, free_basis};
use super::settings::INITIAL_SIGMA_M;
use crate::geometry::EulerConvention;

/// Rotations are weighted by the shift they cause at this distance, metres: the working range of a
/// close-range scanner.
pub const LEVER_M: f64 = 1.5;
/// A direction concerns the parameters that it moves by at least this share of the largest.
const MOVED_SHARE: f64 = 1.0 / 3.0;

/// Directions with a smaller share of the information count as unobservable. On simulated drives
/// without a reference the heights have 2e-6 to 1e-5, from small roll and pitch angles, and the
/// next direction 5e-3; with a reference all have more than 1e-2. The threshold is the geometric
/// mean.
pub const MIN_SHARE: f64 = 2e-4;

/// A direction that the data do not determine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnobservableDirection {
    /// (δp, δφ) of every scanner: metres and radians, in body axes.
    pub direction: DVector<f64>,
    /// Remaining share of the information.
    pub share: f64,
    /// Description of the direction.
    pub description: String,
    /// The parameters concerned: (scanner, index into [`PARAMETER_NAMES`]).
    pub parameters: Vec<(usize, usize)>,
}

/// Eigenvalues of the scaled normal matrix and the unobservable directions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Observability {
    /// Remaining shares of the information, ascending.
    pub shares: Vec<f64>,
    /// Unobservable directions; empty if everything is determined.
    pub unobservable: Vec<UnobservableDirection>,
}

impl Observability {
    /// Analyses the normal equations at `mountings` for their free parameters.
    pub fn new(equations: &NormalEquations, mountings: &[Mounting]) -> Self {
        let basis = &free_basis(mountings);
        let reduced = basis.transpose() * &equations.matrix * basis;
        // The squares of wildly wrong points overflow: the matrix is not finite and has no
        // eigenvalues.
        if reduced.is_empty() || reduced.iter().any(|entry| !entry.is_finite()) {
            return Self {
                shares: Vec::new(),
                unobservable: Vec::new(),
            };
        }
        let scale: Vec<f64> = basis
            .column_iter()
            .map(|column| {
                let information = column.component_mul(&column).dot(&equations.uncentred);
                information.max(f64::MIN_POSITIVE).sqrt().recip()
            })
            .collect();
        let scaled = DMatrix::from_fn(reduced.nrows(), reduced.ncols(), |i, j| {
            reduced[(i, j)] * scale[i] * scale[j]
        });
        let eigen = SymmetricEigen::new(scaled);
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let share = |i: usize| eigen.eigenvalues[i].max(0.0);
        let unobservable = order
            .iter()
            .filter(|&&i| share(i) < MIN_SHARE)
            .map(|&i| {
                let coordinates = DVector::from_fn(scale.len(), |row, _| {
                    scale[row] * eigen.eigenvectors[(row, i)]
                });
                UnobservableDirection::of(&(basis * coordinates), mountings, share(i))
            })
            .collect();
        Self {
            shares: order.iter().map(|&i| share(i)).collect(),
            unobservable,
        }
    }

    /// Basis of the directions in which the free parameters of `mountings` move without the
    /// unobservable directions: 6 s × f.
    pub fn determined(&self, mountings: &[Mounting]) -> DMatrix<f64> {
        let basis = free_basis(mountings);
        if self.unobservable.is_empty() {
            return basis;
        }
        // Null space of the constraints nᵀ P B z = 0, by QR of the transpose.
        let constraints =
            DMatrix::from_fn(basis.ncols(), self.unobservable.len(), |column, row| {
                self.unobservable[row].weighted().dot(&basis.column(column))
            });
        basis * null_space(&constraints)
    }

    /// Returns the correction along the unobservable directions that undoes their part of `change`.
    pub fn restoring(&self, change: &DVector<f64>) -> DVector<f64> {
        let count = self.unobservable.len();
        let weighted: Vec<DVector<f64>> = self
            .unobservable
            .iter()
            .map(UnobservableDirection::weighted)
            .collect();
        let products = DMatrix::from_fn(count, count, |i, j| {
            weighted[i].dot(&self.unobservable[j].direction)
        });
        let sums = DVector::from_fn(count, |i, _| weighted[i].dot(change));
        let mut correction = DVector::zeros(change.len());
        // Singular if two directions move the same parameters alike: then neither is restored.
        if let Some(amounts) = products.lu().solve(&sums) {
            for (free, amount) in self.unobservable.iter().zip(amounts.iter()) {
                correction -= &free.direction * *amount;
            }
        }
        correction
    }
}

impl UnobservableDirection {
    /// A direction (δp, δφ) of all mountings along which this share of the information remains.
    pub(crate) fn of(direction: &DVector<f64>, mountings: &[Mounting], share: f64) -> Self {
        let direction = direction.normalize();
        let parameters = affected_parameters(&direction, mountings, None);
        Self {
            share,
            description: describe(&direction, &parameters, mountings),
            parameters,
            direction,
        }
    }

    /// Whether it moves this parameter by at least a third of its largest component, with angles of
    /// `convention`.
    pub fn moves(
        &self,
        (scanner, parameter): (usize, usize),
        convention: EulerConvention,
        mountings: &[Mounting],
    ) -> bool {
        affected_parameters(&self.direction, mountings, Some(convention))
            .contains(&(scanner, parameter))
    }

    /// Whether it moves this component of (δp, δφ) by at least [`MOVED_SHARE`] of its largest.
    pub(super) fn moves_row(&self, row: usize) -> bool {
        self.amount_m(row) > MOVED_SHARE * self.largest_m()
    }

    /// The error of initial values along it, one standard deviation: held at them, the mountings are off by so much.
    pub(super) fn initial_error(&self) -> DVector<f64> {
        &self.direction * (INITIAL_SIGMA_M / self.largest_m())
    }

    /// How far it moves a component of (δp, δφ), metres.
    fn amount_m(&self, row: usize) -> f64 {
        let lever_m = if row % 6 < 3 { 1.0 } else { LEVER_M };
        lever_m * self.direction[row].abs()
    }

    fn largest_m(&self) -> f64 {
        let rows = 0..self.direction.len();
        rows.map(|row| self.amount_m(row)).fold(0.0, f64::max)
    }

    /// P n: the direction restricted to the parameters it mainly moves, rotations weighted by
    /// [`LEVER_M`].
    fn weighted(&self) -> DVector<f64> {
        DVector::from_fn(self.direction.len(), |row, _| {
            let (scanner, axis) = (row / 6, row % 6);
            // The listed angles are Euler angles; any of them includes the whole rotation.
            let concerned = self.parameters.iter().any(|&(s, parameter)| {
                s == scanner
                    && if axis < 3 {
                        parameter == axis
                    } else {
                        parameter >= 3
                    }
            });
            let metric = if axis < 3 { 1.0 } else { LEVER_M * LEVER_M };
            if concerned {
                self.direction[row] * metric
            } else {
                0.0
            }
        })
    }
}

/// Orthonormal columns that span the complement of the columns of `constraints`.
fn null_space(constraints: &DMatrix<f64>) -> DMatrix<f64> {
    let size = constraints.nrows();
    let projector = {
        let q = constraints.clone().qr().q();
        DMatrix::identity(size, size) - &q * q.transpose()
    };
    let eigen = SymmetricEigen::new(projector);
    let complement: Vec<usize> = (0..size).filter(|&i| eigen.eigenvalues[i] > 0.5).collect();
    DMatrix::from_fn(size, complement.len(), |row, column| {
        eigen.eigenvectors[(row, complement[column])]
    })
}

/// Parameters that a direction moves by at least a third of its largest component; angles
/// in `convention`, or in each mounting's own.
fn affected_parameters(
    direction: &DVector<f64>,
    mountings: &[Mounting],
    convention: Option<EulerConvention>,
) -> Vec<(usize, usize)> {
    let amounts = amounts(direction, mountings, convention);
    let largest = amounts
        .iter()
        .map(|(_, amount)| amount.abs())
        .fold(0.0, f64::max);
    amounts
        .into_iter()
        .filter(|(_, amount)| amount.abs() > MOVED_SHARE * largest)
        .map(|(parameter, _)| parameter)
        .collect()
}

/// Displacement of each parameter along a direction, in metres (angles times [`LEVER_M`]).
fn amounts(
    direction: &DVector<f64>,
    mountings: &[Mounting],
    convention: Option<EulerConvention>,
) -> Vec<((usize, usize), f64)> {
    let mut amounts = Vec::new();
    for (scanner, mounting) in mountings.iter().enumerate() {
        let part = direction.rows(6 * scanner, 6);
        let angles = euler_jacobian_body(
            convention.unwrap_or(mounting.convention),
            &mounting.body_from_scanner,
        ) * part.fixed_rows::<3>(3);
        for axis in 0..3 {
            amounts.push(((scanner, axis), part[axis]));
        }
        for axis in 0..3 {
            amounts.push(((scanner, 3 + axis), angles[axis] * LEVER_M));
        }
    }
    amounts
}

fn describe(
    direction: &DVector<f64>,
    parameters: &[(usize, usize)],
    mountings: &[Mounting],
) -> String {
    let scanners = mountings.len();
    for (axis, noun) in ["shift along x", "shift along y", "height"]
        .iter()
        .enumerate()
    {
        let alone = parameters.iter().all(|&(_, parameter)| parameter == axis);
        let all = parameters.len() == scanners;
        let first = direction[axis];
        let alike = (0..scanners).all(|s| direction[6 * s + axis] * first > 0.0);
        if alone && all && alike {
            return if scanners == 1 {
                format!("the {noun} of `{}`", mountings[0].name)
            } else {
                format!("all scanners' common {noun}")
            };
        }
    }
    let names: Vec<String> = parameters
        .iter()
        .map(|&(scanner, parameter)| {
            format!(
                "`{}` {}",
                mountings[scanner].name, PARAMETER_NAMES[parameter]
            )
        })
        .collect();
    match names.as_slice() {
        [single] => single.clone(),
        several => format!("a combination of {}", several.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BodyFromScanner;

    /// Normal equations with this matrix, where each parameter alone would have information 1.
    fn equations(matrix: DMatrix<f64>) -> NormalEquations {
        let size = matrix.nrows();
        NormalEquations {
            gradient: DVector::zeros(size),
            uncentred: DVector::repeat(size, 1.0),
            matrix,
        }
    }

    fn two() -> Vec<Mounting> {
        ["left", "right"]
            .map(|name| Mounting::new(name, BodyFromScanner::identity()))
            .to_vec()
    }

    #[test]
    fn a_common_height_is_found_named_and_held() {
        // Everything is determined except the sum of both heights.
        let mut null = DVector::zeros(12);
        null[2] = 0.5f64.sqrt();
        null[8] = 0.5f64.sqrt();
        let matrix = DMatrix::identity(12, 12) - &null * null.transpose();
        let seen = Observability::new(&equations(matrix), &two());
        assert_eq!(seen.unobservable.len(), 1);
        assert_eq!(
            seen.unobservable[0].description,
            "all scanners' common height"
        );
        assert_eq!(seen.unobservable[0].parameters, [(0, 2), (1, 2)]);
        // Held at initial values, both heights are as wrong as these.
        let error = seen.unobservable[0].initial_error();
        assert!(
            (error[2].abs() - INITIAL_SIGMA_M).abs() < 1e-12 && (error[8] - error[2]).abs() < 1e-12
        );
        let held = seen.determined(&two());
        assert_eq!(held.ncols(), 11);
        assert!((held.transpose() * &null).norm() < 1e-12);
        let mut change = DVector::zeros(12);
        change[2] = 0.03;
        change[8] = 0.01;
        let back = seen.restoring(&change);
        assert!((back[2] + 0.02).abs() < 1e-12 && (back[8] + 0.02).abs() < 1e-12);
    }

    #[test]
    fn a_full_matrix_determines_everything() {
        let seen = Observability::new(&equations(DMatrix::identity(12, 12)), &two());
        assert!(seen.unobservable.is_empty());
        assert_eq!(seen.determined(&two()), DMatrix::identity(12, 12));
    }

    #[test]
    fn a_single_weak_parameter_is_unobservable_too() {
        // One scanner with only its height free, and almost no information left.
        let mut matrix = DMatrix::zeros(6, 6);
        matrix[(2, 2)] = 1e-6;
        let mut mounting = two().remove(0);
        mounting.fixed = [true, true, false, true, true, true];
        let mountings = [mounting];
        let seen = Observability::new(&equations(matrix), &mountings);
        assert_eq!(seen.unobservable.len(), 1);
        assert_eq!(seen.unobservable[0].description, "the height of `left`");
        assert_eq!(seen.determined(&mountings).ncols(), 0);
    }

    #[test]
    fn two_unobservable_directions_are_both_restored() {
        // Both heights are unobservable: any two directions that span them must restore both.
        let mut matrix = DMatrix::identity(12, 12);
        matrix[(2, 2)] = 0.0;
        matrix[(8, 8)] = 0.0;
        let mut seen = Observability::new(&equations(matrix), &two());
        assert_eq!(seen.unobservable.len(), 2);
        for (free, (left, right)) in seen.unobservable.iter_mut().zip([(1.0, 0.9), (0.9, 1.0)]) {
            free.direction = DVector::zeros(12);
            free.direction[2] = left;
            free.direction[8] = right;
            free.parameters = vec![(0, 2), (1, 2)];
        }
        let mut change = DVector::zeros(12);
        change[2] = 0.05;
        change[8] = -0.02;
        let back = seen.restoring(&change);
        assert!((back[2] + 0.05).abs() < 1e-12 && (back[8] - 0.02).abs() < 1e-12);
    }
}
