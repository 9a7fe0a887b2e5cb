//! Surfaces on the field: rough soil, tilted boards and leaves.

use super::board::Board;
use super::plants::Plants;
use super::scenario::Scenario;
use super::soil::Soil;
use crate::geometry::Vec3;

/// The surface that a ray hits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// The ground.
    Soil,
    /// The board of this index.
    Board(usize),
    /// A leaf.
    Plant,
}

/// The point where a ray hits a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance from the origin, metres.
    pub range_m: f64,
    /// Unit normal of the surface, facing the origin of the ray.
    pub normal: Vec3,
    /// The surface.
    pub surface: Surface,
}

/// The field during the drives.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The ground.
    pub soil: Soil,
    /// The boards where they stand during the drives.
    pub boards: Vec<Board>,
    /// The plants.
    pub plants: Plants,
    /// The field extends from the origin to this corner (east, north), metres.
    pub size_m: [f64; 2],
}

impl Scene {
    /// The scene of a scenario.
    pub fn new(scenario: &Scenario) -> Self {
        let soil = Soil::new(scenario.seed, &scenario.field, &scenario.soil);
        Self {
            plants: Plants::new(scenario, &soil),
            soil,
            boards: scenario.boards.iter().map(Board::moved).collect(),
            size_m: scenario.field.size_m,
        }
    }

    /// The first surface along the unit vector `direction` at this time, exact for boards and leaves
    /// and accurate to 1e-6 m on the ground; `None` beyond `max_range_m`.
    pub fn intersect(
        &self,
        origin: &Vec3,
        direction: &Vec3,
        max_range_m: f64,
        time_s: f64,
    ) -> Option<Hit> {
        let mut reach = max_range_m;
        let mut hit = None;
        for (index, board) in self.boards.iter().enumerate() {
            if let Some(range_m) = board.intersect(origin, direction)
                && range_m <= reach
            {
                reach = range_m;
                hit = Some((range_m, board.normal, Surface::Board(index)));
            }
        }
        let plants = &self.plants;
        if let Some((range_m, normal)) = plants.intersect(origin, direction, reach, time_s) {
            reach = range_m;
            hit = Some((range_m, normal, Surface::Plant));
        }
        if let Some(range_m) = self.soil.intersect(origin, direction, reach) {
            let p = origin + direction * range_m;
            let (_, [gx, gy]) = self.soil.height_and_gradient(p.x, p.y);
            hit = Some((range_m, Vec3::new(-gx, -gy, 1.0).normalize(), Surface::Soil));
        }
        hit.map(|(range_m, normal, surface)| Hit {
            range_m,
            normal: if normal.dot(direction) > 0.0 {
                -normal
            } else {
                normal
            },
            surface,
        })
    }

    /// Distance from a point to the nearest surface, ground or board, metres; to the ground to first order,
    /// for points close to it.
    pub fn distance_m(&self, point: &Vec3) -> f64 {
        let (height, [gx, gy]) = self.soil.height_and_gradient(point.x, point.y);
        let ground = (point.z - height).abs() / (1.0 + gx * gx + gy * gy).sqrt();
        self.boards
            .iter()
            .map(|board| {
                let [u, v, w] = board.coordinates_m(point);
                let beyond = |c: f64, half: f64| (c.abs() - half).max(0.0);
                Vec3::new(beyond(u, board.half_m[0]), beyond(v, board.half_m[1]), w).norm()
            })
            .fold(ground, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::super::random::{Purpose, stream};
    use super::*;

    /// First sign change on a dense march, refined by bisection: slow and simple.
    fn reference(scene: &Scene, origin: &Vec3, direction: &Vec3, max_range_m: f64) -> Option<f64> {
        let above = |range: f64| {
            let p = origin + direction * range;
            p.z - scene.soil.height_m(p.x, p.y)
        };
        let step = 2e-4;
        let mut ground = None;
        for k in 1..=(max_range_m / step) as usize + 1 {
            let far = k as f64 * step;
            if above(far) <= 0.0 {
                let (mut low, mut high) = (far - step, far);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if above(middle) > 0.0 {
                        low = middle
                    } else {
                        high = middle
                    }
                }
                ground = Some(low);
                break;
            }
        }
        let boards = scene.boards.iter().filter_map(|board| {
            // Solve origin + range d = center + u e0 + v e1.
            let system =
                nalgebra::Matrix3::from_columns(&[*direction, -board.edges[0], -board.edges[1]]);
            let x = system.lu().solve(&(board.center_m - origin))?;
            (x[0] > 0.0 && x[1].abs() <= board.half_m[0] && x[2].abs() <= board.half_m[1])
                .then_some(x[0])
        });
        boards
            .chain(ground)
            .filter(|&r| r <= max_range_m)
            .reduce(f64::min)
    }

    #[test]
    fn rays_end_where_the_slow_march_ends() {
        let scene = Scene::new(&Scenario::demo());
        let mut rng = stream(3, Purpose::Profile, 9, 9);
        let (mut hits, mut boards, mut grazed) = (0, 0, 0);
        for _ in 0..1000 {
            let origin = Vec3::new(
                rng.random_range(-1.0..8.5),
                rng.random_range(-1.0..7.0),
                rng.random_range(1.2..1.6),
            );
            let (tilt, azimuth) = (
                rng.random_range(0.0..1.35f64),
                rng.random_range(0.0..std::f64::consts::TAU),
            );
            let direction = Vec3::new(
                tilt.sin() * azimuth.cos(),
                tilt.sin() * azimuth.sin(),
                -tilt.cos(),
            );
            let fast = scene.intersect(&origin, &direction, 2.5, 0.0);
            let slow = reference(&scene, &origin, &direction, 2.5);
            let Some(hit) = fast else {
                assert_eq!(slow, None, "missed from {origin} along {direction}");
                continue;
            };
            hits += 1;
            boards += usize::from(hit.surface != Surface::Soil);
            assert!(hit.normal.dot(&direction) <= 0.0);
            // The march may step over a crumb that the ray grazes for less than 0.2 mm; then the
            // fast range is shorter and must itself be on the surface.
            if slow.is_none_or(|range| (hit.range_m - range).abs() > 1e-6) {
                assert!(
                    slow.is_none_or(|range| hit.range_m < range),
                    "{hit:?} {slow:?}"
                );
                assert!(scene.distance_m(&(origin + direction * hit.range_m)) < 1e-6);
                grazed += 1;
            }
        }
        assert!(grazed <= 3, "{grazed}");
        assert!(hits > 600 && boards > 30, "{hits} {boards}");
    }
}
