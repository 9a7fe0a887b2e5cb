//! The points of a cloud file as its reader finds them, and what is left out of them.

use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::format::cloud::viewpoints::Viewpoints;
use crate::format::input::Input;
use crate::format::plausible::check_point;
use crate::geometry::{Vec3, is_finite};

/// Steps of times that are worth a word, and steps in which no time is left, seconds.
const COARSE_S: f64 = 1e-3;
const USELESS_S: f64 = 1.0;

/// Collects the points of a file; the input remarks what is left out of them.
pub(crate) struct Gathering<'a> {
    input: &'a Input,
    cloud: PointCloud,
    /// Records without a position, which were not measured.
    unmeasured: u64,
    /// Points at the origin of their scanner, which were not measured.
    at_scanner: u64,
    viewpoints: Viewpoints,
    /// The error of the first point that is too far away or too late.
    impossible: Option<Error>,
}

impl<'a> Gathering<'a> {
    pub(crate) fn new(input: &'a Input) -> Self {
        Self {
            input,
            cloud: PointCloud::default(),
            unmeasured: 0,
            at_scanner: 0,
            viewpoints: Viewpoints::default(),
            impossible: None,
        }
    }

    /// The file.
    pub(crate) fn input(&self) -> &Input {
        self.input
    }

    /// Adds a record; NaN stands for values that it does not have. Without a finite position it was not measured.
    pub(crate) fn push(&mut self, position: Vec3, time_s: f64, intensity: f64) {
        if !is_finite(&position) {
            self.unmeasured += 1;
            return;
        }
        let or_none = |value: f64| if value.is_finite() { value } else { f64::NAN };
        let time_s = or_none(time_s);
        let number = self.cloud.points.len() as u64;
        if let Err(error) = check_point(self.input.path(), number, &position, time_s) {
            self.impossible.get_or_insert(error);
        }
        self.cloud.points.push(position);
        self.cloud.time_s.push(time_s);
        self.cloud.intensity.push(or_none(intensity) as f32);
    }

    /// Counts a point at the origin of its scanner.
    pub(crate) fn skip_at_scanner(&mut self) {
        self.at_scanner += 1;
    }

    /// Keeps a place from which points were seen; of those within a decimetre, the first.
    pub(crate) fn seen_from(&mut self, place: Vec3) {
        self.viewpoints.add(place);
    }

    /// Keeps the place from which the scan that ends here was taken, by the translation of its pose. Programs also
    /// write a translation of zero for a scan whose pose they do not know: it counts if the scan lies around it.
    /// `first` is the number of points before the scan.
    pub(crate) fn scanned_from(&mut self, translation: Vec3, first: usize) {
        let scan = &self.cloud.points[first.min(self.cloud.points.len())..];
        let mut bounds = scan
            .iter()
            .fold(None, |bounds: Option<(Vec3, Vec3)>, point| {
                let (low, high) = bounds.unwrap_or((*point, *point));
                Some((low.inf(point), high.sup(point)))
            });
        if translation == Vec3::zeros() {
            bounds = bounds.filter(|(low, high)| {
                let size = high - low;
                (0..3).all(|i| low[i] - size.norm() <= 0.0 && high[i] + size.norm() >= 0.0)
            });
        }
        if bounds.is_some() {
            self.seen_from(translation);
        }
    }

    /// Says how coarse times are that were numbers of 32 bits, and leaves them out if they are useless. Numbers that
    /// were written in decimals are exact.
    pub(crate) fn check_single_times(&mut self) {
        let times_s = self
            .cloud
            .time_s
            .iter()
            .copied()
            .filter(|time_s| !time_s.is_nan());
        let latest_s = times_s.clone().map(f64::abs).fold(0.0, f64::max);
        let latest = latest_s as f32;
        let step_s = f64::from(latest.next_up() - latest);
        if step_s < COARSE_S
            || times_s
                .clone()
                .any(|time_s| f64::from(time_s as f32) != time_s)
        {
            return;
        }
        let what =
            format!("times near {latest_s:.0} s as numbers of 32 bits have steps of {step_s} s");
        if step_s < USELESS_S {
            self.input.remark(what);
        } else {
            self.input
                .remark(format!("{what} and are left out: write them as `double`"));
            self.cloud.time_s.fill(f64::NAN);
        }
    }

    /// Number of points so far.
    pub(crate) fn len(&self) -> usize {
        self.cloud.points.len()
    }

    /// Makes room for this many points.
    pub(crate) fn reserve(&mut self, points: usize) {
        self.cloud.points.reserve_exact(points);
        self.cloud.time_s.reserve_exact(points);
        self.cloud.intensity.reserve_exact(points);
    }

    /// The cloud; times and intensities that no point has are removed.
    ///
    /// # Errors
    /// A coordinate or a time beyond any sensor.
    pub(crate) fn finish(mut self) -> Result<PointCloud> {
        if let Some(error) = self.impossible {
            return Err(error);
        }
        self.cloud.forget_absent();
        self.input.seen_from(self.viewpoints.into_places());
        let left_out = [
            (self.unmeasured, "record", "without a position"),
            (
                self.at_scanner,
                "point",
                "at the origin of the scanner, not measured",
            ),
        ];
        for (count, thing, why) in left_out.into_iter().filter(|(count, ..)| *count > 0) {
            let records = counted(count, thing);
            self.input.remark(format!("left out: {records} {why}"));
        }
        gaps(&self.cloud)
            .into_iter()
            .for_each(|gap| self.input.remark(gap));
        Ok(self.cloud)
    }
}

/// What to say about the columns behind x y z of a table with this many columns that does not name them.
pub(crate) fn unnamed(columns: usize) -> Option<String> {
    let which = match columns {
        0..=3 => return None,
        4 => "column 4 has no name and is".to_owned(),
        _ => format!("columns 4 to {columns} have no names and are"),
    };
    Some(format!("{which} left out"))
}

/// A number of things: `1 point`, `2 points`.
pub(crate) fn counted(count: u64, thing: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} {thing}{plural}")
}

/// Remarks on columns with gaps.
pub(crate) fn gaps(cloud: &PointCloud) -> Vec<String> {
    let points = cloud.points.len();
    let times = cloud.time_s.iter().filter(|v| v.is_nan()).count();
    let intensities = cloud.intensity.iter().filter(|v| v.is_nan()).count();
    let remark = |missing: usize, what: &str| {
        (missing > 0).then(|| format!("{missing} of {points} points have no {what}"))
    };
    let remarks = [remark(times, "time"), remark(intensities, "intensity")];
    remarks.into_iter().flatten().collect()
}
