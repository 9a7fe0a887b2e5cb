//! Neighbourhoods of points.

use rayon::prelude::*;

use super::plane::Plane;
use crate::cloud::NeighbourIndex;
use crate::geometry::Vec3;

/// The k nearest neighbours of selected points, including the points themselves: searched once and
/// kept while the points move little.
#[derive(Debug, Clone)]
pub struct Neighbourhoods {
    k: usize,
    centres: Vec<u32>,
    members: Vec<u32>,
}

impl Neighbourhoods {
    /// Searches the `k` points nearest to each of `centres` (indices into `points`), or all points
    /// if there are fewer.
    pub fn search(points: &[Vec3], centres: Vec<u32>, k: usize) -> Self {
        let index = NeighbourIndex::new(points);
        let places: Vec<Vec3> = centres
            .iter()
            .map(|&centre| points[centre as usize])
            .collect();
        Self {
            k: k.min(points.len()),
            members: index.nearest_of_all(&places, k),
            centres,
        }
    }

    /// Searches neighbourhoods of the same size around the same points at new positions.
    pub fn search_again(&self, points: &[Vec3]) -> Self {
        Self::search(points, self.centres.clone(), self.k)
    }

    /// Number of points in each neighbourhood.
    pub fn k(&self) -> usize {
        self.k
    }

    /// Indices of the centres, one per neighbourhood.
    pub fn centres(&self) -> &[u32] {
        &self.centres
    }

    /// Indices of the points of neighbourhood `index`.
    #[inline]
    pub fn members(&self, index: usize) -> &[u32] {
        &self.members[index * self.k..(index + 1) * self.k]
    }

    /// The plane of every neighbourhood.
    pub fn planes(&self, points: &[Vec3]) -> Vec<Plane> {
        (0..self.centres.len())
            .into_par_iter()
            .map(|index| Plane::fit(points, self.members(index)))
            .collect()
    }

    /// The neighbourhoods that each of the first `points` points belongs to.
    pub fn memberships(&self, points: usize) -> Memberships {
        let known = |&&member: &&u32| (member as usize) < points;
        let mut starts = vec![0; points + 1];
        for &member in self.members.iter().filter(known) {
            starts[member as usize + 1] += 1;
        }
        for point in 0..points {
            starts[point + 1] += starts[point];
        }
        let mut next = starts.clone();
        let mut neighbourhoods = vec![0; starts[points]];
        for index in 0..self.centres.len() {
            for &member in self.members(index).iter().filter(known) {
                let at = &mut next[member as usize];
                neighbourhoods[*at] = index as u32;
                *at += 1;
            }
        }
        Memberships {
            starts,
            neighbourhoods,
        }
    }
}

/// The neighbourhoods of every point.
#[derive(Debug, Clone)]
pub struct Memberships {
    starts: Vec<usize>,
    neighbourhoods: Vec<u32>,
}

impl Memberships {
    /// Neighbourhoods that point `index` belongs to, in ascending order.
    #[inline]
    pub fn neighbourhoods(&self, index: usize) -> &[u32] {
        &self.neighbourhoods[self.starts[index]..self.starts[index + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_and_memberships_agree() {
        let points: Vec<Vec3> = (0..40)
            .map(|i| Vec3::new(f64::from(i * i % 17), f64::from(i % 7), 0.0))
            .collect();
        let neighbourhoods = Neighbourhoods::search(&points, vec![0, 3, 30, 39], 6);
        let memberships = neighbourhoods.memberships(35);
        for point in 0..35 {
            let expected: Vec<u32> = (0..4)
                .filter(|&index| {
                    neighbourhoods
                        .members(index as usize)
                        .contains(&(point as u32))
                })
                .collect();
            assert_eq!(memberships.neighbourhoods(point), expected, "point {point}");
        }
        assert!(neighbourhoods.members(2).contains(&30));
    }
}
