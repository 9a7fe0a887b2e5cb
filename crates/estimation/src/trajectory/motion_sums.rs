//! IMU samples summed up between two nodes (Forster, Carlone, Dellaert, Scaramuzza 2017), with
//! first-order correction for biases found later.

use super::imu_series::Piece;
use super::states::NodeState;
use crate::geometry::so3::{exp, hat, log, right_jacobian};
use crate::geometry::{Mat3, Rotation, Vec3, WorldFromBody};
use crate::sensor::ImuBias;

pub type Mat9 = nalgebra::SMatrix<f64, 9, 9>;
pub type Mat9x6 = nalgebra::SMatrix<f64, 9, 6>;

/// The motion from node i to node j as the IMU measures it, without gravity:
/// R_j = R_i ΔR, v_j = v_i + g Δt + R_i Δv, p_j = p_i + v_i Δt + ½ g Δt² + R_i Δp.
///
/// Order of the 9: rotation (in the body frame at j), position, velocity; of the 6: gyro bias,
/// accelerometer bias.
#[derive(Debug, Clone)]
pub struct MotionSums {
    pub duration_s: f64,
    pub rotation: Rotation,
    pub position_m: Vec3,
    pub velocity_m_s: Vec3,
    /// The bias subtracted while summing.
    pub bias: ImuBias,
    /// Derivative of (rotation, position, velocity) with respect to the bias.
    pub by_bias: Mat9x6,
}

/// The derivative of the new sums with respect to the old ones,
/// A = [[turn, 0, 0], [position, 1, dt], [velocity, 0, 1]] in blocks of 3.
#[derive(Debug, Clone, Copy)]
pub struct Transition {
    pub turn: Mat3,
    pub position: Mat3,
    pub velocity: Mat3,
    pub dt_s: f64,
}

impl Transition {
    /// The product `left` A.
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

/// The derivatives of the new sums (rotation, position, velocity) with respect to the gyro and the
/// accelerometer bias of the added sample; those with respect to its noise are their negatives.
#[derive(Debug, Clone, Copy)]
pub struct SampleDerivative {
    pub by_gyro: [Mat3; 3],
    pub by_accel: [Mat3; 3],
}

/// The sums corrected to a bias.
#[derive(Debug, Clone, Copy)]
pub struct Corrected {
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
    /// The sums of no motion, about this bias.
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

    /// The sums over all these pieces, about this bias.
    pub fn over<'a>(bias: ImuBias, pieces: impl Iterator<Item = Piece<'a>>) -> Self {
        let mut sums = Self::new(bias);
        for piece in pieces {
            let sample = piece.sample;
            sums.add(sample.gyro_rad_s, sample.accel_m_s2, piece.duration_s);
        }
        sums
    }

    /// Adds one sample: mean angular rate and specific force over `dt_s`.
    ///
    /// With θ = (ω − b_g) dt and a = f − b_a,
    /// Δp += Δv dt + ½ ΔR Exp(θ/3) a dt², Δv += ΔR Exp(θ/2) a dt, ΔR ← ΔR Exp(θ).
    /// The fractions of θ turn the mean force to where it acts while the body turns; what they
    /// neglect is of second order in θ (Forster et al. neglect the first order).
    ///
    /// Returns the derivatives of the new sums with respect to the old ones and to the sample's bias.
    pub fn add(
        &mut self,
        gyro_rad_s: Vec3,
        accel_m_s2: Vec3,
        dt_s: f64,
    ) -> (Transition, SampleDerivative) {
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
        let derivative = SampleDerivative {
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
        // The rotation does not depend on the accelerometer.
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
        put(0, 0, turn * by_gyro[0] + derivative.by_gyro[0]);
        put(
            3,
            0,
            position * by_gyro[0] + by_gyro[1] + by_gyro[2] * dt_s + derivative.by_gyro[1],
        );
        put(
            6,
            0,
            velocity * by_gyro[0] + by_gyro[2] + derivative.by_gyro[2],
        );
        put(
            3,
            3,
            by_accel[0] + by_accel[1] * dt_s + derivative.by_accel[1],
        );
        put(6, 3, by_accel[1] + derivative.by_accel[2]);

        self.position_m += self.velocity_m_s * dt_s + start * (third * force) * half_square;
        self.velocity_m_s += start * (half * force) * dt_s;
        self.rotation *= step;
        self.duration_s += dt_s;
        (transition, derivative)
    }

    /// The 3 × 3 block of [`MotionSums::by_bias`] at these rows and columns.
    pub fn bias_block(&self, row: usize, column: usize) -> Mat3 {
        self.by_bias.fixed_view::<3, 3>(row, column).into_owned()
    }

    /// The mean rate that was summed, with the bias in it, rad/s: to second order of the turn, Log(ΔR)/Δt + b.
    pub fn mean_rate_rad_s(&self) -> Vec3 {
        log(&self.rotation) / self.duration_s + self.bias.gyro_rad_s
    }

    /// J δb, the rotation vector that corrects the rotation to a bias.
    pub fn turn(&self, bias: &ImuBias) -> Vec3 {
        self.bias_block(0, 0) * (bias.gyro_rad_s - self.bias.gyro_rad_s)
    }

    /// The sums corrected to a bias, to first order of its difference from the bias subtracted.
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

    /// The motion predicted from a node by the sums, corrected to `bias`.
    pub fn predict(&self, from: &NodeState, bias: &ImuBias, gravity_m_s2: f64) -> NodeState {
        let (sums, dt) = (self.corrected(bias), self.duration_s);
        let gravity = Vec3::new(0.0, 0.0, -gravity_m_s2);
        let WorldFromBody {
            rotation,
            translation_m,
            ..
        } = from.world_from_body;
        let position_m = translation_m
            + from.velocity_m_s * dt
            + gravity * (0.5 * dt * dt)
            + rotation * sums.position_m;
        NodeState {
            world_from_body: WorldFromBody::new(rotation * sums.rotation, position_m),
            velocity_m_s: from.velocity_m_s + gravity * dt + rotation * sums.velocity_m_s,
        }
    }
}
