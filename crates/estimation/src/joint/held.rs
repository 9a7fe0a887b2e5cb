//! A slow motion of a mounting that is held at zero.

use std::f64::consts::{PI, SQRT_2};

use super::row::RowBatch;

/// Number of modes: periods down to a third of the drive.
pub const MODES: usize = 6;

/// A motion (δφ, δp) of a mounting in a drive that is held at zero, as coefficients of the modes √2 cos(k π t/T),
/// k = 1 to [`MODES`], with the time t since the first of its scans and their duration T.
#[derive(Debug, Clone)]
pub struct HeldMotion {
    /// Index of the drive.
    pub drive: usize,
    /// Index of the scanner.
    pub scanner: usize,
    /// The block of the first coefficient: 6 of a mode, mode after mode, a block each.
    pub first: usize,
    /// Time of the first profile, seconds.
    pub from_s: f64,
    /// From the first to the last profile, seconds.
    pub duration_s: f64,
}

impl HeldMotion {
    /// Whether it is of this scanner in this drive.
    pub fn is_of(&self, drive: usize, scanner: usize) -> bool {
        (self.drive, self.scanner) == (drive, scanner)
    }

    /// Adds the derivatives of a row at a time, given those by the mounting.
    pub fn touch(&self, time_s: f64, by_mounting: &[f64; 6], batch: &mut RowBatch) {
        let share = (time_s - self.from_s) / self.duration_s;
        for mode in 0..MODES {
            let value = SQRT_2 * ((mode + 1) as f64 * PI * share).cos();
            for (i, by) in by_mounting.iter().enumerate() {
                batch.touch(self.first + 6 * mode + i, &[by * value]);
            }
        }
    }
}
