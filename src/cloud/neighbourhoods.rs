//! The neighbourhoods of many points at once: which points belong to them, and their structure
//! tensors.
//!
//! Queries are taken in groups, the small boxes of an index over the queries, and each group is
//! served from candidates gathered once (`candidates.rs`).

use rayon::prelude::*;

use super::candidates::{Candidates, Search};
use super::lanes::{Lanes, Plain};
use super::neighbours::Bounds;
use super::vectors::with_widest_vectors;
use super::{NeighbourIndex, StructureTensor};
use crate::geometry::Vec3;
use crate::progress::{Progress, Silent};

/// Most queries that share candidates.
const GROUP: usize = 64;

/// Candidates for each neighbour, or query if they are more, beyond which queries are searched for
/// one by one. On surfaces there are about 6 of each.
const MOST_CANDIDATES: usize = 64;

/// Margins tried for a group before queries are searched for one by one. On surfaces it takes two or
/// three; beside points that are closer by many powers of ten, hundreds.
const MOST_ROUNDS: usize = 8;

/// Groups a thread works on at a time.
const CHUNK: usize = 64;

/// Which points belong to a neighbourhood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Neighbourhood {
    /// The k nearest, of equal distances those of smaller index; all where there are fewer.
    Nearest(usize),
    /// Those in the closed ball of this radius, metres.
    Within(f64),
}

/// The structure tensor around a query, and how far it reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surroundings {
    /// Tensor of the neighbours.
    pub tensor: StructureTensor,
    /// Distance to the farthest neighbour, metres: no point outside the ball of this radius was
    /// needed. Infinite where fewer than k points were found, the radius where one was asked for.
    pub reach_m: f64,
}

impl NeighbourIndex {
    /// Hands the surroundings of every query to `each`, with the position of the query in the
    /// list, and returns what it makes of them in the order of the queries. A query that is not
    /// finite has no neighbours.
    ///
    /// On all threads; the result does not depend on their number. The stage is the caller's to
    /// begin, name and end; it advances by one for each query.
    pub fn surroundings<T: Send + Sync + Clone>(
        &self,
        queries: &[Vec3],
        of: Neighbourhood,
        progress: &dyn Progress,
        each: impl Fn(usize, &Surroundings) -> T + Sync,
    ) -> Vec<T> {
        self.surroundings_of_all(&Self::new(queries), of, progress, each)
    }

    /// As [`Self::surroundings`], for the points of an index: this one, say.
    pub fn surroundings_of_all<T: Send + Sync + Clone>(
        &self,
        queries: &Self,
        of: Neighbourhood,
        progress: &dyn Progress,
        each: impl Fn(usize, &Surroundings) -> T + Sync,
    ) -> Vec<T> {
        let none = Surroundings {
            tensor: StructureTensor::from_points(&[]),
            reach_m: f64::INFINITY,
        };
        let mut found = self.in_groups(queries, of, progress, none, |places, found| {
            places
                .zip(found)
                .map(|(place, surroundings)| each(queries.indices[place] as usize, surroundings))
                .collect()
        });
        let lost = queries.indices[found.len()..].iter();
        found.extend(lost.map(|&index| each(index as usize, &none)));
        let mut places = vec![0u32; found.len()];
        for (&index, place) in queries.indices.iter().zip(0u32..) {
            places[index as usize] = place;
        }
        places
            .par_iter()
            .map(|&place| found[place as usize].clone())
            .collect()
    }

    /// The indices of the `k` points nearest to each query (of equal distances those of smaller
    /// index), `k` a query, in the order of the queries, which must be finite. Those of one query
    /// are in no order that means anything, but always in the same. Where there are fewer points
    /// than `k`, all are given.
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

    /// Finds `Found` for the queries of every group; `each` takes the places of a group's queries
    /// in their index and what was found for them. In the order of the queries' index, without
    /// those that are not finite.
    fn in_groups<Found: Take, T: Send>(
        &self,
        queries: &Self,
        of: Neighbourhood,
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
                    found.clear();
                    found.resize(group.points().len(), nothing.clone());
                    let queries = &queries.points[group.points()];
                    let task = Group {
                        index: self,
                        bounds: group.bounds,
                        queries,
                        of,
                    };
                    solve_group(&task, &mut scratch, &mut found);
                    values.extend(each(group.points(), &found));
                    progress.advance(queries.len() as u64);
                }
                values
            })
            .collect()
    }
}

/// What is wanted of the neighbours of a query.
trait Take: Clone + Send + Sync {
    /// Takes it from the candidates that were chosen.
    fn take<L: Lanes>(candidates: &mut Candidates, query: &Vec3, reach_m: f64) -> Self;
}

impl Take for Surroundings {
    #[inline(always)]
    fn take<L: Lanes>(candidates: &mut Candidates, query: &Vec3, reach_m: f64) -> Self {
        Self {
            tensor: candidates.tensor::<L>(query),
            reach_m,
        }
    }
}

/// Indices.
impl Take for Vec<u32> {
    #[inline(always)]
    fn take<L: Lanes>(candidates: &mut Candidates, _query: &Vec3, _reach_m: f64) -> Self {
        candidates.chosen_indices::<L>()
    }
}

/// Queries that lie close together, and what they ask for.
struct Group<'a> {
    index: &'a NeighbourIndex,
    /// Box around the queries.
    bounds: Bounds,
    queries: &'a [Vec3],
    of: Neighbourhood,
}

/// What is kept from group to group.
struct Scratch<Found> {
    candidates: Candidates,
    /// How far the neighbours of the group before reached, metres; 0 where that is not known.
    reach_m: f64,
    /// The last query of the group before, and what was found for it.
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
            // SAFETY: the machine has what the function was compiled for.
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

/// Finds the neighbours of the queries of a group. Queries at one place have the same neighbours: of
/// a run of them only the first is searched for.
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

/// Finds the neighbours of the queries of a group at the places `open`. Written without closures,
/// which would not be compiled for the wide vectors.
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
        of,
    } = group;
    let Scratch {
        candidates,
        reach_m,
        ..
    } = scratch;
    let k = match of {
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
        let farthest = index.find_nearest(&queries[0], k).next_back();
        1.05 * farthest.map_or(0.0, |(squared, _, _)| squared.sqrt())
    };
    // As far as the group before reached; if that holds too much, as far as the first query does.
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
        if rounds > MOST_ROUNDS || !candidates.gather(index, bounds, margin_m, most) {
            if !is_first_known && rounds <= MOST_ROUNDS {
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
        // Where there are k within twice the margin, none but those are looked for.
        margin_m = if margin_m > 0.0 {
            wanted_m.clamp(1.01 * margin_m, 2.0 * margin_m)
        } else {
            wanted_m
        };
    }
}
