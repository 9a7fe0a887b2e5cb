//! A solution like that of the trajectory stage, with faults: outliers, a time without prism, an IMU
//! gap, a constant that the drive does not determine.

use super::synthetic::normal;
use boresight::trajectory::{
    ClockJump, EstimatedConstant, Rejection, RejectionReason, Residual, SensorDiagnostics,
    Solution, StopReason,
};

/// Start of the drive, seconds.
pub const START_S: f64 = 1_000.0;
/// Sigma of a prism coordinate, metres.
const SIGMA_M: f64 = 0.005;
/// Redundancy of each component of a prism position.
const REDUNDANCY: f64 = 0.81;

fn prism(records: usize, rate_hz: f64) -> Vec<Residual> {
    (0..records)
        .map(|i| (i, START_S + i as f64 / rate_hz))
        .filter(|(_, time_s)| !(1_100.0..1_120.0).contains(time_s))
        .map(|(i, time_s)| {
            let rejected = i % 40 == 7;
            let values: Vec<f64> = (0..3)
                .map(|axis| match (rejected, axis) {
                    (true, 0) => 0.3,
                    (true, 1) => 0.012,
                    _ => SIGMA_M * REDUNDANCY.sqrt() * normal(3 * i + axis),
                })
                .collect();
            let normalised: Vec<f64> = values.iter().map(|v| v / SIGMA_M).collect();
            Residual {
                record: i + 1,
                time_s,
                tests: normalised.iter().map(|n| n / REDUNDANCY.sqrt()).collect(),
                normalised,
                values,
                weight: if rejected { 0.0 } else { 1.0 },
            }
        })
        .collect()
}

fn heading(records: usize) -> Vec<Residual> {
    (0..records)
        .map(|i| Residual {
            record: i + 1,
            time_s: START_S + 0.2 * i as f64,
            values: vec![0.012 * normal(i + 77)],
            normalised: vec![normal(i + 77)],
            tests: vec![normal(i + 77)],
            weight: 1.0,
        })
        .collect()
}

fn sensor(name: &str, unit: &str, count: usize) -> SensorDiagnostics {
    SensorDiagnostics {
        name: name.into(),
        unit: unit.into(),
        count,
        rejected: 0,
        ignored: 0,
        rms_raw: 0.0,
        rms_normalised: 0.97,
        redundancy: 0.0,
        chi_square: 0.0,
        chi_square_bounds_95: [0.0, 0.0],
        variance_component: None,
    }
}

/// A solution with these numbers of prism records, at this rate, and of headings.
pub fn solution(records: usize, rate_hz: f64, headings: usize) -> Solution {
    let residuals = vec![prism(records, rate_hz), heading(headings), vec![], vec![]];
    let outliers = residuals[0].iter().filter(|r| r.weight == 0.0);
    let mut rejections = vec![Rejection {
        sensor: "imu".into(),
        record: 4_711,
        time_s: 1_047.11,
        reason: RejectionReason::TimeOrder,
        normalised: None,
    }];
    rejections.extend(outliers.map(|r| Rejection {
        sensor: "prism".into(),
        record: r.record,
        time_s: r.time_s,
        reason: RejectionReason::Outlier,
        normalised: Some(60.05),
    }));
    let rejected = rejections.len() - 1;
    let constant = |name: &str, unit: &str, start, value, sigma| EstimatedConstant {
        name: name.into(),
        unit: unit.into(),
        start,
        value,
        sigma,
    };
    Solution {
        iterations: 6,
        converged: true,
        stop: StopReason::Converged,
        cost_initial: 1e6,
        cost_final: 1e3,
        nodes: 12_345,
        clock_jumps: vec![ClockJump {
            sensor: "prism".into(),
            record: 77,
            time_s: 1234.5,
            size_s: 0.512,
        }],
        sensors: vec![
            SensorDiagnostics {
                count: residuals[0].len() - rejected,
                rejected,
                ignored: 3,
                rms_raw: 0.004_56,
                redundancy: 4_321.4,
                chi_square: 4_250.0,
                chi_square_bounds_95: [4_140.0, 4_505.0],
                variance_component: Some(0.983_5),
                ..sensor("prism", "m", 0)
            },
            SensorDiagnostics {
                rms_raw: 0.0123f64.to_radians(),
                redundancy: 1_000.0,
                chi_square: 3_240.0,
                chi_square_bounds_95: [914.0, 1_090.0],
                variance_component: Some(3.24),
                ..sensor("heading", "rad", headings)
            },
            SensorDiagnostics {
                rms_raw: 0.05f64.to_radians(),
                redundancy: 800.0,
                chi_square: 512.0,
                chi_square_bounds_95: [723.0, 880.0],
                variance_component: Some(0.64),
                ..sensor("gyro", "rad/s", 30_000)
            },
            sensor("bias_walk", "", 2_000),
            // Not used, and so not shown.
            sensor("pitch", "rad", 0),
        ],
        constants: vec![
            constant("prism.lever_arm.x", "m", 0.10, 0.103_417, Some(0.000_83)),
            constant("prism.time_offset", "s", 0.0, -0.012_34, Some(0.000_21)),
            constant("heading.mounting_offset", "rad", 0.0, 0.0, None),
        ],
        rejections,
        imu_gaps_s: vec![(1_060.0, 1_060.8)],
        rests_s: vec![(1_000.0, 1_008.0)],
        residuals,
    }
}
