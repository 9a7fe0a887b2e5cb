//! Association of points with surfels.

use rayon::prelude::*;

use super::cells::{ReferenceCells, Sums, add, columns, surfaces};
use super::regions::regions;
use super::{
    Association, CLASS_SIZES, CLASSES, COVERAGE_SHARES, COVERAGES, DriveRows, Gates, Grid,
    RowPoint, ScanRow, Surfel, Tally,
};
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::{BodyFromScanner, Vec3, WorldFromScanner, bent};
use crate::joint::bend::Bends;
use crate::joint::input::Scans;
use crate::joint::motion::Motion;
use crate::statistics::{SIGMAS_PER_MAD, median};

/// Fewest rows of a surfel without a reference: three determine its own plane.
const MIN_ROWS: u32 = 4;
/// Time without a row after which a scanner begins another pass, seconds.
const PASS_S: f64 = 3.0;
/// Fewest points of a row.
const MIN_ROW_POINTS: usize = 3;
/// Points farther from a surfel than this many standard deviations do not belong to it.
const GATE_SIGMAS: f64 = 4.0;
/// Points within this many sizes count as near a surfel, even if they are beyond its gate.
const NEAR_SIZES: f64 = 0.6;

/// A point placed in the world.
#[derive(Clone, Copy)]
struct Placed {
    world_m: Vec3,
    step: u32,
    point: u32,
}

/// The surfel in each voxel.
struct SurfelVoxels {
    grid: Grid,
    surfels: VoxelMap<VoxelKey, u32>,
}

impl SurfelVoxels {
    /// The surfel in whose voxels a point of the world lies.
    fn surfel_at(&self, world_m: &Vec3) -> Option<u32> {
        self.surfels.get(&self.grid.key(world_m)).copied()
    }
}

