//! Estimates the mountings of the other scanners in the frame of the first from the distances on all spots.

use nalgebra::{DVector, Matrix6, Vector6};

use super::cells::{GRIDS, LAG_S, Scene, Side};
use super::normal::{Normal, PRIOR, blocks};
use super::overlap::{Overlap, ScannerOverlap};
use super::step::perturbed;
use crate::calibration::{Mounting, ScannerFromScanner, ScannerSample, relative};
use crate::error::{Error, Problem, Result};
use crate::geometry::{Bending, Vec3};
use crate::progress::Progress;
use crate::statistics::median;

/// One level of the coarse-to-fine estimation.
struct Level {
    /// Edge of the cells in finest voxels of the samples.
    cell_voxels: f64,
    grids: usize,
    /// The level ends when the square of a step, weighted by the information of the spots, is less than this.
    converged: f64,
}

impl Level {
    const fn new(cell_voxels: f64, grids: usize, converged: f64) -> Self {
        Self {
            cell_voxels,
            grids,
            converged,
        }
    }
}

/// The levels from coarse to fine: cells of the last hold some 16 points of each scanner.
const LEVELS: [Level; 4] = [
    Level::new(16.0, 1, 1.0),
    Level::new(8.0, 1, 1.0),
    Level::new(4.0, 1, 1.0),
    Level::new(4.0, GRIDS.len(), 0.01),
];
const MAX_ITERATIONS: usize = 10;

/// A component is determined if its standard deviation is less than this share of the prior's.
const DETERMINED_SHARE: f64 = 0.1;

/// Fewest spots.
const MIN_SPOTS: usize = 240;

/// A drive in the field.
pub struct OverlapInput<'a> {
    /// The mountings in use, one per scanner.
    pub mountings: &'a [Mounting],
    /// The points of each scanner on the poses of the drive.
    pub samples: &'a [ScannerSample],
    /// Offsets of the mountings along the drive; empty if they are rigid.
    pub bending: &'a [Bending],
    /// Edge of the voxels that the samples were thinned to, metres.
    pub voxel_m: f64,
}

/// Estimates the mounting of each further scanner in the frame of the first from the ground that both saw in one
/// pass.
///
/// The poses are those of the samples. Pose errors that both scanners share cancel; all others are in the
/// covariance, which is computed from the disagreement of blocks of the drive.
///
/// # Errors
/// Fewer than two scanners; too little ground that two scanners saw; [`Error::Cancelled`].
pub fn overlap(input: &OverlapInput<'_>, progress: &dyn Progress) -> Result<Overlap> {
    let mountings = input.mountings;
    check_scanners(mountings.len())?;
    if mountings.len() != input.samples.len() || input.voxel_m.is_nan() || input.voxel_m <= 0.0 {
        return Err(Error::data(
            format!(
                "{} mountings for the samples of {} scanners, with voxels of {} m",
                mountings.len(),
                input.samples.len(),
                input.voxel_m
            ),
            "give one mounting for each sample, and the voxel size above 0 m that they were thinned to",
        ));
    }
    let (first, others) = (&mountings[0], &mountings[1..]);
    let scene = Scene::new(mountings, input.samples, input.bending);
    let in_use: Vec<ScannerFromScanner> = mountings
        .iter()
        .map(|other| relative(&first.body_from_scanner, &other.body_from_scanner))
        .collect();
    let stage = progress.stage("overlap", LEVELS.len() as u64);
    let mut step = DVector::zeros(6 * others.len());
    let mut at = in_use.clone();
    let mut last = Err(too_little(0));
    for level in &LEVELS {
        let cell_m = level.cell_voxels * input.voxel_m;
        let mut iterations = 0;
        last = loop {
            progress.check()?;
            let spots = scene.spots(&at, cell_m, level.grids);
            // Cells that are too coarse for the ground leave the work to the next level.
            if spots.len() < MIN_SPOTS * level.grids {
                break Err(too_little(spots.len()));
            }
            let normal =
                match blocks(&spots).and_then(|count| Normal::new(&spots, others.len(), count)) {
                    Ok(normal) => normal,
                    Err(error) => break Err(error),
                };
            let next = normal.solved(&step);
            let squared = normal.information(&(&next - &step));
            step = next;
            at = in_use.clone();
            for (pose, delta) in at[1..].iter_mut().zip(step.as_slice().chunks_exact(6)) {
                *pose = perturbed(pose, delta);
            }
            iterations += 1;
            if squared < level.converged || iterations == MAX_ITERATIONS {
                progress.say(&format!(
                    "cells of {:.0} mm: {} spots, {iterations} iterations",
                    1e3 * cell_m,
                    spots.len()
                ));
                break Ok((spots, normal));
            }
        };
        progress.advance(1);
    }
    drop(stage);
    let (spots, normal) = last?;
    let (covariance, blocks) = normal.covariance()?;
    let scanners = others.iter().enumerate().map(|(i, other)| {
        // The scanner may be the first or the second on a spot.
        let sides = spots.iter().filter_map(|spot| {
            let side = spot.scanners.iter().position(|scanner| *scanner == i + 1)?;
            Some((&spot.sides[side], spot.lag_s))
        });
        let (sides_seen, lags_s): (Vec<&Side>, Vec<f64>) = sides.unzip();
        let offset: Vector6<f64> = step.fixed_rows::<6>(6 * i).into_owned();
        let covariance: Matrix6<f64> = covariance.fixed_view::<6, 6>(6 * i, 6 * i).into_owned();
        let prior = |k: usize| DETERMINED_SHARE * PRIOR[k / 3];
        let determined = std::array::from_fn(|k| covariance[(k, k)].sqrt() < prior(k));
        let [along_normal, upwards, total] = moments(&sides_seen);
        ScannerOverlap {
            name: other.name.clone(),
            in_use: in_use[i + 1],
            offset,
            covariance,
            determined,
            blocks,
            spots: sides_seen.len(),
            lag_s: median(lags_s).unwrap_or(0.0),
            normal: along_normal,
            vertical: upwards,
            total,
        }
    });
    Ok(Overlap {
        first: first.name.clone(),
        scanners: scanners.collect(),
    })
}

