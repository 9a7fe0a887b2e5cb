//! The IMU between neighbouring nodes.

use super::jacobian::{Jacobian, matrix, put, touch_gyro_scale};
use crate::adjustment::{FactorRows, NODE, STEP};
use crate::geometry::Vec3;
use crate::geometry::so3::{exp, hat, log, right_jacobian, right_jacobian_inverse};
use crate::sensor::ImuBias;
use crate::trajectory::constants::Constants;
use crate::trajectory::motion_sums::MotionSums;
use crate::trajectory::preintegration::Preintegrated;
use crate::trajectory::states::{ACCEL, ATTITUDE, GYRO, NodeState, POSITION, VELOCITY};

/// Preintegrated IMU between node i and node i + 1:
/// r_φ = Log(ΔRᵀ R_iᵀ R_j), r_p = R_iᵀ (p_j − p_i − v_i Δt − ½ g Δt²) − Δp,
/// r_v = R_iᵀ (v_j − v_i − g Δt) − Δv, with the sums corrected to the bias.
#[derive(Debug, Clone)]
pub struct ImuFactor {
    pub sums: MotionSums,
    /// Lower triangular W with Wᵀ W = covariance⁻¹.
    pub whitener: [[f64; 9]; 9],
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

    /// The motion of node i to node j in the body frame at i, without gravity: what Δp and Δv
    /// measure.
    fn motion(&self, gravity_m_s2: f64, from: &NodeState, to: &NodeState) -> (Vec3, Vec3) {
        let dt = self.sums.duration_s;
        let g = Vec3::new(0.0, 0.0, -gravity_m_s2);
        let (at, then) = (&from.world_from_body, &to.world_from_body);
        let back = at.rotation.inverse();
        let moved = then.translation_m - at.translation_m;
        (
            back * (moved - from.velocity_m_s * dt - g * (0.5 * dt * dt)),
            back * (to.velocity_m_s - from.velocity_m_s - g * dt),
        )
    }

    /// The bias that acts in the step, with what is left of the gyroscope's scale factor.
    pub fn bias(&self, constants: &Constants, bias: &ImuBias) -> ImuBias {
        constants
            .gyro_scale
            .bias_at(|| self.sums.mean_rate_rad_s(), bias)
    }

    /// (r_φ, r_p, r_v), rad, m, m/s.
    pub fn residual(
        &self,
        constants: &Constants,
        (from, to): (&NodeState, &NodeState),
        bias: &ImuBias,
    ) -> [Vec3; 3] {
        let sums = self.sums.corrected(&self.bias(constants, bias));
        let (dp, dv) = self.motion(constants.gravity_m_s2.value, from, to);
        let turned = from.world_from_body.rotation.inverse() * to.world_from_body.rotation;
        [
            log(&(sums.rotation.inverse() * turned)),
            dp - sums.position_m,
            dv - sums.velocity_m_s,
        ]
    }

    /// W r.
    fn whiten(&self, residual: &[Vec3; 3]) -> [f64; 9] {
        let mut out = [0.0; 9];
        for (a, x) in out.iter_mut().enumerate() {
            *x = (0..=a)
                .map(|b| self.whitener[a][b] * residual[b / 3][b % 3])
                .sum();
        }
        out
    }

    /// The residual in standard deviations, which are `scale` times those of the IMU's noise.
    pub fn whitened(
        &self,
        constants: &Constants,
        nodes: (&NodeState, &NodeState),
        bias: &ImuBias,
        scale: f64,
    ) -> [f64; 9] {
        let residual = self.residual(constants, nodes, bias);
        self.whiten(&residual).map(|x| x / scale)
    }

    /// ∂r with respect to the step's unknowns, before whitening.
    pub(super) fn jacobian(
        &self,
        constants: &Constants,
        (from, to): (&NodeState, &NodeState),
        bias: &ImuBias,
        residual: &[Vec3; 3],
    ) -> Jacobian<9> {
        let dt = self.sums.duration_s;
        let (dp, dv) = self.motion(constants.gravity_m_s2.value, from, to);
        let world_from_body = from.world_from_body.rotation;
        let back = matrix(&world_from_body.inverse());
        let turned = matrix(&(to.world_from_body.rotation.inverse() * world_from_body));
        let inverse = right_jacobian_inverse(&residual[0]);
        let turn = self.sums.turn(&self.bias(constants, bias));
        let gyro = -inverse
            * matrix(&exp(&-residual[0]))
            * right_jacobian(&turn)
            * self.sums.bias_block(0, 0);
        let mut rows = [[0.0; STEP]; 9];
        put(&mut rows, 0, ATTITUDE, &(-inverse * turned));
        put(&mut rows, 0, NODE + ATTITUDE, &inverse);
        put(&mut rows, 0, GYRO, &gyro);
        put(&mut rows, 3, ATTITUDE, &hat(&dp));
        put(&mut rows, 3, POSITION, &-back);
        put(&mut rows, 3, VELOCITY, &(-back * dt));
        put(&mut rows, 3, NODE + POSITION, &back);
        put(&mut rows, 3, GYRO, &-self.sums.bias_block(3, 0));
        put(&mut rows, 3, ACCEL, &-self.sums.bias_block(3, 3));
        put(&mut rows, 6, ATTITUDE, &hat(&dv));
        put(&mut rows, 6, VELOCITY, &-back);
        put(&mut rows, 6, NODE + VELOCITY, &back);
        put(&mut rows, 6, GYRO, &-self.sums.bias_block(6, 0));
        put(&mut rows, 6, ACCEL, &-self.sums.bias_block(6, 3));
        rows
    }

    /// Whitened rows; the standard deviations are `scale` times those of the IMU's noise.
    pub fn rows(
        &self,
        constants: &Constants,
        nodes: (&NodeState, &NodeState),
        bias: &ImuBias,
        scale: f64,
    ) -> FactorRows<9> {
        let residual = self.residual(constants, nodes, bias);
        let raw = self.jacobian(constants, nodes, bias, &residual);
        let whitened = self.whiten(&residual).map(|x| x / scale);
        let mut rows = FactorRows::new(whitened, [[0.0; STEP]; 9]);
        for (a, row) in rows.by_step.iter_mut().enumerate() {
            for (w, source) in self.whitener[a][..=a].iter().zip(&raw) {
                let w = w / scale;
                for (x, j) in row.iter_mut().zip(source) {
                    *x += w * j;
                }
            }
        }
        touch_gyro_scale(&mut rows, &constants.gyro_scale, || {
            self.sums.mean_rate_rad_s()
        });
        if let Some(gravity) = constants.gravity_m_s2.block() {
            let by = self.whiten(&self.gravity_jacobian(nodes.0));
            rows.touch(gravity, [by.map(|x| x / scale)]);
        }
        rows
    }

    /// ∂r with respect to the magnitude of gravity, before whitening.
    pub(super) fn gravity_jacobian(&self, from: &NodeState) -> [Vec3; 3] {
        let dt = self.sums.duration_s;
        let up = from.world_from_body.rotation.inverse() * Vec3::z();
        [Vec3::zeros(), up * (0.5 * dt * dt), up * dt]
    }
}
