//! Thresholds and limits of the online smoother.

use crate::adjustment::NODE;
use crate::geometry::Vec3;
use crate::sensor::ImuBias;
use crate::trajectory::states::BIAS;

/// Sizes of steps, one for each kind of unknown, per component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    /// Attitude, radians.
    pub attitude_rad: f64,
    /// Metres.
    pub position_m: f64,
    /// m/s.
    pub velocity_m_s: f64,
    /// Gyro bias, rad/s.
    pub gyro_rad_s: f64,
    /// Accelerometer bias, m/s².
    pub accel_m_s2: f64,
}

impl Thresholds {
    /// No step is small enough.
    pub const ZERO: Self = Self {
        attitude_rad: 0.0,
        position_m: 0.0,
        velocity_m_s: 0.0,
        gyro_rad_s: 0.0,
        accel_m_s2: 0.0,
    };

    /// Whether two steps of a node differ in any component by more than this.
    pub(super) fn node_steps_differ(&self, a: &[f64; NODE], b: &[f64; NODE]) -> bool {
        let limits = [self.attitude_rad, self.position_m, self.velocity_m_s];
        (0..NODE).any(|i| (a[i] - b[i]).abs() > limits[i / 3])
    }

    /// The same for steps of a bias.
    pub(super) fn bias_steps_differ(&self, a: &[f64; BIAS], b: &[f64; BIAS]) -> bool {
        let limits = [self.gyro_rad_s, self.accel_m_s2];
        (0..BIAS).any(|i| (a[i] - b[i]).abs() > limits[i / 3])
    }
}

impl Thresholds {
    /// The same for biases themselves.
    pub(super) fn biases_differ(&self, a: &ImuBias, b: &ImuBias) -> bool {
        let differ = |a: &Vec3, b: &Vec3, limit: f64| (a - b).amax() > limit;
        differ(&a.gyro_rad_s, &b.gyro_rad_s, self.gyro_rad_s)
            || differ(&a.accel_m_s2, &b.accel_m_s2, self.accel_m_s2)
    }
}

/// Options of the online smoother.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnlineOptions {
    /// Nodes and biases are relinearised where their step from the linearisation point exceeds this.
    pub relinearise: Thresholds,
    /// Back-substitution ends where steps change by less than this.
    pub wildfire: Thresholds,
    /// Number of nodes, counted from the newest, at which elimination may start again: it bounds the cost
    /// of an update. Older nodes keep their linearisation points until the end.
    pub reach: usize,
    /// Shortest time before the start, seconds.
    pub start_s: f64,
}

impl Default for OnlineOptions {
    /// The linearisation error of a step within these thresholds is of the order of the product of two of
    /// them: micrometres at the newest node.
    fn default() -> Self {
        Self {
            relinearise: Thresholds {
                attitude_rad: 2e-3,
                position_m: 0.1,
                velocity_m_s: 0.1,
                gyro_rad_s: 2e-3,
                accel_m_s2: 0.2,
            },
            wildfire: Thresholds {
                attitude_rad: 1e-5,
                position_m: 1e-4,
                velocity_m_s: 1e-4,
                gyro_rad_s: 1e-6,
                accel_m_s2: 1e-4,
            },
            reach: 256,
            start_s: 2.0,
        }
    }
}
