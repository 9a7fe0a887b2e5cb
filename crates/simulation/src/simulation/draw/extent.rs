//! How large drawn drives are.

/// How large a drawn drive may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Rays of all profile scanners together, and of a lidar, at most, unless fewer would tell nothing.
    pub most_rays: f64,
    /// Shortest and longest duration of passes and turns, seconds; a drive has at least three passes.
    pub duration_s: (f64, f64),
    /// Slowest speed over the ground, m/s.
    pub slowest_m_s: f64,
}

impl Extent {
    /// A run takes some minutes.
    pub const FULL: Self = Self {
        most_rays: 4e6,
        duration_s: (60.0, 900.0),
        slowest_m_s: 0.05,
    };
    /// A run takes some seconds.
    pub const TINY: Self = Self {
        most_rays: 1e5,
        duration_s: (20.0, 60.0),
        slowest_m_s: 0.3,
    };
}
