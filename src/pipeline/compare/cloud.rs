//! A comparison as a cloud of its core points.

use std::path::Path;

use crate::cloud::PointCloud;
use crate::comparison::{CoreDistance, M3c2};
use crate::error::Result;
use crate::format::{self, ExtraDimension, ExtraKind};
use crate::progress::Progress;

/// An extra dimension: name, description, type and value.
type Column = (
    &'static str,
    &'static str,
    ExtraKind,
    fn(&CoreDistance) -> f64,
);

const COLUMNS: [Column; 11] = [
    ("distance", "M3C2 distance (m)", ExtraKind::F64, |c| {
        c.distance_m
    }),
    ("level_of_detection", "at 95 % (m)", ExtraKind::F64, |c| {
        c.level_of_detection_m
    }),
    (
        "significant",
        "1: beyond the level of detection",
        ExtraKind::U32,
        |c| f64::from(u8::from(c.significant() == Some(true))),
    ),
    ("spread1", "of the reference (m)", ExtraKind::F64, |c| {
        c.reference_spread_m
    }),
    ("spread2", "of the cloud (m)", ExtraKind::F64, |c| {
        c.compared_spread_m
    }),
    ("count1", "points of the reference", ExtraKind::U32, |c| {
        f64::from(c.reference_count)
    }),
    ("count2", "points of the cloud", ExtraKind::U32, |c| {
        f64::from(c.compared_count)
    }),
    ("normal_x", "east", ExtraKind::F64, |c| c.normal.x),
    ("normal_y", "north", ExtraKind::F64, |c| c.normal.y),
    ("normal_z", "up", ExtraKind::F64, |c| c.normal.z),
    (
        "normal_radius",
        "of its neighbourhood (m)",
        ExtraKind::F64,
        |c| c.normal_radius_m,
    ),
];

/// Writes the core points in their order, with the results as extra dimensions; NaN if a result is
/// unknown.
pub(super) fn write(path: &Path, found: &M3c2, progress: &dyn Progress) -> Result<()> {
    let cloud = PointCloud {
        points: found.core.iter().map(|core| core.point).collect(),
        ..PointCloud::default()
    };
    let dimensions = COLUMNS.map(|(name, text, kind, _)| ExtraDimension::new(name, kind, text));
    let _stage = progress.stage("writing the core points", cloud.points.len() as u64);
    let mut row = |index: u64, values: &mut [f64]| {
        let core = &found.core[index as usize];
        for (value, (.., column)) in values.iter_mut().zip(&COLUMNS) {
            *value = column(core);
        }
        Ok(true)
    };
    format::cloud_to_las(&cloud, path, &dimensions, &mut row, progress).map(drop)
}
