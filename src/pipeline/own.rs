//! The project's own drive: inputs of stages are made when a stage first asks for them, because a stage that an earlier
//! run finished needs none.

use std::cell::OnceCell;

use super::rig::Rig;
use super::stages::{self, EstimatedPoses};
use crate::calibration::ScannerSample;
use crate::comparison::ReferenceSurface;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::project::Project;

/// Reference, poses and samples of a drive.
pub struct Own<'a> {
    project: &'a Project,
    reference: OnceCell<Vec<Vec3>>,
    surface: OnceCell<Option<ReferenceSurface>>,
    poses: OnceCell<EstimatedPoses>,
    samples: OnceCell<Vec<ScannerSample>>,
}

impl<'a> Own<'a> {
    /// The project's own drive, with nothing read yet.
    pub fn new(project: &'a Project) -> Self {
        Self {
            project,
            reference: OnceCell::new(),
            surface: OnceCell::new(),
            poses: OnceCell::new(),
            samples: OnceCell::new(),
        }
    }

    /// The points of the reference.
    ///
    /// # Errors
    /// See [`stages::reference`].
    pub fn reference(&self, progress: &dyn Progress) -> Result<&[Vec3]> {
        made(&self.reference, || {
            stages::reference(self.project, progress)
        })
        .map(Vec::as_slice)
    }

    /// The surface of the reference, with which the clouds of all drives are compared; `None` if the
    /// project has no reference.
    ///
    /// # Errors
    /// See [`Self::reference`] and [`ReferenceSurface::upwards`].
    pub fn surface(&self, progress: &dyn Progress) -> Result<Option<&ReferenceSurface>> {
        let reference = self.reference(progress)?;
        let settings = &self.project.comparison;
        made(&self.surface, || {
            ReferenceSurface::upwards("the reference", reference, settings, progress)
        })
        .map(Option::as_ref)
    }

    /// The poses with their joint covariance.
    ///
    /// # Errors
    /// See [`stages::poses`].
    pub fn poses(&self, progress: &dyn Progress) -> Result<&EstimatedPoses> {
        made(&self.poses, || stages::poses(self.project, progress))
    }

    /// A sample of each scanner, by the mountings and scales of `rig`.
    ///
    /// # Errors
    /// See [`stages::samples`].
    pub fn samples(&self, rig: &Rig, progress: &dyn Progress) -> Result<&[ScannerSample]> {
        let trajectory = self.poses(progress)?.trajectory();
        let make = || stages::samples(self.project, rig, trajectory, progress);
        made(&self.samples, make).map(Vec::as_slice)
    }

    /// Frees the memory of poses and samples.
    pub fn forget_poses_and_samples(&mut self) {
        self.poses.take();
        self.samples.take();
    }
}

fn made<T>(cell: &OnceCell<T>, make: impl FnOnce() -> Result<T>) -> Result<&T> {
    if let Some(made) = cell.get() {
        return Ok(made);
    }
    let value = make()?;
    Ok(cell.get_or_init(|| value))
}
