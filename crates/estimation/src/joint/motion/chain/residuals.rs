//! Residuals of the position sensors, one by one and in blocks of time.

use super::ChainMotion;
use crate::geometry::Vec3;
use crate::joint::motion::{Motion, PositionBlocks, PositionResiduals};
use crate::trajectory::factors::PositionFactor;
use crate::trajectory::graph::Source;

/// Fewest records of a block.
const MIN_BLOCK: usize = 3;

impl ChainMotion {
    /// Visits the used records of a position sensor: time, whitened residual, and whitened residual
    /// without the correlated error.
    fn each_position(&self, sensor: usize, mut visit: impl FnMut(&PositionFactor, Vec3, Vec3)) {
        for step in 0..self.steps() {
            self.graph
                .record_residuals(&self.state, step, |source, weight, residual| {
                    let Source::Position(fix) = source else {
                        return;
                    };
                    if fix.sensor != sensor || weight == 0.0 {
                        return;
                    }
                    let error = self.error_of(&source);
                    let moved = |i: usize| error.as_ref().map_or(0.0, |error| error.residual(i));
                    let whitened = Vec3::from_column_slice(residual);
                    visit(fix, whitened, Vec3::from_fn(|i, _| residual[i] + moved(i)));
                });
        }
    }

    /// All residuals of a position sensor.
    pub(super) fn residuals_of(&self, sensor: usize, name: &str) -> PositionResiduals {
        let mut records = Vec::new();
        self.each_position(sensor, |fix, whitened, _| {
            let metres = fix.whitener.try_inverse().map(|w| w * whitened);
            records.extend(metres.map(|metres| (fix.time_s, metres)));
        });
        PositionResiduals {
            sensor: name.to_owned(),
            records,
        }
    }

    /// Root mean squares of the means of its residuals over blocks of time.
    pub(super) fn blocks_of(&self, sensor: usize, name: &str, block_s: f64) -> PositionBlocks {
        let start_s = self.graph.timeline.node_s[0];
        // Block, its number of records, and the sum of their normalised residuals.
        let mut sums: Vec<(i64, usize, Vec3)> = Vec::new();
        self.each_position(sensor, |fix, _, value| {
            let block = ((fix.time_s - start_s) / block_s).floor() as i64;
            match sums.last_mut().filter(|last| last.0 == block) {
                Some(last) => {
                    last.1 += 1;
                    last.2 += value;
                }
                None => sums.push((block, 1, value)),
            }
        });
        sums.retain(|sum| sum.1 >= MIN_BLOCK);
        let count = sums.len().max(1) as f64;
        let square = |i: usize| {
            sums.iter()
                .map(|(_, n, sum)| sum[i] * sum[i] / *n as f64)
                .sum::<f64>()
        };
        PositionBlocks {
            sensor: name.to_owned(),
            block_s,
            blocks: sums.len(),
            rms: std::array::from_fn(|i| (square(i) / count).sqrt()),
        }
    }
}
