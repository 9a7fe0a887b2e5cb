//! Surfels: patches of the surface that scanners and reference saw, and which points belong to
//! which.

use rayon::prelude::*;

use super::input::Scans;
use super::motion::Motion;
use crate::cloud::StructureTensor;
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::{BodyFromScanner, Mat3, Vec3, WorldFromBody};
use crate::statistics::{SIGMAS_PER_MAD, median};

/// Fewest points that a surfel is fitted to.
const MIN_POINTS: f64 = 12.0;
/// Fewest rows of a surfel without a reference: three are its own.
const MIN_ROWS: u32 = 4;
/// Steps without a row after which a scanner is on another pass.
const PASS_STEPS: usize = 20;
/// Fewest points of a row.
const MIN_ROW_POINTS: usize = 3;
/// Least standard deviation of the points of a surfel across its narrow side, as a share of its
/// size; points spread over the whole width have 0.29.
const MIN_WIDTH: f64 = 0.12;
/// Largest standard deviation about the plane, as a share of that across the narrow side: beyond,
/// it is no surface.
const MAX_THICKNESS: f64 = 0.4;
/// A surface lies clear of the faces of its voxel where so many standard deviations do.
const CLEAR_SIGMAS: f64 = 3.0;
/// Points farther from their surfel than this many standard deviations are not of it.
const GATE_SIGMAS: f64 = 4.0;
/// Points count as near a surfel, even where they are beyond its gate, within this many sizes.
const NEAR_SIZES: f64 = 0.6;
/// Edge of a region and least number of its surfels.
const REGION_SIZES: f64 = 10.0;
const MIN_REGION: usize = 12;
/// A region is off where its median lies beyond this many standard deviations of all regions'
/// medians, and this many sizes of a surfel.
const REGION_SIGMAS: f64 = 6.0;
const LEAST_REGION_SIZES: f64 = 0.03;
/// Upper bounds of the classes of roughness, in sizes of a surfel: within a class the noise of rows is
/// alike. For surfels of 5 cm they are 0.4, 0.8, 1.6, 3 and 6 mm.
const CLASS_SIZES: [f64; 6] = [0.008, 0.016, 0.032, 0.06, 0.12, f64::INFINITY];

/// Upper bounds of the classes of coverage. What a rough surface does to the mean of a strip averages
/// out over the whole surfel.
const COVERAGE_SHARES: [f64; 3] = [0.35, 0.7, 1.0];
/// Number of classes of coverage.
pub const COVERAGES: usize = COVERAGE_SHARES.len();

/// Number of classes of roughness.
pub const CLASSES: usize = CLASS_SIZES.len();

/// A patch of the surface: the plane n·(x − c) = a + b u + c v with u and v along its own axes; a,
/// b and c are unknowns.
#[derive(Debug, Clone)]
pub struct Surfel {
    /// World, metres.
    pub centre_m: Vec3,
    /// Unit vectors: normal, u, v.
    pub axes: [Vec3; 3],
    /// Standard deviation of the points about the plane, metres.
    pub roughness_m: f64,
    /// Standard deviation of the scanners' points about the mean of their row, metres: noise and
    /// roughness, without what poses do.
    pub scatter_m: f64,
    /// Class of this scatter.
    pub class: usize,
    /// Whether the reference knows it, or several passes or scanners saw it.
    pub is_checked: bool,
    /// What the reference says about (a, b, c); `None` without one.
    pub prior: Option<ReferencePlane>,
}

/// The reference's plane of a surfel: it is the surfel's own frame, so that a = b = c = 0.
#[derive(Debug, Clone)]
pub struct ReferencePlane {
    /// Standard deviations of offset (metres) and slopes.
    pub sigma: [f64; 3],
    /// Its patch of the reference's surface errors.
    pub patch: u32,
}

/// All observations of one surfel by one scanner within a step.
#[derive(Debug, Clone, Copy)]
pub struct ScanRow {
    pub surfel: u32,
    pub scanner: u32,
    /// Places among the points.
    pub first: u32,
    pub count: u32,
    /// Class of the part of the surfel that it saw.
    pub coverage: u8,
    /// How far its points lay from the scanner along the surfel's normal, metres, with its sign.
    pub depth_m: f64,
}

