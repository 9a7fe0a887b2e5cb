//! The IMU between neighbouring nodes.

use super::{ACCEL, ATTITUDE, GYRO, NodeState, POSITION, Rows, VELOCITY, add_rows, matrix, put};
use crate::geometry::so3::{exp, hat, log, right_jacobian, right_jacobian_inverse};
use crate::geometry::{Mat3, Rotation, Vec3};
use crate::sensor::ImuBias;
use crate::trajectory::chain::{NODE, STEP, StepSystem};
use crate::trajectory::preintegration::{MotionSums, Preintegrated};

/// Preintegrated IMU between node i and node i + 1:
/// r_φ = Log(ΔRᵀ R_iᵀ R_j), r_p = R_iᵀ (p_j − p_i − v_i Δt − ½ g Δt²) − Δp,
/// r_v = R_iᵀ (v_j − v_i − g Δt) − Δv, with the sums corrected to the bias.
#[derive(Debug, Clone)]
pub(in crate::trajectory) struct ImuFactor {
    sums: MotionSums,
    /// Lower triangular W with Wᵀ W = covariance⁻¹.
    whitener: [[f64; 9]; 9],
}

/// The sums corrected to a bias: what the residual compares with.
struct Corrected {
    rotation: Rotation,
    position_m: Vec3,
    velocity_m_s: Vec3,
}

impl ImuFactor {
    /// `None` where the covariance is not positive definite.
    pub fn new(preintegrated: &Preintegrated) -> Option<Self> {
        let w = preintegrated.whitener()?;
        let mut whitener = [[0.0; 9]; 9];
        for (a, row) in whitener.iter_mut().enumerate() {
            for (b, x) in row.iter_mut().enumerate() {
                *x = w[(a, b)];
            }
        }
        Some(Self {
            sums: preintegrated.sums.clone(),
            whitener,
        })
    }

    pub fn duration_s(&self) -> f64 {
        self.sums.duration_s
    }

    fn by_bias(&self, row: usize, column: usize) -> Mat3 {
        self.sums
            .by_bias
            .fixed_view::<3, 3>(row, column)
            .into_owned()
    }

    /// J_φ δb, the correction of the rotation to a bias.
    fn turn(&self, bias: &ImuBias) -> Vec3 {
        self.by_bias(0, 0) * (bias.gyro_rad_s - self.sums.bias.gyro_rad_s)
    }

    fn corrected(&self, bias: &ImuBias) -> Corrected {
        let gyro = bias.gyro_rad_s - self.sums.bias.gyro_rad_s;
        let accel = bias.accel_m_s2 - self.sums.bias.accel_m_s2;
        Corrected {
            rotation: self.sums.rotation * exp(&self.turn(bias)),
            position_m: self.sums.position_m
                + self.by_bias(3, 0) * gyro
                + self.by_bias(3, 3) * accel,
            velocity_m_s: self.sums.velocity_m_s
                + self.by_bias(6, 0) * gyro
                + self.by_bias(6, 3) * accel,
        }
    }

    /// The motion of node i to node j in the body frame at i, without gravity: what Δp and Δv
    /// measure.
    fn motion(&self, gravity_m_s2: f64, from: &NodeState, to: &NodeState) -> (Vec3, Vec3) {
        let dt = self.sums.duration_s;
        let g = Vec3::new(0.0, 0.0, -gravity_m_s2);
        let back = from.rotation.inverse();
        (
            back * (to.position_m - from.position_m - from.velocity_m_s * dt - g * (0.5 * dt * dt)),
            back * (to.velocity_m_s - from.velocity_m_s - g * dt),
        )
    }

    /// (r_φ, r_p, r_v), rad, m, m/s.
    pub fn residual(
        &self,
        gravity_m_s2: f64,
        from: &NodeState,
        to: &NodeState,
        bias: &ImuBias,
    ) -> [Vec3; 3] {
        let sums = self.corrected(bias);
        let (dp, dv) = self.motion(gravity_m_s2, from, to);
        [
            log(&(sums.rotation.inverse() * (from.rotation.inverse() * to.rotation))),
            dp - sums.position_m,
            dv - sums.velocity_m_s,
        ]
    }

    /// W r.
    pub fn whiten(&self, residual: &[Vec3; 3]) -> [f64; 9] {
        let mut out = [0.0; 9];
        for (a, x) in out.iter_mut().enumerate() {
            *x = (0..=a)
                .map(|b| self.whitener[a][b] * residual[b / 3][b % 3])
                .sum();
        }
        out
    }

    /// dr by the step's unknowns, before whitening.
    pub(super) fn jacobian(
        &self,
        gravity_m_s2: f64,
        from: &NodeState,
        to: &NodeState,
        bias: &ImuBias,
        residual: &[Vec3; 3],
    ) -> Rows<9> {
        let dt = self.sums.duration_s;
        let (dp, dv) = self.motion(gravity_m_s2, from, to);
        let back = matrix(&from.rotation.inverse());
        let turned = matrix(&(to.rotation.inverse() * from.rotation));
        let inverse = right_jacobian_inverse(&residual[0]);
        let turn = self.turn(bias);
        let gyro =
            -inverse * matrix(&exp(&-residual[0])) * right_jacobian(&turn) * self.by_bias(0, 0);
        let mut rows = [[0.0; STEP]; 9];
        put(&mut rows, 0, ATTITUDE, &(-inverse * turned));
        put(&mut rows, 0, NODE + ATTITUDE, &inverse);
        put(&mut rows, 0, GYRO, &gyro);
        put(&mut rows, 3, ATTITUDE, &hat(&dp));
        put(&mut rows, 3, POSITION, &-back);
        put(&mut rows, 3, VELOCITY, &(-back * dt));
        put(&mut rows, 3, NODE + POSITION, &back);
        put(&mut rows, 3, GYRO, &-self.by_bias(3, 0));
        put(&mut rows, 3, ACCEL, &-self.by_bias(3, 3));
        put(&mut rows, 6, ATTITUDE, &hat(&dv));
        put(&mut rows, 6, VELOCITY, &-back);
        put(&mut rows, 6, NODE + VELOCITY, &back);
        put(&mut rows, 6, GYRO, &-self.by_bias(6, 0));
        put(&mut rows, 6, ACCEL, &-self.by_bias(6, 3));
        rows
    }

    /// Adds the factor to its step.
    pub fn add_to(
        &self,
        system: &mut StepSystem,
        gravity_m_s2: f64,
        from: &NodeState,
        to: &NodeState,
        bias: &ImuBias,
    ) {
        let residual = self.residual(gravity_m_s2, from, to, bias);
        let raw = self.jacobian(gravity_m_s2, from, to, bias, &residual);
        let mut rows = [[0.0; STEP]; 9];
        for (a, row) in rows.iter_mut().enumerate() {
            for (w, source) in self.whitener[a][..=a].iter().zip(&raw) {
                for (x, j) in row.iter_mut().zip(source) {
                    *x += w * j;
                }
            }
        }
        add_rows(system, &rows, &self.whiten(&residual));
    }
}
