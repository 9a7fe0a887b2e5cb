//! The calibration drive, which is the drive of the project itself. Its reference, poses and samples are prepared when
//! a stage first needs them, because stages that an earlier run finished need none.

use std::cell::OnceCell;

use super::open_project::OpenProject;
use super::rig::Rig;
use super::stages::{self, EstimatedPoses};
use crate::calibration::ScannerSample;
use crate::comparison::ReferenceSurface;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::progress::Progress;

/// The reference, the poses and the samples of the calibration drive.
pub struct CalibrationDrive<'a> {
    project: &'a OpenProject,
    reference: OnceCell<Vec<Vec3>>,
    surface: OnceCell<Option<ReferenceSurface>>,
    poses: OnceCell<EstimatedPoses>,
    samples: OnceCell<Vec<ScannerSample>>,
}

impl<'a> CalibrationDrive<'a> {
    /// The drive of a project, of which nothing has been read yet.
    pub fn new(project: &'a OpenProject) -> Self {
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
        get_or_make(&self.reference, || {
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
        get_or_make(&self.surface, || {
            ReferenceSurface::upwards("the reference", reference, settings, progress)
        })
        .map(Option::as_ref)
    }

    /// The poses with their joint covariance.
    ///
    /// # Errors
    /// See [`stages::poses`].
    pub fn poses(&self, progress: &dyn Progress) -> Result<&EstimatedPoses> {
        get_or_make(&self.poses, || stages::poses(self.project, progress))
    }

    /// A sample of each scanner's points, with the mountings and scales of `rig` in the first call.
    ///
    /// # Errors
    /// See [`stages::samples`].
    pub fn samples(&self, rig: &Rig, progress: &dyn Progress) -> Result<&[ScannerSample]> {
        let trajectory = self.poses(progress)?.trajectory();
        let make = || stages::samples(self.project, rig, trajectory, progress);
        get_or_make(&self.samples, make).map(Vec::as_slice)
    }

    /// Frees the memory of poses and samples.
    pub fn drop_poses_and_samples(&mut self) {
        self.poses.take();
        self.samples.take();
    }
}

/// The value of a cell; the first call makes it.
fn get_or_make<T>(cell: &OnceCell<T>, make: impl FnOnce() -> Result<T>) -> Result<&T> {
    if let Some(value) = cell.get() {
        return Ok(value);
    }
    let value = make()?;
    Ok(cell.get_or_init(|| value))
}
