//! What the data determine, and what they do not, in plain words.
//!
//! The normal matrix is scaled by what each point would say of each parameter if the planes of the
//! neighbourhoods stood still ([`NormalEquations::uncentred`]). An eigenvalue is then the share of
//! that information which is left once the planes move along: near zero for a direction in which
//! the mountings move without any neighbourhood growing thicker. Such a direction is held at its
//! initial value: of the parameters that it mostly moves, the sum weighted by the direction stays,
//! where a metre of shift counts as much as a radian over [`LEVER_M`].

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::cost::NormalEquations;
use super::parameters::{Mounting, PARAMETER_NAMES, euler_jacobian_body, free_basis};
use crate::geometry::EulerConvention;

/// A rotation counts as the shift it causes at this distance, metres: the working range of a
/// close-range scanner.
pub const LEVER_M: f64 = 1.5;

/// Shares of the information below this count as none. On simulated drives the heights have 2e-6 to
/// 1e-5 without a reference, from what little roll and pitch tell, and the next direction 5e-3; with
/// one, nothing is below 1e-2. The threshold lies halfway between, in factors.
pub const WEAK_SHARE: f64 = 2e-4;

/// A direction that the data leave free.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct FreeDirection {
    /// (δp, δφ) of every scanner: metres and radians, in body axes.
    #[serde(skip)]
    pub direction: DVector<f64>,
    /// Share of the information that is left.
    #[serde(rename = "eigenvalue_share")]
    pub share: f64,
    /// What cannot be found, in words.
    #[serde(rename = "what")]
    pub words: String,
    /// The parameters concerned: (scanner, index into [`PARAMETER_NAMES`]).
    #[serde(skip)]
    pub parameters: Vec<(usize, usize)>,
}

/// Eigenvalues of the scaled normal matrix and the directions that are free.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Observability {
    /// Shares of the information that are left, ascending.
    #[serde(rename = "eigenvalue_shares")]
    pub shares: Vec<f64>,
    /// Free directions; empty where all is determined.
    #[serde(rename = "undetermined")]
    pub free: Vec<FreeDirection>,
}

impl Observability {
    /// What the normal equations at `mountings` say of their free parameters.
    pub fn of(equations: &NormalEquations, mountings: &[Mounting]) -> Self {
        let basis = &free_basis(mountings);
        let reduced = basis.transpose() * &equations.matrix * basis;
        // Points so far off that their squares overflow leave no numbers, and no eigenvalues.
        if reduced.is_empty() || reduced.iter().any(|entry| !entry.is_finite()) {
            return Self {
                shares: Vec::new(),
                free: Vec::new(),
            };
        }
        let scale: Vec<f64> = basis
            .column_iter()
            .map(|column| {
                let said = column.component_mul(&column).dot(&equations.uncentred);
                said.max(f64::MIN_POSITIVE).sqrt().recip()
            })
            .collect();
        let scaled = DMatrix::from_fn(reduced.nrows(), reduced.ncols(), |i, j| {
            reduced[(i, j)] * scale[i] * scale[j]
        });
        let eigen = SymmetricEigen::new(scaled);
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let share = |i: usize| eigen.eigenvalues[i].max(0.0);
        let free = order
            .iter()
            .filter(|&&i| share(i) < WEAK_SHARE)
            .map(|&i| {
                let coordinates = DVector::from_fn(scale.len(), |row, _| {
                    scale[row] * eigen.eigenvectors[(row, i)]
                });
                let direction = (basis * coordinates).normalize();
                let parameters = concerned(&direction, mountings, None);
                let words = in_words(&direction, &parameters, mountings);
                FreeDirection {
                    direction,
                    share: share(i),
                    words,
                    parameters,
                }
            })
            .collect();
        Self {
            shares: order.iter().map(|&i| share(i)).collect(),
            free,
        }
    }

    /// The directions in which the free parameters of `mountings` move and those that the data leave
    /// free stand still: 6 s × f.
    pub fn determined(&self, mountings: &[Mounting]) -> DMatrix<f64> {
        let basis = free_basis(mountings);
        if self.free.is_empty() {
            return basis;
        }
        // Constraint rows nᵀ P B z = 0; the null space of all of them, by QR of the transpose.
        let constraints = DMatrix::from_fn(basis.ncols(), self.free.len(), |column, row| {
            self.free[row].weighted().dot(&basis.column(column))
        });
        basis * null_space(&constraints)
    }

