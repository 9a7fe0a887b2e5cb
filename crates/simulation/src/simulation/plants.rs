//! Plants: leaves that hover above the soil and sway.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::board::Board;
use super::random::{Purpose, normal3, stream};
use super::ray::{self, Squares};
use super::scenario::Scenario;
use super::soil::Soil;
use crate::geometry::{Rotation, Vec3};

/// Leaves of a plant.
const LEAVES: usize = 6;

/// Azimuth between one leaf and the next: the golden angle.
const BETWEEN_LEAVES: f64 = 0.381_966 * TAU;

/// Range of the heights of plants, relative to the tallest.
const PLANT_HEIGHTS: (f64, f64) = (0.6, 1.0);
/// Range of the heights of leaves, relative to their plant.
const LEAF_HEIGHTS: (f64, f64) = (0.25, 1.0);

/// Periods of the two oscillations of a leaf, seconds. They differ from leaf to leaf, so that no two
/// times show the same field.
const PERIODS_S: (f64, f64) = (7.0, 13.0);

/// The leaves of all plants, indexed by a grid in plan view.
#[derive(Debug, Clone)]
pub struct Plants {
    leaves: Vec<Leaf>,
    squares: Squares,
    /// Indices of the leaves that may be above each square.
    above: Vec<Vec<u32>>,
    /// Lower and upper corner of the box that the leaves may reach, metres.
    extent_m: [[f64; 3]; 2],
}

/// An ellipse that sways.
#[derive(Debug, Clone)]
struct Leaf {
    centre_m: Vec3,
    normal: Vec3,
    /// Along the leaf and across it, one over half the length.
    axes: [Vec3; 2],
    sway: [Oscillation; 2],
    /// Largest distance that a point of the swaying leaf can have from the centre at rest, metres.
    reach_m: f64,
}

/// A sinusoidal displacement.
#[derive(Debug, Clone)]
struct Oscillation {
    amplitude_m: Vec3,
    rate_rad_s: f64,
    phase: f64,
}

impl Oscillation {
    fn new(rng: &mut ChaCha8Rng, amplitude_m: f64) -> Self {
        Self {
            amplitude_m: normal3(rng).normalize() * amplitude_m,
            rate_rad_s: TAU / rng.random_range(PERIODS_S.0..PERIODS_S.1),
            phase: rng.random_range(0.0..TAU),
        }
    }

    fn at(&self, time_s: f64) -> Vec3 {
        self.amplitude_m * (self.rate_rad_s * time_s + self.phase).sin()
    }
}

impl Leaf {
    /// Range along the unit vector `direction` at this time.
    fn intersect(&self, origin: &Vec3, direction: &Vec3, time_s: f64) -> Option<f64> {
        let rest = self.centre_m - origin;
        let along = rest.dot(direction);
        if (rest - direction * along).norm_squared() > self.reach_m * self.reach_m {
            return None;
        }
        let centre = rest + self.displacement_m(time_s);
        let closing = self.normal.dot(direction);
        let range = self.normal.dot(&centre) / closing;
        let on = direction * range - centre;
        let [u, v] = self.axes.map(|axis| axis.dot(&on));
        // Also false for a ray within the leaf's plane, where the range is not finite.
        (range >= 0.0 && u * u + v * v <= 1.0).then_some(range)
    }

    fn displacement_m(&self, time_s: f64) -> Vec3 {
        self.sway[0].at(time_s) + self.sway[1].at(time_s)
    }
}

