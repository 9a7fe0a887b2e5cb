//! Rough soil as a height field, and its intersection with rays.

use rayon::prelude::*;

use super::clods::{self, Raster};
use super::field::{Field, SoilSettings};
use super::random::{Purpose, stream};
use super::ray::{self, Squares};
use super::wave::Wave;
use crate::geometry::Vec3;

/// Cells along one side of a tile.
const TILE: usize = 8;

/// A height field: a biquadratic B-spline over a fine grid of heights, continuously
/// differentiable. The heights are a sum of smooth noise from metres down to centimetres, with clods
/// on it.
#[derive(Debug, Clone)]
pub struct Soil {
    waves: Vec<Wave>,
    origin: [f64; 2],
    cell_m: f64,
    columns: usize,
    rows: usize,
    control: Vec<f32>,
    /// One square for each tile.
    squares: Squares,
    tiles: Vec<Tile>,
    highest: f64,
}

/// Bounds for rays over a square of cells.
#[derive(Debug, Clone, Copy, Default)]
struct Tile {
    highest: f64,
    slope: f64,
}

impl Soil {
    /// The soil of this seed around the field.
    pub fn new(seed: u64, field: &Field, settings: &SoilSettings) -> Self {
        let waves: Vec<Wave> = settings
            .wavelengths_m
            .iter()
            .zip(&settings.sigmas_m)
            .enumerate()
            .map(|(i, (&length, &sigma))| {
                Wave::new(stream(seed, Purpose::Soil, i as u64, 0), length, sigma)
            })
            .collect();
        let cell = settings.cell_m;
        let origin = [-field.margin_m, -field.margin_m];
        let count = |size: f64| {
            let cells = ((size + 2.0 * field.margin_m) / cell).ceil() as usize;
            cells.div_ceil(TILE) * TILE
        };
        let (columns, rows) = (count(field.size_m[0]) + 2, count(field.size_m[1]) + 2);
        let mut control: Vec<f32> = (0..rows)
            .into_par_iter()
            .flat_map_iter(|j| {
                let waves = &waves;
                (0..columns).map(move |i| {
                    let x = origin[0] + (i as f64 - 0.5) * cell;
                    let y = origin[1] + (j as f64 - 0.5) * cell;
                    waves.iter().map(|wave| wave.at(x, y)).sum::<f64>() as f32
                })
            })
            .collect();
        // Control point i is centred half a cell before grid line i.
        let centred = Raster {
            first_m: origin.map(|o| o - 0.5 * cell),
            cell_m: cell,
            columns,
            rows,
        };
        clods::add(&mut control, &centred, seed, settings);
        let mut soil = Self {
            waves,
            origin,
            cell_m: cell,
            columns,
            rows,
            control,
            squares: Squares {
                origin,
                side_m: TILE as f64 * cell,
                count: [(columns - 2) / TILE, (rows - 2) / TILE],
            },
            tiles: Vec::new(),
            highest: f64::NEG_INFINITY,
        };
        let [tile_columns, tile_rows] = soil.squares.count;
        soil.tiles = (0..tile_rows)
            .flat_map(|tj| (0..tile_columns).map(move |ti| (ti, tj)))
            .map(|(ti, tj)| soil.bound(ti, tj))
            .collect();
        soil.highest = soil
            .tiles
            .iter()
            .map(|tile| tile.highest)
            .fold(f64::NEG_INFINITY, f64::max);
        soil
    }

    /// Bounds of a tile by the convex hull of its control points and of their differences.
    fn bound(&self, ti: usize, tj: usize) -> Tile {
        let (mut highest, mut dx, mut dy) = (f64::NEG_INFINITY, 0.0f64, 0.0f64);
        for j in tj * TILE..(tj + 1) * TILE + 2 {
            for i in ti * TILE..(ti + 1) * TILE + 2 {
                let h = self.control(i, j);
                highest = highest.max(h);
                if i + 1 < (ti + 1) * TILE + 2 {
                    dx = dx.max((self.control(i + 1, j) - h).abs());
                }
                if j + 1 < (tj + 1) * TILE + 2 {
                    dy = dy.max((self.control(i, j + 1) - h).abs());
                }
            }
        }
        Tile {
            highest,
            slope: dx.hypot(dy) / self.cell_m,
        }
    }

