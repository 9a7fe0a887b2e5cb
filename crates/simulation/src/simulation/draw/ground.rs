//! The ground, the boards on it, and the route over them.

use super::super::field::{BoardSettings, DriveSettings, Field, Pass};
use super::super::scenario::Scenario;
use super::draws::Draws;
use super::extent::Extent;

/// Cells of the soil, at most.
const MOST_CELLS: f64 = 1e7;

/// Points of the reference, at most.
const MOST_REFERENCE_POINTS: f64 = 1e6;

/// Steepest slope that a wave of the ground may have, r.m.s.: a field that the robot can drive on.
const STEEPEST: f64 = 0.12;

/// Draws the field with its soil, plants and boards.
pub(super) fn ground(draws: &mut Draws, standoff_m: f64, scenario: &mut Scenario) {
    let motion = &scenario.motion;
    let along_m = (standoff_m * draws.uniform((2.5, 5.0)))
        .max(motion.scan_speed_m_s * draws.uniform((8.0, 20.0)));
    scenario.field = Field {
        size_m: [along_m, standoff_m * draws.uniform((1.5, 5.0))],
        margin_m: 2.0 + 3.5 * motion.turn_radius_m,
    };
    let extent = scenario
        .field
        .size_m
        .map(|s| s + 2.0 * scenario.field.margin_m);
    let soil = &mut scenario.soil;
    soil.cell_m = (extent[0] * extent[1] / MOST_CELLS).sqrt().max(0.01);
    // A spectrum σ(λ) = a (λ/m)^h, from a hall floor to ploughed soil.
    let amplitude_m = draws.log_uniform((1e-5, 1e-2));
    let exponent = draws.uniform((0.4, 1.2));
    let shortest_m = 2.5 * soil.cell_m;
    let longest_m = draws.uniform((1.5, 6.0)).max(4.0 * shortest_m);
    let waves = ((longest_m / shortest_m).log2() as i32).max(1);
    soil.wavelengths_m = (0..=waves).map(|k| longest_m / 2f64.powi(k)).collect();
    let sigma = |length: &f64| (amplitude_m * length.powf(exponent)).min(STEEPEST * length / 6.0);
    soil.sigmas_m = soil.wavelengths_m.iter().map(sigma).collect();
    if draws.chance(0.25) {
        soil.clod_height_m = draws.log_uniform((0.005, 0.05));
        soil.clod_size_m = (soil.clod_height_m * draws.uniform((1.5, 4.0))).max(2.5 * soil.cell_m);
        soil.clod_cover = draws.uniform((0.05, 0.5));
    }
    let plants = &mut scenario.plants;
    let field_m2: f64 = scenario.field.size_m.iter().product();
    if draws.chance(0.3) {
        plants.count_per_m2 = draws.log_uniform((1.0, 40.0)).min(2e4 / field_m2);
        plants.height_m = draws.log_uniform((0.05, 0.3 * standoff_m.max(0.2)));
        plants.leaf_m = draws.uniform((0.02, 0.1));
        plants.sway_m = draws.log_uniform((0.001, 0.02));
    }
    let count = if draws.chance(0.35) {
        0
    } else {
        draws.count(1, 8)
    };
    scenario.boards = boards(draws, count, standoff_m, scenario.field.size_m);
    let reference = &mut scenario.reference;
    reference.soil_spacing_m = (field_m2 / MOST_REFERENCE_POINTS).sqrt().max(0.005);
    reference.board_spacing_m = 0.6 * reference.soil_spacing_m;
}

/// Boards that stand apart, as many as find room.
fn boards(
    draws: &mut Draws,
    count: usize,
    standoff_m: f64,
    size_m: [f64; 2],
) -> Vec<BoardSettings> {
    /// Tries to find room for a board.
    const TRIES: usize = 50;
    let mut boards: Vec<BoardSettings> = Vec::new();
    let side_m = standoff_m * draws.uniform((0.5, 0.9));
    for _ in 0..count {
        for _ in 0..TRIES {
            let [east, north] = size_m.map(|size| draws.uniform((0.0, size)));
            let is_free = boards.iter().all(|other| {
                let [x, y, _] = other.center_m;
                (east - x).hypot(north - y) > 1.5 * side_m
            });
            if is_free {
                boards.push(BoardSettings {
                    center_m: [east, north, 0.3 * standoff_m],
                    tilt_deg: draws.uniform((0.0, 55.0)),
                    azimuth_deg: draws.uniform((0.0, 360.0)),
                    size_m: [side_m, side_m],
                    moved_m: [0.0; 3],
                });
                break;
            }
        }
    }
    boards
}

/// Draws the passes: strips back and forth, lines in all directions, one loop again and again, or over the boards.
pub(super) fn route(draws: &mut Draws, extent: &Extent, scenario: &mut Scenario) {
    let [east_m, north_m] = scenario.field.size_m;
    let motion = &scenario.motion;
    let turn_s = 7.0 * motion.turn_radius_m / motion.transit_speed_m_s;
    let pass_s = east_m / motion.scan_speed_m_s + turn_s;
    let duration_s = draws.log_uniform(extent.duration_s);
    let count = ((duration_s / pass_s) as usize).clamp(3, 24);
    let line = |from_m: [f64; 2], to_m: [f64; 2]| Pass::Line { from_m, to_m };
    let kind = draws.uniform((0.0, 1.0));
    let passes: Vec<Pass> = if !scenario.boards.is_empty() && kind < 0.7 {
        (0..count)
            .map(|k| Pass::Board {
                board: k % scenario.boards.len(),
                heading_deg: draws.uniform((0.0, 360.0)),
            })
            .collect()
    } else if kind < 0.8 {
        let start = draws.uniform((0.1, 0.3));
        (0..count)
            .map(|k| {
                let share = start + (0.9 - start) * k as f64 / count as f64;
                let ends = [[0.0, share * north_m], [east_m, share * north_m]];
                let [from_m, to_m] = if k % 2 == 0 { ends } else { [ends[1], ends[0]] };
                line(from_m, to_m)
            })
            .collect()
    } else if kind < 0.9 {
        // Lines through the middle of the field, each from another side.
        (0..count)
            .map(|_| {
                let half_m = 0.5 * east_m.min(3.0 * north_m);
                let (sin, cos) = draws.uniform((0.0, 360.0)).to_radians().sin_cos();
                let at = |length_m: f64| {
                    let margin_m = scenario.field.margin_m;
                    let north =
                        (0.5 * north_m + sin * length_m).clamp(-margin_m, north_m + margin_m);
                    [0.5 * east_m + cos * length_m, north]
                };
                line(at(-half_m), at(half_m))
            })
            .collect()
    } else {
        let [low, high] = [0.3, 0.7].map(|share| share * north_m);
        (0..count)
            .map(|k| {
                if k % 2 == 0 {
                    line([0.0, low], [east_m, low])
                } else {
                    line([east_m, high], [0.0, high])
                }
            })
            .collect()
    };
    scenario.drives = vec![DriveSettings { passes }];
}