/// A laser point of a row.
#[derive(Debug, Clone, Copy)]
pub struct RowPoint {
    /// Of its scanner in this drive.
    pub profile: u32,
    /// Scanner frame, metres.
    pub position_m: Vec3,
}

/// The rows of a drive.
#[derive(Debug, Clone, Default)]
pub struct DriveRows {
    /// First row of each step, and the end.
    pub step_start: Vec<u32>,
    pub rows: Vec<ScanRow>,
    pub points: Vec<RowPoint>,
}

impl DriveRows {
    /// The rows of a step.
    pub fn of_step(&self, step: usize) -> &[ScanRow] {
        &self.rows[self.step_start[step] as usize..self.step_start[step + 1] as usize]
    }

    /// The points of a row.
    pub fn points_of(&self, row: &ScanRow) -> &[RowPoint] {
        &self.points[row.first as usize..(row.first + row.count) as usize]
    }
}

/// Surfels and the rows that see them.
#[derive(Debug, Clone, Default)]
pub struct Association {
    pub surfels: Vec<Surfel>,
    /// One a drive.
    pub drives: Vec<DriveRows>,
    /// Patches of the reference's surface errors.
    pub patches: usize,
    /// Regions in which scans and reference disagree.
    pub regions: Vec<Region>,
}

/// A region in which scans and reference disagree, as where a board was moved.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Region {
    /// Mean of its surfels, world, metres.
    pub centre_m: Vec3,
    /// How far the scans lie above the reference along its normal, which looks up, metres.
    pub offset_m: f64,
    /// Number of its surfels.
    pub surfels: usize,
}

impl Region {
    /// Where it is and how far off, in words; `origin_m` is added to its place.
    pub fn describe(&self, origin_m: &Vec3) -> String {
        let place = self.centre_m + origin_m;
        let side = if self.offset_m > 0.0 {
            "above"
        } else {
            "below"
        };
        format!(
            "around east {:.1}, north {:.1} m the scans lie {:.1} mm {side} the reference, and \
             nowhere near it elsewhere: was something moved after the reference was scanned?",
            place.x,
            place.y,
            1e3 * self.offset_m.abs()
        )
    }
}

/// What the points of one surfel add up to.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    /// Squared distances of points from the mean of their row, and degrees of freedom.
    squares_m2: f64,
    free: f64,
    /// Points near the surfel, and the sum of their distances: also of those beyond the gate.
    near: f64,
    distance_m: f64,
}

/// Sums of points about the centre of their voxel.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f64,
    first: Vec3,
    second: Mat3,
}

impl Sums {
    fn add(&mut self, offset: &Vec3) {
        self.count += 1.0;
        self.first += offset;
        self.second += offset * offset.transpose();
    }

    /// Adds sums that are about a centre `shift` away.
    fn combine(&mut self, other: &Self, shift: &Vec3) {
        let cross = other.first * shift.transpose();
        self.count += other.count;
        self.first += other.first + shift * other.count;
        self.second +=
            other.second + cross + cross.transpose() + shift * shift.transpose() * other.count;
    }

    fn tensor(&self, centre: &Vec3) -> StructureTensor {
        let mean = self.first / self.count;
        StructureTensor {
            mean: centre + mean,
            covariance: self.second / self.count - mean * mean.transpose(),
            count: self.count as usize,
        }
    }
}

/// The reference's points in voxels of the surfels' size.
#[derive(Debug, Clone, Default)]
pub struct ReferenceCells {
    cells: VoxelMap<VoxelKey, Sums>,
}

fn centre_of(key: &VoxelKey, size_m: f64) -> Vec3 {
    Vec3::from_fn(|i, _| (key[i] as f64 + 0.5) * size_m)
}

impl ReferenceCells {
    /// Sorts points into voxels.
    pub fn new(points: &[Vec3], size_m: f64) -> Self {
        let mut cells: VoxelMap<VoxelKey, Sums> = VoxelMap::default();
        for point in points {
            let key = voxel_key(point, size_m);
            let centre = centre_of(&key, size_m);
            cells.entry(key).or_default().add(&(point - centre));
        }
        Self { cells }
    }
}

