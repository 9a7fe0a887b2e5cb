//! Prism and heading, between nodes.

use super::{ACCEL, ATTITUDE, GYRO, NodeState, POSITION, Rows, VELOCITY, add_rows, matrix, put};
use crate::geometry::heading::{heading_rad, wrap};
use crate::geometry::so3::{exp, hat, right_jacobian};
use crate::geometry::{Mat3, Vec3};
use crate::sensor::{ImuBias, ImuSample};
use crate::trajectory::chain::{STEP, StepSystem};

/// Where the body is `rest_s` after its node, by the node's IMU sample:
/// R(t) = R Exp((ω − b_g) τ), p(t) = p + v τ + ½ (R (f − b_a) + g) τ².
#[derive(Debug, Clone, Copy)]
pub(in crate::trajectory) struct Ahead {
    pub rest_s: f64,
    pub sample: ImuSample,
}

impl Ahead {
    fn theta(&self, bias: &ImuBias) -> Vec3 {
        (self.sample.gyro_rad_s - bias.gyro_rad_s) * self.rest_s
    }
}

/// A prism fix: r = p(t) + R(t) l − z, metres.
#[derive(Debug, Clone, Copy)]
pub(in crate::trajectory) struct PrismFactor {
    pub ahead: Ahead,
    pub position_m: Vec3,
    pub sigma_m: f64,
    /// l, in the body frame.
    pub lever_arm_m: Vec3,
}

impl PrismFactor {
    pub fn residual(&self, gravity_m_s2: f64, node: &NodeState, bias: &ImuBias) -> Vec3 {
        let tau = self.ahead.rest_s;
        let force = self.ahead.sample.accel_m_s2 - bias.accel_m_s2;
        let acceleration = node.rotation * force - Vec3::new(0.0, 0.0, gravity_m_s2);
        let arm = exp(&self.ahead.theta(bias)) * self.lever_arm_m;
        node.position_m
            + node.velocity_m_s * tau
            + acceleration * (0.5 * tau * tau)
            + node.rotation * arm
            - self.position_m
    }

    pub(super) fn jacobian(&self, node: &NodeState, bias: &ImuBias) -> Rows<3> {
        let tau = self.ahead.rest_s;
        let theta = self.ahead.theta(bias);
        let turn = exp(&theta);
        let r = matrix(&node.rotation);
        let force = self.ahead.sample.accel_m_s2 - bias.accel_m_s2;
        let half = 0.5 * tau * tau;
        let arm = hat(&self.lever_arm_m);
        let attitude = -r * (hat(&force) * half + hat(&(turn * self.lever_arm_m)));
        let gyro = r * matrix(&turn) * arm * right_jacobian(&theta) * tau;
        let mut rows = [[0.0; STEP]; 3];
        put(&mut rows, 0, ATTITUDE, &attitude);
        put(&mut rows, 0, POSITION, &Mat3::identity());
        put(&mut rows, 0, VELOCITY, &(Mat3::identity() * tau));
        put(&mut rows, 0, GYRO, &gyro);
        put(&mut rows, 0, ACCEL, &(-r * half));
        rows
    }

    /// Adds the factor to its step.
    pub fn add_to(&self, system: &mut StepSystem, g_m_s2: f64, node: &NodeState, bias: &ImuBias) {
        let residual = self.residual(g_m_s2, node, bias);
        let rows = self.jacobian(node, bias);
        let weight = 1.0 / self.sigma_m;
        let residual = [residual.x, residual.y, residual.z].map(|x| x * weight);
        add_rows(system, &rows.map(|row| row.map(|x| x * weight)), &residual);
    }
}

/// A heading of the body's x axis: r = heading(R(t)) − z wrapped into (−π, π], radians.
#[derive(Debug, Clone, Copy)]
pub(in crate::trajectory) struct HeadingFactor {
    pub ahead: Ahead,
    /// Grid heading of the body's x axis, clockwise from north.
    pub heading_rad: f64,
    pub sigma_rad: f64,
}

/// Least squared horizontal length of the body's x axis that is divided by: nose-up within a
/// milliradian of the vertical there is no heading.
const LEAST_HORIZONTAL_SQUARED: f64 = 1e-6;

impl HeadingFactor {
    pub fn residual(&self, node: &NodeState, bias: &ImuBias) -> f64 {
        let rotation = node.rotation * exp(&self.ahead.theta(bias));
        wrap(heading_rad(&rotation) - self.heading_rad)
    }

    pub(super) fn jacobian(&self, node: &NodeState, bias: &ImuBias) -> Rows<1> {
        let theta = self.ahead.theta(bias);
        let turn = exp(&theta);
        let rotation = node.rotation * turn;
        // heading = atan2(e, n) of x = R e_x, and dx = −R hat(e_x) δφ.
        let x = rotation * Vec3::x();
        let horizontal = (x.x * x.x + x.y * x.y).max(LEAST_HORIZONTAL_SQUARED);
        let by_x = Vec3::new(x.y, -x.x, 0.0) / horizontal;
        let by_turn = -(matrix(&rotation) * hat(&Vec3::x())).transpose() * by_x;
        let by_attitude = matrix(&turn) * by_turn;
        let by_gyro = -(right_jacobian(&theta) * self.ahead.rest_s).transpose() * by_turn;
        let mut rows = [[0.0; STEP]; 1];
        for i in 0..3 {
            rows[0][ATTITUDE + i] = by_attitude[i];
            rows[0][GYRO + i] = by_gyro[i];
        }
        rows
    }

    /// Adds the factor to its step.
    pub fn add_to(&self, system: &mut StepSystem, node: &NodeState, bias: &ImuBias) {
        let weight = 1.0 / self.sigma_rad;
        let rows = self.jacobian(node, bias).map(|row| row.map(|x| x * weight));
        add_rows(system, &rows, &[self.residual(node, bias) * weight]);
    }
}
