//! IMU samples summed up between two nodes (Forster, Carlone, Dellaert, Scaramuzza 2017), with
//! first-order correction for biases found later.

use crate::geometry::so3::{exp, hat, right_jacobian};
use crate::geometry::{Mat3, Rotation, Vec3};
use crate::sensor::ImuBias;
use crate::trajectory::ImuNoise;

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

/// The derivative of new sums by the old ones,
/// A = [[turn, 0, 0], [position, 1, dt], [velocity, 0, 1]] in blocks of 3.
#[derive(Debug, Clone, Copy)]
pub(super) struct Transition {
    pub turn: Mat3,
    pub position: Mat3,
    pub velocity: Mat3,
    pub dt_s: f64,
}

impl Transition {
    /// `left` A.
    pub fn after(&self, left: &Mat9) -> Mat9 {
        let columns = |at: usize| left.fixed_columns::<3>(at);
        let mut product = *left;
        product.fixed_columns_mut::<3>(0).copy_from(
            &(columns(0) * self.turn + columns(3) * self.position + columns(6) * self.velocity),
        );
        product
            .fixed_columns_mut::<3>(6)
            .copy_from(&(columns(3) * self.dt_s + columns(6)));
        product
    }
}

/// The derivatives of new sums (rotation, position, velocity) by the gyro and the accelerometer
/// bias of the sample added; minus these, by its noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct Own {
    by_gyro: [Mat3; 3],
    by_accel: [Mat3; 3],
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

    /// Adds one sample: mean angular rate and specific force over `dt_s`.
    ///
    /// With θ = (ω − b_g) dt and a = f − b_a,
    /// Δp += Δv dt + ½ ΔR Exp(θ/3) a dt², Δv += ΔR Exp(θ/2) a dt, ΔR ← ΔR Exp(θ).
    /// The fractions of θ turn the mean force to where it acts while the body turns; what they
    /// leave is of second order in θ (Forster et al. leave the first).
    ///
    /// Returns the derivatives of the new sums by the old, and by the sample's own bias.
    pub fn add(&mut self, gyro_rad_s: Vec3, accel_m_s2: Vec3, dt_s: f64) -> (Transition, Own) {
        let theta = (gyro_rad_s - self.bias.gyro_rad_s) * dt_s;
        let force = accel_m_s2 - self.bias.accel_m_s2;
        let matrix = |rotation: &Rotation| rotation.to_rotation_matrix().into_inner();
        let step = exp(&theta);
        let start = matrix(&self.rotation);
        let half = matrix(&exp(&(theta / 2.0)));
        let third = matrix(&exp(&(theta / 3.0)));
        let half_square = 0.5 * dt_s * dt_s;
        let force_hat = hat(&force);
        let transition = Transition {
            turn: matrix(&step).transpose(),
            position: start * hat(&(third * force)) * -half_square,
            velocity: start * hat(&(half * force)) * -dt_s,
            dt_s,
        };
        let turned_third = right_jacobian(&(theta / 3.0)) * (dt_s / 3.0);
        let turned_half = right_jacobian(&(theta / 2.0)) * (dt_s / 2.0);
        let own = Own {
            by_gyro: [
                right_jacobian(&theta) * -dt_s,
                start * third * force_hat * turned_third * half_square,
                start * half * force_hat * turned_half * dt_s,
            ],
            by_accel: [
                Mat3::zeros(),
                start * third * -half_square,
                start * half * -dt_s,
            ],
        };
        // The rotation does not hang on the accelerometer.
        let by_gyro = [0, 3, 6].map(|row| self.bias_block(row, 0));
        let by_accel = [3, 6].map(|row| self.bias_block(row, 3));
        let Transition {
            turn,
            position,
            velocity,
            ..
        } = &transition;
        let mut put = |row: usize, column: usize, block: Mat3| {
            self.by_bias
                .fixed_view_mut::<3, 3>(row, column)
                .copy_from(&block);
        };
        put(0, 0, turn * by_gyro[0] + own.by_gyro[0]);
        put(
            3,
            0,
            position * by_gyro[0] + by_gyro[1] + by_gyro[2] * dt_s + own.by_gyro[1],
        );
        put(6, 0, velocity * by_gyro[0] + by_gyro[2] + own.by_gyro[2]);
        put(3, 3, by_accel[0] + by_accel[1] * dt_s + own.by_accel[1]);
        put(6, 3, by_accel[1] + own.by_accel[2]);

        self.position_m += self.velocity_m_s * dt_s + start * (third * force) * half_square;
        self.velocity_m_s += start * (half * force) * dt_s;
        self.rotation *= step;
        self.duration_s += dt_s;
        (transition, own)
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

    /// Adds one sample to sums and covariance, see [`MotionSums::add`].
    pub fn add(
        &mut self,
        gyro_rad_s: Vec3,
        accel_m_s2: Vec3,
        dt_s: f64,
        noise: &ImuNoise,
    ) -> Transition {
        let (transition, own) = self.sums.add(gyro_rad_s, accel_m_s2, dt_s);
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
        // A Σ, then its upper blocks by Aᵀ.
        let first = upper.map(|block| turn * block);
        let second: [Mat3; 3] =
            std::array::from_fn(|i| position * upper[i] + middle[i] + lower[i] * dt_s);
        let third: [Mat3; 3] = std::array::from_fn(|i| velocity * upper[i] + lower[i]);
        let gyro = noise.gyro_density.powi(2) / dt_s;
        let accel = noise.accel_density.powi(2) / dt_s;
        let white = |a: usize, b: usize| {
            own.by_gyro[a] * own.by_gyro[b].transpose() * gyro
                + own.by_accel[a] * own.by_accel[b].transpose() * accel
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
