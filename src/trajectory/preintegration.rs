//! IMU samples summed up between two nodes (Forster, Carlone, Dellaert, Scaramuzza 2017), with
//! first-order correction for biases found later.

use crate::geometry::so3::{exp, hat, right_jacobian};
use crate::geometry::{Mat3, Rotation, Vec3};
use crate::project::ImuNoise;
use crate::sensor::ImuBias;

pub(super) type Mat9 = nalgebra::SMatrix<f64, 9, 9>;
pub(super) type Mat9x6 = nalgebra::SMatrix<f64, 9, 6>;

/// White noise of the integration itself, m/√s on the position. It stands for motion faster than
/// the sampling and keeps the covariance of a single sample well conditioned; over the 0.14 s
/// between prism fixes it is 4 µm.
pub(super) const INTEGRATION_DENSITY: f64 = 1e-5;

/// What the IMU says about the motion from node i to node j, without gravity:
/// R_j = R_i ΔR, v_j = v_i + g Δt + R_i Δv, p_j = p_i + v_i Δt + ½ g Δt² + R_i Δp.
///
/// Order of the 9: rotation (in the body frame at j), position, velocity; of the 6: gyro bias,
/// accelerometer bias.
#[derive(Debug, Clone)]
pub(super) struct MotionSums {
    pub duration_s: f64,
    pub rotation: Rotation,
    pub position_m: Vec3,
    pub velocity_m_s: Vec3,
    /// The bias taken off while summing.
    pub bias: ImuBias,
    /// Derivative of (rotation, position, velocity) by the bias.
    pub by_bias: Mat9x6,
}

/// The sums corrected to a bias.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corrected {
    pub rotation: Rotation,
    pub position_m: Vec3,
    pub velocity_m_s: Vec3,
}

impl Corrected {
    /// No motion.
    pub const NONE: Self = Self {
        rotation: Rotation::new_unchecked(nalgebra::Quaternion::new(1.0, 0.0, 0.0, 0.0)),
        position_m: Vec3::new(0.0, 0.0, 0.0),
        velocity_m_s: Vec3::new(0.0, 0.0, 0.0),
    };
}

impl MotionSums {
    /// No motion yet, about this bias.
    pub fn new(bias: ImuBias) -> Self {
        Self {
            duration_s: 0.0,
            rotation: Rotation::identity(),
            position_m: Vec3::zeros(),
            velocity_m_s: Vec3::zeros(),
            bias,
            by_bias: Mat9x6::zeros(),
        }
    }

    /// The 3 × 3 block of [`MotionSums::by_bias`] at these rows and columns.
    pub fn bias_block(&self, row: usize, column: usize) -> Mat3 {
        self.by_bias.fixed_view::<3, 3>(row, column).into_owned()
    }

    /// J δb, the rotation vector that corrects the rotation to a bias.
    pub fn turn(&self, bias: &ImuBias) -> Vec3 {
        self.bias_block(0, 0) * (bias.gyro_rad_s - self.bias.gyro_rad_s)
    }

    /// The sums to first order of what the bias misses.
    pub fn corrected(&self, bias: &ImuBias) -> Corrected {
        let gyro = bias.gyro_rad_s - self.bias.gyro_rad_s;
        let accel = bias.accel_m_s2 - self.bias.accel_m_s2;
        Corrected {
            rotation: self.rotation * exp(&self.turn(bias)),
            position_m: self.position_m
                + self.bias_block(3, 0) * gyro
                + self.bias_block(3, 3) * accel,
            velocity_m_s: self.velocity_m_s
                + self.bias_block(6, 0) * gyro
                + self.bias_block(6, 3) * accel,
        }
    }
}

/// Sums and their covariance.
#[derive(Debug, Clone)]
pub(super) struct Preintegrated {
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

    /// Adds one sample: mean angular rate and specific force over `dt_s`.
    ///
    /// With θ = (ω − b_g) dt and a = f − b_a,
    /// Δp += Δv dt + ½ ΔR Exp(θ/3) a dt², Δv += ΔR Exp(θ/2) a dt, ΔR ← ΔR Exp(θ).
    /// The fractions of θ turn the mean force to where it acts while the body turns; what they
    /// leave is of second order in θ (Forster et al. leave the first).
    ///
    /// Returns the derivative of the new sums by the old, in the order of the 9.
    pub fn add(&mut self, gyro_rad_s: Vec3, accel_m_s2: Vec3, dt_s: f64, noise: &ImuNoise) -> Mat9 {
        let dt = dt_s;
        let theta = (gyro_rad_s - self.sums.bias.gyro_rad_s) * dt;
        let force = accel_m_s2 - self.sums.bias.accel_m_s2;
        let step = exp(&theta);
        let start = self.sums.rotation.to_rotation_matrix().into_inner();
        let half = exp(&(theta / 2.0)).to_rotation_matrix().into_inner();
        let third = exp(&(theta / 3.0)).to_rotation_matrix().into_inner();

        // Derivative of the new sums by the sample's own bias; minus that, by its noise.
        let mut own = Mat9x6::zeros();
        let mut put = |row: usize, column: usize, block: Mat3| {
            own.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
        };
        let force_hat = hat(&force);
        put(0, 0, -right_jacobian(&theta) * dt);
        let turn = right_jacobian(&(theta / 3.0)) * (dt / 3.0);
        put(3, 0, start * third * force_hat * turn * (0.5 * dt * dt));
        put(3, 3, start * third * (-0.5 * dt * dt));
        let turn = right_jacobian(&(theta / 2.0)) * (dt / 2.0);
        put(6, 0, start * half * force_hat * turn * dt);
        put(6, 3, start * half * -dt);

        let mut old = Mat9::identity();
        let mut put = |row: usize, column: usize, block: Mat3| {
            old.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
        };
        put(0, 0, step.inverse().to_rotation_matrix().into_inner());
        put(3, 0, start * hat(&(third * force)) * (-0.5 * dt * dt));
        put(3, 6, Mat3::identity() * dt);
        put(6, 0, start * hat(&(half * force)) * -dt);
        if self.sums.duration_s > 0.0 {
            self.sums.by_bias = old * self.sums.by_bias + own;
            self.covariance = old * self.covariance * old.transpose();
        } else {
            self.sums.by_bias = own;
        }
        let mut weighted = own;
        let gyro_variance = noise.gyro_density.powi(2) / dt;
        let accel_variance = noise.accel_density.powi(2) / dt;
        for column in 0..6 {
            let variance = if column < 3 {
                gyro_variance
            } else {
                accel_variance
            };
            weighted.column_mut(column).scale_mut(variance);
        }
        self.covariance += weighted * own.transpose();
        for axis in 3..6 {
            self.covariance[(axis, axis)] += INTEGRATION_DENSITY.powi(2) * dt;
        }

        self.sums.position_m +=
            self.sums.velocity_m_s * dt + start * (third * force) * (0.5 * dt * dt);
        self.sums.velocity_m_s += start * (half * force) * dt;
        self.sums.rotation *= step;
        self.sums.duration_s += dt;
        old
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
    use crate::geometry::so3::log;

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
