//! The start values and the scales of a calibration.

use serde::{Deserialize, Serialize};

use super::open_project::OpenProject;
use super::profiles::{open_profiles, profile_inputs};
use super::rig::Rig;
use crate::calibration::{Reach, ScannerSample, better_start, point_spacing_m};
use crate::cloud::voxel::occupied;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::judgement;
use crate::preflight::{Placement, fans, scans};
use crate::progress::Progress;
use crate::project::Project;
use crate::results::FirstPlacement;
use crate::statistics::median;
use crate::trajectory::Trajectory;

/// Work units of the search for a better start; evaluating one start is one unit.
const SEARCH_UNITS: u64 = 6;
/// Smallest sufficient value of the coarsest scale, as a share of the distance between the clouds.
const SCALE_PER_MISFIT: f64 = 0.5;
/// Smallest number of neighbourhoods of a scale that is added.
const NEIGHBOURHOODS: usize = 10;
/// Distance between clouds beyond which no scale helps, metres.
const MAX_MISFIT_M: f64 = 5.0;
/// The finest scale is at least this, metres, or this share of the median range if that is less.
pub const CLOSE_M: f64 = 0.005;
const CLOSE_SHARE: f64 = 1.0 / 150.0;
/// Clouds are compared by their heights in columns of half this size, metres: points that are farther from their true
/// places are near each other in height only by chance.
const TWO_COLUMNS_M: f64 = 0.5;
/// The spacing of points is measured over a stretch on which the body moves by these shares of the median range: over
/// the longer one if the points of the shorter one are sparse, as a lidar's are until the body has moved on.
const MOVED_SHARES: [f64; 2] = [0.05, 1.0];
/// Points are sparse if their spacing exceeds this share of the median range.
const SPARSE_SHARE: f64 = 0.02;
/// Most points of a stretch.
const MOST_POINTS: usize = 2_000_000;

/// The rig with scales that match the spacing of its points, if the project asks for automatic scales.
///
/// # Errors
/// Errors of the readers.
pub fn with_scales(
    project: &OpenProject,
    rig: &Rig,
    trajectory: &Trajectory,
    progress: &dyn Progress,
) -> Result<Rig> {
    let mut rig = rig.clone();
    if !project.has_auto_scales {
        return Ok(rig);
    }
    let mut finest_m: Option<f64> = None;
    for number in 0..project.scanners.len() {
        let scale_m = finest_scale(project, &rig, number, trajectory)?;
        // Points of a sparse scanner lie on the surface that a dense one sees.
        finest_m = finest_m.into_iter().chain(scale_m).reduce(f64::min);
    }
    let Some(finest_m) = finest_m else {
        progress
            .say("the spacing of the points cannot be determined: scales for close range are used");
        return Ok(rig);
    };
    // Round to two digits.
    let digit = 10f64.powf(finest_m.log10().floor() - 1.0);
    let finest_m = (finest_m / digit).round() * digit;
    let sizes = &mut rig.voxel_sizes_m;
    let project_m = sizes[sizes.len() - 1];
    sizes
        .iter_mut()
        .for_each(|size| *size *= finest_m / project_m);
    progress.say(&format!(
        "the finest scale is {:.1} mm, from the ranges and the spacing of the points",
        1e3 * finest_m
    ));
    Ok(rig)
}

/// The finest scale at which the points of the scanner with this number form surfaces, metres; `None` if it cannot be
/// determined.
fn finest_scale(
    project: &OpenProject,
    rig: &Rig,
    scanner: usize,
    trajectory: &Trajectory,
) -> Result<Option<f64>> {
    let pose = rig.mountings[scanner].body_from_scanner;
    let mut chunk = Vec::new();
    let (mut bodies, mut points, mut ranges_m) = (Vec::new(), Vec::new(), Vec::new());
    let mut shares = MOVED_SHARES.into_iter().peekable();
    let mut spacing_m = None;
    let inputs = profile_inputs(project, &project.scanners[scanner]);
    for mut reader in open_profiles(&project.scanners[scanner], &inputs, trajectory)? {
        while reader.next_chunk(&mut chunk)? {
            let mut placing = rig.georeferencer(scanner, trajectory);
            for point in &chunk {
                if let Some(body) = placing.body_at(point).1 {
                    bodies.push(body.translation_m);
                    points.push(body.map(&pose.map(&point.position_m)));
                    ranges_m.push(point.position_m.norm());
                }
            }
            let ([first, .., last], Some(range_m)) =
                (bodies.as_slice(), median(ranges_m.iter().copied()))
            else {
                continue;
            };
            let moved_m = (last - first).norm();
            if shares.next_if(|share| moved_m > share * range_m).is_none() {
                // A body that stands shows nothing new.
                if points.len() > MOST_POINTS {
                    if spacing_m.is_some() {
                        return Ok(spacing_m);
                    }
                    (bodies, points, ranges_m) = Default::default();
                }
                continue;
            }
            let close_m = CLOSE_M.min(CLOSE_SHARE * range_m);
            let now_m = point_spacing_m(&points, range_m).map(|m| m.max(close_m));
            spacing_m = now_m.or(spacing_m);
            let is_dense = spacing_m.is_some_and(|m| m < SPARSE_SHARE * range_m);
            if is_dense || shares.peek().is_none() || points.len() > MOST_POINTS {
                return Ok(spacing_m);
            }
        }
    }
    Ok(spacing_m)
}

