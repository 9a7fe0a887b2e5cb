//! Association of points with surfels.

use rayon::prelude::*;

use super::cells::ReferenceCells;
use super::level::{Level, Placed};
use super::planes::share_slopes;
use super::regions::regions;
use super::relief::rougher;
use super::{
    Association, CLASS_SIZES, CLASSES, COVERAGE_SHARES, COVERAGES, DriveRows, Gates, ScanRow,
    Surfel, keep,
};
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::{BodyFromScanner, WorldFromScanner, bent};
use crate::joint::bend::Bends;
use crate::joint::input::Scans;
use crate::joint::motion::Motion;

/// Fewest rows of a surfel without a reference: three determine its own plane.
const MIN_ROWS: u32 = 4;
/// Time without a row after which a scanner begins another pass, seconds.
const PASS_S: f64 = 3.0;

/// Finds the surfels and their rows for these motions and mountings. Scanner points and the reference are
/// cut by the same voxels, those of the first of `references`; voxels of the second are taken where the ground asks for
/// smaller planes. A surfel takes its plane from the reference, or from the scans if the reference
/// has no points there.
pub fn associate(
    scans: &[Scans<'_>],
    motions: &[Box<dyn Motion>],
    mountings: &[BodyFromScanner],
    bends: Option<&Bends>,
    late_s: &[f64],
    references: &[ReferenceCells],
    gates: &Gates,
) -> Association {
    // The placed points of each drive and scanner.
    let placed: Vec<Vec<Vec<Placed>>> = scans
        .iter()
        .zip(motions)
        .enumerate()
        .map(|(drive, (scans, motion))| {
            let mounting = |s: usize, time_s: f64| match bends {
                Some(bends) => bent(&mountings[s], &bends.offset(drive, s, time_s)),
                None => mountings[s],
            };
            let place_scanner = |s: usize| {
                let mounting = |time_s: f64| mounting(s, time_s);
                place(scans, motion.as_ref(), s, &mounting, late_s[s])
            };
            (0..mountings.len())
                .into_par_iter()
                .map(place_scanner)
                .collect()
        })
        .collect();
    let at = |reference: &ReferenceCells| Level::new(&placed, scans, motions, reference, gates);
    let level = at(&references[0]);
    let regions = regions(&level.surfels, &level.tallies, level.grid.size_m);
    let (mut surfels, mut drives) = match references.get(1) {
        Some(finer) => {
            let finer = at(finer);
            let is_rougher = rougher(&level, &finer);
            level.refined(finer, &is_rougher)
        }
        None => (level.surfels, level.drives),
    };
    let mut patches: VoxelMap<VoxelKey, u32> = VoxelMap::default();
    for surfel in &mut surfels {
        if let Some(prior) = &mut surfel.prior {
            let next = patches.len() as u32;
            let key = voxel_key(&surfel.centre_m, gates.patch_m);
            prior.patch = *patches.entry(key).or_insert(next);
        }
        let sizes = surfel.scatter_m / surfel.size_m;
        let class = CLASS_SIZES.iter().position(|most| sizes <= *most);
        surfel.class = class.unwrap_or(CLASSES - 1);
    }
    for drive in &mut drives {
        keep_keyframes(drive, &gates.keyframe_steps);
    }
    find_coverage(&surfels, mountings.len(), &mut drives);
    drop_unchecked(&mut surfels, &mut drives, scans);
    let ground = references[0].grid.regions();
    let planes = share_slopes(&mut surfels, |surfel| ground.key(&surfel.centre_m));
    Association {
        surfels,
        planes,
        drives,
        patches: patches.len(),
        reference: references[0].place,
        regions,
    }
}

/// Places the points of one scanner.
fn place(
    scans: &Scans<'_>,
    motion: &dyn Motion,
    scanner: usize,
    mounting: &dyn Fn(f64) -> BodyFromScanner,
    late_s: f64,
) -> Vec<Placed> {
    let sample = scans.samples[scanner];
    let mut profiles: Vec<Option<(u32, WorldFromScanner)>> = vec![None; sample.profiles.len()];
    let mut next = 0;
    while next < profiles.len() {
        let time_of = |profile: usize| sample.profiles[profile].time_s - late_s;
        let Some(step) = motion.step_at(time_of(next)) else {
            next += 1;
            continue;
        };
        let poses = motion.poses(step);
        while next < profiles.len() && motion.step_at(time_of(next)) == Some(step) {
            let body = poses.at(time_of(next)).world_from_body;
            profiles[next] = Some((step as u32, body * mounting(time_of(next))));
            next += 1;
        }
    }
    let points = (0..).zip(&sample.points);
    let placed = points.filter_map(|(index, point): (u32, _)| {
        let (step, pose) = profiles[point.profile as usize]?;
        Some(Placed {
            world_m: pose.map(&point.position_m),
            step,
            point: index,
        })
    });
    placed.collect()
}

/// Keeps only the rows of each scanner's keyframes. Every `keyframe_steps` consecutive steps have one
/// keyframe: the step with the most rows.
fn keep_keyframes(drive: &mut DriveRows, keyframe_steps: &[usize]) {
    for (scanner, &every) in (0..).zip(keyframe_steps).filter(|(_, every)| **every > 1) {
        let row_count = |step: usize| {
            let rows = drive.of_step(step).iter();
            rows.filter(|row| row.scanner == scanner).count()
        };
        let steps: Vec<usize> = (0..drive.step_start.len() - 1).collect();
        let fullest = |window: &[usize]| window.iter().copied().max_by_key(|&step| row_count(step));
        let keyframes: Vec<usize> = steps.chunks(every).filter_map(fullest).collect();
        drive.retain(|step, row| {
            let is_kept = row.scanner != scanner || keyframes.binary_search(&step).is_ok();
            is_kept.then_some(row.surfel)
        });
    }
}

/// Sets the coverage of each row, the part of its surfel that it saw: its share of the points of the
/// scanner's fullest row.
fn find_coverage(surfels: &[Surfel], scanners: usize, drives: &mut [DriveRows]) {
    let place = |row: &ScanRow| row.surfel as usize * scanners + row.scanner as usize;
    let mut fullest = vec![0_u32; surfels.len() * scanners];
    for row in drives.iter().flat_map(|drive| &drive.rows) {
        let most = &mut fullest[place(row)];
        *most = row.count.max(*most);
    }
    for row in drives.iter_mut().flat_map(|drive| &mut drive.rows) {
        let share = f64::from(row.count) / f64::from(fullest[place(row)]);
        let class = COVERAGE_SHARES.iter().position(|most| share <= *most);
        row.coverage = class.unwrap_or(COVERAGES - 1) as u8;
    }
}

/// Marks the surfels that several passes or scanners saw, and removes those with too few rows.
fn drop_unchecked(surfels: &mut Vec<Surfel>, drives: &mut [DriveRows], scans: &[Scans<'_>]) {
    let mut seen = vec![0_u32; surfels.len()];
    // The drive, time and scanner that last saw each surfel.
    let mut before = vec![None; surfels.len()];
    for (number, drive) in drives.iter().enumerate() {
        for row in &drive.rows {
            let surfel = row.surfel as usize;
            let profile = drive.points_of(row)[0].profile as usize;
            let time_s = scans[number].samples[row.scanner as usize].profiles[profile].time_s;
            seen[surfel] += 1;
            let again = before[surfel].is_some_and(|(drive, last_s, scanner)| {
                drive != number || time_s > last_s + PASS_S || scanner != row.scanner
            });
            surfels[surfel].is_checked |= again;
            before[surfel] = Some((number, time_s, row.scanner));
        }
    }
    let needed = |surfel: &Surfel| if surfel.prior.is_some() { 1 } else { MIN_ROWS };
    let kept: Vec<bool> = surfels
        .iter()
        .zip(&seen)
        .map(|(surfel, seen)| *seen >= needed(surfel))
        .collect();
    keep(surfels, drives, &kept);
}
