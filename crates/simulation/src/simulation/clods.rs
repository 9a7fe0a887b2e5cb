//! Clods on the soil: bumps of random place, size, shape and height.

use std::f64::consts::{PI, TAU};

use rand::RngExt;

use super::field::SoilSettings;
use super::random::{Purpose, stream};

/// Smallest and largest size of a clod, relative to the mean size.
const SIZES: (f64, f64) = (0.5, 1.5);

/// Smallest ratio of the axes of a clod in plan view.
const ROUNDNESS: f64 = 0.6;

/// A grid of heights, row by row from south to north.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Raster {
    /// East and north of the first height, metres.
    pub first_m: [f64; 2],
    /// Distance between neighbours, metres.
    pub cell_m: f64,
    /// Heights per row.
    pub columns: usize,
    /// Number of rows.
    pub rows: usize,
}

/// Adds clods to the heights; where several overlap, the highest counts.
pub fn add(heights: &mut [f32], raster: &Raster, seed: u64, settings: &SoilSettings) {
    if settings.clod_height_m == 0.0 {
        return;
    }
    let mut clods = vec![0f32; heights.len()];
    let mut rng = stream(seed, Purpose::Clods, 0, 0);
    let size_m = [raster.columns, raster.rows].map(|n| n as f64 * raster.cell_m);
    // Means over sizes and shapes give the mean area; clods at random leave exp(−number · area) of
    // the ground free.
    let (small, large) = SIZES;
    let mean_square = (large.powi(3) - small.powi(3)) / (3.0 * (large - small));
    let mean_round = 0.5 * (1.0 + ROUNDNESS);
    let area_m2 = 0.25 * PI * settings.clod_size_m.powi(2) * mean_square * mean_round;
    let per_m2 = -(1.0 - settings.clod_cover).ln() / area_m2;
    let count = (per_m2 * size_m[0] * size_m[1]).round() as usize;
    for _ in 0..count {
        let [east, north] =
            [0, 1].map(|axis| raster.first_m[axis] + rng.random::<f64>() * size_m[axis]);
        let clod = Clod {
            centre_m: [east, north],
            half_m: 0.5 * settings.clod_size_m * rng.random_range(small..large),
            roundness: rng.random_range(ROUNDNESS..1.0),
            azimuth: rng.random_range(0.0..TAU),
            height_m: settings.clod_height_m * rng.random_range(small..large),
        };
        clod.raise(&mut clods, raster);
    }
    for (height, clod) in heights.iter_mut().zip(clods) {
        *height += clod;
    }
}

/// A dome over an ellipse.
struct Clod {
    centre_m: [f64; 2],
    half_m: f64,
    roundness: f64,
    azimuth: f64,
    height_m: f64,
}

impl Clod {
    /// Raises the heights below the clod to its own.
    fn raise(&self, heights: &mut [f32], raster: &Raster) {
        let span = |axis: usize, count: usize| {
            let at =
                |reach: f64| (self.centre_m[axis] + reach - raster.first_m[axis]) / raster.cell_m;
            let first = at(-self.half_m).ceil().max(0.0) as usize;
            let end = (at(self.half_m).floor() + 1.0).clamp(0.0, count as f64) as usize;
            first..end
        };
        for j in span(1, raster.rows) {
            for i in span(0, raster.columns) {
                let at = |axis: usize, k: usize| raster.first_m[axis] + k as f64 * raster.cell_m;
                let height = self.height_m(at(0, i), at(1, j)) as f32;
                let slot = &mut heights[j * raster.columns + i];
                *slot = slot.max(height);
            }
        }
    }

    /// Height of the clod above the relief: flat on top, steep at the rim.
    fn height_m(&self, east: f64, north: f64) -> f64 {
        let (dx, dy) = (east - self.centre_m[0], north - self.centre_m[1]);
        let (sin, cos) = self.azimuth.sin_cos();
        let along = (cos * dx + sin * dy) / self.half_m;
        let across = (cos * dy - sin * dx) / (self.half_m * self.roundness);
        let square = along * along + across * across;
        self.height_m * (1.0 - square * square).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clods_cover_their_share_with_their_height() {
        let raster = Raster {
            first_m: [-1.0, 2.0],
            cell_m: 0.01,
            columns: 1000,
            rows: 800,
        };
        let settings = SoilSettings {
            clod_height_m: 0.02,
            clod_cover: 0.3,
            ..SoilSettings::default()
        };
        let mut heights = vec![1f32; raster.columns * raster.rows];
        add(&mut heights, &raster, 1, &settings);
        let clods: Vec<f64> = heights.iter().map(|h| f64::from(h - 1.0)).collect();
        let covered = clods.iter().filter(|&&h| h > 0.0).count() as f64 / clods.len() as f64;
        assert!((covered - 0.3).abs() < 0.01, "{covered}");
        let highest = clods.iter().copied().fold(0.0, f64::max);
        assert!((0.028..0.0301).contains(&highest), "{highest}");
        // The mean of 1 − q⁴ over an ellipse is 2/3; overlaps show the higher clods.
        let mean = clods.iter().sum::<f64>() / (covered * clods.len() as f64);
        assert!((0.0125..0.016).contains(&mean), "{mean}");
    }
}
