//! The drift watch of one drive: changes of the mountings that the overlap of a project's scanners shows.

use super::{clouds, stages, start};
use crate::drift::{self, Overlap, OverlapInput};
use crate::error::Result;
use crate::progress::Progress;
use crate::project::Project;

/// Compares each further scanner in the frame of the first with the mountings of the project, by the ground that both
/// saw in one pass. This needs poses, from logs or a file, but no boards, reference or prism.
///
/// # Errors
/// Errors of the stages; see [`drift::overlap`].
pub fn overlap(project: &Project, progress: &dyn Progress) -> Result<Overlap> {
    drift::check_scanners(project.scanners.len())?;
    let poses = stages::poses(project, progress)?;
    let project = &start::with_scales(project, poses.trajectory(), progress)?;
    overlap_on(project, &poses, progress)
}

/// As [`overlap`], with poses that are already known; the scales are those of the project.
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
