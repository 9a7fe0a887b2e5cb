//! The neighbourhoods of many points at once: their points and their structure tensors.
//!
//! Queries are processed in groups, the small boxes of an index over the queries; each group uses
//! candidates gathered once (`candidates.rs`).

use rayon::prelude::*;

use super::bounds::Bounds;
use super::candidates::{Candidates, Search};
use super::lanes::{Lanes, Plain};
use super::neighbours::NeighbourIndex;
use super::tensor::StructureTensor;
use super::vectors::with_widest_vectors;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::progress::{Progress, Silent};

/// Most queries that share candidates.
const GROUP: usize = 64;

/// Candidates per neighbour, or per query if there are more queries, beyond which queries are
/// searched one by one. On surfaces there are about 6 of each.
const MOST_CANDIDATES: usize = 64;

/// Margins tried for a group before its queries are searched one by one. On surfaces two or three
/// are enough; near points whose distances differ by many powers of ten, hundreds are needed.
const MAX_ROUNDS: usize = 8;

/// Groups processed by a thread at a time.
const CHUNK: usize = 64;

/// Which points belong to a neighbourhood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Neighbourhood {
    /// The k nearest, at equal distances those of smaller index; all points if there are fewer.
    Nearest(usize),
    /// The points in the closed ball of this radius, metres.
    Within(f64),
}

/// The structure tensor of a query's neighbours, and the distance they reach to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surroundings {
    /// Tensor of the neighbours.
    pub tensor: StructureTensor,
    /// Distance to the farthest neighbour, metres: no point beyond it matters. Infinite if there
    /// are fewer than k points, the radius if one was given.
    pub reach_m: f64,
}

impl NeighbourIndex {
    /// Calls `each` with the surroundings of every query and its position in the list, and returns
    /// the results in the order of the queries. A query that is not finite has no neighbours.
    ///
    /// Runs on all threads; the result does not depend on their number. The caller begins, names
    /// and ends the stage, which advances by one for each query.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled).
    pub fn surroundings<T: Send + Sync + Clone>(
        &self,
        queries: &[Vec3],
        neighbourhood: Neighbourhood,
        progress: &dyn Progress,
        each: impl Fn(usize, &Surroundings) -> T + Sync,
    ) -> Result<Vec<T>> {
        self.surroundings_of_all(&Self::new(queries), neighbourhood, progress, each)
    }

    /// As [`Self::surroundings`], with the points of an index as queries, for example this one's.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled).
    pub fn surroundings_of_all<T: Send + Sync + Clone>(
        &self,
        queries: &Self,
        neighbourhood: Neighbourhood,
        progress: &dyn Progress,
        each: impl Fn(usize, &Surroundings) -> T + Sync,
    ) -> Result<Vec<T>> {
        let none = Surroundings {
            tensor: StructureTensor::from_points(&[]),
            reach_m: f64::INFINITY,
        };
        let mut found = self.in_groups(queries, neighbourhood, progress, none, |places, found| {
            places
                .zip(found)
                .map(|(place, surroundings)| each(queries.indices[place] as usize, surroundings))
                .collect()
        });
        progress.check()?;
        let lost = queries.indices[found.len()..].iter();
        found.extend(lost.map(|&index| each(index as usize, &none)));
        let mut places = vec![0u32; found.len()];
        for (&index, place) in queries.indices.iter().zip(0u32..) {
            places[index as usize] = place;
        }
        let values = places.par_iter();
        Ok(values.map(|&place| found[place as usize].clone()).collect())
    }

    /// The indices of the `k` points nearest to each query (at equal distances those of smaller
    /// index), `k` per query, in the order of the queries, which must be finite. Those of one query
    /// are in an arbitrary but reproducible order. If there are fewer than `k` points, all are
    /// returned.
    pub fn nearest_of_all(&self, queries: &[Vec3], k: usize) -> Vec<u32> {
        let order = Self::new(queries);
        let k = k.min(self.nodes.first().map_or(0, |root| root.points().len()));
        let found: Vec<u32> = self.in_groups(
            &order,
            Neighbourhood::Nearest(k),
            &Silent,
            Vec::new(),
            |_, found: &[Vec<u32>]| found.concat(),
        );
        let mut members = vec![0; queries.len() * k];
        if k > 0 {
            for (&index, found) in order.indices.iter().zip(found.chunks_exact(k)) {
                let at = index as usize * k;
                members[at..at + k].copy_from_slice(found);
            }
        }
        members
    }

