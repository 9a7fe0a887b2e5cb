//! The structure tensor of a neighbourhood: its covariance, eigenvalues and derived quantities.

use crate::geometry::{Mat3, Vec3};

/// Rounding error of the covariance of a neighbourhood, relative to its trace: a few roundings of
/// its entries. Smaller eigenvalues are returned as 0.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Mean and covariance of a set of points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StructureTensor {
    /// Mean of the points, metres.
    pub mean: Vec3,
    /// Σ (x − x̄)(x − x̄)ᵀ / n, square metres.
    pub covariance: Mat3,
    /// Number of points n.
    pub count: usize,
}

/// Eigenvalues and eigenvectors of a structure tensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eigen {
    /// λ₁ ≥ λ₂ ≥ λ₃ ≥ 0, square metres.
    pub values: Vec3,
    /// Unit eigenvectors as columns, in the order of the values, an orthogonal matrix.
    pub vectors: Mat3,
}

impl StructureTensor {
    /// The tensor of `points`, in two passes over offsets from the first point, so that large
    /// coordinates lose no precision. For an empty set, mean and covariance are NaN; for one point
    /// or coincident points, the covariance is zero.
    pub fn from_points<'a, I>(points: I) -> Self
    where
        I: IntoIterator<Item = &'a Vec3>,
        I::IntoIter: Clone,
    {
        let points = points.into_iter();
        let Some(&first) = points.clone().next() else {
            return Self {
                mean: Vec3::repeat(f64::NAN),
                covariance: Mat3::repeat(f64::NAN),
                count: 0,
            };
        };
        let mut count = 0;
        let mut sum = Vec3::zeros();
        for point in points.clone() {
            sum += point - first;
            count += 1;
        }
        let n = count as f64;
        let mean = sum / n;
        let [mut xx, mut xy, mut xz, mut yy, mut yz, mut zz] = [0.0; 6];
        for point in points {
            let d = (point - first) - mean;
            xx += d.x * d.x;
            xy += d.x * d.y;
            xz += d.x * d.z;
            yy += d.y * d.y;
            yz += d.y * d.z;
            zz += d.z * d.z;
        }
        Self {
            mean: first + mean,
            covariance: Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) / n,
            count,
        }
    }

    /// The tensor of the points at `indices`, in that order.
    pub fn of(points: &[Vec3], indices: &[u32]) -> Self {
        Self::from_points(indices.iter().map(|&index| &points[index as usize]))
    }

    /// Eigenvalues and eigenvectors, by Jacobi's rotations.
    ///
    /// Values are accurate to a few roundings of the largest. If points are coplanar, collinear or
    /// coincident, up to that rounding, the vanishing values are exactly 0, and the vectors of
    /// equal values are arbitrary orthogonal ones. All NaN for an empty set.
    pub fn eigen(&self) -> Eigen {
        if !self.covariance.iter().all(|entry| entry.is_finite()) {
            return Eigen {
                values: Vec3::repeat(f64::NAN),
                vectors: Mat3::repeat(f64::NAN),
            };
        }
        let (values, vectors) = jacobi(self.covariance);
        let floor = ROUNDING * self.covariance.trace();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
        Eigen {
            values: Vec3::from_fn(|i, _| {
                let value = values[order[i]];
                if value > floor { value } else { 0.0 }
            }),
            vectors: Mat3::from_fn(|row, column| vectors[(row, order[column])]),
        }
    }

    /// Omnivariance (λ₁ λ₂ λ₃)^⅓ = det(C)^⅓, square metres.
    ///
    /// The determinant is the product of the pivots of a Cholesky decomposition with diagonal
    /// pivoting, which is accurate to a few roundings times λ₁/λ₃. Exactly 0 for coplanar,
    /// collinear or coincident points (up to rounding), so always for one to three points; NaN for
    /// an empty set.
    pub fn omnivariance(&self) -> f64 {
        if self.count == 0 {
            return f64::NAN;
        }
        if self.count < 4 {
            return 0.0;
        }
        let c = &self.covariance;
        let floor = ROUNDING * c.trace();
        let first = c.diagonal().imax();
        let (second, third) = ((first + 1) % 3, (first + 2) % 3);
        // The remaining entries after eliminating the largest, and the larger and smaller on their
        // diagonal.
        let pivot = c[(first, first)];
        let (to_second, to_third) = (c[(first, second)], c[(first, third)]);
        let left = c[(second, second)] - to_second * to_second / pivot;
        let other = c[(third, third)] - to_third * to_third / pivot;
        let off = c[(second, third)] - to_second * to_third / pivot;
        let (large, small) = (left.max(other), left.min(other));
        if pivot <= floor || large <= floor {
            return 0.0;
        }
        let last = small - off * off / large;
        if last <= floor {
            return 0.0;
        }
        let determinant = pivot * large * last;
        determinant.cbrt()
    }

    /// Unit normal: the eigenvector of the smallest eigenvalue, of either sign. `None` if the
    /// points do not span a plane: fewer than three, coincident or collinear.
    pub fn normal(&self) -> Option<Vec3> {
        let eigen = self.eigen();
        (self.count >= 3 && eigen.values.y > 0.0).then(|| eigen.vectors.column(2).into_owned())
    }
}

impl Eigen {
    /// (λ₂ − λ₃) / λ₁: 1 for a round disc, 0 for a line or a ball; NaN if λ₁ = 0.
    pub fn planarity(&self) -> f64 {
        (self.values.y - self.values.z) / self.values.x
    }
}

/// Eigenvalues and eigenvectors (columns) of the symmetric `a`: plane rotations eliminate the
/// off-diagonal entries in turn. Convergence is quadratic, usually within four sweeps.
fn jacobi(mut a: Mat3) -> (Vec3, Mat3) {
    let mut vectors = Mat3::identity();
    for _sweep in 0..16 {
        if a[(0, 1)] == 0.0 && a[(0, 2)] == 0.0 && a[(1, 2)] == 0.0 {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a[(p, q)];
            // An entry below the rounding error of both its diagonal entries changes neither.
            let (app, aqq) = (a[(p, p)], a[(q, q)]);
            if off.abs() <= 0.25 * f64::EPSILON * (app.abs() * aqq.abs()).sqrt() {
                a[(p, q)] = 0.0;
                a[(q, p)] = 0.0;
                continue;
            }
            // Tangent of the rotation angle: the smaller root of t² + 2 θ t − 1 = 0.
            let theta = (aqq - app) / (2.0 * off);
            // If θ² overflows, t is 0, which is correct up to rounding.
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (t * t + 1.0).sqrt();
            let sine = t * cosine;
            a[(p, p)] = app - t * off;
            a[(q, q)] = aqq + t * off;
            a[(p, q)] = 0.0;
            a[(q, p)] = 0.0;
            let r = 3 - p - q;
            let (arp, arq) = (a[(r, p)], a[(r, q)]);
            let (rotated_p, rotated_q) = (cosine * arp - sine * arq, sine * arp + cosine * arq);
            a[(r, p)] = rotated_p;
            a[(p, r)] = rotated_p;
            a[(r, q)] = rotated_q;
            a[(q, r)] = rotated_q;
            for row in 0..3 {
                let (vp, vq) = (vectors[(row, p)], vectors[(row, q)]);
                vectors[(row, p)] = cosine * vp - sine * vq;
                vectors[(row, q)] = sine * vp + cosine * vq;
            }
        }
    }
    (a.diagonal(), vectors)
}
