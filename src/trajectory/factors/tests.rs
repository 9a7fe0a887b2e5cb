use super::*;
use crate::geometry::so3::exp;
use crate::project::ImuNoise;
use crate::sensor::{ImuBias, ImuSample};
use crate::trajectory::preintegration::Preintegrated;

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

fn preintegrated() -> Preintegrated {
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
    sums
}

fn imu() -> ImuFactor {
    ImuFactor::new(&preintegrated()).expect("positive covariance")
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
    let analytic = nalgebra::SMatrix::<f64, R, STEP>::from_fn(|a, b| analytic[a][b]);
    let h = 1e-5;
    for column in 0..STEP {
        let value = |h: f64| {
            let (from, to, bias) = moved(column, h, &from, &to, &bias);
            residual(&from, &to, &bias)
        };
        let (plus, minus) = (value(h), value(-h));
        for row in 0..R {
            let numeric = (plus[row] - minus[row]) / (2.0 * h);
            let error = (numeric - analytic[(row, column)]).abs();
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
    let information = preintegrated().covariance.try_inverse().expect("regular");
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
    let factor = ImuFactor::new(&sums).expect("positive covariance");
    let rest = NodeState {
        rotation: Rotation::identity(),
        position_m: Vec3::new(1.0, 2.0, 3.0),
        velocity_m_s: Vec3::zeros(),
    };
    for part in factor.residual(GRAVITY, &rest, &rest, &ImuBias::default()) {
        assert!(part.norm() < 1e-12, "{part}");
    }
}
