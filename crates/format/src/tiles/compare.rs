//! M3C2 between cloud files of any size; the results do not depend on whether the clouds fit in memory.

use std::path::PathBuf;
use std::time::Instant;

use super::plane::Rectangle;
use super::source::CloudSource;
use super::stage::stage;
use super::store::TileStore;
use crate::comparison::{
    ComparisonSettings, Computed, CoreDistance, IndexedClouds, M3c2, MeasuredScales, Normals,
    OpenSettings, StreamedCloud, core_indices, core_points, reach_m,
};
use crate::error::Result;
use crate::format::memory::Budget;
use crate::format::{self, CorePoints};
use crate::geometry::Vec3;
use crate::output::Staging;
use crate::progress::{Progress, Silent};

/// Number of points measured between two looks at whether to stop.
const CHUNK: usize = 100_000;
/// Memory for each point of the two clouds in one piece, bytes: as read, as indexed, and during
/// indexing.
const BYTES_A_POINT: u64 = 160;
/// Memory for each point of a tile, bytes: the points of its halo and of the other cloud are loaded as well.
const BYTES_A_TILE_POINT: u64 = 4 * BYTES_A_POINT;

/// The files of a comparison, and its settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The cloud to assess.
    pub cloud: PathBuf,
    /// The cloud to compare it with.
    pub reference: PathBuf,
    /// A file of core points; by default they are the reference, thinned.
    pub core: Option<PathBuf>,
    /// The source of the normals.
    pub normals: NormalSource,
    /// Radii and other settings. Scales that are not given are measured.
    pub settings: OpenSettings,
    /// Memory limit, bytes; `None` for half of the free memory. Clouds that fit are compared in one
    /// piece, larger ones tile by tile; the results are the same. About 150 MB, and 20 MB per
    /// thread while a file is read, are used in any case; results and core points from a file are
    /// kept in memory, and formats other than LAS and LAZ are read whole.
    pub memory_bytes: Option<u64>,
}

impl Comparison {
    /// The input files.
    pub fn inputs(&self) -> Vec<PathBuf> {
        let mut inputs = vec![self.cloud.clone(), self.reference.clone()];
        inputs.extend(self.core.clone());
        inputs
    }
}

/// The source of the normals of the core points.
#[derive(Debug, Clone, PartialEq)]
pub enum NormalSource {
    /// The file of core points if it contains normals, else the reference.
    Core {
        /// Of normals computed from the reference.
        orientation: Orientation,
    },
    /// The reference, even if the file of core points contains normals.
    Reference {
        /// Of the normals.
        orientation: Orientation,
    },
    /// One direction for all.
    Fixed(Vec3),
}

/// Where computed normals point to.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Orientation {
    /// Towards the nearest of the scanners' places in the file of the reference, else in that of the
    /// cloud; if neither names one, up.
    #[default]
    Scanners,
    /// Along a direction: non-zero, of any length.
    Direction(Vec3),
    /// Towards the nearest of these places, metres; at least one.
    SeenFrom(Vec<Vec3>),
}

/// A comparison, and the times of its stages.
#[derive(Debug)]
pub struct Compared {
    /// The result at each core point.
    pub m3c2: M3c2,
    /// The settings that were used.
    pub settings: ComparisonSettings,
    /// Where computed normals point to: a direction or places; `None` if none were computed.
    pub orientation: Option<Orientation>,
    /// What the scales were measured from; `None` if all were given.
    pub measured: Option<MeasuredScales>,
    /// Number of tiles; 1 if compared in one piece.
    pub tiles: usize,
    /// The memory limit, bytes.
    pub memory_bytes: u64,
    /// Time to read the clouds and select core points, seconds.
    pub read_s: f64,
    /// Time to index the clouds, seconds.
    pub index_s: f64,
    /// Time to compute the distances, seconds.
    pub compare_s: f64,
}

