//! The IMU between neighbouring nodes.

use super::{
    ACCEL, ATTITUDE, Constants, GYRO, NodeState, POSITION, Row, Rows, VELOCITY, add_rows, matrix,
    put,
};
use crate::geometry::Vec3;
use crate::geometry::so3::{exp, hat, log, right_jacobian, right_jacobian_inverse};
use crate::sensor::ImuBias;
use crate::trajectory::chain::{Border, NODE, STEP, StepSystem};
use crate::trajectory::preintegration::{MotionSums, Preintegrated};

/// Preintegrated IMU between node i and node i + 1:
/// r_φ = Log(ΔRᵀ R_iᵀ R_j), r_p = R_iᵀ (p_j − p_i − v_i Δt − ½ g Δt²) − Δp,
/// r_v = R_iᵀ (v_j − v_i − g Δt) − Δv, with the sums corrected to the bias.
#[derive(Debug, Clone)]
pub(in crate::trajectory) struct ImuFactor {
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

    pub fn duration_s(&self) -> f64 {
        self.sums.duration_s
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
        let sums = self.sums.corrected(bias);
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
        let turn = self.sums.turn(bias);
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

    /// Whitened derivatives and residual, at `1 / scale` of the weight.
    pub fn rows(
        &self,
        known: &Constants,
        (from, to): (&NodeState, &NodeState),
        (bias, constants): (&ImuBias, &[f64]),
        scale: f64,
    ) -> (Rows<9>, Vec<Row<9>>, [f64; 9]) {
        let gravity_m_s2 = known.gravity_m_s2(constants);
        let residual = self.residual(gravity_m_s2, from, to, bias);
        let raw = self.jacobian(gravity_m_s2, from, to, bias, &residual);
        let mut rows = [[0.0; STEP]; 9];
        for (a, row) in rows.iter_mut().enumerate() {
            for (w, source) in self.whitener[a][..=a].iter().zip(&raw) {
                for (x, j) in row.iter_mut().zip(source) {
                    *x += w / scale * j;
                }
            }
        }
        let by_constants = known.gravity.map(|column| {
            let by = self.whiten(&self.gravity_jacobian(from));
            (column, by.map(|x| x / scale))
        });
        (
            rows,
            by_constants.into_iter().collect(),
            self.whiten(&residual).map(|x| x / scale),
        )
    }

    /// ∂r by the magnitude of gravity, before whitening.
    pub(super) fn gravity_jacobian(&self, from: &NodeState) -> [Vec3; 3] {
        let dt = self.sums.duration_s;
        let up = from.rotation.inverse() * Vec3::z();
        [Vec3::zeros(), up * (0.5 * dt * dt), up * dt]
    }

    /// Adds the factor to its step.
    pub fn add_to(
        &self,
        system: &mut StepSystem,
        border: &mut Border,
        known: &Constants,
        nodes: (&NodeState, &NodeState),
        values: (&ImuBias, &[f64]),
        scale: f64,
    ) {
        let (rows, by_constants, residual) = self.rows(known, nodes, values, scale);
        add_rows(system, border, &rows, &by_constants, &residual);
    }
}
