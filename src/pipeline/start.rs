//! The start values and the scales of a calibration.

use serde::{Deserialize, Serialize};

use super::stages::{initial_poses, mountings, open_profiles, with_mountings};
use crate::calibration::{CalibrationSettings, ScannerSample, better_start, point_spacing_m};
use crate::cloud::voxel::occupied;
use crate::error::Result;
use crate::geometry::{BodyFromScanner, Vec3};
use crate::georeference::Georeferencer;
use crate::preflight::{Placement, fans, scans};
use crate::progress::Progress;
use crate::project::{Project, Scanner};
use crate::statistics::median;
use crate::trajectory::Trajectory;
use crate::verdict::Verdict;

/// Duration of the search for a better start, in evaluations of one start.
const SEARCH_UNITS: u64 = 6;
/// Smallest sufficient value of the coarsest scale, as a share of the distance between the clouds.
const SCALE_PER_MISFIT: f64 = 0.5;
/// Fewest neighbourhoods of a scale that is added.
const NEIGHBOURHOODS: usize = 10;
/// Distance between clouds beyond which no scale helps, metres.
const MAX_MISFIT_M: f64 = 5.0;
/// Largest error of a rough mounting: radians, metres.
const ROUGH_START: (f64, f64) = (0.06, 0.1);
/// The finest scale of a close-range scanner, metres, and of any at this share of its ranges.
const CLOSE_M: f64 = 0.005;
const CLOSE_SHARE: f64 = 1.0 / 150.0;
/// Displacement of the body, as a share of the ranges, during which the points are recorded whose spacing is measured.
const MOVED_SHARE: f64 = 0.05;

/// The project with scales that match the spacing of its points, if it asks for automatic scales.
///
/// # Errors
/// Errors of the readers.
pub fn with_scales(
    project: &Project,
    trajectory: &Trajectory,
    progress: &dyn Progress,
) -> Result<Project> {
    let mut project = project.clone();
    if !project.has_auto_scales {
        return Ok(project);
    }
    project.has_auto_scales = false;
    let mut finest_m: Option<f64> = None;
    for scanner in &project.scanners {
        let found_m = finest_scale(scanner, trajectory)?;
        finest_m = finest_m.into_iter().chain(found_m).reduce(f64::max);
    }
    let Some(finest_m) = finest_m else {
        progress
            .say("how far points lie apart cannot be seen: the scales are those of close range");
        return Ok(project);
    };
    // Round to two digits.
    let digit = 10f64.powf(finest_m.log10().floor() - 1.0);
    let finest_m = (finest_m / digit).round() * digit;
    let sizes = &mut project.calibration.voxel_sizes_m;
    let own_m = sizes[sizes.len() - 1];
    sizes.iter_mut().for_each(|size| *size *= finest_m / own_m);
    progress.say(&format!(
        "the finest scale is {:.1} mm, by range and spacing of points",
        1e3 * finest_m
    ));
    Ok(project)
}

/// The finest scale at which a scanner's points form surfaces, metres; `None` if it cannot be determined.
fn finest_scale(scanner: &Scanner, trajectory: &Trajectory) -> Result<Option<f64>> {
    let mut chunk = Vec::new();
    for mut reader in open_profiles(scanner)? {
        while reader.next_chunk(&mut chunk)? {
            let pose = scanner.body_from_scanner;
            let mut placing = Georeferencer::new(trajectory, pose, scanner.time_offset_s);
            let placed = chunk.iter().filter_map(|point| {
                let body = placing.body_at(point).1?;
                Some((body.translation_m, body.map(&pose.map(&point.position_m))))
            });
            let (bodies, points): (Vec<Vec3>, Vec<Vec3>) = placed.unzip();
            let ranges_m = chunk.iter().map(|point| point.position_m.norm());
            let (Some(range_m), [first, .., last]) = (median(ranges_m), bodies.as_slice()) else {
                continue;
            };
            if (last - first).norm() > MOVED_SHARE * range_m {
                let close_m = CLOSE_M.min(CLOSE_SHARE * range_m);
                return Ok(point_spacing_m(&points, range_m).map(|m| m.max(close_m)));
            }
        }
    }
    Ok(None)
}