/// Finds the surfels and their rows for these motions and mountings. Scanner points and the reference are
/// cut by the same voxels. A surfel takes its plane from the reference, or from the scans if the reference
/// has no points there.
pub fn associate(
    scans: &[Scans<'_>],
    motions: &[Box<dyn Motion>],
    mountings: &[BodyFromScanner],
    bends: Option<&Bends>,
    late_s: &[f64],
    reference: &ReferenceCells,
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
    let grid = &reference.grid;
    let mut cells: VoxelMap<VoxelKey, Sums> = VoxelMap::default();
    for point in placed.iter().flatten().flatten() {
        add(&mut cells, grid, &point.world_m);
    }
    let columns = columns(&cells, reference);
    let mut patches: VoxelMap<VoxelKey, u32> = VoxelMap::default();
    let mut surfels: Vec<Surfel> = Vec::new();
    let mut voxels = SurfelVoxels {
        grid: *grid,
        surfels: VoxelMap::default(),
    };
    let fitted: Vec<Vec<(&[VoxelKey], Surfel)>> = columns
        .par_iter()
        .map(|column| surfaces(column, &cells, reference, gates))
        .collect();
    for (keys, mut surfel) in fitted.into_iter().flatten() {
        if let Some(prior) = &mut surfel.prior {
            let next = patches.len() as u32;
            let key = voxel_key(&surfel.centre_m, gates.patch_m);
            prior.patch = *patches.entry(key).or_insert(next);
        }
        for key in keys {
            voxels.surfels.insert(*key, surfels.len() as u32);
        }
        surfels.push(surfel);
    }
    let mut tallies = vec![Tally::default(); surfels.len()];
    let mut drives: Vec<DriveRows> = placed
        .iter()
        .zip(scans)
        .zip(motions)
        .map(|((placed, scans), motion)| {
            rows_of(
                placed,
                scans,
                motion.steps(),
                &surfels,
                &voxels,
                gates,
                &mut tallies,
            )
        })
        .collect();
    let regions = regions(&surfels, &tallies, grid.size_m);
    for (surfel, tally) in surfels.iter_mut().zip(&tallies) {
        if tally.free > 0.0 {
            surfel.scatter_m = (tally.squares_m2 / tally.free).sqrt();
        }
        let sizes = surfel.scatter_m / grid.size_m;
        let class = CLASS_SIZES.iter().position(|most| sizes <= *most);
        surfel.class = class.unwrap_or(CLASSES - 1);
    }
    for drive in &mut drives {
        keep_keyframes(drive, &gates.keyframe_steps);
    }
    find_coverage(&surfels, mountings.len(), &mut drives);
    drop_unchecked(&mut surfels, &mut drives, scans);
    Association {
        surfels,
        drives,
        patches: patches.len(),
        reference: reference.place,
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

/// The rows of a drive: its points sorted by step, scanner and surfel. Adds the points to the tallies of
/// the surfels.
fn rows_of(
    placed: &[Vec<Placed>],
    scans: &Scans<'_>,
    steps: usize,
    surfels: &[Surfel],
    voxels: &SurfelVoxels,
    gates: &Gates,
    tallies: &mut [Tally],
) -> DriveRows {
    // Step, scanner, surfel, point, and the bits of its distance from the surfel.
    let mut seen: Vec<(u32, u32, u32, u32, u32)> = Vec::new();
    for (scanner, points) in placed.iter().enumerate() {
        let near = points.par_iter().filter_map(|point| {
            let surfel = voxels.surfel_at(&point.world_m)?;
            let plane = &surfels[surfel as usize];
            let distance_m = plane.axes[0].dot(&(point.world_m - plane.centre_m));
            (distance_m.abs() < NEAR_SIZES * voxels.grid.size_m).then_some((
                point.step,
                scanner as u32,
                surfel,
                point.point,
                (distance_m as f32).to_bits(),
            ))
        });
        seen.par_extend(near);
    }
    seen.par_sort_unstable();
    let mut rows = DriveRows {
        step_start: vec![0; steps + 1],
        ..DriveRows::default()
    };
    let excess_m: Vec<f64> = (0..placed.len())
        .map(|scanner| excess_m(&seen, surfels, scanner as u32))
        .collect();
    let mut group: Vec<(u32, u32, u32, u32, u32)> = Vec::new();
    for near in seen.chunk_by(|a, b| (a.0, a.1, a.2) == (b.0, b.1, b.2)) {
        let (step, scanner, surfel, ..) = near[0];
        let tally = &mut tallies[surfel as usize];
        tally.near += near.len() as f64;
        tally.distance_m += near.iter().map(|seen| distance_m(seen.4)).sum::<f64>();
        let sigma_m = surfels[surfel as usize]
            .roughness_m
            .hypot(gates.misfit_m)
            .hypot(excess_m[scanner as usize]);
        group.clear();
        let within = |bits: u32| distance_m(bits).abs() < GATE_SIGMAS * sigma_m;
        group.extend(near.iter().filter(|seen| within(seen.4)).copied());
        if group.len() < MIN_ROW_POINTS {
            continue;
        }
        let sample = scans.samples[scanner as usize];
        let distances = || group.iter().map(|seen| distance_m(seen.4));
        let weights = || {
            let point = |place: u32| &sample.points[place as usize];
            group
                .iter()
                .map(move |(.., place, _)| f64::from(point(*place).count))
        };
        let count = group.len() as f64;
        let mean = distances().sum::<f64>() / count;
        tally.squares_m2 += distances().map(|d| (d - mean).powi(2)).sum::<f64>();
        tally.free += count - 1.0;
        rows.step_start[step as usize + 1] += 1;
        rows.rows.push(ScanRow {
            surfel,
            scanner,
            first: rows.points.len() as u32,
            count: group.len() as u32,
            effective: weights().sum::<f64>().powi(2) / weights().map(|w| w * w).sum::<f64>(),
            coverage: 0,
            depth_m: 0.0,
            by_motion: [0.0; 2],
            rows_in_step: 1,
            trust: 1.0,
        });
        rows.points.extend(group.iter().map(|(.., point, _)| {
            let point = &sample.points[*point as usize];
            RowPoint {
                profile: point.profile,
                position_m: point.position_m,
                weight: f64::from(point.count),
            }
        }));
    }
    for step in 0..steps {
        rows.step_start[step + 1] += rows.step_start[step];
    }
    rows
}

fn distance_m(bits: u32) -> f64 {
    f64::from(f32::from_bits(bits))
}

/// Excess of the scatter of a scanner's points over the roughness of the surfels they lie on, metres: its
/// own noise, if that is larger.
fn excess_m(seen: &[(u32, u32, u32, u32, u32)], surfels: &[Surfel], scanner: u32) -> f64 {
    let points = || seen.iter().filter(|seen| seen.1 == scanner);
    let distance_m = median(points().map(|seen| distance_m(seen.4).abs()));
    let roughness_m = median(points().map(|seen| surfels[seen.2 as usize].roughness_m));
    let square = |value: Option<f64>| value.unwrap_or(0.0).powi(2);
    let excess_m2 = SIGMAS_PER_MAD.powi(2) * square(distance_m) - square(roughness_m);
    excess_m2.max(0.0).sqrt()
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
    let mut next = 0;
    let number: Vec<Option<u32>> = surfels
        .iter()
        .zip(&seen)
        .map(|(surfel, seen)| {
            (*seen >= needed(surfel)).then(|| {
                next += 1;
                next - 1
            })
        })
        .collect();
    for drive in drives {
        drive.retain(|_, row| number[row.surfel as usize]);
    }
    let mut keep = number.iter();
    surfels.retain(|_| keep.next().is_some_and(Option::is_some));
}
