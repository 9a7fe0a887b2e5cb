//! The drift watch of one drive: changes of the mountings that the overlap of a project's scanners shows.

use super::open_project::OpenProject;
use super::rig::Rig;
use super::{clouds, stages, start};
use crate::drift::{self, Overlap, OverlapInput};
use crate::error::Result;
use crate::progress::Progress;
use crate::project::Project;

/// Compares each further scanner in the frame of the first with the mountings in use, by the ground that both saw in one
/// pass. This needs poses, from logs or a file, but no boards, reference or prism.
///
/// # Errors
/// Errors of the stages; see [`drift::overlap`].
pub fn overlap(project: &Project, rig: &Rig, progress: &dyn Progress) -> Result<Overlap> {
    drift::check_scanners(project.scanners.len())?;
    let project = &OpenProject::new(project);
    let poses = stages::poses(project, progress)?;
    let rig = &start::with_scales(project, rig, poses.trajectory(), progress)?;
    let samples = stages::samples(project, rig, poses.trajectory(), progress)?;
    let input = OverlapInput {
        mountings: &rig.mountings,
        samples: &samples,
        bending: &clouds::bending(rig, poses.trajectory()),
        voxel_m: rig.finest_m(),
    };
    drift::overlap(&input, progress)
}
