//! The residuals of the factor graph, with analytic derivatives, and how they enter the normal
//! equations. Attitudes are perturbed as R ← R Exp(δφ), positions and velocities by addition.

use super::chain::{NODE, STEP, StepSystem};
use super::preintegration::Preintegrated;
use crate::geometry::heading::{heading_rad, wrap};
use crate::geometry::so3::{exp, hat, log, right_jacobian, right_jacobian_inverse};
use crate::geometry::{Mat3, Rotation, Vec3};
use crate::sensor::{ImuBias, ImuSample};

/// The motion state at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NodeState {
    /// world_from_body.
    pub rotation: Rotation,
    /// World.
    pub position_m: Vec3,
    /// World.
    pub velocity_m_s: Vec3,
}

/// First columns of a step's unknowns: attitude, position and velocity of node i, then node
/// i + 1 and the bias.
const ATTITUDE: usize = 0;
const POSITION: usize = 3;
const VELOCITY: usize = 6;
const GYRO: usize = 2 * NODE;
const ACCEL: usize = 2 * NODE + 3;

/// Rows of a Jacobian over a step's unknowns.
type Rows<const R: usize> = [[f64; STEP]; R];

fn put<const R: usize>(rows: &mut Rows<R>, row: usize, column: usize, block: &Mat3) {
    for i in 0..3 {
        for j in 0..3 {
            rows[row + i][column + j] = block[(i, j)];
        }
    }
}

fn matrix(rotation: &Rotation) -> Mat3 {
    rotation.to_rotation_matrix().into_inner()
}

/// Adds whitened rows: H += Jᵀ J, g −= Jᵀ r.
fn add_rows<const R: usize>(system: &mut StepSystem, rows: &Rows<R>, residual: &[f64; R]) {
    for (row, r) in rows.iter().zip(residual) {
        for a in 0..STEP {
            let factor = row[a];
            if factor == 0.0 {
                continue;
            }
            // Upper triangle, from the multiple of 4 at or below the diagonal: whole vectors.
            let start = a & !3;
            for (x, j) in system.h[a][start..].iter_mut().zip(&row[start..]) {
                *x += factor * j;
            }
            system.g[a] -= factor * r;
        }
    }
}

/// Preintegrated IMU between node i and node i + 1:
/// r_φ = Log(ΔRᵀ R_iᵀ R_j), r_p = R_iᵀ (p_j − p_i − v_i Δt − ½ g Δt²) − Δp,
/// r_v = R_iᵀ (v_j − v_i − g Δt) − Δv, with the sums corrected to the bias.
#[derive(Debug, Clone)]
pub(super) struct ImuFactor {
    sums: Preintegrated,
    /// Lower triangular W with Wᵀ W = covariance⁻¹.
    whitener: [[f64; 9]; 9],
}

/// The sums corrected to a bias: what the residual compares with.
struct Corrected {
    /// J_φ δb, the correction of the rotation.
    turn: Vec3,
    rotation: Rotation,
    position_m: Vec3,
    velocity_m_s: Vec3,
}

