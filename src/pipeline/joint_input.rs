//! What the joint adjustment takes of a drive.

use super::open_project::OpenProject;
use super::rig::Rig;
use super::stages::EstimatedPoses;
use super::start::CLOSE_M;
use crate::calibration::ScannerSample;
use crate::error::{Error, Problem, Result};
use crate::format;
use crate::joint::motion::Motion as JointMotion;
use crate::joint::{ChainMotion, CorrectedPoses, CorrelatedError, JointDrive, Scans};
use crate::project::{FrameLogFile, Logs, Motion};
use crate::sensor::{FrameLog, MAX_FRAME_COLUMNS, check_overlap};
use crate::statistics::median;
use crate::trajectory::Solution;

/// A drive before the adjustment.
pub struct Drive<'a> {
    /// Name of the drive in the results.
    pub name: &'a str,
    /// Its project.
    pub project: &'a OpenProject,
    /// Its scanners.
    pub rig: &'a Rig,
    /// Its poses, from logs or a file.
    pub poses: &'a EstimatedPoses,
    /// A sample of each scanner's points.
    pub samples: &'a [ScannerSample],
}

/// The edge of a surfel of a drive, metres.
pub fn surfel_m(drive: &Drive<'_>) -> f64 {
    let finest_m = drive.rig.finest_m();
    let spacing_m = if drive.project.has_auto_scales {
        spacing_m(drive.samples, finest_m)
    } else {
        finest_m
    };
    drive.project.joint.surfel_size_m(spacing_m)
}

/// The spacing of the points of samples that were thinned by voxels of this edge, metres. The edge is the spacing of
/// profiles if that is wider than the one along profiles; with n points in a voxel and pass, their geometric mean is by √n
/// smaller. Voxels of [`CLOSE_M`] have their size for another reason.
fn spacing_m(samples: &[ScannerSample], voxel_m: f64) -> f64 {
    let spacings_m = samples.iter().filter_map(|sample| {
        let points = median(sample.points.iter().map(|point| f64::from(point.count)))?;
        Some(voxel_m / points.sqrt())
    });
    spacings_m.fold(voxel_m.min(CLOSE_M), f64::max)
}

/// A drive for the adjustment.
///
/// # Errors
/// Poses without standard deviations; the log of the frame cannot be read or does not overlap.
pub fn input<'a>(drive: &Drive<'a>) -> Result<JointDrive<'a>> {
    let EstimatedPoses { poses, covariance } = drive.poses;
    let motion: Box<dyn JointMotion> = match (covariance, &drive.project.motion) {
        (Some(covariance), Motion::Logs(logs)) => {
            let names = logs.settings.positions.iter().map(|p| p.name.clone());
            let chain = ChainMotion::new(covariance, names.collect(), &correlated(logs));
            let scale = poses
                .solution
                .as_ref()
                .map_or(1.0, Solution::imu_noise_factor);
            Box::new(chain.with_noise_scaled(scale))
        }
        _ => {
            let correlation_s = drive.project.joint.correlation_s;
            let motion = CorrectedPoses::new(&poses.trajectory, correlation_s);
            Box::new(motion.ok_or_else(|| {
                Error::of(
                    Problem::TooFew,
                    "the poses have no standard deviations, which limit how far they may be corrected",
                    "give sigma_position_m and sigma_rotation_deg in [trajectory]",
                )
            })?)
        }
    };
    Ok(JointDrive {
        name: drive.name.into(),
        motion,
        scans: Scans {
            samples: drive.samples.iter().collect(),
        },
        frame: frame_log(drive)?,
    })
}

/// The log of the quantities that the mountings of a drive may follow, in common time.
fn frame_log(drive: &Drive<'_>) -> Result<Option<FrameLog>> {
    let Some(FrameLogFile { log, columns }) = &drive.project.bending else {
        return Ok(None);
    };
    let mut read = format::read_frame_log(drive.project.input(&log.path), columns)?;
    read.rows
        .iter_mut()
        .for_each(|(time_s, _)| *time_s += log.time_offset_s);
    let span_s = |rows: &[(f64, [f64; MAX_FRAME_COLUMNS])]| Some((rows.first()?.0, rows.last()?.0));
    if let Some(span_s) = span_s(&read.rows) {
        check_overlap(
            ("bending", span_s),
            ("trajectory", drive.poses.trajectory().span_s()),
        )?;
    }
    Ok(Some(read))
}

/// The correlated errors of position sensors and heading.
fn correlated(logs: &Logs) -> Vec<Option<CorrelatedError>> {
    let error = |sigma: Vec<f64>, correlation_s| {
        sigma.iter().any(|s| *s > 0.0).then_some(CorrelatedError {
            sigma,
            correlation_s,
        })
    };
    let positions = logs.settings.positions.iter();
    let positions = positions.map(|p| {
        let sigma = p.sigma_correlated_m.iter().copied().collect();
        error(sigma, p.correlation_s)
    });
    let heading = &logs.settings.heading;
    let heading = error(vec![heading.sigma_correlated_rad], heading.correlation_s);
    positions.chain([heading]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;
    use crate::surface::ProfilePoint;

    fn sample(count: u32) -> ScannerSample {
        let point = ProfilePoint {
            profile: 0,
            position_m: Vec3::zeros(),
            count,
        };
        ScannerSample {
            points: vec![point; 3],
            ..ScannerSample::default()
        }
    }

    #[test]
    fn the_spacing_is_the_mean_of_that_along_and_across_profiles() {
        // Profiles 80 mm apart with points every 20 mm.
        assert!((spacing_m(&[sample(4)], 0.08) - 0.04).abs() < 1e-12);
        assert!((spacing_m(&[sample(4), sample(1)], 0.08) - 0.08).abs() < 1e-12);
        // Close scanners have many points in the smallest voxels.
        assert_eq!(spacing_m(&[sample(100)], 0.008), CLOSE_M);
        assert_eq!(spacing_m(&[sample(100)], 0.003), 0.003);
    }
}
