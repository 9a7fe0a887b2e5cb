//! Content of the report: the results of the stages, and their provenance.
//!
//! Every section may be absent (`None` or an empty list) and is then left out of the page. Numbers
//! that are not finite are shown as a dash in tables and as a gap in figures.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::imprint::Imprint;
use super::scene::Scene;
use crate::comparison::Agreement;
use crate::geometry::{BodyAxes, Vec3};
use crate::progress::StageSeconds;
use crate::results::{Calibrations, Drive};
use crate::verdict::Verdict;

/// The whole report.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Content<'a> {
    /// Heading of the page, for example "Calibration of drive-1".
    pub title: String,
    /// The command as typed.
    pub command: String,
    /// Path of the project file as typed.
    pub project: String,
    /// Seed of every random draw.
    pub seed: Option<u64>,
    /// Author of the report.
    pub imprint: Imprint,
    /// Logo of the author as a data URI.
    pub logo: Option<String>,
    /// When the results were computed, seconds since 1970.
    pub made_s: Option<f64>,
    /// Inputs: one line per sensor, drive or notable setting.
    pub inputs: Vec<Fact>,
    /// Names of the [`csv::FILES`](super::csv::FILES) that were written beside the page.
    pub csv: Vec<String>,
    /// The files that were read.
    pub files: Cow<'a, [InputFile]>,
    /// Where the sensors are on the body.
    pub platform: Option<Platform>,
    /// The calibration, with the values that it is compared with.
    pub calibrations: Option<Cow<'a, Calibrations>>,
    /// Two clouds compared by themselves.
    pub comparison: Option<Comparison>,
    /// A trajectory compared with a reference.
    pub compared_poses: Option<ComparedPoses>,
    /// The calibration drive, then the others.
    pub drives: Cow<'a, [Drive]>,
    /// The clouds of each drive for the viewer; empty if the page has no viewer.
    pub scenes: Cow<'a, [Option<Scene>]>,
    /// The thinned reference, world frame, metres; higher points are drawn darker.
    pub background_m: Cow<'a, [Vec3]>,
    /// Run time by stage, in order.
    pub stages: Cow<'a, [StageSeconds]>,
    /// Peak resident memory, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// Warnings in the order they were raised.
    pub warnings: Cow<'a, [String]>,
    /// The verdicts on the results, those that need attention first.
    pub verdicts: Vec<Verdict>,
}

/// Two clouds compared with each other.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Comparison {
    /// Name of the reference.
    pub reference: String,
    /// The comparison, under the name of the cloud.
    pub agreement: Agreement,
}

/// A trajectory compared with a reference, at its poses.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ComparedPoses {
    /// The errors in numbers.
    pub rows: Vec<ErrorRow>,
    /// Times, seconds.
    pub time_s: Vec<f64>,
    /// East and north of the reference, metres.
    pub reference_m: Vec<[f64; 2]>,
    /// East and north of the aligned estimate, metres.
    pub estimate_m: Vec<[f64; 2]>,
    /// Distances between them, metres.
    pub translation_m: Vec<f64>,
    /// Angles between the attitudes, radians.
    pub rotation_rad: Vec<f64>,
}

/// A kind of error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorRow {
    /// For example "ATE, translation".
    pub name: String,
    /// Unit of the values.
    pub unit: String,
    /// Root mean square, mean, median, standard deviation, least, most.
    pub values: [f64; 6],
}

/// Where the sensors are on the body.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Platform {
    /// Axes of the body.
    pub axes: BodyAxes,
    /// Prisms and antennas, in the body frame, metres.
    pub marks: Vec<(String, Vec3)>,
    /// The far end of each scanner's field of view, in its frame, metres; empty if it is not a fan.
    pub outlines_m: Vec<Vec<Vec3>>,
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InputFile {
    /// As named by the project, absolute.
    pub path: String,
    /// Its size.
    pub bytes: u64,
    /// XXH128 of its content, as `xxhsum -H2` prints it; `None` if it could not be read.
    pub xxh128: Option<u128>,
}

/// A label and its value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fact {
    /// For example "IMU".
    pub label: String,
    /// For example "imu.csv, 30,000 samples at 100 Hz, 300 s".
    pub value: String,
}