/// The start of the calibration of a project.
#[derive(Serialize, Deserialize)]
pub struct Start {
    /// The initial mountings: those of the project, unless the clouds take up much less space with others.
    pub mountings: Vec<BodyFromScanner>,
    /// Its scales, preceded by coarser ones if the clouds lie farther apart than the scales of the project reach.
    pub voxel_sizes_m: Vec<f64>,
    /// Contradictions between the scans and their placement.
    pub verdicts: Vec<Verdict>,
}

impl Start {
    /// The project with these mountings.
    pub fn project(&self, project: &Project) -> Project {
        with_mountings(project, &self.mountings)
    }

    /// The settings of the project with these scales.
    pub fn settings(&self, project: &Project) -> CalibrationSettings {
        CalibrationSettings {
            voxel_sizes_m: self.voxel_sizes_m.clone(),
            ..project.calibration.clone()
        }
    }
}

/// Examines the scans with the mountings of the project, and finds the start of the calibration.
pub fn start(
    project: &Project,
    trajectory: &Trajectory,
    samples: &[ScannerSample],
    reference: &[Vec3],
    progress: &dyn Progress,
) -> Start {
    let placed = |project: &Project| {
        scans(&Placement {
            mountings: &mountings(project),
            samples,
            trajectory,
            reference,
        })
    };
    let stage = progress.stage("checking the placement", SEARCH_UNITS + 2);
    let own = placed(project);
    progress.advance(1);
    let better = better_start(&mountings(project), samples, reference);
    progress.advance(SEARCH_UNITS);
    let better = better.map(|poses| with_mountings(project, &poses));
    let better = better.map(|project| (placed(&project), project));
    drop(stage);
    let (placed, project, mut verdicts) = match better {
        // A better start is not used if a usual mistake explains the scans about as well.
        Some((other, better))
            if other.is_as_close_as(&own) && !own.is_explained_as_well_as(&other) =>
        {
            let verdicts = far_starts(project, &better);
            (other, better, verdicts)
        }
        _ => (own, project.clone(), Vec::new()),
    };
    let apart_m = placed.apart_m();
    verdicts.extend(placed.verdict);
    verdicts.extend(fans(&mountings(&project), samples));
    for verdict in &verdicts {
        progress.warn(&verdict.text);
    }
    Start {
        mountings: initial_poses(&project),
        voxel_sizes_m: scales_for(&project, samples, apart_m, progress),
        verdicts,
    }
}

/// The verdicts on starts that are far from the project's own.
fn far_starts(project: &Project, better: &Project) -> Vec<Verdict> {
    let pairs = project.scanners.iter().zip(&better.scanners);
    let moved = pairs.map(|(own, better)| {
        let (turn, shift) = better
            .body_from_scanner
            .perturbation_from(&own.body_from_scanner);
        (&own.name, turn.norm(), shift.norm())
    });
    let far = moved.filter(|(_, turn, shift)| *turn > ROUGH_START.0 || *shift > ROUGH_START.1);
    let verdicts = far.map(|(name, turn, shift)| {
        let text = format!(
            "The calibration starts with scanner {name} {:.1}° and {shift:.2} m from the project's mounting, as the \
             clouds then take up much less space: is that as wrong?",
            turn.to_degrees()
        );
        Verdict::care("mounting.start", text).with_value(turn, None)
    });
    verdicts.collect()
}

/// The scales of the project, preceded by coarser ones if the clouds lie farther apart than the scales reach, as far as
/// these hold enough points.
fn scales_for(
    project: &Project,
    samples: &[ScannerSample],
    apart_m: Option<f64>,
    progress: &dyn Progress,
) -> Vec<f64> {
    let mut sizes = project.calibration.voxel_sizes_m.clone();
    let reach_m = apart_m.unwrap_or(0.0);
    let least_m = SCALE_PER_MISFIT * reach_m.min(MAX_MISFIT_M);
    let poses = initial_poses(project);
    let voxels = |voxel_m: f64| {
        let placed = samples.iter().zip(&poses);
        occupied(placed.flat_map(|(s, pose)| s.placed(pose)), voxel_m).len()
    };
    while let Some(coarser_m) = sizes.first().filter(|m| **m < least_m).map(|m| 2.0 * m) {
        if voxels(coarser_m) < NEIGHBOURHOODS * project.calibration.neighbours {
            break;
        }
        progress.say(&format!(
            "the clouds lie {reach_m:.2} m apart: a scale of {coarser_m} m comes first"
        ));
        sizes.insert(0, coarser_m);
    }
    sizes
}
