//! Time scales that are taken for one another.

use serde::{Deserialize, Serialize};

/// Latencies that differ by less are the same, seconds.
pub const SAME_LATENCY_S: f64 = 0.5;

/// Two time scales.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum TimeScales {
    /// GPS and UTC.
    GpsUtc,
    /// TAI and GPS.
    TaiGps,
    /// TAI and UTC.
    TaiUtc,
}

impl TimeScales {
    /// All pairs.
    pub const ALL: [Self; 3] = [Self::GpsUtc, Self::TaiGps, Self::TaiUtc];

    /// By how much they differ, seconds.
    pub fn difference_s(self) -> f64 {
        match self {
            Self::GpsUtc => 18.0,
            Self::TaiGps => 19.0,
            Self::TaiUtc => 37.0,
        }
    }

    /// Those that differ by about this, seconds.
    pub(super) fn that_differ_by(late_s: f64) -> Option<Self> {
        let is_near = |scales: &Self| (late_s.abs() - scales.difference_s()).abs() < SAME_LATENCY_S;
        Self::ALL.into_iter().find(is_near)
    }
}
