//! Prisms and GNSS antennas.

use super::jacobian::{Jacobian, touch_gyro_scale};
use super::propagation::{Propagated, Propagation};
use crate::adjustment::{FactorRows, STEP};
use crate::geometry::{Mat3, Rotation, Vec3};
use crate::sensor::ImuBias;
use crate::trajectory::constants::{Constants, LateBy};
use crate::trajectory::states::NodeState;

/// Periods of the incidence-dependent error of a 360° prism in a turn: one for each of its facets.
const FACETS: f64 = 6.0;

/// A fix of a prism or antenna: r = p(t) + R(t) l + e + s + c(t) − z, metres in the world, with the steps s of earlier
/// records and the lasting error c.
///
/// e is the error of a 360° prism that turns with the angle of incidence α of the line of sight in
/// the body's horizontal plane: for each of the directions along and across the line of sight and
/// up, a cos 6α + b sin 6α.
#[derive(Debug, Clone)]
pub struct PositionFactor {
    pub propagation: Propagation,
    /// Which of the position sensors.
    pub sensor: usize,
    /// Number of the record in its log, from 0.
    pub record: usize,
    pub time_s: f64,
    /// World.
    pub position_m: Vec3,
    /// W with Wᵀ W the inverse of the covariance.
    pub whitener: Mat3,
    /// Weight given by the loss, 0 to 1.
    pub weight: f64,
    /// The clocks that apply to the record.
    pub clocks: Vec<LateBy>,
}

/// The fixed properties of a position sensor.
#[derive(Debug, Clone, Copy)]
pub struct PositionSensor {
    /// The total station in the world, metres, where it is known.
    pub station_m: Option<Vec3>,
    /// The upward direction in the body frame.
    pub up: Vec3,
}

impl PositionSensor {
    /// The six directions of the incidence-dependent error, one for each amplitude.
    fn incidence_basis(&self, prism_m: &Vec3, world_from_body: &Rotation) -> [Vec3; 6] {
        let station = self.station_m.unwrap_or_default();
        let sight = (prism_m - station).normalize();
        let seen = world_from_body.inverse() * sight;
        let level = self.up.cross(&Vec3::x());
        let angle = FACETS * seen.dot(&level).atan2(seen.x);
        let across = Vec3::z().cross(&sight);
        let (sin, cos) = angle.sin_cos();
        [
            sight * cos,
            sight * sin,
            across * cos,
            across * sin,
            Vec3::z() * cos,
            Vec3::z() * sin,
        ]
    }
}

impl PositionFactor {
    fn propagated(&self, constants: &Constants, node: &NodeState, bias: &ImuBias) -> Propagated {
        let late_s = constants.late_s(&self.clocks);
        self.propagation.propagate(constants, node, bias, late_s)
    }

    fn residual_at(&self, sensor: &PositionSensor, constants: &Constants, at: &Propagated) -> Vec3 {
        let sensor_constants = &constants.positions[self.sensor];
        let prism = at.world_from_body.map(&sensor_constants.lever_arm_m.value);
        let mut residual = prism - self.position_m;
        for step in constants.steps_before(self.sensor, self.record) {
            residual += step.offset_m.value;
        }
        residual += constants.lasting_m(self.sensor, self.time_s);
        if sensor_constants.incidence_m.block().is_some() {
            let basis = sensor.incidence_basis(&prism, &at.world_from_body.rotation);
            let terms = basis.iter().zip(sensor_constants.incidence_m.value.iter());
            residual += terms.map(|(direction, a)| direction * *a).sum::<Vec3>();
        }
        residual
    }

    /// The residual r, metres.
    pub fn residual(
        &self,
        sensor: &PositionSensor,
        constants: &Constants,
        node: &NodeState,
        bias: &ImuBias,
    ) -> Vec3 {
        self.residual_at(sensor, constants, &self.propagated(constants, node, bias))
    }

    /// The residual in standard deviations.
    pub fn whitened(
        &self,
        sensor: &PositionSensor,
        constants: &Constants,
        node: &NodeState,
        bias: &ImuBias,
    ) -> [f64; 3] {
        (self.whitener_with(constants) * self.residual(sensor, constants, node, bias)).into()
    }

    /// The whitener for the noise of the records and the lasting errors that are taken for it.
    fn whitener_with(&self, constants: &Constants) -> Mat3 {
        self.whitener / constants.position_noise(self.sensor)
    }

    /// Whitened rows. They neglect that the direction of the incidence-dependent error turns with
    /// the attitude: its amplitude is millimetres, whereas the lever arm is decimetres.
    pub fn rows(
        &self,
        sensor: &PositionSensor,
        constants: &Constants,
        node: &NodeState,
        bias: &ImuBias,
    ) -> FactorRows<3> {
        let at = self.propagated(constants, node, bias);
        let sensor_constants = &constants.positions[self.sensor];
        let arm = sensor_constants.lever_arm_m.value;
        let raw = self.propagation.position_jacobian(&at, node, &arm);
        let w = self.whitener_with(constants);
        let residual = w * self.residual_at(sensor, constants, &at);
        let mut rows = FactorRows::new(residual.into(), whitened(&w, &raw));
        let column = |by: Vec3| -> [f64; 3] { (w * by).into() };
        touch_gyro_scale(&mut rows, &constants.gyro_scale, || {
            self.propagation.mean_rate_rad_s()
        });
        if !self.clocks.is_empty() {
            let by_time = at.velocity_m_s + at.turning(&arm);
            for late in &self.clocks {
                if let Some(block) = constants.clock(late.clock).block() {
                    rows.touch(block, [column(by_time * late.share)]);
                }
            }
        }
        let rotation = &at.world_from_body.rotation;
        if let Some(block) = sensor_constants.lever_arm_m.block() {
            let axes = [Vec3::x(), Vec3::y(), Vec3::z()];
            rows.touch(block, axes.map(|axis| column(rotation * axis)));
        }
        for step in constants.steps_before(self.sensor, self.record) {
            if let Some(block) = step.offset_m.block() {
                rows.touch(block, [Vec3::x(), Vec3::y(), Vec3::z()].map(column));
            }
        }
        for (amplitude, by) in constants.lasting_position(self.sensor, self.time_s) {
            if let Some(block) = amplitude.block() {
                let axes = [Vec3::x(), Vec3::y(), Vec3::z()];
                rows.touch(block, axes.map(|axis| column(axis.component_mul(&by))));
            }
        }
        if let Some(block) = sensor_constants.incidence_m.block() {
            let basis = sensor.incidence_basis(&at.world_from_body.map(&arm), rotation);
            rows.touch(block, basis.map(column));
        }
        if let Some(block) = constants.gravity_m_s2.block() {
            rows.touch(block, [column(at.gravity_jacobian())]);
        }
        rows
    }
}

/// W J.
fn whitened(w: &Mat3, raw: &Jacobian<3>) -> Jacobian<3> {
    let mut rows = [[0.0; STEP]; 3];
    for (a, row) in rows.iter_mut().enumerate() {
        for (b, source) in raw.iter().enumerate() {
            for (x, j) in row.iter_mut().zip(source) {
                *x += w[(a, b)] * j;
            }
        }
    }
    rows
}