/// Compares two cloud files. Data that do not fit in memory go to `staging`.
///
/// # Errors
/// Clouds that cannot be read; settings that [`crate::comparison::m3c2()`] refuses.
pub fn compare(
    comparison: &Comparison,
    staging: &Staging,
    progress: &dyn Progress,
) -> Result<Compared> {
    let start = Instant::now();
    let budget = Budget::new(comparison.memory_bytes);
    let open = |path| CloudSource::open(path, progress);
    let clouds = [open(&comparison.reference)?, open(&comparison.cloud)?];
    let core = comparison.core.as_deref().map(format::read_core_points);
    let core = core.transpose()?;
    let mut work = Compared {
        m3c2: M3c2::default(),
        settings: comparison.settings.closed(None),
        orientation: orientation_of(comparison, &clouds, core.as_ref())?,
        measured: None,
        tiles: 1,
        memory_bytes: budget.bytes,
        read_s: 0.0,
        index_s: 0.0,
        compare_s: 0.0,
    };
    let points: u64 = clouds.iter().map(CloudSource::len).sum();
    if points <= budget.points(BYTES_A_POINT).min(u64::from(u32::MAX)) {
        in_one_piece(comparison, clouds, core, &mut work, progress)?;
    } else {
        measure(
            comparison,
            StreamedCloud {
                count: clouds[0].len(),
                points: &mut |each| clouds[0].stream(progress, each),
            },
            StreamedCloud {
                count: clouds[1].len(),
                points: &mut |each| clouds[1].stream(progress, each),
            },
            &mut work,
            progress,
        )?;
        let folders = ["reference-tiles", "compared-tiles"].map(|name| staging.path(name));
        let tile_points = budget.tile_points(BYTES_A_TILE_POINT);
        let [reference, compared] = clouds;
        let stores = [
            TileStore::of(&reference, &folders[0], tile_points, progress)?,
            TileStore::of(&compared, &folders[1], tile_points, progress)?,
        ];
        drop((reference, compared));
        work.tiles = stores[0].tiles().rectangles().len();
        let total = (0..work.tiles).map(|tile| stores[0].count(tile)).sum();
        stage(
            progress,
            "comparing the clouds (M3C2), by tiles",
            total,
            || by_tiles(comparison, core.as_ref(), &stores, &mut work, progress),
        )?;
    }
    work.read_s = start.elapsed().as_secs_f64() - work.index_s - work.compare_s;
    Ok(work)
}

/// Measures the scales that are needed and not given, which reads each cloud three times.
fn measure(
    comparison: &Comparison,
    reference: StreamedCloud<'_>,
    compared: StreamedCloud<'_>,
    work: &mut Compared,
    progress: &dyn Progress,
) -> Result<()> {
    let computed = Computed {
        core_points: comparison.core.is_none(),
        normals: work.orientation.is_some(),
    };
    if !comparison.settings.scales.lack(computed) {
        return Ok(());
    }
    let total = 3 * (reference.count + compared.count);
    let name = "measuring the spacing of the points";
    let (measured, _) = stage(progress, name, total, || {
        MeasuredScales::of(reference, compared)
    })?;
    work.settings = comparison.settings.closed(measured.as_ref());
    work.measured = measured;
    Ok(())
}

fn in_one_piece(
    comparison: &Comparison,
    clouds: [CloudSource; 2],
    core: Option<CorePoints>,
    work: &mut Compared,
    progress: &dyn Progress,
) -> Result<()> {
    let (reference, compared) = (clouds[0].points(progress)?, clouds[1].points(progress)?);
    let in_pieces = |points: &[Vec3], each: &mut dyn FnMut(&[Vec3]) -> Result<()>| {
        points.chunks(CHUNK).try_for_each(|piece| {
            each(piece)?;
            progress.advance(piece.len() as u64);
            progress.check()
        })
    };
    measure(
        comparison,
        StreamedCloud {
            count: clouds[0].len(),
            points: &mut |each| in_pieces(&reference, each),
        },
        StreamedCloud {
            count: clouds[1].len(),
            points: &mut |each| in_pieces(&compared, each),
        },
        work,
        progress,
    )?;
    let settings = &work.settings.clone();
    let core = core.unwrap_or_else(|| CorePoints {
        points: core_points(&reference, settings),
        normals: Vec::new(),
    });
    let orientation = work.orientation.clone();
    let normals = normals_of(comparison, Some(&core), orientation.as_ref(), progress);
    let (indexed, seconds) = stage(progress, "indexing the clouds", 0, || {
        IndexedClouds::new(&reference, &compared, normals, settings)
    })?;
    work.index_s = seconds;
    drop((reference, compared));
    drop(clouds);
    let total = core.points.len() as u64;
    let (m3c2, seconds) = stage(progress, "comparing the clouds (M3C2)", total, || {
        indexed.distances(&core.points, normals, progress)
    })?;
    work.compare_s = seconds;
    work.m3c2 = m3c2;
    Ok(())
}

