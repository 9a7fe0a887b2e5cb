//! The clouds of a drive for the page, which its viewer moves and draws.
//!
//! Points are stored in the scanner frame. Each profile stores the pose of the body and, if the mounting moves, the
//! mounting. The viewer computes x_m = t_mb(t) + R_mb(t) (t_bs + R_bs x_s) itself, so that one set of points serves
//! every mounting they are shown with. Lengths are quantised.
//!
//! [`gather()`] makes a scene of a drive, and [`section()`] its markup with the data in base64; `web/README.md`
//! describes the bytes.

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
use serde::{Deserialize, Serialize};

use crate::comparison::MountingKind;
use crate::geometry::{BodyFromScanner, Vec3};

/// The clouds of one drive.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Scene {
    /// Origin of all positions, in the coordinates of the map, metres.
    pub origin_m: Vec3,
    /// Step of positions of body and scanners, metres.
    pub step_m: f64,
    /// Start of the times, seconds on the common clock.
    pub start_s: f64,
    /// Step of times, seconds.
    pub step_s: f64,
    /// The points of each scanner.
    pub fans: Vec<Fan>,
    /// Poses of the body: for each distinct trajectory and each scanner, the poses of its profiles.
    pub poses: Vec<Vec<Track>>,
    /// The ways in which the points are placed.
    pub variants: Vec<Variant>,
    /// Name of the cloud to which the M3C2 distances are measured.
    pub against: String,
    /// Points of the reference, in steps of 10 µm.
    pub reference: Places,
    /// Number of points of the complete reference.
    pub reference_of: u64,
    /// Surfels of the surface that the adjustment estimated.
    pub surfels: Surfels,
    /// Places for sections; around them, all points that were kept for comparison are included.
    pub places: Vec<Place>,
    /// Radius around a place within which all points are included, metres.
    pub place_radius_m: f64,
}

/// Surfels of a surface.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Surfels {
    /// Their centres relative to the origin, in steps of 10 µm.
    pub centres: Places,
    /// East, north and up of their normals, −1 to 1 in steps of 1/127, as bytes in two's complement.
    pub normals: [Vec<u8>; 3],
    /// Standard deviation of the points about each surfel, metres.
    pub roughness: Bytes,
    /// The edge of each surfel, metres.
    pub sizes: Bytes,
}

/// Step of the points of the reference, metres.
const REFERENCE_STEP_M: f64 = 1e-5;

/// Radius around the place of a section within which all points are taken, metres.
const PLACE_RADIUS_M: f64 = 0.2;

/// The points of one scanner, profile by profile in the order of their times.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Fan {
    /// Name of the scanner.
    pub name: String,
    /// Number of points with a pose in its recordings.
    pub total: u64,
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
    /// The far end of its field of view, in the scanner frame, metres; empty if it is not a fan.
    pub outline_m: Vec<Vec3>,
}

/// A way in which the points are placed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Variant {
    /// The mountings.
    pub kind: MountingKind,
    /// Index into [`Scene::poses`].
    pub poses: usize,
    /// The mounting of each scanner; if it moves, the mounting about which it moves.
    pub mountings: Vec<BodyFromScanner>,
    /// The mounting at each profile of each scanner, in steps of [`Scene::step_m`]; empty if mountings are rigid.
    pub moving: Vec<Track>,
    /// M3C2 distance at each point of each scanner, metres.
    pub distances: Vec<Bytes>,
    /// Its level of detection at 95 %, metres.
    pub detections: Vec<Bytes>,
    /// Omnivariance of the nearest points of all scanners, among those shown, mm².
    pub omnivariances: Vec<Bytes>,
    /// Standard deviation of the 3D position of the body when a point was measured, metres.
    pub pose_sigmas: Vec<Bytes>,
}