impl ImuFactor {
    /// `None` where the covariance is not positive definite.
    pub fn new(sums: Preintegrated) -> Option<Self> {
        let w = sums.whitener()?;
        let mut whitener = [[0.0; 9]; 9];
        for (a, row) in whitener.iter_mut().enumerate() {
            for (b, x) in row.iter_mut().enumerate() {
                *x = w[(a, b)];
            }
        }
        Some(Self { sums, whitener })
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

    fn corrected(&self, bias: &ImuBias) -> Corrected {
        let gyro = bias.gyro_rad_s - self.sums.bias.gyro_rad_s;
        let accel = bias.accel_m_s2 - self.sums.bias.accel_m_s2;
        let turn = self.by_bias(0, 0) * gyro;
        Corrected {
            turn,
            rotation: self.sums.rotation * exp(&turn),
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
    fn jacobian(
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
        let turn = self.corrected(bias).turn;
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

/// Where the body is `rest_s` after its node, by the node's IMU sample:
/// R(t) = R Exp((ω − b_g) τ), p(t) = p + v τ + ½ (R (f − b_a) + g) τ².
#[derive(Debug, Clone, Copy)]
pub(super) struct Ahead {
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
pub(super) struct PrismFactor {
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

    fn jacobian(&self, node: &NodeState, bias: &ImuBias) -> Rows<3> {
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
pub(super) struct HeadingFactor {
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

    fn jacobian(&self, node: &NodeState, bias: &ImuBias) -> Rows<1> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project::ImuNoise;

    const GRAVITY: f64 = 9.81;

    fn state(shift: f64) -> NodeState {
        NodeState {
            rotation: exp(&Vec3::new(0.3 + shift, -0.2, 1.4 - shift)),
            position_m: Vec3::new(1.0, 2.0 + shift, -0.5),
            velocity_m_s: Vec3::new(0.5, -0.4, 0.1 + shift),
        }
    }

    fn bias() -> ImuBias {
        ImuBias {
            gyro_rad_s: Vec3::new(0.02, -0.05, 0.01),
            accel_m_s2: Vec3::new(-0.1, 0.2, 0.3),
        }
    }

    fn sample() -> ImuSample {
        ImuSample {
            time_s: 0.0,
            gyro_rad_s: Vec3::new(1.0, -2.0, 0.7),
            accel_m_s2: Vec3::new(1.0, 0.5, 9.0),
        }
    }

    fn imu() -> ImuFactor {
        let noise = ImuNoise {
            gyro_density: 1e-3,
            accel_density: 1e-2,
            gyro_bias_walk: 0.0,
            accel_bias_walk: 0.0,
        };
        let mut sums = Preintegrated::new(ImuBias::default());
        for _ in 0..3 {
            sums.add(sample().gyro_rad_s, sample().accel_m_s2, 0.05, &noise);
        }
        ImuFactor::new(sums).expect("positive covariance")
    }

    fn moved(
        column: usize,
        h: f64,
        from: &NodeState,
        to: &NodeState,
        bias: &ImuBias,
    ) -> (NodeState, NodeState, ImuBias) {
        let (mut from, mut to, mut bias) = (*from, *to, *bias);
        let mut d = Vec3::zeros();
        d[column % 3] = h;
        match column / 3 {
            0 => from.rotation *= exp(&d),
            1 => from.position_m += d,
            2 => from.velocity_m_s += d,
            3 => to.rotation *= exp(&d),
            4 => to.position_m += d,
            5 => to.velocity_m_s += d,
            6 => bias.gyro_rad_s += d,
            _ => bias.accel_m_s2 += d,
        }
        (from, to, bias)
    }

    /// Compares with central differences of step 1e-5, whose error is about 1e-10 here.
    fn check<const R: usize>(
        analytic: &Rows<R>,
        residual: impl Fn(&NodeState, &NodeState, &ImuBias) -> [f64; R],
    ) {
        let (from, to, bias) = (state(0.0), state(0.1), bias());
        let h = 1e-5;
        for column in 0..STEP {
            let value = |h: f64| {
                let (from, to, bias) = moved(column, h, &from, &to, &bias);
                residual(&from, &to, &bias)
            };
            let (plus, minus) = (value(h), value(-h));
            for row in 0..R {
                let numeric = (plus[row] - minus[row]) / (2.0 * h);
                let error = (numeric - analytic[row][column]).abs();
                assert!(error < 2e-9, "row {row}, column {column}: {error}");
            }
        }
    }

    #[test]
    fn imu_jacobian_meets_finite_differences() {
        let factor = imu();
        let (from, to, bias) = (state(0.0), state(0.1), bias());
        let flat = |r: [Vec3; 3]| std::array::from_fn(|i| r[i / 3][i % 3]);
        let residual = factor.residual(GRAVITY, &from, &to, &bias);
        let analytic = factor.jacobian(GRAVITY, &from, &to, &bias, &residual);
        check::<9>(&analytic, |from, to, bias| {
            flat(factor.residual(GRAVITY, from, to, bias))
        });
    }

    #[test]
    fn prism_and_heading_jacobians_meet_finite_differences() {
        let ahead = Ahead {
            rest_s: 0.07,
            sample: sample(),
        };
        let prism = PrismFactor {
            ahead,
            position_m: Vec3::new(0.9, 2.1, 0.4),
            sigma_m: 0.005,
            lever_arm_m: Vec3::new(0.3, -0.2, 1.5),
        };
        check::<3>(&prism.jacobian(&state(0.0), &bias()), |from, _, bias| {
            prism.residual(GRAVITY, from, bias).into()
        });
        let heading = HeadingFactor {
            ahead,
            heading_rad: 0.4,
            sigma_rad: 0.01,
        };
        check::<1>(&heading.jacobian(&state(0.0), &bias()), |from, _, bias| {
            [heading.residual(from, bias)]
        });
    }

    #[test]
    fn normal_equations_are_those_of_the_whitened_rows() {
        let factor = imu();
        let (from, to, bias) = (state(0.0), state(0.1), bias());
        let mut system = StepSystem::ZERO;
        factor.add_to(&mut system, GRAVITY, &from, &to, &bias);
        let residual = factor.residual(GRAVITY, &from, &to, &bias);
        let rows = factor.jacobian(GRAVITY, &from, &to, &bias, &residual);
        let information = factor.sums.covariance.try_inverse().expect("regular");
        let j = nalgebra::SMatrix::<f64, 9, STEP>::from_fn(|a, b| rows[a][b]);
        let r = nalgebra::SVector::<f64, 9>::from_fn(|a, _| residual[a / 3][a % 3]);
        let h = j.transpose() * information * j;
        let g = -(j.transpose() * information * r);
        for a in 0..STEP {
            assert!((g[a] - system.g[a]).abs() < 1e-7 * g.norm());
            for b in a..STEP {
                assert!((h[(a, b)] - system.h[a][b]).abs() < 1e-7 * h.norm());
            }
        }
    }

    #[test]
    fn a_body_at_rest_feels_gravity_upwards() {
        let noise = ImuNoise {
            gyro_density: 1e-3,
            accel_density: 1e-2,
            gyro_bias_walk: 0.0,
            accel_bias_walk: 0.0,
        };
        let mut sums = Preintegrated::new(ImuBias::default());
        sums.add(Vec3::zeros(), Vec3::new(0.0, 0.0, GRAVITY), 0.01, &noise);
        let factor = ImuFactor::new(sums).expect("positive covariance");
        let rest = NodeState {
            rotation: Rotation::identity(),
            position_m: Vec3::new(1.0, 2.0, 3.0),
            velocity_m_s: Vec3::zeros(),
        };
        for part in factor.residual(GRAVITY, &rest, &rest, &ImuBias::default()) {
            assert!(part.norm() < 1e-12, "{part}");
        }
    }
}
