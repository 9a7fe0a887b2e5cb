//! Derivatives against finite differences.

use super::jacobian::{Jacobian, touch_gyro_scale};
use super::{HeadingFactor, ImuFactor, PositionFactor, PositionSensor, Propagation, Quantity};
use crate::adjustment::{BorderSystem, FactorRows, NODE, STEP, StepSystem, Unknown, assemble};
use crate::geometry::so3::exp;
use crate::geometry::{BodyAxes, Mat3, Rotation, Vec3, WorldFromBody};
use crate::sensor::{ImuBias, ImuSample};
use crate::trajectory::constants::Constants;
use crate::trajectory::lasting::Modes;
use crate::trajectory::logs::{ClockCorrection, Course, Stream};
use crate::trajectory::preintegration::Preintegrated;
use crate::trajectory::settings::{
    Constant, HeadingSettings, ImuNoise, PositionSettings, TrajectorySettings,
};
use crate::trajectory::states::NodeState;

const GRAVITY: f64 = 9.81;

fn state(shift: f64) -> NodeState {
    NodeState {
        world_from_body: WorldFromBody::new(
            exp(&Vec3::new(0.3 + shift, -0.2, 1.4 - shift)),
            Vec3::new(1.0, 2.0 + shift, -0.5),
        ),
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

fn preintegrated_noise() -> ImuNoise {
    ImuNoise {
        gyro_density: 1e-3,
        accel_density: 1e-2,
        gyro_bias_walk: 0.0,
        accel_bias_walk: 0.0,
    }
}

fn preintegrated() -> Preintegrated {
    let noise = preintegrated_noise();
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
    let mut step = [0.0; STEP];
    step[column] = h;
    (
        from.retracted(&step[..NODE]),
        to.retracted(&step[NODE..2 * NODE]),
        bias.retracted(&step[2 * NODE..]),
    )
}

/// Compares with central differences of step 1e-5, whose error is about 1e-10 here.
fn check<const R: usize>(
    analytic: &Jacobian<R>,
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
    let constants = constants();
    let residual = factor.residual(&constants, (&from, &to), &bias);
    let analytic = factor.jacobian(&constants, (&from, &to), &bias, &residual);
    check::<9>(&analytic, |from, to, bias| {
        flat(factor.residual(&constants, (from, to), bias))
    });
}

/// A lever arm, an incidence bias, a heading offset, gravity, the scale of the gyroscope and a latency of all records are
/// estimated, at values that are not zero.
fn constants() -> Constants {
    let arm = PositionSettings::prism(0.005, Vec3::new(0.3, -0.2, 1.5));
    let noise = preintegrated_noise();
    let mut settings =
        TrajectorySettings::new(BodyAxes::Flu, noise, arm, HeadingSettings::aligned(0.01));
    settings.gravity_m_s2 = GRAVITY;
    settings.estimate = vec![
        Constant::LeverArm(0),
        Constant::IncidenceBias(0),
        Constant::HeadingOffset,
        Constant::Gravity,
        Constant::GyroScale,
    ];
    let drift = Course::Linear {
        from_s: -5.0,
        to_s: 20.0,
    };
    let corrections = [
        ClockCorrection::none(Stream::Position(0), Course::Constant),
        ClockCorrection::none(Stream::Heading, Course::Constant),
        ClockCorrection::none(Stream::Position(0), drift),
    ];
    let constants = Constants::new(&settings, &corrections);
    assert_eq!(constants.count(), 17);
    // The incidence bias stays zero: the rows neglect that it turns with the attitude.
    let step = [
        0.01, -0.02, 0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02, -0.05, 0.01, -0.02, 0.015, 0.013,
        0.011, 0.007,
    ];
    constants.retracted(&step)
}

/// Compares the derivatives with respect to the constants with central differences.
fn check_constants<const R: usize>(
    rows: &FactorRows<R>,
    constants: &Constants,
    residual: impl Fn(&Constants) -> [f64; R],
) {
    let h = 1e-5;
    for column in 0..constants.count() {
        let value = |h: f64| {
            let mut step = vec![0.0; constants.count()];
            step[column] = h;
            residual(&constants.retracted(&step))
        };
        let (plus, minus) = (value(h), value(-h));
        let rows = rows.weighted(1.0);
        let derivative = rows.by_column().find(|(c, _)| *c == column);
        for row in 0..R {
            let numeric = (plus[row] - minus[row]) / (2.0 * h);
            let error = (numeric - derivative.map_or(0.0, |(_, by)| by[row])).abs();
            assert!(error < 2e-9, "row {row}, constant {column}: {error}");
        }
    }
}

/// The columns that rows touch.
fn touched<const R: usize>(rows: &FactorRows<R>) -> Vec<usize> {
    rows.weighted(1.0).columns.to_vec()
}

/// The propagation to a record after its node, and to one at its node.
fn propagations() -> [Propagation; 2] {
    [Some(Box::new(preintegrated().sums)), None].map(|sums| Propagation {
        sums,
        sample: sample(),
    })
}

#[test]
fn position_jacobians_meet_finite_differences() {
    let mut constants = constants();
    let modes = Modes::new((-5.0, 20.0), 20.0, 12.0);
    constants.add_lasting_position(0, Vec3::new(0.02, 0.03, 0.04), modes);
    let sensor = PositionSensor {
        station_m: Some(Vec3::new(-10.0, 4.0, 1.0)),
        up: Vec3::z(),
    };
    for propagation in propagations() {
        let fix = PositionFactor {
            propagation,
            sensor: 0,
            record: 0,
            time_s: 0.0,
            position_m: Vec3::new(0.9, 2.1, 0.4),
            whitener: Mat3::identity(),
            weight: 1.0,
            clocks: constants.clocks_of(Stream::Position(0), 0, 4.0),
        };
        let rows = fix.rows(&sensor, &constants, &state(0.0), &bias());
        assert_eq!(
            touched(&rows),
            [
                11, 12, 13, 14, 16, 0, 1, 2, 17, 18, 19, 3, 4, 5, 6, 7, 8, 10
            ]
        );
        check::<3>(&rows.by_step, |from, _, bias| {
            fix.whitened(&sensor, &constants, from, bias)
        });
        check_constants(&rows, &constants, |constants| {
            fix.whitened(&sensor, constants, &state(0.0), &bias())
        });
    }
}

#[test]
fn heading_and_pitch_jacobians_meet_finite_differences() {
    let mut constants = constants();
    constants.add_lasting_heading(0.03, Modes::new((-5.0, 20.0), 20.0, 12.0));
    let baseline = Vec3::new(0.8, 0.6, 0.0);
    for propagation in propagations() {
        for (quantity, columns) in [
            (Quantity::Heading, vec![11, 12, 13, 15, 9, 17]),
            (Quantity::Pitch(baseline), vec![11, 12, 13, 15]),
        ] {
            let fix = HeadingFactor {
                propagation: propagation.clone(),
                record: 0,
                time_s: 0.0,
                quantity,
                value_rad: 0.4,
                sigma_rad: 1.0,
                weight: 1.0,
                clocks: constants.clocks_of(Stream::Heading, 0, 4.0),
            };
            let rows = fix.rows(&constants, &state(0.0), &bias());
            assert_eq!(touched(&rows), columns);
            check::<1>(&rows.by_step, |from, _, bias| {
                fix.whitened(&constants, from, bias)
            });
            check_constants(&rows, &constants, |constants| {
                fix.whitened(constants, &state(0.0), &bias())
            });
        }
    }
}

/// Whitened rows of a factor whose whitener is not the identity: W J and W r.
#[test]
fn rows_are_whitened() {
    let constants = constants();
    let sensor = PositionSensor {
        station_m: None,
        up: Vec3::z(),
    };
    let [propagation, _] = propagations();
    let mut fix = PositionFactor {
        propagation,
        sensor: 0,
        record: 0,
        time_s: 0.0,
        position_m: Vec3::new(0.9, 2.1, 0.4),
        whitener: Mat3::identity(),
        weight: 1.0,
        clocks: vec![],
    };
    let raw = fix.rows(&sensor, &constants, &state(0.0), &bias());
    fix.whitener = Mat3::new(2.0, 0.0, 0.0, 1.0, 3.0, 0.0, -1.0, 0.5, 4.0);
    let rows = fix.rows(&sensor, &constants, &state(0.0), &bias());
    let whiten = |raw: [f64; 3]| fix.whitener * Vec3::from(raw);
    let close = |raw: [f64; 3], whitened: [f64; 3]| {
        assert!((whiten(raw) - Vec3::from(whitened)).norm() < 1e-12);
    };
    close(raw.residual, rows.residual);
    for column in 0..STEP {
        close(
            raw.by_step.map(|row| row[column]),
            rows.by_step.map(|row| row[column]),
        );
    }
    let (raw, rows) = (raw.weighted(1.0), rows.weighted(1.0));
    for ((a, raw), (b, whitened)) in raw.by_column().zip(rows.by_column()) {
        assert_eq!(a, b);
        close(
            [raw[0], raw[1], raw[2]],
            [whitened[0], whitened[1], whitened[2]],
        );
    }
}

#[test]
fn gravity_and_scale_move_the_imu_residual_as_their_jacobians_state() {
    let (factor, constants) = (imu(), constants());
    let (from, to, bias) = (state(0.0), state(0.1), bias());
    let flat = |r: [Vec3; 3]| std::array::from_fn::<f64, 9, _>(|i| r[i / 3][i % 3]);
    let residual = factor.residual(&constants, (&from, &to), &bias);
    let by_step = factor.jacobian(&constants, (&from, &to), &bias, &residual);
    let mut rows = FactorRows::new(flat(residual), by_step);
    let mean_rate_rad_s = factor.sums.mean_rate_rad_s();
    touch_gyro_scale(&mut rows, &constants.gyro_scale, || mean_rate_rad_s);
    let block = constants.gravity_m_s2.block().expect("estimated");
    rows.touch(block, [flat(factor.gravity_jacobian(&from))]);
    check_constants(&rows, &constants, |constants| {
        flat(factor.residual(constants, (&from, &to), &bias))
    });
}

#[test]
fn normal_equations_are_those_of_the_whitened_rows() {
    let (factor, constants) = (imu(), constants());
    let (from, to, bias) = (state(0.0), state(0.1), bias());
    let nodes = (&from, &to);
    let mut system = StepSystem::ZERO;
    let mut border = BorderSystem::new(constants.count());
    let whitened = factor.rows(&constants, nodes, &bias, 1.0);
    assemble(&whitened.weighted(1.0), &mut system, &mut border);
    let residual = factor.residual(&constants, nodes, &bias);
    let rows = factor.jacobian(&constants, nodes, &bias, &residual);
    let information = preintegrated().covariance.try_inverse().expect("regular");
    let j = nalgebra::SMatrix::<f64, 9, STEP>::from_fn(|a, b| rows[a][b]);
    let r = nalgebra::SVector::<f64, 9>::from_fn(|a, _| residual[a / 3][a % 3]);
    let by_gravity = factor.gravity_jacobian(&from);
    let k = nalgebra::SVector::<f64, 9>::from_fn(|a, _| by_gravity[a / 3][a % 3]);
    let h = j.transpose() * information * j;
    let g = -(j.transpose() * information * r);
    let e = j.transpose() * information * k;
    for a in 0..STEP {
        assert!((g[a] - system.g[a]).abs() < 1e-7 * g.norm());
        assert!((e[a] - border.h[10][a]).abs() < 1e-7 * e.norm());
        for b in a..STEP {
            assert!((h[(a, b)] - system.h[a][b]).abs() < 1e-7 * h.norm());
        }
    }
    let diagonal = (k.transpose() * information * k)[0];
    assert!((border.c[10 * constants.count() + 10] - diagonal).abs() < 1e-7 * diagonal);
}

#[test]
fn a_body_at_rest_feels_gravity_upwards() {
    let mut sums = Preintegrated::new(ImuBias::default());
    let force = Vec3::new(0.0, 0.0, GRAVITY);
    sums.add(Vec3::zeros(), force, 0.01, &preintegrated_noise());
    let factor = ImuFactor::new(&sums).expect("positive covariance");
    let rest = NodeState {
        world_from_body: WorldFromBody::new(Rotation::identity(), Vec3::new(1.0, 2.0, 3.0)),
        velocity_m_s: Vec3::zeros(),
    };
    let mut constants = constants();
    constants.gravity_m_s2.value = GRAVITY;
    for part in factor.residual(&constants, (&rest, &rest), &ImuBias::default()) {
        assert!(part.norm() < 1e-12, "{part}");
    }
}
