//! Builds each index over a cloud, finds the k nearest neighbours of each of its points, and prints the
//! times as one JSON line per index.
//!
//! usage: neighbour-indices CLOUD THREADS K

use std::error::Error;
use std::num::NonZero;
use std::path::Path;
use std::time::Instant;

use boresight::cloud::{NeighbourIndex, Neighbourhood};
use boresight::geometry::Vec3;
use boresight::progress::Silent;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// Seconds to build an index and to query it, and the sum of the distances to each farthest neighbour.
struct Run {
    name: &'static str,
    build_s: f64,
    query_s: f64,
    reach_sum_m: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().collect();
    let [_, cloud, threads, k] = &words[..] else {
        return Err("usage: neighbour-indices CLOUD THREADS K".into());
    };
    let points = boresight::format::read_cloud(Path::new(cloud))?.points;
    let k: NonZero<usize> = k.parse()?;
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.parse()?)
        .build_global()?;
    let runs = [
        nearest(&points, k),
        nearest_of_all(&points, k),
        surroundings(&points, k),
        kiddo(&points, k)?,
    ];
    for run in &runs {
        let line = serde_json::json!({
            "index": run.name, "build_s": run.build_s, "query_s": run.query_s,
            "reach_sum_m": run.reach_sum_m,
        });
        println!("{line}");
    }
    // The sums add the same numbers in another order.
    let sum = runs[0].reach_sum_m;
    match runs
        .iter()
        .find(|run| (run.reach_sum_m - sum).abs() > 1e-9 * sum)
    {
        Some(run) => Err(format!("{} found other neighbours", run.name).into()),
        None => Ok(()),
    }
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let begun = Instant::now();
    let result = work();
    (result, begun.elapsed().as_secs_f64())
}

fn farther(points: &[Vec3], query: &Vec3, found: &[u32]) -> f64 {
    let distance = |&at: &u32| (points[at as usize] - query).norm();
    found.iter().map(distance).fold(0.0, f64::max)
}

fn nearest(points: &[Vec3], k: NonZero<usize>) -> Run {
    let (index, build_s) = timed(|| NeighbourIndex::new(points));
    let (reach_sum_m, query_s) = timed(|| {
        let reach = |found: &mut Vec<u32>, point: &Vec3| {
            index.nearest(point, k.get(), found);
            farther(points, point, found)
        };
        points.par_iter().map_init(Vec::new, reach).sum()
    });
    Run {
        name: "boresight, nearest",
        build_s,
        query_s,
        reach_sum_m,
    }
}

/// All neighbours in one call, which chooses its own order of the queries.
fn nearest_of_all(points: &[Vec3], k: NonZero<usize>) -> Run {
    let (index, build_s) = timed(|| NeighbourIndex::new(points));
    let (found, query_s) = timed(|| index.nearest_of_all(points, k.get()));
    let each = found.chunks(k.get().min(points.len())).zip(points);
    Run {
        name: "boresight, nearest_of_all",
        build_s,
        query_s,
        reach_sum_m: each
            .map(|(found, point)| farther(points, point, found))
            .sum(),
    }
}

/// As above, and also the structure tensors.
fn surroundings(points: &[Vec3], k: NonZero<usize>) -> Run {
    let (index, build_s) = timed(|| NeighbourIndex::new(points));
    let (reach_sum_m, query_s) = timed(|| {
        let of = Neighbourhood::Nearest(k.get());
        let found = index.surroundings_of_all(&index, of, &Silent, |_, near| near.reach_m);
        found.into_iter().flatten().sum()
    });
    Run {
        name: "boresight, surroundings_of_all",
        build_s,
        query_s,
        reach_sum_m,
    }
}

fn kiddo(points: &[Vec3], k: NonZero<usize>) -> Result<Run, Box<dyn Error>> {
    let entries: Vec<[f64; 3]> = points.iter().map(|p| [p.x, p.y, p.z]).collect();
    let (tree, build_s) = timed(|| ImmutableKdTree::<f64, 3>::new_from_slice_parallel(&entries));
    let tree = tree?;
    let (reach_sum_m, query_s) = timed(|| {
        let farthest = |query: &[f64; 3]| {
            let found = tree
                .query(query)
                .nearest_n::<SquaredEuclidean<f64>>(k)
                .execute();
            found
                .last()
                .map_or(0.0, |neighbour| neighbour.distance.sqrt())
        };
        entries.par_iter().map(farthest).sum()
    });
    Ok(Run {
        name: "kiddo 6.3.0, ImmutableKdTree",
        build_s,
        query_s,
        reach_sum_m,
    })
}
