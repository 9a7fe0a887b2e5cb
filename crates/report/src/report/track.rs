//! The poses of a drive for drawing.

use crate::diagnostics::PoseSigmas;
use crate::results::Drive;
use crate::sensor::PoseRecord;
use crate::trajectory::Solution;

/// Maximum number of poses drawn per drive: ten per second look the same as a hundred.
const MAX_POSES: usize = 3000;

/// The data of one drive for drawing.
pub struct Track<'a> {
    /// Name of the drive.
    pub name: &'a str,
    /// Evenly sampled poses.
    pub poses: Vec<&'a PoseRecord>,
    /// Standard deviations of all poses, not only those drawn.
    pub sigmas: Option<PoseSigmas>,
    /// Result of the adjustment; `None` if the poses came from a file.
    pub solution: Option<&'a Solution>,
}

impl<'a> Track<'a> {
    /// The track of a drive.
    pub fn of(drive: &'a Drive) -> Self {
        let stride = drive.poses.len().div_ceil(MAX_POSES).max(1);
        Self {
            name: &drive.name,
            poses: drive.poses.iter().step_by(stride).collect(),
            sigmas: PoseSigmas::of(&drive.poses),
            solution: drive.solution.as_ref(),
        }
    }
}

/// The tracks whose poses were adjusted.
pub fn adjusted<'t, 'a>(
    tracks: &'t [Track<'a>],
) -> impl Iterator<Item = (&'t Track<'a>, &'a Solution)> {
    let all = tracks.iter();
    all.filter_map(|track| Some((track, track.solution?)))
}
