//! IMU samples summed up between two nodes, with the covariance of the sums.

use super::imu_series::Piece;
use super::motion_sums::{Mat9, MotionSums, Transition};
use super::settings::ImuNoise;
use crate::geometry::{Mat3, Vec3};
use crate::sensor::ImuBias;

/// White noise of the integration itself, m/√s on the position. It stands for motion faster than
/// the sampling and keeps the covariance of a single sample well conditioned; over the 0.14 s
/// between prism fixes it is 4 µm.
const INTEGRATION_DENSITY: f64 = 1e-5;

/// Sums and their covariance.
#[derive(Debug, Clone)]
pub struct Preintegrated {
    pub sums: MotionSums,
    pub covariance: Mat9,
}

impl Preintegrated {
    pub fn new(bias: ImuBias) -> Self {
        Self {
            sums: MotionSums::new(bias),
            covariance: Mat9::zeros(),
        }
    }

    /// The sums over all these pieces, about this bias.
    pub fn over<'a>(bias: ImuBias, pieces: impl Iterator<Item = Piece<'a>>) -> Self {
        let mut sums = Self::new(bias);
        pieces.for_each(|piece| {
            sums.add_piece(&piece);
        });
        sums
    }

    /// Adds a piece.
    pub fn add_piece(&mut self, piece: &Piece<'_>) -> Transition {
        let (sample, noise) = (piece.sample, piece.noise);
        let (gyro, accel) = (sample.gyro_rad_s, sample.accel_m_s2);
        self.add(gyro, accel, piece.duration_s, noise)
    }

    /// Adds one sample to sums and covariance, see [`MotionSums::add`].
    pub fn add(
        &mut self,
        gyro_rad_s: Vec3,
        accel_m_s2: Vec3,
        dt_s: f64,
        noise: &ImuNoise,
    ) -> Transition {
        let (transition, derivative) = self.sums.add(gyro_rad_s, accel_m_s2, dt_s);
        let old = |row: usize, column: usize| -> Mat3 {
            self.covariance
                .fixed_view::<3, 3>(3 * row, 3 * column)
                .into_owned()
        };
        let upper = [old(0, 0), old(0, 1), old(0, 2)];
        let middle = [upper[1].transpose(), old(1, 1), old(1, 2)];
        let lower = [upper[2].transpose(), middle[2].transpose(), old(2, 2)];
        let Transition {
            turn,
            position,
            velocity,
            dt_s,
        } = transition;
        // A Σ, then the upper blocks of A Σ Aᵀ.
        let first = upper.map(|block| turn * block);
        let second: [Mat3; 3] =
            std::array::from_fn(|i| position * upper[i] + middle[i] + lower[i] * dt_s);
        let third: [Mat3; 3] = std::array::from_fn(|i| velocity * upper[i] + lower[i]);
        let gyro = noise.gyro_density.powi(2) / dt_s;
        let accel = noise.accel_density.powi(2) / dt_s;
        let white = |a: usize, b: usize| {
            derivative.by_gyro[a] * derivative.by_gyro[b].transpose() * gyro
                + derivative.by_accel[a] * derivative.by_accel[b].transpose() * accel
        };
        let (position, velocity) = (position.transpose(), velocity.transpose());
        let integration = Mat3::identity() * (INTEGRATION_DENSITY.powi(2) * dt_s);
        let blocks = [
            (0, 0, first[0] * turn.transpose()),
            (0, 1, first[0] * position + first[1] + first[2] * dt_s),
            (0, 2, first[0] * velocity + first[2]),
            (
                1,
                1,
                second[0] * position + second[1] + second[2] * dt_s + integration,
            ),
            (1, 2, second[0] * velocity + second[2]),
            (2, 2, third[0] * velocity + third[2]),
        ];
        for (row, column, block) in blocks {
            let block = block + white(row, column);
            let mut put = |row: usize, column: usize, block: &Mat3| {
                self.covariance
                    .fixed_view_mut::<3, 3>(3 * row, 3 * column)
                    .copy_from(block);
            };
            put(row, column, &block);
            if row != column {
                put(column, row, &block.transpose());
            }
        }
        transition
    }

    /// W, lower triangular, with Wᵀ W the inverse of the covariance; `None` where the noise is
    /// not positive.
    pub fn whitener(&self) -> Option<Mat9> {
        let lower = self.covariance.cholesky()?.l();
        lower.solve_lower_triangular(&Mat9::identity())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Rotation;
    use crate::geometry::so3::{exp, log};

    const NOISE: ImuNoise = ImuNoise {
        gyro_density: 1e-3,
        accel_density: 1e-2,
        gyro_bias_walk: 1e-5,
        accel_bias_walk: 1e-4,
    };

    fn samples() -> Vec<(Vec3, Vec3, f64)> {
        (0..7)
            .map(|i| {
                let x = f64::from(i);
                (
                    Vec3::new(0.8 * x.sin(), 1.5, -0.7 * x.cos()),
                    Vec3::new(2.0 * x.cos(), -1.0, 9.0 + x.sin()),
                    0.01 + 0.001 * x,
                )
            })
            .collect()
    }

    fn integrated(bias: ImuBias) -> Preintegrated {
        let mut sum = Preintegrated::new(bias);
        for (gyro, accel, dt) in samples() {
            sum.add(gyro, accel, dt, &NOISE);
        }
        sum
    }

    #[test]
    fn a_transition_from_the_right_is_its_matrix() {
        let (transition, _) = integrated(ImuBias::default()).sums.add(
            Vec3::new(0.1, 0.2, -0.3),
            Vec3::new(1.0, 2.0, 9.0),
            0.02,
        );
        let mut a = Mat9::identity();
        a.fixed_view_mut::<3, 3>(0, 0).copy_from(&transition.turn);
        a.fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&transition.position);
        a.fixed_view_mut::<3, 3>(6, 0)
            .copy_from(&transition.velocity);
        a.fixed_view_mut::<3, 3>(3, 6)
            .copy_from(&(Mat3::identity() * transition.dt_s));
        let left = Mat9::from_fn(|i, j| (i * 9 + j) as f64);
        assert!((transition.after(&left) - left * a).amax() < 1e-12 * left.amax());
    }

    fn difference(a: &Preintegrated, b: &Preintegrated) -> nalgebra::SVector<f64, 9> {
        let mut d = nalgebra::SVector::<f64, 9>::zeros();
        let turn = log(&(a.sums.rotation.inverse() * b.sums.rotation));
        d.fixed_rows_mut::<3>(0).copy_from(&turn);
        d.fixed_rows_mut::<3>(3)
            .copy_from(&(b.sums.position_m - a.sums.position_m));
        d.fixed_rows_mut::<3>(6)
            .copy_from(&(b.sums.velocity_m_s - a.sums.velocity_m_s));
        d
    }

    fn shifted(bias: ImuBias, column: usize, h: f64) -> ImuBias {
        let mut out = bias;
        if column < 3 {
            out.gyro_rad_s[column] += h;
        } else {
            out.accel_m_s2[column - 3] += h;
        }
        out
    }

    #[test]
    fn sums_agree_with_integration_in_small_steps() {
        // Rate and force constant in the body during each sample: Euler steps of dt / 2000 of
        // the equations of motion, error of first order in the step.
        let sum = integrated(ImuBias::default());
        let (mut r, mut p, mut v) = (Rotation::identity(), Vec3::zeros(), Vec3::zeros());
        for (gyro, accel, dt) in samples() {
            let h = dt / 2000.0;
            for _ in 0..2000 {
                let middle = r * exp(&(gyro * (0.5 * h)));
                p += v * h + middle * accel * (0.5 * h * h);
                v += middle * accel * h;
                r *= exp(&(gyro * h));
            }
        }
        assert!(r.angle_to(&sum.sums.rotation) < 1e-9);
        // θ up to 0.025 rad in a sample: θ²/24 of 10 m/s² over 0.09 s is 2e-5 m/s.
        assert!(
            (v - sum.sums.velocity_m_s).norm() < 3e-5,
            "{}",
            (v - sum.sums.velocity_m_s).norm()
        );
        assert!(
            (p - sum.sums.position_m).norm() < 3e-6,
            "{}",
            (p - sum.sums.position_m).norm()
        );
    }

    #[test]
    fn bias_derivative_meets_finite_differences() {
        let bias = ImuBias {
            gyro_rad_s: Vec3::new(0.02, -0.01, 0.03),
            accel_m_s2: Vec3::new(0.1, 0.2, -0.1),
        };
        let sum = integrated(bias);
        let h = 1e-5;
        for column in 0..6 {
            let plus = difference(&sum, &integrated(shifted(bias, column, h)));
            let minus = difference(&sum, &integrated(shifted(bias, column, -h)));
            let numeric = (plus - minus) / (2.0 * h);
            let error = (numeric - sum.sums.by_bias.column(column)).norm();
            assert!(error < 1e-9, "column {column}: {error}");
        }
    }

    #[test]
    fn covariance_is_the_sum_over_the_noise_of_every_sample() {
        // Each noise component of each sample moved by itself: J diag(σ²) Jᵀ.
        let sum = integrated(ImuBias::default());
        let mut expected = Mat9::zeros();
        let h = 1e-5;
        for moved in 0..samples().len() {
            for column in 0..6 {
                let run = |shift: f64| {
                    let mut sum = Preintegrated::new(ImuBias::default());
                    for (i, (mut gyro, mut accel, dt)) in samples().into_iter().enumerate() {
                        if i == moved && column < 3 {
                            gyro[column] += shift;
                        } else if i == moved {
                            accel[column - 3] += shift;
                        }
                        sum.add(gyro, accel, dt, &NOISE);
                    }
                    sum
                };
                let slope = (difference(&sum, &run(h)) - difference(&sum, &run(-h))) / (2.0 * h);
                let dt = samples()[moved].2;
                let density = if column < 3 {
                    NOISE.gyro_density
                } else {
                    NOISE.accel_density
                };
                expected += slope * slope.transpose() * (density * density / dt);
            }
        }
        // Integration noise enters the position of each sample and stays there.
        for axis in 3..6 {
            expected[(axis, axis)] += INTEGRATION_DENSITY.powi(2) * sum.sums.duration_s;
        }
        let error = (expected - sum.covariance).norm() / expected.norm();
        assert!(error < 1e-8, "{error}");
        let w = sum.whitener().expect("positive");
        let unit = w * sum.covariance * w.transpose();
        assert!((unit - Mat9::identity()).norm() < 1e-6);
    }
}
