//! The input from which a scene is gathered.

use crate::comparison::{Agreements, ComparisonSettings, MountingKind};
use crate::geometry::{Bending, BodyFromScanner, Vec3};
use crate::joint::SurfelPlane;
use crate::sensor::ScanPoint;
use crate::trajectory::Trajectory;

/// The data of a drive.
pub struct Input<'a> {
    /// Origin that is subtracted from the coordinates, metres.
    pub origin_m: Vec3,
    /// The scans of each scanner.
    pub scans: Vec<Scan<'a>>,
    /// The ways in which the points are placed; the last is the result.
    pub views: Vec<View<'a>>,
    /// The distances between the clouds.
    pub agreements: &'a Agreements,
    /// The settings with which the distances were computed.
    pub settings: &'a ComparisonSettings,
    /// The reference, metres; empty without one.
    pub reference: &'a [Vec3],
    /// The surface that an adjustment estimated.
    pub planes: &'a [SurfelPlane],
    /// Approximate number of points to take.
    pub most_points: usize,
}

/// The points of a scanner.
pub struct Scan<'a> {
    /// Name of the scanner.
    pub name: &'a str,
    /// Added to its times to get those of the trajectory, seconds.
    pub time_offset_s: f64,
    /// Number of points with a pose in its recordings.
    pub total: u64,
    /// A sample of these points, in the order of their times, each with the number of its profile.
    pub points: &'a [(u32, ScanPoint)],
}

/// A way in which points are placed.
pub struct View<'a> {
    /// The mountings.
    pub kind: MountingKind,
    /// The poses of the body.
    pub trajectory: &'a Trajectory,
    /// The mounting of each scanner.
    pub mountings: &'a [BodyFromScanner],
    /// The motion of each scanner about its mounting; empty if mountings are rigid.
    pub bending: &'a [Bending],
}

impl View<'_> {
    /// The mounting of a scanner at a time, seconds.
    pub(super) fn mounting(&self, scanner: usize, time_s: f64) -> BodyFromScanner {
        let mean = &self.mountings[scanner];
        let bending = self.bending.get(scanner);
        bending.map_or(*mean, |bending| bending.apply(mean, time_s))
    }
}
