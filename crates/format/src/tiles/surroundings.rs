//! The neighbourhood of every point of a cloud on disk, computed tile by tile, with the same results
//! as for a cloud in memory.
//!
//! Each tile is processed with a halo. The k nearest neighbours of a point are correct if the farthest
//! of them is nearer than the border of the loaded region. Points that fail this test are repeated with
//! a wider halo, and those that still fail (outliers, whose neighbours are far away) are deferred:
//! for them the tiles are visited in order, and the k nearest from each relevant tile are merged
//! into those found so far, ties ordered by index in the cloud.

use rayon::prelude::*;

use super::store::TileStore;
use crate::cloud::{NeighbourIndex, Neighbourhood, Surroundings};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::progress::{Progress, Silent};

/// Relative tolerance of every comparison of distances, far above the rounding error.
const SLACK: f64 = 1e-9;
/// First halo in units of the radius that contains k points at the tile's mean density.
const FIRST_HALO: f64 = 3.0;
/// Ratio of the next halo to the last.
const WIDER: f64 = 4.0;
/// Number of halos tried before points are deferred.
const TRIES: usize = 3;
/// If at most this many points are left, they are deferred without another attempt: loading a wider
/// halo would cost more.
const FEW: usize = 100;
/// Most points loaded, in units of those of a full tile.
const MOST_LOADED: usize = 2;
/// Most neighbours in memory for deferred points, in units of the points of a full tile.
const MOST_DEFERRED: usize = 4;

/// A point whose neighbours may lie outside the loaded region.
#[derive(Debug, Clone, Copy)]
struct Pending {
    index: u64,
    point: Vec3,
    /// Upper bound on the distance of its neighbours, metres.
    bound_m: f64,
}

/// Size of the work on a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TilingSummary {
    /// Number of tiles.
    pub tiles: usize,
    /// Number of deferred points.
    pub deferred: u64,
}

/// Calls `each` with the neighbourhood of every point of the store, and `take` with the index of the
/// point in the cloud and the result of `each`, in arbitrary order. The results do not depend on
/// the tiles. Memory grows with `most_points`, which should be that of the store, and, for a given
/// radius, with the number of points in a tile widened by the radius.
///
/// `progress` advances by one for each point; the caller begins and ends the stage.
///
/// # Errors
/// A file of the store that cannot be read; errors of `take`.
pub fn surroundings<T: Send + Sync + Clone>(
    store: &TileStore,
    neighbourhood: Neighbourhood,
    most_points: usize,
    progress: &dyn Progress,
    each: impl Fn(&Surroundings) -> T + Sync,
    mut take: impl FnMut(u64, T) -> Result<()>,
) -> Result<TilingSummary> {
    let mut deferred = Vec::new();
    let mut deferred_count = 0;
    let batch = match neighbourhood {
        Neighbourhood::Nearest(k) => (MOST_DEFERRED * most_points / k.max(1)).max(1),
        Neighbourhood::Within(_) => usize::MAX,
    };
    for tile in 0..store.tiles().rectangles().len() {
        let left = process_tile(
            store,
            tile,
            neighbourhood,
            most_points,
            progress,
            &each,
            &mut take,
        )?;
        deferred_count += left.len() as u64;
        deferred.extend(left);
        while deferred.len() >= batch {
            let rest = deferred.split_off(batch);
            process_deferred(store, &deferred, neighbourhood, &each, &mut take)?;
            deferred = rest;
        }
    }
    process_deferred(store, &deferred, neighbourhood, &each, &mut take)?;
    Ok(TilingSummary {
        tiles: store.tiles().rectangles().len(),
        deferred: deferred_count,
    })
}