    /// Computes `Found` for the queries of every group; `each` takes the positions of a group's
    /// queries in their index and the results. In the order of the queries' index, without queries
    /// that are not finite; unusable if the work was cancelled.
    fn in_groups<Found: Take, T: Send>(
        &self,
        queries: &Self,
        neighbourhood: Neighbourhood,
        progress: &dyn Progress,
        nothing: Found,
        each: impl Fn(std::ops::Range<usize>, &[Found]) -> Vec<T> + Sync,
    ) -> Vec<T> {
        let groups = queries.groups(GROUP);
        groups
            .par_chunks(CHUNK)
            .flat_map_iter(|groups| {
                let mut values = Vec::new();
                let mut scratch = Scratch::new();
                let mut found = Vec::new();
                for group in groups {
                    if progress.is_cancelled() {
                        break;
                    }
                    found.clear();
                    found.resize(group.points().len(), nothing.clone());
                    let queries = &queries.points[group.points()];
                    let task = Group {
                        index: self,
                        bounds: group.bounds,
                        queries,
                        neighbourhood,
                    };
                    Found::solve_group(&task, &mut scratch, &mut found);
                    values.extend(each(group.points(), &found));
                    progress.advance(queries.len() as u64);
                }
                values
            })
            .collect()
    }
}

/// What to extract from the neighbours of a query.
trait Take: Clone + Send + Sync {
    /// Extracts it from the chosen candidates.
    fn take<L: Lanes>(candidates: &mut Candidates, query: &Vec3, reach_m: f64) -> Self;

    /// Is [`solve_group`], compiled here once instead of in every crate that searches neighbours, which may not be
    /// optimised.
    fn solve_group(group: &Group<'_>, scratch: &mut Scratch<Self>, found: &mut [Self]);
}

impl Take for Surroundings {
    #[inline(always)]
    fn take<L: Lanes>(candidates: &mut Candidates, query: &Vec3, reach_m: f64) -> Self {
        Self {
            tensor: candidates.tensor::<L>(query),
            reach_m,
        }
    }

    #[inline(never)]
    fn solve_group(group: &Group<'_>, scratch: &mut Scratch<Self>, found: &mut [Self]) {
        solve_group(group, scratch, found);
    }
}

/// Indices.
impl Take for Vec<u32> {
    #[inline(always)]
    fn take<L: Lanes>(candidates: &mut Candidates, _query: &Vec3, _reach_m: f64) -> Self {
        candidates.chosen_indices::<L>()
    }

    #[inline(never)]
    fn solve_group(group: &Group<'_>, scratch: &mut Scratch<Self>, found: &mut [Self]) {
        solve_group(group, scratch, found);
    }
}

/// Queries that lie close together, and the neighbourhood to search.
struct Group<'a> {
    index: &'a NeighbourIndex,
    /// Bounding box of the queries.
    bounds: Bounds,
    queries: &'a [Vec3],
    neighbourhood: Neighbourhood,
}

/// State carried from group to group.
struct Scratch<Found> {
    candidates: Candidates,
    /// Distance that the neighbours of the previous group reached, metres; 0 if unknown.
    reach_m: f64,
    /// The last query of the previous group, and its result.
    last: Option<(Vec3, Found)>,
}

impl<Found> Scratch<Found> {
    fn new() -> Self {
        Self {
            candidates: Candidates::default(),
            reach_m: 0.0,
            last: None,
        }
    }
}

/// As [`solve`], compiled for the widest vectors of this machine; see [`super::vectors`].
fn solve_group<Found: Take>(group: &Group<'_>, scratch: &mut Scratch<Found>, found: &mut [Found]) {
    #[cfg(target_arch = "x86_64")]
    {
        use super::lanes::Avx512;
        use super::vectors::Width;
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
        fn with_avx512<Found: Take>(
            group: &Group<'_>,
            scratch: &mut Scratch<Found>,
            found: &mut [Found],
        ) {
            solve::<Avx512, Found>(group, scratch, found);
        }
        if Width::here() == Width::Avx512 {
            // SAFETY: the machine has the instructions that the function was compiled for.
            #[allow(unsafe_code)]
            return unsafe { with_avx512(group, scratch, found) };
        }
    }
    solve_plain(group, scratch, found);
}