/// What decides which points belong to a surfel.
#[derive(Debug, Clone, Copy)]
pub struct Gates {
    /// Edge of the voxels, metres.
    pub size_m: f64,
    /// How far scans and reference may yet lie apart, metres.
    pub misfit_m: f64,
    /// Edge of the patches of the reference's surface errors, metres.
    pub patch_m: f64,
}

/// One point at its place.
#[derive(Clone, Copy)]
struct Placed {
    world_m: Vec3,
    step: u32,
    point: u32,
}

/// Finds the surfels and their rows for these motions and mountings. Scanner points and the
/// reference are cut by the same voxels; a surfel takes its plane from the reference where there is
/// one, and from the scans elsewhere.
pub fn associate(
    scans: &[Scans<'_>],
    motions: &[Box<dyn Motion>],
    mountings: &[BodyFromScanner],
    late_s: &[f64],
    reference: &ReferenceCells,
    gates: &Gates,
) -> Association {
    // Of each drive and scanner.
    let placed: Vec<Vec<Vec<Placed>>> = scans
        .iter()
        .zip(motions)
        .map(|(scans, motion)| {
            let scanners = 0..mountings.len();
            let of = |s: usize| place(scans, motion.as_ref(), s, &mountings[s], late_s[s]);
            scanners.into_par_iter().map(of).collect()
        })
        .collect();
    let mut cells: VoxelMap<VoxelKey, Sums> = VoxelMap::default();
    for point in placed.iter().flatten().flatten() {
        let key = voxel_key(&point.world_m, gates.size_m);
        let offset = point.world_m - centre_of(&key, gates.size_m);
        cells.entry(key).or_default().add(&offset);
    }
    let columns = columns(&cells, reference, gates.size_m);
    let mut patches: VoxelMap<VoxelKey, u32> = VoxelMap::default();
    let mut surfels: Vec<Surfel> = Vec::new();
    let mut by_key: VoxelMap<VoxelKey, u32> = VoxelMap::default();
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
            by_key.insert(*key, surfels.len() as u32);
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
                (&surfels, &by_key),
                gates,
                &mut tallies,
            )
        })
        .collect();
    let regions = regions(&surfels, &tallies, gates);
    for (surfel, tally) in surfels.iter_mut().zip(&tallies) {
        if tally.free > 0.0 {
            surfel.scatter_m = (tally.squares_m2 / tally.free).sqrt();
        }
        let sizes = surfel.scatter_m / gates.size_m;
        let class = CLASS_SIZES.iter().position(|most| sizes <= *most);
        surfel.class = class.unwrap_or(CLASSES - 1);
    }
    find_coverage(&surfels, mountings.len(), &mut drives);
    drop_unseen(&mut surfels, &mut drives);
    Association {
        surfels,
        drives,
        patches: patches.len(),
        regions,
    }
}

/// Places the points of one scanner.
fn place(
    scans: &Scans<'_>,
    motion: &dyn Motion,
    scanner: usize,
    mounting: &BodyFromScanner,
    late_s: f64,
) -> Vec<Placed> {
    let sample = scans.samples[scanner];
    let mut profiles: Vec<Option<(u32, WorldFromBody)>> = vec![None; sample.profiles.len()];
    let mut next = 0;
    while next < profiles.len() {
        let time_of = |profile: usize| sample.profiles[profile].time_s - late_s;
        let Some(step) = motion.step_at(time_of(next)) else {
            next += 1;
            continue;
        };
        let poses = motion.poses(step);
        while next < profiles.len() && motion.step_at(time_of(next)) == Some(step) {
            profiles[next] = Some((step as u32, poses.at(time_of(next)).world_from_body));
            next += 1;
        }
    }
    let points = (0..).zip(&sample.points);
    let placed = points.filter_map(|(index, point): (u32, _)| {
        let (step, pose) = profiles[point.profile as usize]?;
        Some(Placed {
            world_m: pose.map(&mounting.map(&point.position_m)),
            step,
            point: index,
        })
    });
    placed.collect()
}

