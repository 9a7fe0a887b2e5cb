//! Input of the calibration.

use rayon::prelude::*;

use super::parameters::{Mounting, poses};
use super::sample::ScannerSample;
use super::settings::CalibrationSettings;
use crate::cloud::voxel;
use crate::error::{Error, Problem, Result};
use crate::geometry::Vec3;
use crate::statistics::median;
use crate::surface::SurfaceCloud;
use crate::trajectory::{PosteriorCovariance, Trajectory};

/// Share of the voxel size below which the thickness of a neighbourhood carries no information
/// about the alignment. The scatter of the poses is added to it.
const FLOOR_SHARE: f64 = 0.05;

/// Correlation time of the errors of poses if only standard deviations are given, seconds: about
/// that of a total station's positions and of a filter's attitude.
pub const POSE_CORRELATION_S: f64 = 5.0;

/// What is known about the errors of the poses.
#[derive(Debug, Clone, Copy)]
pub enum PoseUncertainty<'a> {
    /// The smoother's posterior covariance, including correlations.
    Smoothed(&'a PosteriorCovariance),
    /// Standard deviations of the poses; errors are assumed constant over their correlation time.
    Sigmas {
        /// The correlation time, seconds.
        correlation_s: f64,
    },
    /// Nothing is known, or the poses are exact: standard deviations hold for exact poses.
    None,
}

/// Input of the calibration.
#[derive(Debug, Clone)]
pub struct Input<'a> {
    /// Initial mountings, one per scanner.
    pub mountings: Vec<Mounting>,
    /// The scanners' points, thinned on the finest grid, in the order of `mountings`.
    pub samples: &'a [ScannerSample],
    /// Points of the reference in the world, metres; empty without one.
    pub reference: &'a [Vec3],
    /// The trajectory of the body.
    pub trajectory: &'a Trajectory,
    /// The uncertainty of its poses.
    pub poses: PoseUncertainty<'a>,
}

impl<'a> Input<'a> {
    /// Input without a reference. The poses' own standard deviations are used; without them, poses
    /// count as exact.
    pub fn new(
        mountings: Vec<Mounting>,
        samples: &'a [ScannerSample],
        trajectory: &'a Trajectory,
    ) -> Self {
        let has_sigmas = trajectory.poses().iter().any(|node| node.sigma.is_some());
        Self {
            mountings,
            samples,
            reference: &[],
            trajectory,
            poses: if has_sigmas {
                PoseUncertainty::Sigmas {
                    correlation_s: POSE_CORRELATION_S,
                }
            } else {
                PoseUncertainty::None
            },
        }
    }

    /// Adds points of a reference in the world, metres.
    pub fn with_reference(self, reference: &'a [Vec3]) -> Self {
        Self { reference, ..self }
    }

    /// Adds the covariance of the poses from the estimate of the trajectory.
    pub fn with_pose_covariance(self, covariance: &'a PosteriorCovariance) -> Self {
        Self {
            poses: PoseUncertainty::Smoothed(covariance),
            ..self
        }
    }

    /// Sets the correlation time of the errors of poses with standard deviations, seconds; without
    /// it, [`POSE_CORRELATION_S`].
    pub fn with_pose_correlation(mut self, seconds: f64) -> Self {
        if let PoseUncertainty::Sigmas { correlation_s } = &mut self.poses {
            *correlation_s = seconds;
        }
        self
    }

    /// Checks that the parts of the input belong together.
    ///
    /// # Errors
    /// Different numbers of mountings and samples, a scanner without points, a covariance of
    /// another trajectory.
    pub(super) fn check(&self) -> Result<()> {
        let (mountings, samples) = (self.mountings.len(), self.samples.len());
        if mountings != samples || mountings == 0 {
            return Err(Error::data(
                format!("{mountings} mountings for the samples of {samples} scanners"),
                "give one mounting for each sample, and at least one",
            ));
        }
        for (mounting, sample) in self.mountings.iter().zip(self.samples) {
            if sample.points.is_empty() {
                return Err(Error::of(
                    Problem::TooFew,
                    format!("scanner `{}` has no points", mounting.name),
                    "leave the scanner out, or give its points",
                ));
            }
        }
        let poses = self.trajectory.poses().len();
        match self.poses {
            PoseUncertainty::Smoothed(covariance) if covariance.nodes() != poses => {
                Err(Error::data(
                    format!(
                        "a covariance of {} poses for a trajectory of {poses}",
                        covariance.nodes()
                    ),
                    "give the trajectory and the covariance of one estimate",
                ))
            }
            PoseUncertainty::Sigmas { correlation_s }
                if !(correlation_s > 0.0 && correlation_s.is_finite()) =>
            {
                Err(Error::data(
                    format!("a correlation time of the poses of {correlation_s} s"),
                    "give a time above 0 s",
                ))
            }
            _ => Ok(()),
        }
    }

