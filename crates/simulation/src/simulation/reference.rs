//! The registered point cloud of a terrestrial laser scanner.

use rand::RngExt;

use super::board::Board;
use super::random::{Purpose, normal3, stream};
use super::scenario::Scenario;
use super::scene::Scene;
use super::wave::Wave;
use crate::geometry::Vec3;

/// Time of the reference scan, seconds of the day: well before the drives.
const SURVEY_S: f64 = 30_000.0;

/// Height above all plants, metres.
const ABOVE_M: f64 = 10.0;

/// The reference cloud in strips, which can be generated in any order.
#[derive(Debug, Clone)]
pub struct Reference<'a> {
    scenario: &'a Scenario,
    scene: &'a Scene,
    soil_rows: usize,
    /// The boards where they stood during the reference scan.
    boards: Vec<Board>,
    board_rows: Vec<usize>,
    surface_error: Option<Wave>,
}

impl<'a> Reference<'a> {
    /// The reference of a scene.
    pub fn new(scenario: &'a Scenario, scene: &'a Scene) -> Self {
        let rows = |length: f64, spacing: f64| (length / spacing).round().max(1.0) as usize;
        let settings = &scenario.reference;
        let boards: Vec<Board> = scenario.boards.iter().map(Board::new).collect();
        Self {
            scenario,
            scene,
            soil_rows: rows(scene.size_m[1], settings.soil_spacing_m),
            board_rows: boards
                .iter()
                .map(|board| rows(2.0 * board.half_m[1], settings.board_spacing_m))
                .collect(),
            boards,
            surface_error: (settings.surface_error_m > 0.0).then(|| {
                Wave::new(
                    stream(scenario.seed, Purpose::ReferenceSurface, 0, 0),
                    settings.surface_error_scale_m,
                    settings.surface_error_m,
                )
            }),
        }
    }

    /// Number of strips.
    pub fn strips(&self) -> usize {
        self.soil_rows + self.board_rows.iter().sum::<usize>()
    }

    /// The points of one strip in the world, metres. Each cell of the grid contains one point at a
    /// random position; leaves are where they are during the scan, and soil below a board is missing.
    pub fn strip(&self, index: usize) -> Vec<Vec3> {
        let settings = &self.scenario.reference;
        let mut rng = stream(self.scenario.seed, Purpose::Reference, 0, index as u64);
        let offset = Vec3::from(settings.offset_m);
        let mut points = Vec::new();
        let (surface, row) = self.locate(index);
        let (length, spacing) = match surface {
            None => (self.scene.size_m[0], settings.soil_spacing_m),
            Some(b) => (2.0 * self.boards[b].half_m[0], settings.board_spacing_m),
        };
        let columns = (length / spacing).round().max(1.0) as usize;
        for column in 0..columns {
            let along = (column as f64 + rng.random::<f64>()) * length / columns as f64;
            let across = row as f64 + rng.random::<f64>();
            let noise = normal3(&mut rng) * settings.sigma_m;
            let (exact, normal) = match surface {
                None => {
                    let y = across * self.scene.size_m[1] / self.soil_rows as f64;
                    if self.boards.iter().any(|board| board.covers(along, y, 0.0)) {
                        continue;
                    }
                    self.ground(along, y)
                }
                Some(b) => {
                    let board = &self.boards[b];
                    let v = across * 2.0 * board.half_m[1] / self.board_rows[b] as f64;
                    let point = board.point_m(along - board.half_m[0], v - board.half_m[1]);
                    (point, board.normal)
                }
            };
            let mut point = exact + noise + offset;
            if let Some(error) = &self.surface_error {
                point += normal * error.at(exact.x, exact.y);
            }
            points.push(point);
        }
        points
    }

    /// The point of the leaf, or else of the soil, that is visible from above, and its upward normal.
    fn ground(&self, x: f64, y: f64) -> (Vec3, Vec3) {
        let (height, [gx, gy]) = self.scene.soil.height_and_gradient(x, y);
        let above = Vec3::new(x, y, height + ABOVE_M);
        let plants = &self.scene.plants;
        match plants.intersect(&above, &-Vec3::z(), ABOVE_M, SURVEY_S) {
            Some((range_m, normal)) => (above - Vec3::z() * range_m, normal * normal.z.signum()),
            None => (
                Vec3::new(x, y, height),
                Vec3::new(-gx, -gy, 1.0).normalize(),
            ),
        }
    }

    /// The board (or the soil) and the row of a strip.
    fn locate(&self, index: usize) -> (Option<usize>, usize) {
        let Some(mut row) = index.checked_sub(self.soil_rows) else {
            return (None, index);
        };
        for (board, &rows) in self.board_rows.iter().enumerate() {
            if row < rows {
                return (Some(board), row);
            }
            row -= rows;
        }
        (None, index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_on_the_visible_surfaces_within_their_noise() {
        let mut scenario = Scenario::demo();
        scenario.reference.soil_spacing_m = 0.03;
        scenario.reference.board_spacing_m = 0.02;
        let scene = Scene::new(&scenario);
        let reference = Reference::new(&scenario, &scene);
        let points: Vec<Vec3> = (0..reference.strips())
            .flat_map(|i| reference.strip(i))
            .collect();
        let squares: f64 = points.iter().map(|p| scene.distance_m(p).powi(2)).sum();
        let rms = (squares / points.len() as f64).sqrt();
        // One of three coordinates of 0.5 mm counts; the soil is flat within the noise.
        assert!((rms / 0.0005 - 1.0).abs() < 0.03, "{rms}");
        // 45 m² at 3 cm without 5 shadows (cosines 1, .966, .866, .707, .574), 5 m² at 2 cm.
        let expected = (45.0 - 4.113) / 0.0009 + 5.0 / 0.0004;
        assert!(
            (points.len() as f64 / expected - 1.0).abs() < 0.01,
            "{}",
            points.len()
        );
    }
}