/// Voxels one above the other that one surface may cross, along the axis that is nearest to its
/// normal. A voxel alone would cut the noise of a surface close to its face in two, and each half
/// would keep its points whatever the mountings.
fn columns(
    cells: &VoxelMap<VoxelKey, Sums>,
    reference: &ReferenceCells,
    size_m: f64,
) -> Vec<Vec<VoxelKey>> {
    let mut keys: Vec<VoxelKey> = cells.keys().copied().collect();
    keys.par_sort_unstable();
    let axes: Vec<Option<usize>> = keys
        .par_iter()
        .map(|key| {
            let mut sums = cells[key];
            if let Some(known) = reference.cells.get(key) {
                sums.combine(known, &Vec3::zeros());
            }
            let tensor = (sums.count >= MIN_POINTS).then(|| sums.tensor(&centre_of(key, size_m)));
            Some(tensor?.normal()?.iamax())
        })
        .collect();
    let known: VoxelMap<VoxelKey, usize> = keys
        .iter()
        .zip(&axes)
        .filter_map(|(key, axis)| Some((*key, (*axis)?)))
        .collect();
    // A slice with few points belongs to the surface that a neighbour across its face holds.
    let adopted = |key: &VoxelKey| {
        (0..3).rev().find(|&axis| {
            [-1, 1].into_iter().any(|side| {
                let mut next = *key;
                next[axis] += side;
                known.get(&next) == Some(&axis)
            })
        })
    };
    let mut sorted: Vec<(usize, i64, i64, i64)> = keys
        .iter()
        .zip(&axes)
        .filter_map(|(key, axis)| {
            let axis = axis.or_else(|| adopted(key))?;
            Some((axis, key[(axis + 1) % 3], key[(axis + 2) % 3], key[axis]))
        })
        .collect();
    sorted.par_sort_unstable();
    let next_to = |a: &(usize, i64, i64, i64), b: &(usize, i64, i64, i64)| {
        (a.0, a.1, a.2, a.3 + 1) == (b.0, b.1, b.2, b.3)
    };
    sorted
        .chunk_by(next_to)
        .map(|run| {
            let key = |&(axis, u, v, layer): &(usize, i64, i64, i64)| {
                let mut key = [0; 3];
                (key[axis], key[(axis + 1) % 3], key[(axis + 2) % 3]) = (layer, u, v);
                key
            };
            run.iter().map(key).collect()
        })
        .collect()
}

/// The sums of all voxels of a column about the centre of its first.
fn sums_of(column: &[VoxelKey], cells: &VoxelMap<VoxelKey, Sums>, size_m: f64) -> Sums {
    let centre = centre_of(&column[0], size_m);
    let mut sums = Sums::default();
    for key in column {
        if let Some(own) = cells.get(key) {
            sums.combine(own, &(centre_of(key, size_m) - centre));
        }
    }
    sums
}

/// The surfaces in a column of voxels: one, or where it holds no single surface, as at the edge of a
/// board above soil, those that lie within one voxel and clear of its faces.
fn surfaces<'a>(
    column: &'a [VoxelKey],
    scanned: &VoxelMap<VoxelKey, Sums>,
    reference: &ReferenceCells,
    gates: &Gates,
) -> Vec<(&'a [VoxelKey], Surfel)> {
    if let Some(surfel) = fit(column, scanned, reference, gates) {
        return vec![(column, surfel)];
    }
    if column.len() == 1 {
        return Vec::new();
    }
    let axis = (0..3).find(|&i| column[0][i] != column[1][i]).unwrap_or(2);
    let clear = |key: &&'a [VoxelKey]| {
        let of = |cells: &VoxelMap<VoxelKey, Sums>| {
            let sums = sums_of(key, cells, gates.size_m);
            let mean = sums.first[axis] / sums.count;
            let variance = sums.second[(axis, axis)] / sums.count - mean * mean;
            let reach_m = mean.abs() + CLEAR_SIGMAS * variance.max(0.0).sqrt();
            sums.count == 0.0 || reach_m < 0.5 * gates.size_m
        };
        of(scanned) && of(&reference.cells)
    };
    let single = column.chunks(1).filter(clear);
    single
        .filter_map(|key| Some((key, fit(key, scanned, reference, gates)?)))
        .collect()
}

