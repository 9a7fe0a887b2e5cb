//! The structure tensors of the neighbourhoods of many points at once.

use rayon::prelude::*;

use super::{NeighbourIndex, StructureTensor};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Queries a thread works on at a time.
const CHUNK: usize = 1024;

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
    /// list, and returns what it makes of them in the order of the queries.
    ///
    /// On all threads; the result does not depend on their number. The stage is the caller's to
    /// begin, name and end; it advances by one for each query.
    pub fn surroundings<T: Send + Clone>(
        &self,
        queries: &[Vec3],
        of: Neighbourhood,
        progress: &dyn Progress,
        each: impl Fn(usize, &Surroundings) -> T + Sync,
    ) -> Vec<T> {
        let order = Self::new(queries);
        let found: Vec<T> = order
            .spatial_order()
            .par_chunks(CHUNK)
            .flat_map_iter(|chunk| {
                let mut near = Vec::new();
                let values: Vec<T> = chunk
                    .iter()
                    .map(|&at| {
                        let query = &queries[at as usize];
                        let surroundings = self.surroundings_of(query, of, &mut near);
                        each(at as usize, &surroundings)
                    })
                    .collect();
                progress.advance(chunk.len() as u64);
                values
            })
            .collect();
        let mut in_order = found.clone();
        for (&at, value) in order.spatial_order().iter().zip(found) {
            in_order[at as usize] = value;
        }
        in_order
    }

    fn surroundings_of(
        &self,
        query: &Vec3,
        of: Neighbourhood,
        near: &mut Vec<u32>,
    ) -> Surroundings {
        let reach_m = match of {
            Neighbourhood::Nearest(k) => {
                self.nearest(query, k, near);
                match near.last() {
                    Some(&farthest) if near.len() == k => (self.point(farthest) - query).norm(),
                    _ => f64::INFINITY,
                }
            }
            Neighbourhood::Within(radius) => {
                self.within(query, radius, near);
                radius
            }
        };
        Surroundings {
            tensor: StructureTensor::from_points(near.iter().map(|&at| self.point(at))),
            reach_m,
        }
    }
}