impl Plants {
    /// The plants of a scenario on its soil, clear of the boards.
    pub fn new(scenario: &Scenario, soil: &Soil) -> Self {
        let settings = &scenario.plants;
        let size_m = scenario.field.size_m;
        let area_m2 = size_m[0] * size_m[1];
        let clearance_m = 1.5 * settings.leaf_m + 2.0 * settings.sway_m;
        let boards = scenario.boards.iter();
        let boards: Vec<Board> = boards
            .flat_map(|b| [Board::new(b), Board::moved(b)])
            .collect();
        let mut rng = stream(scenario.seed, Purpose::Plants, 0, 0);
        let mut leaves = Vec::new();
        for _ in 0..(settings.count_per_m2 * area_m2).round() as usize {
            let [x, y] = size_m.map(|size| rng.random::<f64>() * size);
            let height_m = settings.height_m * rng.random_range(PLANT_HEIGHTS.0..PLANT_HEIGHTS.1);
            let turn = rng.random_range(0.0..TAU);
            let stem = Vec3::new(x, y, soil.height_m(x, y));
            let is_clear = !boards.iter().any(|board| board.covers(x, y, clearance_m));
            for k in 0..LEAVES {
                let azimuth = turn + k as f64 * BETWEEN_LEAVES;
                let up_m = height_m * rng.random_range(LEAF_HEIGHTS.0..LEAF_HEIGHTS.1);
                // Leaves hang outwards, or stand upwards, and are twisted about their length.
                let droop = rng.random_range(-0.6..0.8);
                let twist = rng.random_range(-0.4..0.4);
                let sway = [(); 2].map(|()| Oscillation::new(&mut rng, settings.sway_m));
                if !is_clear {
                    continue;
                }
                let rotation = Rotation::from_euler_angles(twist, droop, azimuth);
                let [along, across, normal] =
                    [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| rotation * axis);
                let half_m = 0.5 * settings.leaf_m;
                leaves.push(Leaf {
                    centre_m: stem + Vec3::z() * up_m + along * settings.leaf_m,
                    normal,
                    axes: [along / half_m, across / (0.5 * half_m)],
                    sway,
                    reach_m: half_m + 2.0 * settings.sway_m,
                });
            }
        }
        Self::from_leaves(leaves)
    }

    fn from_leaves(leaves: Vec<Leaf>) -> Self {
        /// Most squares along each axis.
        const MOST_SQUARES: f64 = 1000.0;
        let mut extent_m = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        let mut largest_m = 0.05f64;
        for leaf in &leaves {
            largest_m = largest_m.max(2.0 * leaf.reach_m);
            for axis in 0..3 {
                let [low, high] = &mut extent_m;
                low[axis] = low[axis].min(leaf.centre_m[axis] - leaf.reach_m);
                high[axis] = high[axis].max(leaf.centre_m[axis] + leaf.reach_m);
            }
        }
        if leaves.is_empty() {
            extent_m = [[0.0; 3]; 2];
        }
        let [low, high] = extent_m;
        let size_m = [high[0] - low[0], high[1] - low[1]];
        // Squares as large as a leaf: each leaf lies above at most four of them.
        let side_m = largest_m.max(size_m[0].max(size_m[1]) / MOST_SQUARES);
        let squares = Squares {
            origin: [low[0], low[1]],
            side_m,
            count: size_m.map(|size| (size / side_m).floor() as usize + 1),
        };
        let mut above = vec![Vec::new(); squares.count[0] * squares.count[1]];
        for (index, leaf) in leaves.iter().enumerate() {
            let (c, r) = (leaf.centre_m, leaf.reach_m);
            let [first, last] = [-r, r].map(|d| squares.at(c.x + d, c.y + d));
            for j in first[1]..=last[1] {
                for i in first[0]..=last[0] {
                    above[j * squares.count[0] + i].push(index as u32);
                }
            }
        }
        Self {
            leaves,
            squares,
            above,
            extent_m,
        }
    }

