//! The points of a cloud file as its reader finds them, and what is left out of them.

use crate::cloud::PointCloud;
use crate::geometry::{Vec3, is_finite};

/// A cloud, and remarks on what its file holds that is not in it.
#[derive(Debug, Clone, Default)]
pub(crate) struct ReadCloud {
    /// The points. A time or an intensity is NaN where a point has none.
    pub cloud: PointCloud,
    /// What was left out or assumed, with numbers, one sentence each.
    pub remarks: Vec<String>,
}

impl From<PointCloud> for ReadCloud {
    fn from(cloud: PointCloud) -> Self {
        Self {
            cloud,
            remarks: Vec::new(),
        }
    }
}

/// Collects the points of a file.
#[derive(Default)]
pub(crate) struct Gathering {
    read: ReadCloud,
    /// Records without a position, which were not measured.
    unmeasured: u64,
    /// Points at the origin of their scanner, which were not measured.
    at_scanner: u64,
}

impl Gathering {
    /// Adds a record; NaN stands for values that it does not have. Without a finite position it was not measured.
    pub(crate) fn push(&mut self, position: Vec3, time_s: f64, intensity: f64) {
        if !is_finite(&position) {
            self.unmeasured += 1;
            return;
        }
        let or_none = |value: f64| if value.is_finite() { value } else { f64::NAN };
        let cloud = &mut self.read.cloud;
        cloud.points.push(position);
        cloud.time_s.push(or_none(time_s));
        cloud.intensity.push(or_none(intensity) as f32);
    }

    /// Counts a point at the origin of its scanner.
    pub(crate) fn skip_at_scanner(&mut self) {
        self.at_scanner += 1;
    }

    /// Adds a remark.
    pub(crate) fn remark(&mut self, remark: String) {
        self.read.remarks.push(remark);
    }

    /// Makes room for this many points.
    pub(crate) fn reserve(&mut self, points: usize) {
        let cloud = &mut self.read.cloud;
        cloud.points.reserve_exact(points);
        cloud.time_s.reserve_exact(points);
        cloud.intensity.reserve_exact(points);
    }

    /// The cloud; times and intensities that no point has are removed.
    pub(crate) fn finish(self) -> ReadCloud {
        let Self {
            mut read,
            unmeasured,
            at_scanner,
        } = self;
        read.cloud.forget_absent();
        if unmeasured > 0 {
            read.remarks.push(format!(
                "left out: {} without a position",
                counted(unmeasured, "record")
            ));
        }
        if at_scanner > 0 {
            read.remarks.push(format!(
                "left out: {} at the origin of the scanner, not measured",
                counted(at_scanner, "point")
            ));
        }
        read
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
