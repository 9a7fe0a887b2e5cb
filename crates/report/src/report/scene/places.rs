//! Places where a section shows most: level and steep surfaces that several scanners or passes saw.

use serde::{Deserialize, Serialize};

use crate::cloud::StructureTensor;
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::geometry::Vec3;

/// Edge of the cells that are searched for surfaces, metres.
const CELL_M: f64 = 0.15;
/// Fewest points of a cell, and most of its points that are used.
const POINTS: [usize; 2] = [40, 600];
/// Largest standard deviation of the points of a cell across its plane for the cell to count as a board, metres.
const BOARD_M: f64 = 0.003;
/// Additional roughness of a board that one more pass outweighs, metres.
const ROUGH_M: f64 = 0.000_25;
/// Extent of a filled cell, as standard deviations along its plane: a cell at an edge has a smaller extent.
const FILLED_M: f64 = 0.2 * CELL_M;
/// Number of similar neighbours of a cell in the middle of a board.
const LIKE_IT: usize = 4;
/// Slopes of level and of steep surfaces, radians.
const LEVEL_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
const STEEP_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;

/// A place for a section.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// Description of the surface.
    pub name: String,
    /// Its centre, metres.
    pub centre_m: Vec3,
    /// Slope of its surface, radians.
    pub slope_rad: f64,
    /// Number of passes that saw it, counted for each scanner.
    pub seen: usize,
}

/// A cell with enough points.
struct Cell {
    key: VoxelKey,
    centre_m: Vec3,
    slope_rad: f64,
    /// Standard deviation across its plane, metres.
    thickness_m: f64,
    /// Whether it is filled to its edges.
    is_filled: bool,
    seen: usize,
}

/// The places among points, each with the number of the pass of the scanner that saw it. The first place is the most
/// telling.
pub fn places(points: &[(Vec3, u32)]) -> Vec<Place> {
    let cells = cells(points);
    let by_key: VoxelMap<VoxelKey, &Cell> = cells.iter().map(|cell| (cell.key, cell)).collect();
    let boards: Vec<&Cell> = cells
        .iter()
        .filter(|cell| is_board(cell) && similar_neighbours(cell, &by_key) >= LIKE_IT)
        .collect();
    let most = |cells: &[&Cell], score: &dyn Fn(&Cell) -> f64| -> Option<Place> {
        let best = cells
            .iter()
            .max_by(|a, b| score(a).total_cmp(&score(b)).then(b.key.cmp(&a.key)))?;
        Some(Place {
            name: String::new(),
            centre_m: best.centre_m,
            slope_rad: best.slope_rad,
            seen: best.seen,
        })
    };
    let named = |name: &str, place: Option<Place>| {
        place.map(|place| Place {
            name: name.into(),
            ..place
        })
    };
    let seen = |cell: &Cell| cell.seen as f64;
    // A surface that more passes saw shows more, unless it is rough; a slope helps up to some degrees.
    let smooth = |cell: &Cell| seen(cell).min(6.0) - cell.thickness_m / ROUGH_M;
    let cells_with = |test: &dyn Fn(&Cell) -> bool| -> Vec<&Cell> {
        boards.iter().copied().filter(|cell| test(cell)).collect()
    };
    let level = cells_with(&|cell| cell.slope_rad < LEVEL_RAD);
    let steep = cells_with(&|cell| cell.slope_rad > STEEP_RAD);
    let rough: Vec<&Cell> = cells
        .iter()
        .filter(|cell| cell.is_filled && !is_board(cell))
        .collect();
    let steepest = |cell: &Cell| cell.slope_rad.to_degrees() + 5.0 * seen(cell).min(4.0);
    let places = [
        named("steepest board", most(&steep, &steepest)),
        named("level board", most(&level, &smooth)),
        named("ground that was seen most", most(&rough, &seen)),
    ];
    places.into_iter().flatten().collect()
}

fn is_board(cell: &Cell) -> bool {
    cell.is_filled && cell.thickness_m < BOARD_M
}

/// Number of neighbouring boards with about the same slope.
fn similar_neighbours(cell: &Cell, by_key: &VoxelMap<VoxelKey, &Cell>) -> usize {
    let [x, y, z] = cell.key;
    let around = (0..27).map(|place| [x + place % 3 - 1, y + place / 3 % 3 - 1, z + place / 9 - 1]);
    let others = around.filter(|key| *key != cell.key);
    others
        .filter_map(|key| by_key.get(&key))
        .filter(|other| {
            other.thickness_m < BOARD_M && (other.slope_rad - cell.slope_rad).abs() < 0.1
        })
        .count()
}

fn cells(points: &[(Vec3, u32)]) -> Vec<Cell> {
    let mut keyed: Vec<(VoxelKey, u32)> = points
        .iter()
        .zip(0..)
        .map(|((point, _), index)| (voxel_key(point, CELL_M), index))
        .collect();
    keyed.sort_unstable();
    let cells = keyed.chunk_by(|a, b| a.0 == b.0);
    let [fewest, enough] = POINTS;
    cells
        .filter(|cell| cell.len() >= fewest)
        .map(|cell| {
            let inside = cell.iter().map(|(_, index)| &points[*index as usize]);
            let mut seen: Vec<u32> = inside.clone().map(|(_, by)| *by).collect();
            seen.sort_unstable();
            seen.dedup();
            let every = cell.len().div_ceil(enough);
            let some = inside.step_by(every).map(|(point, _)| point);
            let tensor = StructureTensor::from_points(some);
            let eigen = tensor.eigen();
            let sigma = eigen.values.map(f64::sqrt);
            let normal = eigen.vectors.column(2);
            Cell {
                key: cell[0].0,
                centre_m: tensor.mean,
                slope_rad: normal.z.abs().min(1.0).acos(),
                thickness_m: sigma[2],
                is_filled: sigma[1] > FILLED_M,
                seen: seen.len(),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_steepest_and_the_level_board_are_found() {
        let mut points = Vec::new();
        for (i, j) in (0..200).flat_map(|i| (0..200).map(move |j| (i, j))) {
            let (x, y) = (0.005 * f64::from(i), 0.005 * f64::from(j));
            let by = u32::from((i + j) % 2 == 0);
            points.push((Vec3::new(x, y, 0.52), by));
            // 45° of slope, five metres to the east.
            points.push((Vec3::new(5.0 + x, y, 0.3 + x), by));
        }
        let ranked = places(&points);
        let names: Vec<&str> = ranked.iter().map(|place| place.name.as_str()).collect();
        assert_eq!(names, ["steepest board", "level board"]);
        let (steep, level) = (&ranked[0], &ranked[1]);
        assert!(
            (steep.slope_rad.to_degrees() - 45.0).abs() < 1.0,
            "{steep:?}"
        );
        assert!(steep.centre_m.x > 5.0 && level.centre_m.x < 1.0);
        assert_eq!((level.seen, level.slope_rad < 0.01), (2, true));
        assert!(places(&[]).is_empty());
    }
}