    /// Thins the points, placed with `mountings`, to one per voxel, scanner and pass, and the
    /// reference to one per voxel.
    ///
    /// # Errors
    /// Too few points for neighbourhoods.
    pub(super) fn thinned(
        &self,
        mountings: &[Mounting],
        voxel_m: f64,
        settings: &CalibrationSettings,
    ) -> Result<SurfaceCloud> {
        let thinned: Vec<Vec<u32>> = self
            .samples
            .par_iter()
            .zip(poses(mountings))
            .map(|(sample, pose)| sample.thinned(&pose, voxel_m, settings.pass_gap_s))
            .collect();
        let reference = voxel::thin(self.reference, voxel_m);
        let place = |&index: &u32| self.reference[index as usize];
        let mut cloud = SurfaceCloud::new(reference.iter().map(place).collect());
        for (sample, thinned) in self.samples.iter().zip(thinned) {
            let points = thinned.iter().map(|&index| sample.points[index as usize]);
            cloud.add_scanner(&sample.profiles, points);
        }
        let (all, needed) = (cloud.movable.len() + cloud.fixed.len(), settings.neighbours);
        if all < 2 * needed {
            return Err(Error::of(
                Problem::TooFew,
                format!(
                    "only {all} points remain with voxels of {voxel_m} m, but each \
                     neighbourhood needs {needed}"
                ),
                "use smaller calibration.voxel_sizes_m or fewer calibration.neighbours",
            ));
        }
        Ok(cloud)
    }

    /// s of the cost: the share of the voxel size and the standard deviation of a pose coordinate,
    /// added in quadrature. Passes cannot agree better than their poses; the median along the drive
    /// keeps outages out.
    pub(super) fn floor_m(&self, voxel_m: f64) -> f64 {
        let sigmas = self.trajectory.poses().iter().filter_map(|node| node.sigma);
        let variances = sigmas.map(|sigma| sigma.position_m.norm_squared() / 3.0);
        let variance = median(variances).unwrap_or(0.0);
        (variance + (FLOOR_SHARE * voxel_m).powi(2)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::calibrate;
    use crate::geometry::{BodyFromScanner, WorldFromBody};
    use crate::progress::Silent;
    use crate::sensor::PoseRecord;

    #[test]
    fn invalid_input_is_refused() {
        let node = |time_s| PoseRecord {
            time_s,
            world_from_body: WorldFromBody::identity(),
            velocity_m_s: None,
            bias: None,
            sigma: None,
        };
        let trajectory = Trajectory::new(vec![node(0.0), node(1.0)]).unwrap();
        let mounting = Mounting::new("left", BodyFromScanner::identity());
        let settings = CalibrationSettings::default();
        let (times, points) = ([0.5; 3], [Vec3::x(), Vec3::y(), Vec3::z()]);
        let sample =
            ScannerSample::from_points(&mounting, &times, &points, &trajectory, &settings).unwrap();
        let sizes = |voxel_sizes_m: &[f64]| CalibrationSettings {
            voxel_sizes_m: voxel_sizes_m.to_vec(),
            ..settings.clone()
        };
        let flat = CalibrationSettings {
            neighbours: 3,
            ..settings.clone()
        };
        let (full, empty) = ([sample], [ScannerSample::default()]);
        for (samples, settings, named) in [
            (&[][..], &settings, "1 mountings for the samples of 0"),
            (&empty, &settings, "`left` has no points"),
            (&full, &sizes(&[]), "voxel_sizes_m = []"),
            (
                &full,
                &sizes(&[0.1, 0.2]),
                "each smaller than the one before",
            ),
            (&full, &sizes(&[f64::NAN]), "voxel_sizes_m = [NaN]"),
            (&full, &flat, "neighbours = 3"),
            (
                &full,
                &settings,
                "only 3 points remain with voxels of 0.005 m",
            ),
        ] {
            let input = Input::new(vec![mounting.clone()], samples, &trajectory);
            let error = calibrate(&input, settings, &Silent)
                .unwrap_err()
                .to_string();
            assert!(error.contains(named), "{error}");
        }
    }
}
