//! The three-dimensional scene of a drive for the page.

use super::clouds::KeptPoints;
use super::rig::Rig;
use crate::comparison::{Agreements, ComparisonSettings, MountingKind};
use crate::geometry::Vec3;
use crate::joint::SurfelPlane;
use crate::project::Project;
use crate::report::scene::{Input, Scan, Scene, View, gather};

/// Most points of a drive, and of all drives together: the page then has a size of some megabytes.
const MOST_OF_DRIVE: usize = 200_000;
const MOST: usize = 570_000;

/// A drive with the data for its scene.
pub struct Shown<'a> {
    /// Its project.
    pub project: &'a Project,
    /// Its scanners.
    pub rig: &'a Rig,
    /// The kept points of the drive.
    pub kept: &'a KeptPoints,
    /// The distances of its clouds.
    pub agreements: &'a Agreements,
    /// The settings with which the distances were computed.
    pub settings: &'a ComparisonSettings,
    /// The reference, metres; empty without one.
    pub reference: &'a [Vec3],
    /// The surface that an adjustment estimated.
    pub planes: &'a [SurfelPlane],
    /// Number of drives in the page.
    pub drives: usize,
}

impl Shown<'_> {
    /// The scene with the points placed in these ways, except by the truth; `None` without points.
    pub fn with<'a>(&self, views: impl Iterator<Item = View<'a>>) -> Option<Scene> {
        let scanners = self.rig.mountings.iter().zip(&self.rig.time_offsets_s);
        let scans = scanners
            .zip(self.kept)
            .map(|((mounting, offset_s), kept)| Scan {
                name: &mounting.name,
                time_offset_s: *offset_s,
                of: kept.of,
                points: &kept.points,
            });
        gather(&Input {
            origin_m: self.project.origin_m,
            scans: scans.collect(),
            views: views
                .filter(|view| view.kind != MountingKind::Truth)
                .collect(),
            agreements: self.agreements,
            settings: self.settings,
            reference: self.reference,
            planes: self.planes,
            most_points: MOST_OF_DRIVE.min(MOST / self.drives.max(1)),
        })
    }
}
