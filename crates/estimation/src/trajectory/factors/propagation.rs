//! The motion of the body at a record that lies after its node.

use super::jacobian::{Jacobian, matrix, put};
use crate::adjustment::STEP;
use crate::geometry::so3::{exp, hat, right_jacobian};
use crate::geometry::{Mat3, Rotation, Vec3, WorldFromBody};
use crate::sensor::{ImuBias, ImuSample};
use crate::trajectory::constants::Constants;
use crate::trajectory::motion_sums::{Corrected, MotionSums};
use crate::trajectory::states::{ACCEL, ATTITUDE, GYRO, NodeState, POSITION, VELOCITY};

/// The motion from a node to a record as the IMU measures it, continued by the small time δ by which
/// the clock of the record's sensor is estimated to be late:
/// R(t) = R ΔR Exp(ω δ), v(t) = v + g T + R Δv + a δ, p(t) = p + v T + ½ g T² + R Δp + v(T) δ + ½ a δ²
/// with ω = gyro − b_g and a = R ΔR (f − b_a) + g, where b_g holds what is left of the gyroscope's scale factor.
#[derive(Debug, Clone)]
pub struct Propagation {
    /// From the node to the record; `None` where they coincide.
    pub sums: Option<Box<MotionSums>>,
    /// The sample that holds at the record.
    pub sample: ImuSample,
}

/// The body at a record.
pub(super) struct Propagated {
    pub world_from_body: WorldFromBody,
    /// World.
    pub velocity_m_s: Vec3,
    /// ω, body.
    pub rate_rad_s: Vec3,
    /// Rotation from the body at the node to the body at the record.
    turn: Rotation,
    /// The same without δ.
    turn_before: Rotation,
    /// The bias that acts.
    bias: ImuBias,
    sums: Corrected,
    duration_s: f64,
    late_s: f64,
    force_m_s2: Vec3,
}

impl Propagation {
    /// The mean rate from the node to the record, as the gyroscope reads it, rad/s.
    pub(super) fn mean_rate_rad_s(&self) -> Vec3 {
        let sums = self.sums.as_ref();
        sums.map_or(self.sample.gyro_rad_s, |sums| sums.mean_rate_rad_s())
    }

    /// The body at the record.
    pub(super) fn propagate(
        &self,
        constants: &Constants,
        node: &NodeState,
        bias: &ImuBias,
        late_s: f64,
    ) -> Propagated {
        let gravity = Vec3::new(0.0, 0.0, -constants.gravity_m_s2.value);
        let bias = &constants
            .gyro_scale
            .bias_at(|| self.mean_rate_rad_s(), bias);
        let start = &node.world_from_body;
        let (sums, duration_s) = match &self.sums {
            Some(sums) => (sums.corrected(bias), sums.duration_s),
            None => (Corrected::NONE, 0.0),
        };
        let rate_rad_s = self.sample.gyro_rad_s - bias.gyro_rad_s;
        let force_m_s2 = self.sample.accel_m_s2 - bias.accel_m_s2;
        let acceleration = start.rotation * (sums.rotation * force_m_s2) + gravity;
        let velocity =
            node.velocity_m_s + gravity * duration_s + start.rotation * sums.velocity_m_s;
        let turn = sums.rotation * exp(&(rate_rad_s * late_s));
        let position_m = start.translation_m
            + node.velocity_m_s * duration_s
            + gravity * (0.5 * duration_s * duration_s)
            + start.rotation * sums.position_m
            + velocity * late_s
            + acceleration * (0.5 * late_s * late_s);
        Propagated {
            world_from_body: WorldFromBody::new(start.rotation * turn, position_m),
            velocity_m_s: velocity + acceleration * late_s,
            rate_rad_s,
            turn,
            turn_before: sums.rotation,
            bias: *bias,
            sums,
            duration_s,
            late_s,
            force_m_s2,
        }
    }

    /// ∂(R(t) x) with respect to the node's attitude and the gyro bias, for a vector x in the body frame.
    pub(super) fn turned_jacobian(
        &self,
        at: &Propagated,
        node: &NodeState,
        x: &Vec3,
    ) -> (Mat3, Mat3) {
        let r = matrix(&node.world_from_body.rotation);
        let theta = at.rate_rad_s * at.late_s;
        let late = exp(&theta);
        let mut gyro = matrix(&at.turn) * hat(x) * right_jacobian(&theta) * at.late_s;
        if let Some(sums) = &self.sums {
            let before = matrix(&at.turn_before) * hat(&(late * x));
            gyro -= before * right_jacobian(&sums.turn(&at.bias)) * sums.bias_block(0, 0);
        }
        (-r * hat(&(at.turn * x)), r * gyro)
    }

    /// ∂(p(t) + R(t) l) with respect to the step's unknowns, for a lever arm l.
    pub(super) fn position_jacobian(
        &self,
        at: &Propagated,
        node: &NodeState,
        lever_arm_m: &Vec3,
    ) -> Jacobian<3> {
        let r = matrix(&node.world_from_body.rotation);
        let (late, half) = (at.late_s, 0.5 * at.late_s * at.late_s);
        let (mut attitude, mut gyro) = self.turned_jacobian(at, node, lever_arm_m);
        let moved = at.sums.position_m
            + at.sums.velocity_m_s * late
            + at.turn_before * at.force_m_s2 * half;
        attitude -= r * hat(&moved);
        let mut accel = matrix(&at.turn_before) * -half;
        if let Some(sums) = &self.sums {
            let by_turn = hat(&at.force_m_s2) * right_jacobian(&sums.turn(&at.bias));
            gyro += r
                * (sums.bias_block(3, 0) + sums.bias_block(6, 0) * late
                    - matrix(&at.turn_before) * by_turn * sums.bias_block(0, 0) * half);
            accel += sums.bias_block(3, 3) + sums.bias_block(6, 3) * late;
        }
        let velocity = Mat3::identity() * (at.duration_s + late);
        let mut rows = [[0.0; STEP]; 3];
        put(&mut rows, 0, ATTITUDE, &attitude);
        put(&mut rows, 0, POSITION, &Mat3::identity());
        put(&mut rows, 0, VELOCITY, &velocity);
        put(&mut rows, 0, GYRO, &gyro);
        put(&mut rows, 0, ACCEL, &(r * accel));
        rows
    }
}

impl Propagated {
    /// ∂p(t) with respect to the magnitude of gravity.
    pub fn gravity_jacobian(&self) -> Vec3 {
        let t = self.duration_s + self.late_s;
        Vec3::new(0.0, 0.0, -0.5 * t * t)
    }

    /// ∂(R(t) x) with respect to time, for a vector x in the body frame.
    pub fn turning(&self, x: &Vec3) -> Vec3 {
        self.world_from_body.rotation * (hat(&self.rate_rad_s) * x)
    }
}