    /// Range along the unit vector `direction` to the first leaf at this time, and the leaf's
    /// normal; `None` beyond `max_range_m`.
    pub fn intersect(
        &self,
        origin: &Vec3,
        direction: &Vec3,
        max_range_m: f64,
        time_s: f64,
    ) -> Option<(f64, Vec3)> {
        if self.leaves.is_empty() {
            return None;
        }
        let (mut range, leave) = ray::within(origin, direction, self.extent_m)?;
        let mut first: Option<(f64, Vec3)> = None;
        loop {
            let reach = first.map_or(max_range_m, |(range, _)| range);
            if range > leave.min(reach) {
                return first;
            }
            let p = origin + direction * range;
            let square @ [i, j] = self.squares.at(p.x, p.y);
            for &leaf in &self.above[j * self.squares.count[0] + i] {
                let leaf = &self.leaves[leaf as usize];
                let reach = first.map_or(max_range_m, |(range, _)| range);
                if let Some(range) = leaf.intersect(origin, direction, time_s)
                    && range <= reach
                {
                    first = Some((range, leaf.normal));
                }
            }
            range = self.squares.leave(range, &p, direction, square);
        }
    }

    /// Centres of all leaves at this time, metres.
    pub fn centres_m(&self, time_s: f64) -> impl Iterator<Item = Vec3> {
        let leaves = self.leaves.iter();
        leaves.map(move |leaf| leaf.centre_m + leaf.displacement_m(time_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planted() -> (Scenario, Soil, Plants) {
        let mut scenario = Scenario::demo();
        scenario.plants.count_per_m2 = 20.0;
        let soil = Soil::new(scenario.seed, &scenario.field, &scenario.soil);
        let plants = Plants::new(&scenario, &soil);
        (scenario, soil, plants)
    }

    #[test]
    fn the_grid_finds_the_same_leaf_as_a_search_of_all_leaves() {
        let (_, _, plants) = planted();
        let mut rng = stream(3, Purpose::Plants, 9, 9);
        let mut hits = 0;
        for k in 0..2000 {
            let origin = Vec3::new(
                rng.random_range(-1.0..8.5),
                rng.random_range(-1.0..7.0),
                rng.random_range(0.0..1.6),
            );
            let direction = normal3(&mut rng).normalize();
            let time_s = 7.3 * f64::from(k);
            let found = plants.intersect(&origin, &direction, 4.0, time_s);
            let leaves = plants.leaves.iter();
            let slow = leaves
                .filter_map(|leaf| leaf.intersect(&origin, &direction, time_s))
                .filter(|&range| range <= 4.0)
                .reduce(f64::min);
            assert_eq!(found.map(|(range, _)| range), slow);
            hits += usize::from(slow.is_some());
        }
        assert!(hits > 30, "{hits}");
    }

    #[test]
    fn leaves_hover_over_soil_clear_of_boards_and_sway_by_their_amplitude() {
        let (scenario, soil, plants) = planted();
        let boards: Vec<Board> = scenario.boards.iter().map(Board::new).collect();
        // A ninth of the plants would stand on the boards, which cover 4.1 of 45 square metres.
        let count = plants.leaves.len() as f64 / (20.0 * 45.0 * LEAVES as f64);
        assert!((0.8..0.92).contains(&count), "{count}");
        let settings = &scenario.plants;
        for (leaf, centre) in plants.leaves.iter().zip(plants.centres_m(12.0)) {
            let rest = leaf.centre_m;
            let above_m = rest.z - soil.height_m(rest.x, rest.y);
            // The soil below a leaf is not that at the stem.
            assert!((-0.02..=settings.height_m + settings.leaf_m + 0.03).contains(&above_m));
            assert!((centre - rest).norm() <= 2.0 * settings.sway_m);
            assert!(
                !boards
                    .iter()
                    .any(|board| board.covers(centre.x, centre.y, 0.0))
            );
        }
        let rms = |from_s: f64, to_s: f64| {
            let pairs = plants.centres_m(from_s).zip(plants.centres_m(to_s));
            let sum: f64 = pairs.map(|(a, b)| (b - a).norm_squared()).sum();
            (sum / plants.leaves.len() as f64).sqrt()
        };
        // Independent positions differ by √2 times the sway; within half a second a leaf hardly moves.
        let far = rms(100.0, 1700.0) / (2f64.sqrt() * settings.sway_m);
        assert!((far - 1.0).abs() < 0.05, "{far}");
        assert!(rms(100.0, 100.5) < 0.4 * settings.sway_m);
    }
}
