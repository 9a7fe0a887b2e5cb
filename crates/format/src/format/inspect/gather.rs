//! Times and ranges of a stream, collected while it is read.

use super::inspection::{Bounds, Gap, Inspection};
use super::picture::Picture;
use crate::error::Result;
use crate::format::plausible::{check_place, check_time};
use crate::geometry::Vec3;
use crate::sensor::Continued;
use crate::statistics::{SIGMAS_PER_MAD, median};

/// Columns of points.
pub(super) const POINT: [&str; 4] = ["x_m", "y_m", "z_m", "intensity"];
/// Columns with coordinates.
const COORDINATES: [&str; 6] = ["x_m", "y_m", "z_m", "east_m", "north_m", "up_m"];
/// An interval is a gap beyond this many usual ones: single records that are lost or late are not.
const GAP_INTERVALS: f64 = 5.0;
/// Largest number of gaps listed.
const MOST_GAPS: usize = 10;
/// Largest number of intervals from which the median is taken.
const MOST_INTERVALS: usize = 1_000_000;

/// Collects the times of a stream.
#[derive(Default)]
pub(super) struct Times {
    span: Option<[f64; 2]>,
    last: Option<f64>,
    epochs: u64,
    intervals: Vec<f64>,
    longest: Vec<Gap>,
    backwards: u64,
    continued: Continued,
    /// Rows with the time of the previous row.
    pub(super) repeated: u64,
}

impl Times {
    fn add(&mut self, time_s: f64) {
        let time_s = self.continued.at(time_s);
        let span = self.span.get_or_insert([time_s; 2]);
        *span = [span[0].min(time_s), span[1].max(time_s)];
        let Some(last) = self.last.replace(time_s) else {
            self.epochs = 1;
            return;
        };
        if time_s < last {
            self.backwards += 1;
        } else if time_s == last {
            self.repeated += 1;
        } else if time_s > last {
            self.epochs += 1;
            let duration_s = time_s - last;
            if self.intervals.len() < MOST_INTERVALS {
                self.intervals.push(duration_s);
            }
            let place = self.longest.partition_point(|g| g.duration_s >= duration_s);
            if place < MOST_GAPS {
                let gap = Gap {
                    start_s: last,
                    duration_s,
                };
                self.longest.insert(place, gap);
                self.longest.truncate(MOST_GAPS);
            }
        }
    }

    fn report(mut self, into: &mut Inspection) -> Result<()> {
        into.span_s = self.span;
        for time_s in self.span.into_iter().flatten() {
            check_time(&into.path, time_s)?;
        }
        into.notes.extend(self.continued.remark());
        if self.backwards > 0 {
            let times = match self.backwards {
                1 => "once".to_owned(),
                several => format!("{several} times"),
            };
            into.notes.push(format!(
                "the time goes backwards {times}: the rows are not in time order"
            ));
            return Ok(());
        }
        into.epochs = self.span.map(|_| self.epochs);
        let Some(median_s) = median(self.intervals.clone()) else {
            return Ok(());
        };
        let mut deviations_s = std::mem::take(&mut self.intervals);
        deviations_s
            .iter_mut()
            .for_each(|interval| *interval = (*interval - median_s).abs());
        into.rate_hz = Some(1.0 / median_s);
        into.jitter_s = median(deviations_s).map(|mad_s| SIGMAS_PER_MAD * mad_s);
        into.gaps = self.longest;
        into.gaps
            .retain(|gap| gap.duration_s > GAP_INTERVALS * median_s);
        Ok(())
    }
}

/// Summary of the records of a stream: their number, their times, and the ranges of named columns.
pub(super) struct StreamSummary {
    pub(super) count: u64,
    pub(super) clock: Times,
    bounds: Vec<Bounds>,
    picture: Option<Picture>,
    /// Values of the last record.
    values: Vec<f64>,
}

impl StreamSummary {
    /// The summary of records that hold `names` in addition to their time.
    pub(super) fn of_columns(names: &[&str]) -> Self {
        let bounds = |name: &&str| Bounds {
            column: (*name).to_owned(),
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
        };
        Self {
            count: 0,
            clock: Times::default(),
            bounds: names.iter().map(bounds).collect(),
            picture: Picture::of_columns(names),
            values: Vec::with_capacity(names.len()),
        }
    }

    /// Adds a record; NaN stands for absent values, also for an absent time.
    pub(super) fn add(&mut self, time_s: f64, values: impl IntoIterator<Item = f64>) {
        self.count += 1;
        if !time_s.is_nan() {
            self.clock.add(time_s);
        }
        self.values.clear();
        self.values.extend(values);
        if let Some(picture) = &mut self.picture {
            picture.add(&self.values);
        }
        for (bounds, &value) in self.bounds.iter_mut().zip(&self.values) {
            // Both comparisons are false for NaN.
            if value < bounds.min {
                bounds.min = value;
            }
            if value > bounds.max {
                bounds.max = value;
            }
        }
    }

    /// Writes the summary into an inspection.
    ///
    /// # Errors
    /// Times or coordinates that no sensor can have.
    pub(super) fn report(mut self, into: &mut Inspection) -> Result<()> {
        self.bounds.retain(|b| b.min <= b.max);
        for bounds in &self.bounds {
            if COORDINATES.contains(&bounds.column.as_str()) {
                check_place(&into.path, &Vec3::new(bounds.min, bounds.max, 0.0))?;
            }
        }
        into.bounds = self.bounds;
        into.count = self.count;
        into.picture = self
            .picture
            .map_or_else(Vec::new, |picture| picture.lines());
        self.clock.report(into)
    }
}