/// Checks that there are scanners to compare.
///
/// # Errors
/// Fewer than two scanners.
pub fn check_scanners(count: usize) -> Result<()> {
    if count > 1 {
        return Ok(());
    }
    Err(Error::of(
        Problem::TooFew,
        format!("{count} scanners, but the drift watch compares two or more"),
        "give a project with two or more scanners",
    ))
}

fn too_little(spots: usize) -> Error {
    Error::of(
        Problem::TooFew,
        format!("the scanners saw only {spots} spots of the ground together within {LAG_S} s"),
        "the drift watch needs scanners whose fans overlap on the ground, and a drive of some metres",
    )
}

/// Matrices M of the mean squared displacement δᵀ M δ of points: along the normal, upwards, and in total.
fn moments(spots: &[&Side]) -> [Matrix6<f64>; 3] {
    let mut sums = [Matrix6::zeros(); 3];
    for spot in spots {
        let along = |direction: &Vec3| {
            let moment = spot.arm_m.cross(direction);
            Vector6::new(
                direction.x,
                direction.y,
                direction.z,
                moment.x,
                moment.y,
                moment.z,
            )
        };
        let mut add = |sum: usize, direction: &Vec3| {
            let row = along(direction);
            sums[sum] += row * row.transpose() / spots.len() as f64;
        };
        add(0, &spot.normal);
        add(1, &spot.up);
        [Vec3::x(), Vec3::y(), Vec3::z()]
            .iter()
            .for_each(|axis| add(2, axis));
    }
    sums
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::geometry::{BodyFromScanner, Rotation, WorldFromBody, so3};
    use crate::progress::Silent;
    use crate::surface::{Profile, ProfilePoint};

    const VOXEL_M: f64 = 0.01;
    const NOISE_M: f64 = 2e-4;

    fn mountings() -> Vec<Mounting> {
        let at = |side: f64| {
            let turn = so3::exp(&Vec3::new(0.3 * side, 0.05, 0.4));
            BodyFromScanner::new(turn, Vec3::new(0.2, 0.5 * side, 0.1))
        };
        vec![
            Mounting::new("left", at(1.0)),
            Mounting::new("right", at(-1.0)),
        ]
    }

    /// Points of a strip of ground, two metres long and one wide. The true mounting of the second scanner differs
    /// from its mounting in use by `off`, in the frame of the first.
    fn samples(height: impl Fn(f64, f64) -> f64, off: &[f64; 6]) -> Vec<ScannerSample> {
        let mountings = mountings();
        let [first, second] = [0, 1].map(|i| mountings[i].body_from_scanner);
        let moved = perturbed(&relative(&first, &second), off);
        let truth = [first, first * moved];
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let sample = |mounting: &BodyFromScanner| {
            let mut sample = ScannerSample::default();
            for number in 0..400 {
                let along = f64::from(number) * 0.005;
                let turn = Rotation::from_euler_angles(0.02 * along.sin(), 0.01, 0.0);
                let world_from_body = WorldFromBody::new(turn, Vec3::new(along, 0.0, 1.5));
                let pose = world_from_body * *mounting;
                sample.profiles.push(Profile {
                    time_s: 0.25 * f64::from(number),
                    world_from_body,
                });
                for _ in 0..200 {
                    let (x, y) = (
                        along + 0.005 * rng.random::<f64>(),
                        rng.random::<f64>() - 0.5,
                    );
                    let noise: f64 = StandardNormal.sample(&mut rng);
                    let world = Vec3::new(x, y, height(x, y) + NOISE_M * noise);
                    sample.points.push(ProfilePoint {
                        profile: number as u32,
                        position_m: pose.map_back(&world),
                        count: 1,
                    });
                }
            }
            sample
        };
        truth.iter().map(sample).collect()
    }

    fn estimated(samples: &[ScannerSample]) -> Result<Overlap> {
        let input = OverlapInput {
            mountings: &mountings(),
            samples,
            bending: &[],
            voxel_m: VOXEL_M,
        };
        overlap(&input, &Silent)
    }

    fn waves(x: f64, y: f64) -> f64 {
        0.05 * (9.0 * x + 2.0 * y).sin() + 0.05 * (8.0 * y - 3.0 * x).cos()
    }

    #[test]
    fn a_knock_is_estimated_within_its_sigmas() {
        let off = [2e-3, -1e-3, 1.5e-3, 1e-3, -2e-3, 1.5e-3];
        let right = estimated(&samples(waves, &off)).unwrap().scanners.remove(0);
        let sigma = right.sigma();
        let mut chi = 0.0;
        for i in 0..6 {
            let sigma = sigma[i].unwrap();
            // 0.2 mm of noise on 80,000 points, on cells that are not quite flat.
            assert!(sigma < 2e-4, "{i}: {sigma}");
            chi += ((right.offset[i] - off[i]) / sigma).powi(2) / 6.0;
        }
        assert!(chi < 3.0, "{chi} {right:?}");
        assert!(right.undetermined().is_empty() && (15..=20).contains(&right.blocks));
        // The displacement along the normal is the part of the knock that the distances show.
        let knock = Vector6::from(off);
        let normal_m = knock.dot(&(right.normal * knock)).sqrt();
        let total_m = knock.dot(&(right.total * knock)).sqrt();
        assert!(normal_m < total_m && total_m < 6e-3 && normal_m > 1e-3);
    }

    #[test]
    fn flat_ground_names_the_components_that_it_does_not_determine() {
        let off = [0.0, 0.0, 1e-3, 0.0, 0.0, 0.0];
        let right = estimated(&samples(|_, _| 0.0, &off))
            .unwrap()
            .scanners
            .remove(0);
        // The axes are turned by half a radian against the ground, so every undetermined direction mixes components.
        assert!(!right.undetermined().is_empty(), "{right:?}");
        for (i, sigma) in right.sigma().iter().enumerate() {
            if let Some(sigma) = sigma {
                assert!(
                    (right.offset[i] - off[i]).abs() < 4.0 * sigma + 1e-4,
                    "{i} {right:?}"
                );
            }
        }
    }

    #[test]
    fn scanners_that_see_nothing_together_are_refused() {
        let mut apart = samples(waves, &[0.0; 6]);
        for profile in &mut apart[1].profiles {
            profile.time_s += 200.0;
        }
        let problem = estimated(&apart).unwrap_err().to_string();
        assert!(
            problem.contains("saw only 0 spots of the ground together"),
            "{problem}"
        );
        let input = OverlapInput {
            mountings: &mountings()[..1],
            samples: &apart[..1],
            bending: &[],
            voxel_m: VOXEL_M,
        };
        let problem = overlap(&input, &Silent).unwrap_err().to_string();
        assert!(problem.contains("compares two or more"), "{problem}");
    }
}
