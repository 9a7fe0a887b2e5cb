//! The clouds of a drive for the page: what its viewer moves and draws.
//!
//! Points are kept in the scanner frame, and with them for every profile the pose of the body and where the
//! mounting moves also the mounting. The viewer computes x_m = t_mb(t) + R_mb(t) (t_bs + R_bs x_s) itself, so that
//! one set of points serves every mounting they are shown with. Lengths are quantised.
//!
//! [`gather()`] makes a scene of a drive, and [`section()`] its markup with the data in base64; `web/README.md`
//! describes their bytes.

mod distances;
mod gather;
mod input;
mod outline;
mod packed;
mod passes;
mod places;
mod quantised;
mod section;
mod select;
mod surfels;
#[cfg(test)]
mod tests;
mod variant;

pub use gather::gather;
pub use input::{Input, Scan, View};
pub use section::section;

use places::Place;
use quantised::{Bytes, Places, Range16, Track};

use crate::comparison::MountingKind;
use crate::geometry::{BodyFromScanner, Vec3};
use crate::stored::stored;

/// The clouds of one drive.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scene {
    /// Origin of all positions, in the coordinates of the map, metres.
    pub origin_m: Vec3,
    /// Step of positions of body and scanners, metres.
    pub step_m: f64,
    /// Time from which times count, seconds on the common clock.
    pub start_s: f64,
    /// Step of times, seconds.
    pub step_s: f64,
    /// One a scanner.
    pub fans: Vec<Fan>,
    /// Poses of the body: for each distinct trajectory, and each scanner, those of its profiles.
    pub poses: Vec<Vec<Track>>,
    /// The ways in which the points are placed.
    pub variants: Vec<Variant>,
    /// What the M3C2 distances are to.
    pub against: String,
    /// Points of the reference, in steps of 10 µm.
    pub reference: Places,
    /// Number of points of the whole reference.
    pub reference_of: u64,
    /// Patches of the surface that the adjustment found.
    pub surfels: Surfels,
    /// Places for sections; around them all points are there that were kept for comparison.
    pub places: Vec<Place>,
    /// Radius around a place within which all of them are, metres.
    pub place_radius_m: f64,
}
stored!(struct Scene {
    origin_m, step_m, start_s, step_s, fans, poses, variants, against, reference, reference_of, surfels,
    places, place_radius_m
});

/// Patches of a surface.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surfels {
    /// Their centres from the origin, in steps of 10 µm.
    pub centres: Places,
    /// East, north and up of their normals, −1 to 1 in steps of 1/127, as bytes in two's complement.
    pub normals: [Vec<u8>; 3],
    /// Standard deviation of points about each, metres.
    pub roughness: Bytes,
    /// The edge of all of them, metres.
    pub size_m: f64,
}
stored!(struct Surfels { centres, normals, roughness, size_m });

/// Step of the points of the reference, metres.
const REFERENCE_STEP_M: f64 = 1e-5;

/// Radius around the place of a section within which all points are taken, metres.
const PLACE_RADIUS_M: f64 = 0.2;

/// The points of one scanner, profile by profile in the order of their times.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Fan {
    /// Name of the scanner.
    pub name: String,
    /// Number of points with a pose in its recordings.
    pub of: u64,
    /// x, y and z in the scanner frame, metres, of each point.
    pub coordinates: [Range16; 3],
    /// Number of points of each profile.
    pub counts: Vec<u16>,
    /// Time of each profile, in steps from the start.
    pub times: Vec<i32>,
    /// Number of each profile among those with points in the recordings.
    pub numbers: Vec<i32>,
    /// Pass of each profile, 0 on none.
    pub passes: Vec<u16>,
    /// The far end of its field of view, in the scanner frame, metres; empty where it is no fan.
    pub outline_m: Vec<Vec3>,
}
stored!(struct Fan { name, of, coordinates, counts, times, numbers, passes, outline_m });

/// A way in which the points are placed.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// The mountings.
    pub kind: MountingKind,
    /// Which of the [`Scene::poses`].
    pub poses: usize,
    /// The mounting of each scanner; where it moves, the one about which it does.
    pub mountings: Vec<BodyFromScanner>,
    /// The mounting at each profile of each scanner, in steps of [`Scene::step_m`]; empty where they are rigid.
    pub moving: Vec<Track>,
    /// M3C2 distance at each point of each scanner, metres.
    pub distances: Vec<Bytes>,
    /// Its level of detection at 95 %, metres.
    pub detections: Vec<Bytes>,
    /// Omnivariance of the nearest points of all scanners, among those shown, mm².
    pub omnivariances: Vec<Bytes>,
    /// Standard deviation of the position of the body when a point was seen, in 3D, metres.
    pub pose_sigmas: Vec<Bytes>,
}
stored!(struct Variant {
    kind, poses, mountings, moving, distances, detections, omnivariances, pose_sigmas
});
