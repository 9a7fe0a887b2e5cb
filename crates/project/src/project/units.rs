//! Units of an IMU whose log cannot name them.

use serde::{Deserialize, Serialize};

use crate::sensor::{ImuSample, STANDARD_GRAVITY_M_S2};

/// Unit of the specific forces in a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum AccelUnit {
    /// m/s², or as the columns of a table say.
    #[default]
    #[serde(rename = "m_s2")]
    MetresPerSecondSquared,
    /// Standard gravity.
    #[serde(rename = "g")]
    Gravity,
    /// Thousandths of standard gravity.
    #[serde(rename = "mg")]
    Milligravity,
}

/// Unit of the angular rates in a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum GyroUnit {
    /// rad/s, or as the columns of a table say.
    #[default]
    #[serde(rename = "rad_s")]
    RadiansPerSecond,
    /// Degrees per second.
    #[serde(rename = "deg_s")]
    DegreesPerSecond,
}

/// Unit of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum TimeUnit {
    /// Seconds.
    #[serde(rename = "s")]
    Second,
    /// Milliseconds.
    #[serde(rename = "ms")]
    Millisecond,
    /// Microseconds.
    #[serde(rename = "us")]
    Microsecond,
    /// Nanoseconds.
    #[serde(rename = "ns")]
    Nanosecond,
}

impl TimeUnit {
    const ALL: [Self; 4] = [
        Self::Second,
        Self::Millisecond,
        Self::Microsecond,
        Self::Nanosecond,
    ];

    /// Its length, seconds.
    pub fn length_s(self) -> f64 {
        match self {
            Self::Second => 1.0,
            Self::Millisecond => 1e-3,
            Self::Microsecond => 1e-6,
            Self::Nanosecond => 1e-9,
        }
    }

    /// The unit of this length, seconds.
    pub fn of_length_s(length_s: f64) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|unit| unit.length_s() == length_s)
    }
}

/// The units of an IMU's log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ImuUnits {
    /// Of specific forces.
    pub accel: AccelUnit,
    /// Of angular rates.
    pub gyro: GyroUnit,
}

impl ImuUnits {
    /// Converts a sample to rad/s and m/s².
    pub fn convert(self, sample: &mut ImuSample) {
        sample.accel_m_s2 *= match self.accel {
            AccelUnit::MetresPerSecondSquared => 1.0,
            AccelUnit::Gravity => STANDARD_GRAVITY_M_S2,
            AccelUnit::Milligravity => 1e-3 * STANDARD_GRAVITY_M_S2,
        };
        sample.gyro_rad_s *= match self.gyro {
            GyroUnit::RadiansPerSecond => 1.0,
            GyroUnit::DegreesPerSecond => 1f64.to_radians(),
        };
    }
}