/// The start of the calibration of a project.
#[derive(Serialize, Deserialize)]
pub struct Start {
    /// The mountings of the project, or others with which the clouds take up much less space; and the scales of the
    /// project, preceded by coarser ones if the clouds lie too far apart for them.
    pub rig: Rig,
    /// How the scans lie with these mountings.
    pub first: FirstPlacement,
}

/// Examines the scans with the mountings of `rig`, and finds the start of the calibration.
pub fn start(
    project: &Project,
    rig: &Rig,
    trajectory: &Trajectory,
    samples: &[ScannerSample],
    reference: &[Vec3],
    progress: &dyn Progress,
) -> Start {
    let placed = |rig: &Rig| {
        scans(&Placement {
            mountings: &rig.mountings,
            samples,
            trajectory,
            reference,
        })
    };
    let stage = progress.stage("checking the placement", SEARCH_UNITS + 2);
    let initial = placed(rig);
    progress.advance(1);
    // The calibration aligns clouds that are near.
    let rough_m = rough_m(samples);
    let is_near =
        rough_m < TWO_COLUMNS_M && initial.apart_m().is_some_and(|m| m < Reach::ROUGH.shift_m);
    let better = if is_near {
        None
    } else {
        better_start(&rig.mountings, samples, reference)
    };
    progress.advance(SEARCH_UNITS);
    let better = better.map(|poses| rig.with_poses(&poses));
    let better = better.map(|rig| (placed(&rig), rig));
    drop(stage);
    let (placed, mut begin) = match better {
        // A better start is not used if a usual mistake explains the scans about as well.
        Some((other, better))
            if other.is_as_close_as(&initial) && !initial.is_explained_as_well_as(&other) =>
        {
            (other, better)
        }
        _ => (initial, rig.clone()),
    };
    let apart_m = placed.apart_m();
    let first = FirstPlacement {
        project: rig.mountings.clone(),
        start: begin.mountings.clone(),
        placed,
        views: fans(&begin.mountings, samples),
    };
    for verdict in judgement::first_placement(&first) {
        progress.verdict(&verdict.text);
    }
    begin.voxel_sizes_m = scales_for(project, &begin, samples, rough_m, apart_m, progress);
    Start { rig: begin, first }
}

/// The distance by which rough initial values move points, metres.
fn rough_m(samples: &[ScannerSample]) -> f64 {
    let ranges_m = samples.iter().filter_map(|sample| {
        let points = sample.points.iter();
        median(points.map(|point| point.position_m.norm()))
    });
    Reach::ROUGH.displacement_m(ranges_m.fold(0.0, f64::max))
}

/// The scales of `rig`, without automatic ones that are coarser than rough initial values need, and preceded by coarser
/// ones if the clouds lie too far apart for them, as long as these have enough points.
fn scales_for(
    project: &Project,
    rig: &Rig,
    samples: &[ScannerSample],
    rough_m: f64,
    apart_m: Option<f64>,
    progress: &dyn Progress,
) -> Vec<f64> {
    let fewest = NEIGHBOURHOODS * project.calibration.neighbours;
    let mut sizes = rig.voxel_sizes_m.clone();
    let reach_m = apart_m.unwrap_or(0.0);
    if project.has_auto_scales {
        // Coarser scales than rough initial values need only see more of the relief.
        let coarsest_m = (SCALE_PER_MISFIT * rough_m).max(rig.finest_m());
        sizes.retain(|size_m| *size_m <= coarsest_m);
    }
    let least_m = SCALE_PER_MISFIT * reach_m.min(MAX_MISFIT_M);
    let voxels = |voxel_m: f64| {
        let placed = samples.iter().zip(&rig.mountings);
        let placed = placed.flat_map(|(s, mounting)| s.placed(&mounting.body_from_scanner));
        occupied(placed, voxel_m).len()
    };
    while let Some(coarser_m) = sizes.first().filter(|m| **m < least_m).map(|m| 2.0 * m) {
        if voxels(coarser_m) < fewest {
            break;
        }
        progress.say(&format!(
            "the clouds lie {reach_m:.2} m apart: a scale of {coarser_m} m comes first"
        ));
        sizes.insert(0, coarser_m);
    }
    sizes
}
