//! The three-dimensional scene of a drive for the page.

use super::clouds::CloudSample;
use super::open_project::OpenProject;
use super::rig::Rig;
use crate::comparison::{Agreements, ComparisonSettings, MountingKind};
use crate::geometry::Vec3;
use crate::joint::SurfelPlane;
use crate::report::scene::{Input, Scan, Scene, View, gather};

/// Largest numbers of points of a drive and of all drives together: the page then has a size of some megabytes.
const MOST_OF_DRIVE: usize = 200_000;
const MOST: usize = 570_000;

/// The data from which the scene of a drive is made.
pub struct SceneInput<'a> {
    /// Its project.
    pub project: &'a OpenProject,
    /// Its scanners.
    pub rig: &'a Rig,
    /// An even sample of the points of each scanner.
    pub samples: &'a [CloudSample],
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

impl SceneInput<'_> {
    /// The scene with the points placed as in these views, except that of the true mountings; `None` without points.
    pub fn scene<'a>(&self, views: impl Iterator<Item = View<'a>>) -> Option<Scene> {
        let scanners = self.rig.mountings.iter().zip(&self.rig.time_offsets_s);
        let scans = scanners
            .zip(self.samples)
            .map(|((mounting, offset_s), sample)| Scan {
                name: &mounting.name,
                time_offset_s: *offset_s,
                total: sample.total,
                points: &sample.points,
            });
        gather(&Input {
            origin_m: self.project.origin_m(),
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
