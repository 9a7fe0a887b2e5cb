//! Clouds larger than memory compared tile by tile, with the numbers of one piece.

use std::path::Path;
use std::time::Instant;

use super::Comparison;
use crate::cloud::tiles::Rectangle;
use crate::comparison::{CoreDistance, IndexedClouds, M3c2, Normals, core_indices, reach_m};
use crate::error::Result;
use crate::format::{self, CorePoints};
use crate::geometry::Vec3;
use crate::output::Staging;
use crate::pipeline::tile_store::TileStore;
use crate::progress::{Progress, Silent, Stage};

/// A comparison by tiles, and what its stages took, seconds.
pub(super) struct Tiled {
    pub(super) found: M3c2,
    pub(super) tiles: usize,
    pub(super) read_s: f64,
    pub(super) index_s: f64,
    pub(super) compare_s: f64,
}

/// Sorts both clouds into tiles on disk and compares them there: each tile with all points of both
/// clouds that matter to its core points. Only results, and core points from a file, are kept in
/// memory for all tiles.
pub(super) fn compare(
    comparison: &Comparison,
    core: Option<&CorePoints>,
    normals: Normals<'_>,
    tile_points: usize,
    staging: &Staging,
    progress: &dyn Progress,
) -> Result<Tiled> {
    let start = Instant::now();
    let store = |cloud: &Path, name| store(cloud, &staging.path(name), tile_points, progress);
    let reference = store(&comparison.reference, "reference-tiles")?;
    let compared = store(&comparison.cloud, "compared-tiles")?;
    let mut tiled = Tiled {
        found: M3c2::default(),
        tiles: reference.tiles().rectangles().len(),
        read_s: start.elapsed().as_secs_f64(),
        index_s: 0.0,
        compare_s: 0.0,
    };
    let total = (0..tiled.tiles).map(|tile| reference.count(tile)).sum();
    let stage = progress.stage("comparing the clouds (M3C2), by tiles", total);
    solve(
        comparison,
        core,
        normals,
        [&reference, &compared],
        &mut tiled,
        &stage,
    )?;
    drop(stage);
    Ok(tiled)
}

fn solve(
    comparison: &Comparison,
    core: Option<&CorePoints>,
    normals: Normals<'_>,
    [reference, compared]: [&TileStore; 2],
    tiled: &mut Tiled,
    stage: &Stage<'_>,
) -> Result<()> {
    let settings = &comparison.settings;
    let (low, high) = reference.extent();
    // Coordinates that are rounded when sides are moved must not cost a point.
    let wide = |margin_m: f64| margin_m * (1.0 + 1e-6) + 1e-12 * low.amax().max(high.amax());
    let mut found: Vec<(u64, CoreDistance)> = Vec::new();
    for (tile, rectangle) in reference.tiles().rectangles().iter().enumerate() {
        let start = Instant::now();
        let (places, points) = match core {
            Some(core) => inside(&core.points, rectangle),
            None => {
                // A voxel that reaches into the tile is known with all its points.
                let near = reference.within(&rectangle.grown(wide(settings.core_spacing_m)))?;
                thinned(&near.indices, &near.points, rectangle, comparison)
            }
        };
        let own_normals = match normals {
            Normals::Given(normals) => places
                .iter()
                .map(|&place| normals[place as usize])
                .collect(),
            _ => Vec::new(),
        };
        let normals = match normals {
            Normals::Given(_) => Normals::Given(&own_normals),
            other => other,
        };
        if !points.is_empty() {
            let region = rectangle.grown(wide(reach_m(settings)));
            let before = reference.within(&region)?.points;
            let after = compared.within(&region)?.points;
            let clouds = IndexedClouds::of_pieces(&before, &after, normals, settings)?;
            tiled.index_s += start.elapsed().as_secs_f64();
            let start = Instant::now();
            let distances = clouds.distances(&points, normals, &Silent)?;
            found.extend(places.into_iter().zip(distances.core));
            tiled.compare_s += start.elapsed().as_secs_f64();
        }
        stage.advance(reference.count(tile))?;
    }
    found.sort_unstable_by_key(|(place, _)| *place);
    tiled.found.core = found.into_iter().map(|(_, distance)| distance).collect();
    Ok(())
}

/// Places and points of those of `points` that lie in a tile.
fn inside(points: &[Vec3], tile: &Rectangle) -> (Vec<u64>, Vec<Vec3>) {
    let own = (0u64..)
        .zip(points)
        .filter(|(_, point)| tile.contains(point));
    own.map(|(place, point)| (place, *point)).unzip()
}

/// Places in the reference and points of the core points in a tile, thinned from `points`.
fn thinned(
    indices: &[u64],
    points: &[Vec3],
    tile: &Rectangle,
    comparison: &Comparison,
) -> (Vec<u64>, Vec<Vec3>) {
    let kept = core_indices(points, &comparison.settings);
    let own = kept
        .into_iter()
        .map(|at| at as usize)
        .filter(|&at| tile.contains(&points[at]));
    own.map(|at| (indices[at], points[at])).unzip()
}

fn store(
    cloud: &Path,
    folder: &Path,
    tile_points: usize,
    progress: &dyn Progress,
) -> Result<TileStore> {
    // Other formats are read whole.
    let (count, points) = match format::points_named(cloud)? {
        Some(count) => (count, None),
        None => {
            let points = format::read_cloud(cloud)?.points;
            (points.len() as u64, Some(points))
        }
    };
    let _stage = progress.stage("sorting a cloud into tiles", count);
    match points {
        Some(points) => TileStore::of_points(folder, tile_points, &points, progress),
        None => TileStore::of_file(folder, tile_points, cloud, progress),
    }
}
