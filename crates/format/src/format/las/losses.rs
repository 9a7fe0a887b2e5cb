//! What LAS cannot hold of times and intensities: it has no empty values, and intensities are whole numbers of 16 bits.

use crate::progress::Progress;

/// Counts the values that are changed when points are written as LAS.
#[derive(Debug)]
pub struct LasLosses {
    times: u64,
    intensities: u64,
    rounded: u64,
    points: u64,
    /// Smallest and largest intensity.
    range: [f32; 2],
}

impl Default for LasLosses {
    fn default() -> Self {
        Self {
            times: 0,
            intensities: 0,
            rounded: 0,
            points: 0,
            range: [f32::INFINITY, f32::NEG_INFINITY],
        }
    }
}

impl LasLosses {
    /// A time (s) and an intensity as LAS can hold them: 0 for none. The intensity is rounded later.
    pub fn filled(&mut self, time_s: f64, intensity: f32) -> (f64, f32) {
        self.points += 1;
        self.times += u64::from(time_s.is_nan());
        let time_s = if time_s.is_nan() { 0.0 } else { time_s };
        if intensity.is_nan() {
            self.intensities += 1;
            return (time_s, 0.0);
        }
        let is_whole = intensity.fract() == 0.0 && (0.0..=65535.0).contains(&intensity);
        self.rounded += u64::from(!is_whole);
        self.range = [self.range[0].min(intensity), self.range[1].max(intensity)];
        (time_s, intensity)
    }

    /// Says what was changed.
    pub fn warn(&self, progress: &dyn Progress) {
        let Self {
            points,
            range: [least, most],
            ..
        } = self;
        for (count, what) in [(self.times, "time"), (self.intensities, "intensity")] {
            if count > 0 {
                progress.warn(&format!(
                    "{count} of {points} points have no {what}: 0 is written, because LAS has no empty values"
                ));
            }
        }
        if self.rounded > 0 {
            progress.warn(&format!(
                "intensities are rounded to whole numbers from 0 to 65535, as LAS holds them: {} of {points}, which are \
                 {least} to {most} in all; E57, PLY, Parquet and CSV keep them",
                self.rounded
            ));
        }
    }
}
