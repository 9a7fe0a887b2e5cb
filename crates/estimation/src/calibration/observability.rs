//! Observability of the parameters.
//!
//! The normal matrix is scaled by the information the points would have on each parameter if the
//! planes of the neighbourhoods did not move ([`NormalEquations::uncentred`]). An eigenvalue is
//! then the share of that information that remains when the planes move with the points: near zero
//! for a direction in which the mountings move without any neighbourhood getting thicker. Such a
//! direction is held at its initial value: the sum of the parameters that it mainly moves, weighted
//! by the direction, stays constant. Rotations are converted to metres by [`LEVER_M`].
//!
//! Along slides and turns over level ground, noise of the normals adds its square to the matrix, so that
//! these shares are not small ([`Observability::beyond_noise`]). These directions are held too.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::cost::NormalEquations;
use super::parameters::{Mounting, PARAMETER_NAMES, euler_jacobian_body, free_basis};
use super::settings::{INITIAL_SIGMA, INITIAL_SIGMA_M};
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

/// Share of the normal matrix above which noise of the normals hides what the data say of a direction: the noise then has
/// more curvature than the cost, and the nearest of its dips is not the minimum.
const NOISE_SHARE: f64 = 0.5;

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
    /// Of unit length: the product of this with a change (δp, δφ) of all mountings is held at zero.
    pub constraint: DVector<f64>,
    /// Whether noise of the normals hides what the data say of it.
    pub is_hidden: bool,
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

    /// Also holds the directions along which noise of the normals makes more than half of the normal matrix H. With
    /// the mean N of what it adds, these are v with N v = ν H v; H v·δ is held at zero, so that changes along them and
    /// along the others do not affect each other.
    pub fn beyond_noise(
        mut self,
        equations: &NormalEquations,
        noise: &DMatrix<f64>,
        mountings: &[Mounting],
    ) -> Self {
        let basis = self.determined(mountings);
        let reduced = |matrix: &DMatrix<f64>| basis.transpose() * matrix * &basis;
        let Some(factor) = reduced(&equations.matrix).cholesky() else {
            return self;
        };
        // The eigenvalues of L⁻¹ N L⁻ᵀ.
        let lower = factor.l();
        let Some(half) = lower.solve_lower_triangular(&reduced(noise)) else {
            return self;
        };
        let Some(scaled) = lower.solve_lower_triangular(&half.transpose()) else {
            return self;
        };
        // The squares of wildly wrong points overflow.
        if scaled.is_empty() || scaled.iter().any(|entry| !entry.is_finite()) {
            return self;
        }
        let eigen = SymmetricEigen::new(scaled);
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let upper = lower.transpose();
        for k in order
            .into_iter()
            .take_while(|&k| eigen.eigenvalues[k] > NOISE_SHARE)
        {
            let coordinates = upper.solve_upper_triangular(&eigen.eigenvectors.column(k));
            let Some(direction) = coordinates.map(|coordinates| &basis * coordinates) else {
                continue;
            };
            let mut held = UnobservableDirection::of(&direction, mountings, 0.0);
            held.constraint = (&equations.matrix * &direction).normalize();
            held.is_hidden = true;
            self.unobservable.push(held);
        }
        self
    }

    /// Of the directions that noise of the normals hides, what is held at zero: its product with a change (δp, δφ) of all
    /// mountings, in standard deviations of initial values as the joint adjustment has them.
    pub fn hidden(&self) -> Vec<DVector<f64>> {
        let hidden = self.unobservable.iter().filter(|held| held.is_hidden);
        let scaled = hidden.map(|UnobservableDirection { constraint, .. }| {
            let parts = constraint.iter().enumerate();
            let squares = parts.map(|(row, x)| (x * INITIAL_SIGMA[row % 6 / 3]).powi(2));
            constraint / squares.sum::<f64>().sqrt()
        });
        scaled.collect()
    }

    /// Basis of the directions in which the free parameters of `mountings` move without the
    /// unobservable directions: 6 s × f.
    pub fn determined(&self, mountings: &[Mounting]) -> DMatrix<f64> {
        let basis = free_basis(mountings);
        if self.unobservable.is_empty() {
            return basis;
        }
        // Null space of the constraints, by QR of the transpose.
        let constraints =
            DMatrix::from_fn(basis.ncols(), self.unobservable.len(), |column, row| {
                self.unobservable[row].constraint.dot(&basis.column(column))
            });
        basis * null_space(&constraints)
    }

    /// Returns the correction along the unobservable directions that undoes their part of `change`.
    pub fn restoring(&self, change: &DVector<f64>) -> DVector<f64> {
        let count = self.unobservable.len();
        let products = DMatrix::from_fn(count, count, |i, j| {
            let [held, moved] = [i, j].map(|i| &self.unobservable[i]);
            held.constraint.dot(&moved.direction)
        });
        let sums = DVector::from_fn(count, |i, _| self.unobservable[i].constraint.dot(change));
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
            constraint: concerned(&direction, &parameters).normalize(),
            is_hidden: false,
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
}

/// P n: a direction restricted to the parameters that it mainly moves, rotations weighted by [`LEVER_M`].
fn concerned(direction: &DVector<f64>, parameters: &[(usize, usize)]) -> DVector<f64> {
    DVector::from_fn(direction.len(), |row, _| {
        let (scanner, axis) = (row / 6, row % 6);
        // The listed angles are Euler angles; any of them includes the whole rotation.
        let concerned = parameters.iter().any(|&(s, parameter)| {
            s == scanner
                && if axis < 3 {
                    parameter == axis
                } else {
                    parameter >= 3
                }
        });
        let metric = if axis < 3 { 1.0 } else { LEVER_M * LEVER_M };
        if concerned {
            direction[row] * metric
        } else {
            0.0
        }
    })
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

    /// Noise makes up all but a share of what is known of a direction that is not along the axes of the matrix.
    #[test]
    fn a_direction_that_only_noise_determines_is_held_across_the_matrix() {
        let direction = DVector::from_fn(12, |i, _| if i == 0 || i == 7 { 1.0 } else { 0.0 });
        let matrix = DMatrix::from_fn(12, 12, |i, j| match (i, j) {
            (0, 7) | (7, 0) => 0.4,
            _ => f64::from(u8::from(i == j)) * (1.0 + i as f64),
        });
        let across = &matrix * &direction;
        let held_with = |share: f64| {
            let noise = &across * across.transpose() * (share / direction.dot(&across));
            Observability::new(&equations(matrix.clone()), &two()).beyond_noise(
                &equations(matrix.clone()),
                &noise,
                &two(),
            )
        };
        assert!(held_with(0.9 * NOISE_SHARE).unobservable.is_empty());
        let held = held_with(1.1 * NOISE_SHARE);
        assert_eq!(held.unobservable.len(), 1);
        let found = &held.unobservable[0].direction;
        assert!(
            (found - direction.normalize())
                .amax()
                .min((found + direction.normalize()).amax())
                < 1e-9
        );
        // Free directions are those that the matrix does not couple with it; the rest of a change stays.
        let free = held.determined(&two());
        assert_eq!(free.ncols(), 11);
        assert!((free.transpose() * &across).amax() < 1e-12);
        let change = &free.column(3) * 0.02 + &direction * 0.05;
        assert!((held.restoring(&change) + &direction * 0.05).amax() < 1e-12);
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