    fn control(&self, i: usize, j: usize) -> f64 {
        f64::from(self.control[j * self.columns + i])
    }

    /// Height of the ground that supports a wheel: wavelengths of at least `shortest_m`.
    pub fn carrying_height_m(&self, x: f64, y: f64, shortest_m: f64) -> f64 {
        self.waves
            .iter()
            .filter(|wave| wave.length_m >= shortest_m)
            .map(|wave| wave.at(x, y))
            .sum()
    }

    /// Lower and upper corner of the extent of the ground, metres.
    pub fn extent_m(&self) -> [[f64; 2]; 2] {
        let size = |n: usize| (n - 2) as f64 * self.cell_m;
        [
            self.origin,
            [
                self.origin[0] + size(self.columns),
                self.origin[1] + size(self.rows),
            ],
        ]
    }

    /// Height and its gradient at a point; outside the extent, the nearest cell is extrapolated.
    pub fn height_and_gradient(&self, x: f64, y: f64) -> (f64, [f64; 2]) {
        let (u, v) = (
            (x - self.origin[0]) / self.cell_m,
            (y - self.origin[1]) / self.cell_m,
        );
        let i = (u.max(0.0) as usize).min(self.columns - 3);
        let j = (v.max(0.0) as usize).min(self.rows - 3);
        let (fx, fy) = (u - i as f64, v - j as f64);
        let weights = |f: f64| [0.5 * (1.0 - f) * (1.0 - f), 0.5 + f - f * f, 0.5 * f * f];
        let slopes = |f: f64| [f - 1.0, 1.0 - 2.0 * f, f];
        let (wx, wy, sx, sy) = (weights(fx), weights(fy), slopes(fx), slopes(fy));
        let (mut h, mut gx, mut gy) = (0.0, 0.0, 0.0);
        for k in 0..3 {
            let at = (j + k) * self.columns + i;
            let c = [self.control[at], self.control[at + 1], self.control[at + 2]].map(f64::from);
            let row = wx[0] * c[0] + wx[1] * c[1] + wx[2] * c[2];
            h += wy[k] * row;
            gy += sy[k] * row;
            gx += wy[k] * (sx[0] * c[0] + sx[1] * c[1] + sx[2] * c[2]);
        }
        (h, [gx / self.cell_m, gy / self.cell_m])
    }

    /// Height at a point, metres.
    pub fn height_m(&self, x: f64, y: f64) -> f64 {
        self.height_and_gradient(x, y).0
    }

    /// Range along the unit vector `direction` to the first point on the ground, accurate to 1e-6
    /// m; `None` beyond `max_range_m` or outside the extent of the ground.
    ///
    /// The tile's bound on the slope keeps every step too short to cross the ground.
    pub fn intersect(&self, origin: &Vec3, direction: &Vec3, max_range_m: f64) -> Option<f64> {
        let (enter, leave) = ray::within(origin, direction, self.extent_m())?;
        let max_range = max_range_m.min(leave);
        let mut range = enter.max(0.0);
        if origin.z + range * direction.z > self.highest {
            if direction.z >= 0.0 {
                return None;
            }
            range = (self.highest - origin.z) / direction.z;
        }
        let across = direction.x.hypot(direction.y);
        while range <= max_range {
            let p = origin + direction * range;
            let square @ [ti, tj] = self.squares.at(p.x, p.y);
            let tile = self.tiles[tj * self.squares.count[0] + ti];
            let exit = self.squares.leave(range, &p, direction, square);
            if p.z > tile.highest + 1e-9 {
                range = if direction.z < 0.0 {
                    exit.min((tile.highest - origin.z) / direction.z)
                } else {
                    exit
                };
                continue;
            }
            let (height, gradient) = self.height_and_gradient(p.x, p.y);
            let above = p.z - height;
            if above < 1e-5 {
                let closing = gradient[0] * direction.x + gradient[1] * direction.y - direction.z;
                // Below 10 µm the ground is flat enough for Newton's method unless the ray grazes
                // it.
                if above < 1e-7 {
                    return Some(range);
                } else if closing > 0.1 {
                    return Some(range + above / closing).filter(|&range| range <= max_range);
                }
            }
            let closing_bound = tile.slope * across - direction.z;
            range = if closing_bound > 0.0 {
                exit.min(range + (above / closing_bound).max(1e-8))
            } else {
                exit
            };
        }
        None
    }
}
