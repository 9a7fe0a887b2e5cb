//! The scanned surface: points that move with the poses and the mountings, their neighbourhoods and
//! planes, and the derivatives of point-to-plane distances by pose and by mounting.
//!
//! Each point refers to its profile, and each profile holds one pose. To change poses, change the
//! table of profiles.

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
pub use rows::Row;
