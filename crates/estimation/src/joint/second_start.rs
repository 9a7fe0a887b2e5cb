//! How much of its start is left in a result that the drives determine weakly.
//!
//! Where points only slide along flat or evenly rough ground, their noise slides along with them, and the cost as a
//! function of the mountings is a hilly plain: the adjustment ends in the dip nearest to its start, and the curvature of
//! that dip looks like information. From another start it ends in another dip. A result that the drives determine ends
//! where it was.

use nalgebra::DVector;

use super::directions::Directions;
use super::input::JointInput;
use super::ladder::adjust;
use super::result::{AdjustedDrive, Joint};
use super::settings::{JointSettings, MountingMotion};
use crate::calibration::change;
use crate::calibration::parameters::moved;
use crate::error::{Result, unless_cancelled};
use crate::geometry::{BodyFromScanner, Vec3};
use crate::progress::Progress;

/// Directions are weakly determined if drives claim to know more of them than the initial values, but their variance
/// exceeds this share of that of initial values: a scanner is then known to 5 mm and 0.17° at best, about the distance of
/// points in a surfel. Nearer starts lie in the same dip.
const WEAK_SHARE: f64 = 0.01;
/// The variance relative to that of initial values where drives say as much as these.
const EVEN_SHARE: f64 = 0.5;

fn is_weakly_known(variance: f64) -> bool {
    (WEAK_SHARE..EVEN_SHARE).contains(&variance)
}

/// Whether drives determine a direction of the mountings only weakly.
pub fn is_weak(joint: &Joint) -> bool {
    let directions = Directions::of(&joint.covariance);
    let mut variances = directions.variances().iter();
    variances.any(|variance| is_weakly_known(*variance))
}

/// Variance to add along a direction in which the share `left` of any start remains; 1 is the variance of initial
/// values.
fn added(variance: f64, left: f64) -> f64 {
    (left * left).min(1.0 - variance).max(0.0)
}

/// Repeats an adjustment from another start, if it determines directions of the mountings only weakly, and adds to its
/// standard deviations what is left of the start.
///
/// The other start is displaced from the result by one standard deviation of initial values along each weak direction, to
/// the side on which the initial values do not lie. If the repeated adjustment ends at the share m of this displacement,
/// the same share of the error of any start is left in a result. With the variance of initial values, σ₀², it adds m² σ₀²
/// to the variance along the direction, at most up to σ₀². If the other start leads to no result, m is 1.
///
/// # Errors
/// [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn consider_start(
    input: &mut JointInput<'_>,
    settings: &JointSettings,
    surfel_m: f64,
    joint: &mut Joint,
    progress: &dyn Progress,
) -> Result<()> {
    let directions = Directions::of(&joint.covariance);
    let variances = directions.variances();
    let count = variances.len();
    let to_initial = change(&joint.mountings, input.initial);
    let displaced = DVector::from_fn(count, |k, _| {
        let side = -directions.along(k, &to_initial).signum();
        if is_weakly_known(variances[k]) {
            side
        } else {
            0.0
        }
    });
    if displaced.amax() == 0.0 {
        return Ok(());
    }
    progress.say("the drives determine the mountings weakly: adjusting again from another start");
    let there = moved(&joint.mountings, &directions.change(&displaced));
    let begin = std::mem::replace(&mut input.mountings, there);
    let mut settings = settings.clone();
    settings.mounting = MountingMotion {
        least: joint.rung,
        most: joint.rung,
    };
    let other = adjust(input, &settings, surfel_m, progress);
    input.mountings = begin;
    let other = unless_cancelled(other)?;
    let left = match &other {
        Some(other) => {
            let apart = change(&joint.mountings, &other.mountings);
            DVector::from_fn(count, |k, _| {
                if displaced[k] == 0.0 {
                    0.0
                } else {
                    directions.along(k, &apart) / displaced[k]
                }
            })
        }
        None => displaced.abs(),
    };
    joint.covariance += directions.covariance(&variances.zip_map(&left, added));
    joint.undetermined = Directions::of(&joint.covariance).undetermined();
    if let Some(other) = other {
        let poses = [joint.poses(), other.poses()];
        let drives = joint.drives.iter_mut().zip(&other.drives);
        for (drive, there) in drives {
            add_displacements(drive, there, &poses);
        }
    }
    Ok(())
}

/// Adds to the variances of a drive's points the squares of how far apart both results place them.
fn add_displacements(
    drive: &mut AdjustedDrive,
    there: &AdjustedDrive,
    poses: &[Vec<BodyFromScanner>; 2],
) {
    let mut points = std::mem::take(&mut drive.points);
    for (scanner, points) in points.iter_mut().enumerate() {
        for point in points {
            let [here_m, there_m] =
                [(&*drive, &poses[0]), (there, &poses[1])].map(|(drive, poses)| {
                    let (body, mounting) =
                        drive.poses_at(scanner, &poses[scanner], point.time_s)?;
                    Some(body.map(&mounting.map(&point.in_scanner_m)))
                });
            if let (Some(here_m), Some(there_m)) = (here_m, there_m) {
                let apart_m: Vec3 = there_m - here_m;
                point.sigma_m = point.sigma_m.zip_map(&apart_m, f64::hypot);
            }
        }
    }
    drive.points = points;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint::directions::in_units;
    use nalgebra::DMatrix;

    #[test]
    fn what_is_left_of_the_start_widens_weak_directions_up_to_the_initial_values() {
        // The common shift along x of two mountings is known to half of the initial values, all else to a hundredth.
        let common = DVector::from_fn(12, |i, _| if i % 6 == 0 { 0.5_f64.sqrt() } else { 0.0 });
        let of = |variance: f64| {
            let known = DMatrix::identity(12, 12) * 1e-4;
            let scaled = known + &common * common.transpose() * (variance - 1e-4);
            in_units(&scaled)
        };
        let directions = Directions::of(&of(0.25));
        let variances = directions.variances();
        let weak: Vec<usize> = (0..12).filter(|&k| is_weakly_known(variances[k])).collect();
        let [weak] = weak[..] else {
            panic!("{weak:?}");
        };
        let with_left = |share: f64| {
            let left = DVector::from_fn(12, |k, _| if k == weak { share } else { 0.0 });
            of(0.25) + directions.covariance(&variances.zip_map(&left, added))
        };
        for (share, variance) in [(0.0, 0.25), (0.5, 0.5), (-0.5, 0.5), (2.0, 1.0)] {
            let difference = (with_left(share) - of(variance)).amax();
            assert!(difference < 1e-12, "{share}: {difference:e}");
        }
        let parts = DVector::from_fn(12, |k, _| if k == weak { 0.7 } else { 0.0 });
        assert!((directions.along(weak, &directions.change(&parts)) - 0.7).abs() < 1e-12);
    }
}