/// The surfel of a run of voxels, if there is a surface.
fn fit(
    column: &[VoxelKey],
    scanned: &VoxelMap<VoxelKey, Sums>,
    reference: &ReferenceCells,
    gates: &Gates,
) -> Option<Surfel> {
    let reference = sums_of(column, &reference.cells, gates.size_m);
    let scanned = sums_of(column, scanned, gates.size_m);
    let reference = Some(&reference);
    let reference = reference.filter(|sums| sums.count >= MIN_POINTS);
    let sums = reference.unwrap_or(&scanned);
    if sums.count < MIN_POINTS {
        return None;
    }
    let tensor = sums.tensor(&centre_of(&column[0], gates.size_m));
    let eigen = tensor.eigen();
    let width_m = eigen.values.y.sqrt();
    let roughness_m = eigen.values.z.sqrt();
    let allowed_m = MAX_THICKNESS * width_m
        + if reference.is_some() {
            0.0
        } else {
            gates.misfit_m
        };
    if width_m < MIN_WIDTH * gates.size_m || roughness_m > allowed_m {
        return None;
    }
    let axis = |i: usize| eigen.vectors.column(i).into_owned();
    let slope = |value: f64| roughness_m / (sums.count * value).sqrt();
    Some(Surfel {
        centre_m: tensor.mean,
        axes: [axis(2), axis(0), axis(1)],
        roughness_m,
        scatter_m: roughness_m,
        class: 0,
        is_checked: reference.is_some(),
        prior: reference.map(|_| ReferencePlane {
            sigma: [
                roughness_m / sums.count.sqrt(),
                slope(eigen.values.x),
                slope(eigen.values.y),
            ],
            patch: 0,
        }),
    })
}

/// The rows of a drive: its points sorted by step, surfel and scanner. Adds them to the tallies of the
/// surfels.
fn rows_of(
    placed: &[Vec<Placed>],
    scans: &Scans<'_>,
    steps: usize,
    (surfels, by_key): (&[Surfel], &VoxelMap<VoxelKey, u32>),
    gates: &Gates,
    tallies: &mut [Tally],
) -> DriveRows {
    // Step, surfel, scanner, point, and the bits of its distance from the surfel.
    let mut seen: Vec<(u32, u32, u32, u32, u32)> = Vec::new();
    for (scanner, points) in placed.iter().enumerate() {
        let found = points.par_iter().filter_map(|point| {
            let surfel = *by_key.get(&voxel_key(&point.world_m, gates.size_m))?;
            let of = &surfels[surfel as usize];
            let distance_m = of.axes[0].dot(&(point.world_m - of.centre_m));
            (distance_m.abs() < NEAR_SIZES * gates.size_m).then_some((
                point.step,
                surfel,
                scanner as u32,
                point.point,
                (distance_m as f32).to_bits(),
            ))
        });
        seen.par_extend(found);
    }
    seen.par_sort_unstable();
    let mut rows = DriveRows {
        step_start: vec![0; steps + 1],
        ..DriveRows::default()
    };
    let mut group: Vec<(u32, u32, u32, u32, u32)> = Vec::new();
    for near in seen.chunk_by(|a, b| (a.0, a.1, a.2) == (b.0, b.1, b.2)) {
        let (step, surfel, scanner, ..) = near[0];
        let distance_m = |bits: u32| f64::from(f32::from_bits(bits));
        let of_surfel = &mut tallies[surfel as usize];
        of_surfel.near += near.len() as f64;
        of_surfel.distance_m += near.iter().map(|seen| distance_m(seen.4)).sum::<f64>();
        let sigma_m = surfels[surfel as usize].roughness_m.hypot(gates.misfit_m);
        group.clear();
        let within = |bits: u32| distance_m(bits).abs() < GATE_SIGMAS * sigma_m;
        group.extend(near.iter().filter(|seen| within(seen.4)).copied());
        if group.len() < MIN_ROW_POINTS {
            continue;
        }
        let sample = scans.samples[scanner as usize];
        let distances = || group.iter().map(|seen| distance_m(seen.4));
        let count = group.len() as f64;
        let mean = distances().sum::<f64>() / count;
        of_surfel.squares_m2 += distances().map(|d| (d - mean).powi(2)).sum::<f64>();
        of_surfel.free += count - 1.0;
        rows.step_start[step as usize + 1] += 1;
        rows.rows.push(ScanRow {
            surfel,
            scanner,
            first: rows.points.len() as u32,
            count: group.len() as u32,
            coverage: 0,
            depth_m: 0.0,
        });
        rows.points.extend(group.iter().map(|(.., point, _)| {
            let point = &sample.points[*point as usize];
            RowPoint {
                profile: point.profile,
                position_m: point.position_m,
            }
        }));
    }
    for step in 0..steps {
        rows.step_start[step + 1] += rows.step_start[step];
    }
    rows
}

