//! The scanned surface: points that move with the poses and the mountings, their neighbourhoods, the
//! planes of these, and how points move along a normal with pose and mounting.
//!
//! A point keeps its profile, and poses stand once a profile: whoever changes poses changes the table
//! of profiles.

mod cloud;
mod fitted;
mod neighbourhoods;
mod plane;
mod profile;
mod rows;

pub use cloud::{Placed, PosedProfile, SurfaceCloud};
pub use fitted::Surface;
pub use neighbourhoods::{Memberships, Neighbourhoods};
pub use plane::Plane;
pub use profile::{Profile, ProfilePoint};
pub use rows::{PointRows, Row};
