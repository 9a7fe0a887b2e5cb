//! The values of a core point, under the same names in every file.

use crate::comparison::CoreDistance;
use crate::format::ExtraKind;

/// A value of a core point.
pub(super) struct Column {
    /// Name with its unit.
    pub(super) name: &'static str,
    /// Description in a few words of ASCII.
    pub(super) text: &'static str,
    pub(super) kind: ExtraKind,
    /// The value; NaN if it is unknown.
    pub(super) value: fn(&CoreDistance) -> f64,
}

const fn column(
    name: &'static str,
    text: &'static str,
    kind: ExtraKind,
    value: fn(&CoreDistance) -> f64,
) -> Column {
    Column {
        name,
        text,
        kind,
        value,
    }
}

/// All values but the position, in their order.
pub(super) const COLUMNS: [Column; 11] = {
    use ExtraKind::{F64, U32};
    [
        column("distance_m", "M3C2 distance", F64, |c| c.distance_m),
        column("level_of_detection_m", "at 95 %", F64, |c| {
            c.level_of_detection_m
        }),
        column("normal_x", "east", F64, |c| c.normal.x),
        column("normal_y", "north", F64, |c| c.normal.y),
        column("normal_z", "up", F64, |c| c.normal.z),
        column("normal_radius_m", "of its neighbourhood", F64, |c| {
            c.normal_radius_m
        }),
        column("reference_spread_m", "along the normal", F64, |c| {
            c.reference_spread_m
        }),
        column("compared_spread_m", "along the normal", F64, |c| {
            c.compared_spread_m
        }),
        column("reference_count", "points in the cylinder", U32, |c| {
            f64::from(c.reference_count)
        }),
        column("compared_count", "points in the cylinder", U32, |c| {
            f64::from(c.compared_count)
        }),
        column("significant", "1: beyond level of detection", U32, |c| {
            f64::from(u8::from(c.significant() == Some(true)))
        }),
    ]
};
