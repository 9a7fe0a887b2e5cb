//! Noise of the IMU, as the adjustment needs it and as datasheets give it.

use crate::sensor::STANDARD_GRAVITY_M_S2;

/// Time in which a bias walks by its instability, seconds.
const BIAS_CORRELATION_S: f64 = 100.0;

/// Noise of the IMU as continuous-time densities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuNoise {
    /// Gyro white noise (angle random walk), rad/s/√Hz.
    pub gyro_density: f64,
    /// Accelerometer white noise (velocity random walk), m/s²/√Hz.
    pub accel_density: f64,
    /// Gyro bias random walk, rad/s/√s.
    pub gyro_bias_walk: f64,
    /// Accelerometer bias random walk, m/s²/√s.
    pub accel_bias_walk: f64,
}

/// Noise of the IMU in the units of datasheets. The default is an SBG Ellipse-D.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuDatasheet {
    /// Angle random walk, °/√h.
    pub gyro_noise_deg_sqrt_h: f64,
    /// Velocity random walk, µg/√Hz.
    pub accel_noise_ug_sqrt_hz: f64,
    /// Gyro bias instability, °/h: the bias walks by this in 100 s.
    pub gyro_bias_instability_deg_h: f64,
    /// Accelerometer bias instability, µg: the bias walks by this in 100 s.
    pub accel_bias_instability_ug: f64,
}

impl Default for ImuDatasheet {
    fn default() -> Self {
        Self {
            gyro_noise_deg_sqrt_h: 0.15,
            accel_noise_ug_sqrt_hz: 57.0,
            gyro_bias_instability_deg_h: 7.0,
            accel_bias_instability_ug: 14.0,
        }
    }
}

impl ImuNoise {
    /// The densities of an IMU with this datasheet.
    pub fn from_datasheet(datasheet: &ImuDatasheet) -> Self {
        Self {
            gyro_density: Self::gyro_density(datasheet.gyro_noise_deg_sqrt_h),
            accel_density: Self::accel_density(datasheet.accel_noise_ug_sqrt_hz),
            gyro_bias_walk: Self::gyro_bias_walk(datasheet.gyro_bias_instability_deg_h),
            accel_bias_walk: Self::accel_bias_walk(datasheet.accel_bias_instability_ug),
        }
    }

    /// The gyro density, rad/s/√Hz, of an angle random walk in °/√h.
    pub fn gyro_density(deg_sqrt_h: f64) -> f64 {
        (deg_sqrt_h / 60.0).to_radians()
    }

    /// The accelerometer density, m/s²/√Hz, of a velocity random walk in µg/√Hz.
    pub fn accel_density(ug_sqrt_hz: f64) -> f64 {
        ug_sqrt_hz * 1e-6 * STANDARD_GRAVITY_M_S2
    }

    /// The bias random walk, rad/s/√s, of a bias instability in °/h.
    pub fn gyro_bias_walk(deg_h: f64) -> f64 {
        (deg_h / 3600.0).to_radians() / BIAS_CORRELATION_S.sqrt()
    }

    /// The bias random walk, m/s²/√s, of a bias instability in µg.
    pub fn accel_bias_walk(ug: f64) -> f64 {
        ug * 1e-6 * STANDARD_GRAVITY_M_S2 / BIAS_CORRELATION_S.sqrt()
    }
}