/// Finds how much of its surfel each row saw: its share of the points of the fullest row of the
/// scanner.
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

/// The regions whose scans lie off the reference by more than the others do.
fn regions(surfels: &[Surfel], tallies: &[Tally], gates: &Gates) -> Vec<Region> {
    let mut cells: VoxelMap<VoxelKey, Vec<(Vec3, f64)>> = VoxelMap::default();
    for (surfel, tally) in surfels.iter().zip(tallies) {
        if surfel.prior.is_some() && tally.near >= MIN_POINTS {
            let up = if surfel.axes[0].z < 0.0 { -1.0 } else { 1.0 };
            let key = voxel_key(&surfel.centre_m, REGION_SIZES * gates.size_m);
            let offset_m = up * tally.distance_m / tally.near;
            cells
                .entry(key)
                .or_default()
                .push((surfel.centre_m, offset_m));
        }
    }
    let mut keys: Vec<&VoxelKey> = cells.keys().collect();
    keys.sort_unstable();
    let medians: Vec<Region> = keys
        .into_iter()
        .map(|key| &cells[key])
        .filter(|members| members.len() >= MIN_REGION)
        .filter_map(|members| {
            let count = members.len() as f64;
            Some(Region {
                centre_m: members.iter().map(|member| member.0).sum::<Vec3>() / count,
                offset_m: median(members.iter().map(|member| member.1))?,
                surfels: members.len(),
            })
        })
        .collect();
    let spread = median(medians.iter().map(|region| region.offset_m.abs()));
    let limit_m = spread.map_or(f64::INFINITY, |m| REGION_SIGMAS * SIGMAS_PER_MAD * m);
    let limit_m = limit_m.max(LEAST_REGION_SIZES * gates.size_m);
    let off = |region: &Region| region.offset_m.abs() > limit_m;
    medians.into_iter().filter(off).collect()
}

/// Leaves out surfels that nothing checks, and their rows.
fn drop_unseen(surfels: &mut Vec<Surfel>, drives: &mut [DriveRows]) {
    let mut seen = vec![0_u32; surfels.len()];
    // Drive, last step and scanner that saw each.
    let mut before = vec![None; surfels.len()];
    for (number, drive) in drives.iter().enumerate() {
        for step in 0..drive.step_start.len() - 1 {
            for row in drive.of_step(step) {
                let surfel = row.surfel as usize;
                seen[surfel] += 1;
                let again = before[surfel].is_some_and(|(drive, last, scanner)| {
                    drive != number || step > last + PASS_STEPS || scanner != row.scanner
                });
                surfels[surfel].is_checked |= again;
                before[surfel] = Some((number, step, row.scanner));
            }
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
        let mut kept = Vec::with_capacity(drive.rows.len());
        let mut step_start = vec![0];
        for step in 0..drive.step_start.len() - 1 {
            kept.extend(drive.of_step(step).iter().filter_map(|row| {
                let surfel = number[row.surfel as usize]?;
                Some(ScanRow { surfel, ..*row })
            }));
            step_start.push(kept.len() as u32);
        }
        drive.rows = kept;
        drive.step_start = step_start;
    }
    let mut keep = number.iter();
    surfels.retain(|_| keep.next().is_some_and(Option::is_some));
}
