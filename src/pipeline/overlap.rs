//! What the overlap of a project's scanners shows of their mountings: the drift watch of one drive.

use super::{clouds, stages, start};
use crate::drift::{self, Overlap, OverlapInput};
use crate::error::Result;
use crate::progress::Progress;
use crate::project::Project;

/// How each further scanner sits in the frame of the first, against the mountings of the project, by the ground that
/// both saw in one pass: no boards, no reference and no prism are needed, but poses, from logs or a file.
///
/// # Errors
/// Errors of the stages; see [`drift::overlap`].
pub fn overlap(project: &Project, progress: &dyn Progress) -> Result<Overlap> {
    drift::check_scanners(project.scanners.len())?;
    let poses = stages::poses(project, progress)?;
    let project = &start::with_scales(project, poses.trajectory(), progress)?;
    overlap_on(project, &poses, progress)
}

/// The same on poses that are known already; the scales of the project hold.
///
/// # Errors
/// As for [`overlap`].
pub fn overlap_on(
    project: &Project,
    poses: &stages::EstimatedPoses,
    progress: &dyn Progress,
) -> Result<Overlap> {
    let samples = stages::samples(project, poses.trajectory(), progress)?;
    let sizes = &project.calibration.voxel_sizes_m;
    let input = OverlapInput {
        mountings: &stages::mountings(project),
        samples: &samples,
        bending: &clouds::bending(project, poses.trajectory()),
        voxel_m: sizes.iter().copied().fold(f64::INFINITY, f64::min),
    };
    drift::overlap(&input, progress)
}