    /// The multiple of each free direction that brings `mountings` back to where `initial` held it.
    pub fn back_to(&self, change: &DVector<f64>) -> DVector<f64> {
        let count = self.free.len();
        let weighted: Vec<DVector<f64>> = self.free.iter().map(FreeDirection::weighted).collect();
        let products = DMatrix::from_fn(count, count, |i, j| {
            weighted[i].dot(&self.free[j].direction)
        });
        let sums = DVector::from_fn(count, |i, _| weighted[i].dot(change));
        let mut correction = DVector::zeros(change.len());
        // Singular where two directions move the same parameters alike: neither is then brought back.
        if let Some(amounts) = products.lu().solve(&sums) {
            for (free, amount) in self.free.iter().zip(amounts.iter()) {
                correction -= &free.direction * *amount;
            }
        }
        correction
    }
}

impl FreeDirection {
    /// Whether it moves this parameter by at least a third of what it moves the most, angles being
    /// those of `convention`.
    pub fn moves(
        &self,
        (scanner, parameter): (usize, usize),
        convention: EulerConvention,
        mountings: &[Mounting],
    ) -> bool {
        concerned(&self.direction, mountings, Some(convention)).contains(&(scanner, parameter))
    }

    /// P n: the direction over the parameters it mostly moves, rotations over [`LEVER_M`].
    fn weighted(&self) -> DVector<f64> {
        DVector::from_fn(self.direction.len(), |row, _| {
            let (scanner, axis) = (row / 6, row % 6);
            // The angles of the list are Euler angles; any of them brings in the whole rotation.
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
    let kept: Vec<usize> = (0..size).filter(|&i| eigen.eigenvalues[i] > 0.5).collect();
    DMatrix::from_fn(size, kept.len(), |row, column| {
        eigen.eigenvectors[(row, kept[column])]
    })
}

/// Parameters that a free direction moves by at least a third of what it moves the most; angles
/// in each mounting's own convention unless another is asked for.
fn concerned(
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
        .filter(|(_, amount)| amount.abs() > largest / 3.0)
        .map(|(parameter, _)| parameter)
        .collect()
}

/// How far a direction moves each parameter, in metres (angles over [`LEVER_M`]).
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

fn in_words(
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
        [one] => one.clone(),
        several => format!("a combination of {}", several.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BodyFromScanner;

    /// Normal equations with this matrix where each parameter alone would be known by one.
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
        // Everything determined but the sum of both heights.
        let mut null = DVector::zeros(12);
        null[2] = 0.5f64.sqrt();
        null[8] = 0.5f64.sqrt();
        let matrix = DMatrix::identity(12, 12) - &null * null.transpose();
        let seen = Observability::of(&equations(matrix), &two());
        assert_eq!(seen.free.len(), 1);
        assert_eq!(seen.free[0].words, "all scanners' common height");
        assert_eq!(seen.free[0].parameters, [(0, 2), (1, 2)]);
        let held = seen.determined(&two());
        assert_eq!(held.ncols(), 11);
        assert!((held.transpose() * &null).norm() < 1e-12);
        let mut change = DVector::zeros(12);
        change[2] = 0.03;
        change[8] = 0.01;
        let back = seen.back_to(&change);
        assert!((back[2] + 0.02).abs() < 1e-12 && (back[8] + 0.02).abs() < 1e-12);
    }

    #[test]
    fn a_full_matrix_frees_nothing() {
        let seen = Observability::of(&equations(DMatrix::identity(12, 12)), &two());
        assert!(seen.free.is_empty());
        assert_eq!(seen.determined(&two()), DMatrix::identity(12, 12));
    }

    #[test]
    fn a_parameter_that_is_weak_on_its_own_is_seen_too() {
        // One scanner, only its height free, and next to nothing left once the planes move along.
        let mut matrix = DMatrix::zeros(6, 6);
        matrix[(2, 2)] = 1e-6;
        let mut mounting = two().remove(0);
        mounting.fixed = [true, true, false, true, true, true];
        let mountings = [mounting];
        let seen = Observability::of(&equations(matrix), &mountings);
        assert_eq!(seen.free.len(), 1);
        assert_eq!(seen.free[0].words, "the height of `left`");
        assert_eq!(seen.determined(&mountings).ncols(), 0);
    }

    #[test]
    fn two_free_directions_are_both_brought_back() {
        // Both heights free: any two directions that span them must bring both back.
        let mut matrix = DMatrix::identity(12, 12);
        matrix[(2, 2)] = 0.0;
        matrix[(8, 8)] = 0.0;
        let mut seen = Observability::of(&equations(matrix), &two());
        assert_eq!(seen.free.len(), 2);
        for (free, (left, right)) in seen.free.iter_mut().zip([(1.0, 0.9), (0.9, 1.0)]) {
            free.direction = DVector::zeros(12);
            free.direction[2] = left;
            free.direction[8] = right;
            free.parameters = vec![(0, 2), (1, 2)];
        }
        let mut change = DVector::zeros(12);
        change[2] = 0.05;
        change[8] = -0.02;
        let back = seen.back_to(&change);
        assert!((back[2] + 0.05).abs() < 1e-12 && (back[8] - 0.02).abs() < 1e-12);
    }
}