/// Compares each tile of the reference with all points of both clouds that affect its core points.
/// Only results, and core points from a file, are kept in memory for all tiles.
fn by_tiles(
    comparison: &Comparison,
    core: Option<&CorePoints>,
    [reference, compared]: &[TileStore; 2],
    work: &mut Compared,
    progress: &dyn Progress,
) -> Result<()> {
    let orientation = work.orientation.clone();
    let normals = normals_of(comparison, core, orientation.as_ref(), progress);
    let settings = &work.settings.clone();
    let (low, high) = reference.extent();
    // Moving the sides rounds them, which must not lose a point.
    let wide = |margin_m: f64| margin_m * (1.0 + 1e-6) + 1e-12 * low.amax().max(high.amax());
    let mut results: Vec<(u64, CoreDistance)> = Vec::new();
    for (tile, rectangle) in reference.tiles().rectangles().iter().enumerate() {
        let start = Instant::now();
        let (places, points) = match core {
            Some(core) => inside(&core.points, rectangle),
            None => {
                // Loads all points of every voxel that reaches into the tile.
                let near = reference.within(&rectangle.widened(wide(settings.core_spacing_m)))?;
                thinned(&near.indices, &near.points, rectangle, settings)
            }
        };
        let tile_normals = match normals {
            Normals::Given(normals) => places
                .iter()
                .map(|&place| normals[place as usize])
                .collect(),
            _ => Vec::new(),
        };
        let normals = match normals {
            Normals::Given(_) => Normals::Given(&tile_normals),
            other => other,
        };
        if !points.is_empty() {
            let region = rectangle.widened(wide(reach_m(settings)));
            let before = reference.within(&region)?.points;
            let after = compared.within(&region)?.points;
            let clouds = IndexedClouds::of_pieces(&before, &after, normals, settings)?;
            work.index_s += start.elapsed().as_secs_f64();
            let start = Instant::now();
            let distances = clouds.distances(&points, normals, &Silent)?;
            results.extend(places.into_iter().zip(distances.core));
            work.compare_s += start.elapsed().as_secs_f64();
        }
        progress.advance(reference.count(tile));
        progress.check()?;
    }
    results.sort_unstable_by_key(|(place, _)| *place);
    work.m3c2.core = results.into_iter().map(|(_, distance)| distance).collect();
    Ok(())
}

/// Those of `points` that lie in a tile, with their indices.
fn inside(points: &[Vec3], tile: &Rectangle) -> (Vec<u64>, Vec<Vec3>) {
    let in_tile = (0u64..)
        .zip(points)
        .filter(|(_, point)| tile.contains(point));
    in_tile.map(|(place, point)| (place, *point)).unzip()
}

/// The core points in a tile, thinned from `points`, with their indices in the reference.
fn thinned(
    indices: &[u64],
    points: &[Vec3],
    tile: &Rectangle,
    settings: &ComparisonSettings,
) -> (Vec<u64>, Vec<Vec3>) {
    let in_tile = core_indices(points, settings)
        .into_iter()
        .map(|at| at as usize)
        .filter(|&at| tile.contains(&points[at]));
    in_tile.map(|at| (indices[at], points[at])).unzip()
}

/// The core points' own normals, if they are to be used.
fn given_normals<'a>(comparison: &Comparison, core: Option<&'a CorePoints>) -> Option<&'a [Vec3]> {
    let normals = core.map(|core| &core.normals[..]);
    let are_taken = matches!(comparison.normals, NormalSource::Core { .. });
    normals.filter(|normals| are_taken && !normals.is_empty())
}

/// Where the normals point to, if they are computed.
fn orientation_of(
    comparison: &Comparison,
    clouds: &[CloudSource; 2],
    core: Option<&CorePoints>,
) -> Result<Option<Orientation>> {
    let (NormalSource::Core { orientation } | NormalSource::Reference { orientation }) =
        &comparison.normals
    else {
        return Ok(None);
    };
    if given_normals(comparison, core).is_some() {
        return Ok(None);
    }
    if *orientation != Orientation::Scanners {
        return Ok(Some(orientation.clone()));
    }
    for cloud in clouds {
        let places = cloud.viewpoints_m()?;
        if !places.is_empty() {
            return Ok(Some(Orientation::SeenFrom(places)));
        }
    }
    Ok(Some(Orientation::Direction(Vec3::z())))
}

fn normals_of<'a>(
    comparison: &'a Comparison,
    core: Option<&'a CorePoints>,
    orientation: Option<&'a Orientation>,
    progress: &dyn Progress,
) -> Normals<'a> {
    if let Some(given) = given_normals(comparison, core) {
        progress.say("using the normals in the core point file");
        return Normals::Given(given);
    }
    match (&comparison.normals, orientation) {
        (NormalSource::Fixed(direction), _) => Normals::Fixed(*direction),
        (_, Some(Orientation::SeenFrom(places))) => Normals::SeenFrom(places),
        (_, Some(Orientation::Direction(orientation))) => Normals::MostPlanar {
            orientation: *orientation,
        },
        (_, Some(Orientation::Scanners) | None) => Normals::UPWARDS,
    }
}