with_widest_vectors! {
    fn solve_plain<Found: Take>(group: &Group<'_>, scratch: &mut Scratch<Found>, found: &mut [Found])
        = solve::<Plain, Found>
}

/// Searches the neighbours of the queries of a group. Coincident queries have the same neighbours:
/// only the first of them is searched.
#[inline(always)]
fn solve<L: Lanes, Found: Take>(
    group: &Group<'_>,
    scratch: &mut Scratch<Found>,
    found: &mut [Found],
) {
    let queries = group.queries;
    let mut open: Vec<usize> = Vec::with_capacity(queries.len());
    for at in 0..queries.len() {
        if at > 0 && queries[at] == queries[at - 1] {
            continue;
        }
        match &scratch.last {
            Some((query, same)) if at == 0 && *query == queries[0] => found[0] = same.clone(),
            _ => open.push(at),
        }
    }
    if !open.is_empty() {
        solve_open::<L, Found>(group, scratch, open, found);
    }
    for at in 1..queries.len() {
        if queries[at] == queries[at - 1] {
            found[at] = found[at - 1].clone();
        }
    }
    let last = queries.last().zip(found.last());
    scratch.last = last.map(|(query, found)| (*query, found.clone()));
}

/// Searches the neighbours of the queries of a group at the positions `open`. No closures: they
/// would not be compiled for wide vectors.
#[inline(always)]
fn solve_open<L: Lanes, Found: Take>(
    group: &Group<'_>,
    scratch: &mut Scratch<Found>,
    mut open: Vec<usize>,
    found: &mut [Found],
) {
    let &Group {
        index,
        ref bounds,
        queries,
        neighbourhood,
    } = group;
    let Scratch {
        candidates,
        reach_m,
        ..
    } = scratch;
    let k = match neighbourhood {
        Neighbourhood::Nearest(k) => k,
        Neighbourhood::Within(radius) => {
            candidates.gather(index, bounds, radius * (1.0 + 1e-12), usize::MAX);
            for at in open {
                candidates.within::<L>(&queries[at], radius);
                found[at] = Found::take::<L>(candidates, &queries[at], radius);
            }
            return;
        }
    };
    if k == 0 || index.nodes.is_empty() {
        return;
    }
    let enough_for_first = || {
        let farthest = index.nearest_with_distances(&queries[0], k).next_back();
        1.05 * farthest.map_or(0.0, |(squared, _, _)| squared.sqrt())
    };
    // As far as the previous group reached; if that holds too many points, as far as the first
    // query does.
    let mut is_first_known = *reach_m == 0.0;
    let mut margin_m = if is_first_known {
        enough_for_first()
    } else {
        1.05 * *reach_m
    };
    let most = MOST_CANDIDATES.saturating_mul(k.max(GROUP));
    *reach_m = 0.0;
    let mut rounds = 0;
    while !open.is_empty() {
        rounds += 1;
        if rounds > MAX_ROUNDS || !candidates.gather(index, bounds, margin_m, most) {
            if !is_first_known && rounds <= MAX_ROUNDS {
                is_first_known = true;
                margin_m = enough_for_first();
                continue;
            }
            for &at in &open {
                let reach = candidates.take_nearest(index, &queries[at], k);
                found[at] = Found::take::<L>(candidates, &queries[at], reach);
            }
            return;
        }
        let mut wanted_m: f64 = 0.0;
        let mut left = 0;
        for turn in 0..open.len() {
            let at = open[turn];
            let query = &queries[at];
            match candidates.nearest::<L>(query, k) {
                Search::Found(reach) => {
                    found[at] = Found::take::<L>(candidates, query, reach);
                    if reach.is_finite() {
                        *reach_m = reach_m.max(reach);
                    }
                }
                Search::Margin(enough_m) => {
                    wanted_m = wanted_m.max(enough_m);
                    open[left] = at;
                    left += 1;
                }
            }
        }
        open.truncate(left);
        // If k points lie within twice the margin, that margin suffices.
        margin_m = if margin_m > 0.0 {
            wanted_m.clamp(1.01 * margin_m, 2.0 * margin_m)
        } else {
            wanted_m
        };
    }
}
