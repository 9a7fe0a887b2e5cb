//! The fields of records with a layout described by a header: PLY, PCD and `.npy`.

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::binary::Number;
use crate::format::cloud::gathering::Gathering;
use crate::format::cloud::names::VIEWPOINTS;
use crate::geometry::Vec3;

/// The fields of a record that hold a point.
#[derive(Debug, Clone)]
pub(crate) struct Fields {
    xyz: [usize; 3],
    intensity: Option<usize>,
    time: Option<usize>,
    /// Whether times are numbers of 32 bits.
    is_time_single: bool,
    viewpoint: Option<[usize; 3]>,
    remarks: Vec<String>,
}

/// Names of times in seconds and of intensities, without differences of spelling; the first one found is taken.
const TIMES: [&str; 7] = [
    "times",
    "gpstime",
    "time",
    "timestamp",
    "timestamps",
    "t",
    "gpstimes",
];
const INTENSITIES: [&str; 3] = ["intensity", "intensities", "i"];

/// A name without differences of spelling: `scalar_Gps_Time` of CloudCompare becomes `gpstime`.
fn plain(name: &str) -> String {
    let name = name.to_lowercase();
    name.strip_prefix("scalar_")
        .unwrap_or(&name)
        .replace(['_', ' '], "")
}

impl Fields {
    /// The fields with these names and types; `None` without x, y and z.
    pub(crate) fn of(names: &[String], types: &[Number]) -> Option<Self> {
        let plain: Vec<String> = names.iter().map(|name| plain(name)).collect();
        let find = |wanted: &str| plain.iter().position(|name| name == wanted);
        let first = |wanted: &[&str]| wanted.iter().find_map(|name| find(name));
        let xyz = [find("x")?, find("y")?, find("z")?];
        let is_number = |at: usize| matches!(types.get(at), Some(Number::F32 | Number::F64));
        let named_time = first(&TIMES);
        // Whole numbers count milliseconds, microseconds or nanoseconds.
        let time = named_time.filter(|at| is_number(*at));
        let intensity = first(&INTENSITIES);
        let viewpoint = VIEWPOINTS
            .iter()
            .find_map(|[x, y, z]| Some([find(x)?, find(y)?, find(z)?]));
        let mut remarks = Vec::new();
        let used = |at: &usize| {
            xyz.contains(at)
                || [intensity, time].contains(&Some(*at))
                || viewpoint.is_some_and(|fields| fields.contains(at))
        };
        let is_named = |at: &usize| names[*at] != "_" && Some(*at) != named_time;
        let left_out = (0..names.len()).filter(|at| !used(at) && is_named(at));
        let left_out: Vec<&str> = left_out.map(|at| names[at].as_str()).collect();
        if !left_out.is_empty() {
            remarks.push(format!("the fields {} are left out", left_out.join(", ")));
        }
        if let (Some(at), None) = (named_time, time) {
            remarks.push(format!(
                "the field {} has whole numbers of an unknown unit of time: points have no times",
                names[at]
            ));
        }
        Some(Self {
            xyz,
            intensity,
            time,
            is_time_single: time.is_some_and(|at| matches!(types[at], Number::F32)),
            viewpoint,
            remarks,
        })
    }

    /// Adds a record to a cloud.
    pub(crate) fn push(&self, values: &[f64], into: &mut Gathering<'_>) {
        let at = |index: Option<usize>| index.map_or(f64::NAN, |i| values[i]);
        let [x, y, z] = self.xyz.map(|i| values[i]);
        into.push(Vec3::new(x, y, z), at(self.time), at(self.intensity));
        if let Some(fields) = self.viewpoint {
            into.seen_from(Vec3::from(fields.map(|i| values[i])));
        }
    }

    /// The cloud, with remarks on the fields that are left out.
    ///
    /// # Errors
    /// Those of [`Gathering::finish`].
    pub(crate) fn finish(self, mut gathering: Gathering<'_>) -> Result<PointCloud> {
        if self.is_time_single {
            gathering.check_single_times();
        }
        for remark in self.remarks {
            gathering.input().remark(remark);
        }
        gathering.finish()
    }
}
