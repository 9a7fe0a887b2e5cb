//! The poses of a drive as they are drawn.

use super::content::Drive;
use super::diagnostics::PoseSigmas;
use crate::sensor::PoseRecord;
use crate::trajectory::Solution;

/// Most poses drawn of one drive: about ten a second say as much as a hundred.
const MOST_POSES: usize = 3000;

/// What is drawn of one drive.
pub struct Track<'a> {
    /// Name of the drive.
    pub name: &'a str,
    /// An even share of the poses.
    pub poses: Vec<&'a PoseRecord>,
    /// How well all poses are known, not only those drawn.
    pub sigmas: Option<PoseSigmas>,
    /// What the adjustment left; `None` where the poses came from a file.
    pub solution: Option<&'a Solution>,
}

impl<'a> Track<'a> {
    /// Of this drive.
    pub fn of(drive: &'a Drive) -> Self {
        let stride = drive.poses.len().div_ceil(MOST_POSES).max(1);
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
