use super::*;
use crate::geometry::so3::exp;
use crate::sensor::{ImuBias, ImuSample};
use crate::trajectory::ImuNoise;
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

const NOISE: ImuNoise = ImuNoise {
    gyro_density: 1e-3,
    accel_density: 1e-2,
    gyro_bias_walk: 0.0,
    accel_bias_walk: 0.0,
};

fn preintegrated() -> Preintegrated {
    let mut sums = Preintegrated::new(ImuBias::default());
    for _ in 0..3 {
        sums.add(sample().gyro_rad_s, sample().accel_m_s2, 0.05, &NOISE);
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

/// Two constants that say how late records are, a lever arm, an incidence bias, a heading offset
/// and gravity, with values that are not zero.
fn known() -> (Constants, Vec<f64>, PositionSensor) {
    let columns = PositionColumns {
        lever_arm: Some(1),
        incidence: Some(4),
    };
    let mut known = Constants::default();
    known.base_gravity_m_s2 = GRAVITY;
    known.gravity = Some(11);
    known.heading_offset = Some(10);
    known.positions = vec![columns];
    let mut values = vec![0.0; 12];
    values[0] = 0.013;
    values[1..4].copy_from_slice(&[0.01, -0.02, 0.03]);
    values[10] = 0.02;
    values[11] = -0.05;
    let sensor = PositionSensor {
        lever_arm_m: Vec3::new(0.3, -0.2, 1.5),
        station_m: Some(Vec3::new(-10.0, 4.0, 1.0)),
        up: Vec3::z(),
        columns,
    };
    (known, values, sensor)
}

/// Compares the derivatives by the constants with central differences.
fn check_constants<const R: usize>(
    analytic: &[Row<R>],
    values: &[f64],
    residual: impl Fn(&[f64]) -> [f64; R],
) {
    let h = 1e-5;
    for column in 0..values.len() {
        let value = |h: f64| {
            let mut values = values.to_vec();
            values[column] += h;
            residual(&values)
        };
        let (plus, minus) = (value(h), value(-h));
        let own = analytic.iter().find(|(c, _)| *c == column);
        for row in 0..R {
            let numeric = (plus[row] - minus[row]) / (2.0 * h);
            let error = (numeric - own.map_or(0.0, |(_, by)| by[row])).abs();
            assert!(error < 2e-9, "row {row}, constant {column}: {error}");
        }
    }
}

fn aheads() -> [Ahead; 2] {
    let sums = preintegrated().sums;
    [
        Ahead {
            sums: Some(Box::new(sums)),
            sample: sample(),
        },
        Ahead {
            sums: None,
            sample: sample(),
        },
    ]
}

#[test]
fn position_jacobians_meet_finite_differences() {
    for ahead in aheads() {
        let (known, values, sensor) = known();
        let fix = PositionFactor {
            ahead,
            sensor: 0,
            record: 0,
            time_s: 0.0,
            position_m: Vec3::new(0.9, 2.1, 0.4),
            whitener: Mat3::identity(),
            weight: 1.0,
            late: vec![0],
        };
        let (rows, border) = fix.jacobian(&sensor, &known, &state(0.0), &bias(), &values);
        check::<3>(&rows, |from, _, bias| {
            let g = known.gravity_m_s2(&values);
            fix.residual(&sensor, g, from, bias, &values).into()
        });
        check_constants(&border, &values, |values| {
            let g = known.gravity_m_s2(values);
            fix.residual(&sensor, g, &state(0.0), &bias(), values)
                .into()
        });
    }
}

#[test]
fn heading_and_pitch_jacobians_meet_finite_differences() {
    let baseline = Vec3::new(0.8, 0.6, 0.0);
    for ahead in aheads() {
        for quantity in [Quantity::Heading, Quantity::Pitch(baseline)] {
            let (known, values, _) = known();
            let fix = HeadingFactor {
                ahead: ahead.clone(),
                record: 0,
                time_s: 0.0,
                quantity,
                value_rad: 0.4,
                sigma_rad: 0.01,
                weight: 1.0,
                late: vec![0],
            };
            let (rows, border) = fix.jacobian(&known, &state(0.0), &bias(), &values);
            check::<1>(&rows, |from, _, bias| {
                [fix.residual(&known, from, bias, &values)]
            });
            check_constants(&border, &values, |values| {
                [fix.residual(&known, &state(0.0), &bias(), values)]
            });
        }
    }
}

#[test]
fn gravity_moves_the_imu_residual_as_said() {
    let (factor, known, values) = (imu(), known().0, known().1);
    let (from, to, bias) = (state(0.0), state(0.1), bias());
    let flat = |r: [Vec3; 3]| std::array::from_fn::<f64, 9, _>(|i| r[i / 3][i % 3]);
    let border = [(11, flat(factor.gravity_jacobian(&from)))];
    check_constants(&border, &values, |values| {
        flat(factor.residual(known.gravity_m_s2(values), &from, &to, &bias))
    });
}

#[test]
fn normal_equations_are_those_of_the_whitened_rows() {
    let factor = imu();
    let (from, to, bias) = (state(0.0), state(0.1), bias());
    let mut system = StepSystem::ZERO;
    let mut border = Border::new(0);
    let mut known = Constants::default();
    known.base_gravity_m_s2 = GRAVITY;
    let nodes = (&from, &to);
    factor.add_to(&mut system, &mut border, &known, nodes, (&bias, &[]), 1.0);
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
    let mut sums = Preintegrated::new(ImuBias::default());
    sums.add(Vec3::zeros(), Vec3::new(0.0, 0.0, GRAVITY), 0.01, &NOISE);
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