/// Processes the points of a tile, and returns those whose neighbours may lie outside the loaded region.
fn process_tile<T: Send + Sync + Clone>(
    store: &TileStore,
    tile: usize,
    neighbourhood: Neighbourhood,
    most_points: usize,
    progress: &dyn Progress,
    each: &(impl Fn(&Surroundings) -> T + Sync),
    take: &mut impl FnMut(u64, T) -> Result<()>,
) -> Result<Vec<Pending>> {
    let tile_points = store.count(tile) as usize;
    let rectangle = store.tiles().rectangles()[tile];
    let (low, high) = store.extent();
    let is_radius = matches!(neighbourhood, Neighbourhood::Within(_));
    let most_loaded = if is_radius {
        usize::MAX
    } else {
        MOST_LOADED * most_points.max(tile_points)
    };
    let mut pending: Option<Vec<Pending>> = None;
    let mut halo_m = first_halo_m(store, tile, neighbourhood);
    for attempt in 0.. {
        let region = rectangle.widened(halo_m).open_beyond(&low, &high);
        let Some(loaded) = store.at_most(&region, most_loaded)? else {
            if pending.is_some() {
                break;
            }
            // The tile without a halo can always be loaded.
            halo_m = if attempt < TRIES { halo_m / WIDER } else { 0.0 };
            continue;
        };
        let is_first = pending.is_none();
        let wanted = pending.take().unwrap_or_else(|| {
            let all = loaded.indices.iter().zip(&loaded.points);
            all.filter(|(_, point)| rectangle.contains(point))
                .map(|(index, point)| Pending {
                    index: *index,
                    point: *point,
                    bound_m: f64::INFINITY,
                })
                .collect()
        });
        let queries: Vec<Vec3> = wanted.iter().map(|pending| pending.point).collect();
        let reported: &dyn Progress = if is_first { progress } else { &Silent };
        let results = index(&loaded.points, store).surroundings(
            &queries,
            neighbourhood,
            reported,
            |_, near| (each(near), near.reach_m),
        )?;
        let mut left = Vec::new();
        for (pending, (value, reach_m)) in wanted.into_iter().zip(results) {
            let depth_m = region.depth_m(&pending.point);
            if depth_m == f64::INFINITY || reach_m < depth_m * (1.0 - SLACK) {
                take(pending.index, value)?;
            } else {
                left.push(Pending {
                    bound_m: pending.bound_m.min(reach_m),
                    ..pending
                });
            }
        }
        let enough = left.is_empty() || left.len() <= FEW || attempt + 1 >= TRIES;
        if left.is_empty() || (enough && !is_radius) {
            return Ok(left);
        }
        pending = Some(left);
        halo_m *= WIDER;
    }
    Ok(pending.unwrap_or_default())
}

/// The initial halo.
fn first_halo_m(store: &TileStore, tile: usize, neighbourhood: Neighbourhood) -> f64 {
    let (low, high) = store.extent();
    let rectangle = store.tiles().rectangles()[tile];
    match neighbourhood {
        Neighbourhood::Within(radius) => {
            // Moving the sides rounds them, which must not lose a neighbour.
            radius * (1.0 + 1e-6) + 1e-12 * low.amax().max(high.amax())
        }
        Neighbourhood::Nearest(k) => {
            let side = |axis: usize| {
                rectangle.high[axis].min(high[axis]) - rectangle.low[axis].max(low[axis])
            };
            let (east, north) = (side(0).max(0.0), side(1).max(0.0));
            let share = k as f64 / store.count(tile).max(1) as f64;
            let radius = (share * east * north / std::f64::consts::PI).sqrt();
            FIRST_HALO * radius.max(share * east.max(north))
        }
    }
}

/// Processes deferred points by visiting all tiles that may contain their neighbours.
fn process_deferred<T: Send + Sync + Clone>(
    store: &TileStore,
    deferred: &[Pending],
    neighbourhood: Neighbourhood,
    each: &(impl Fn(&Surroundings) -> T + Sync),
    take: &mut impl FnMut(u64, T) -> Result<()>,
) -> Result<()> {
    let Neighbourhood::Nearest(k) = neighbourhood else {
        return Ok(());
    };
    // Squared distance, index in the cloud, point; nearest first.
    let mut best: Vec<Vec<(f64, u64, Vec3)>> = vec![Vec::new(); deferred.len()];
    for (tile, rectangle) in store.tiles().rectangles().iter().enumerate() {
        let matters = |(pending, best): (&Pending, &Vec<(f64, u64, Vec3)>)| {
            let limit_m = match best.last() {
                Some(last) if best.len() == k => pending.bound_m.min(last.0.sqrt()),
                _ => pending.bound_m,
            };
            rectangle.distance_m(&pending.point) <= limit_m * (1.0 + SLACK)
        };
        if store.count(tile) == 0 || !deferred.iter().zip(&best).any(matters) {
            continue;
        }
        let loaded = store.within(rectangle)?;
        let index = index(&loaded.points, store);
        deferred
            .par_iter()
            .zip(&mut best)
            .filter(|(pending, best)| matters((pending, best)))
            .for_each(|(pending, best)| {
                let near = index.nearest_with_distances(&pending.point, k);
                best.extend(near.map(|(squared, at, _)| {
                    let at = at as usize;
                    (squared, loaded.indices[at], loaded.points[at])
                }));
                best.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                best.truncate(k);
            });
    }
    for (pending, mut near) in deferred.iter().zip(best) {
        near.sort_unstable_by_key(|(_, index, _)| *index);
        let points: Vec<Vec3> = near.iter().map(|(_, _, point)| *point).collect();
        let query = [pending.point];
        let results =
            index(&points, store)
                .surroundings(&query, neighbourhood, &Silent, |_, near| each(near))?;
        for value in results {
            take(pending.index, value)?;
        }
    }
    Ok(())
}

/// An index over some points of a store, in the order of an index over the whole cloud.
fn index(points: &[Vec3], store: &TileStore) -> NeighbourIndex {
    let (low, high) = store.extent();
    NeighbourIndex::in_extent(points, &low, &high)
}
