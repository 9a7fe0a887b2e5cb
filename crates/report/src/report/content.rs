//! Content of the report: the results of the stages, and their provenance.
//!
//! Every section may be absent (`None` or an empty list) and is then left out of the page. Numbers
//! that are not finite are shown as a dash in tables and as a gap in figures.

use super::imprint::Imprint;
use super::scene::Scene;
use crate::calibration::{Calibration, Method, Variant};
use crate::comparison::{Agreement, Agreements, MountingKind};
use crate::geometry::{BodyAxes, BodyFromScanner, Vec3};
use crate::joint::{Joint, JointReport};
use crate::progress::StageSeconds;
use crate::sensor::{PoseRecord, RejectedRow};
use crate::stored::stored;
use crate::trajectory::{Doubt, Solution};
use crate::verdict::Verdict;

/// The whole report.
#[derive(Debug, Clone, Default)]
pub struct Content<'a> {
    /// Heading of the page, for example "Calibration of drive-1".
    pub title: String,
    /// The command as typed.
    pub command: String,
    /// Path of the project file as typed.
    pub project: String,
    /// Seed of every random draw.
    pub seed: Option<u64>,
    /// Who made it.
    pub imprint: Imprint,
    /// Their logo as a data URI.
    pub logo: Option<String>,
    /// When the results were found, seconds since 1970.
    pub made_s: Option<f64>,
    /// Inputs: one line per sensor, drive or notable setting.
    pub inputs: Vec<Fact>,
    /// Names of those of the [`csv::FILES`](super::csv::FILES) that stand beside the page.
    pub csv: Vec<&'static str>,
    /// The files that were read.
    pub files: &'a [InputFile],
    /// Where the sensors are on the body.
    pub platform: Option<Platform>,
    /// The calibration, and what it is compared with.
    pub calibrations: Option<Calibrations<'a>>,
    /// Two clouds compared by themselves.
    pub comparison: Option<Comparison>,
    /// The calibration drive, then the others.
    pub drives: &'a [Drive],
    /// The thinned reference, world frame, metres; higher points are drawn darker.
    pub background_m: &'a [Vec3],
    /// Run time by stage, in order.
    pub stages: &'a [StageSeconds],
    /// Peak resident memory, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// What the first placement of the scans contradicts.
    pub placement: &'a [Verdict],
    /// Warnings in the order they were raised.
    pub warnings: &'a [String],
    /// What is said about the results, the gravest first; empty before it is found.
    pub verdicts: Vec<Verdict>,
}

/// A calibration and what it is compared with. All list the same scanners in the same order.
#[derive(Debug, Clone, Copy)]
pub struct Calibrations<'a> {
    /// The body_from_scanner of each scanner for which clouds were compared: initial, final, and
    /// the truth if it is known (simulation).
    pub mountings: &'a [(MountingKind, Vec<BodyFromScanner>)],
    /// The calibration that gives the result.
    pub result: &'a Calibration,
    /// The joint adjustment of the run, accepted or refused; `None` where none was asked for.
    pub joint: Option<&'a JointReport>,
    /// Calibrations of the same drive under other conditions.
    pub variants: &'a [(Variant, Calibration)],
    /// The project's origin, which coordinates in these results lack, metres.
    pub origin_m: Vec3,
}

impl<'a> Calibrations<'a> {
    /// The mountings of this kind, if there are any.
    pub fn mountings(&self, kind: MountingKind) -> Option<&'a [BodyFromScanner]> {
        let mut all = self.mountings.iter();
        all.find(|(other, _)| *other == kind)
            .map(|(_, poses)| poses.as_slice())
    }

    /// The calibration under these conditions, if there is one.
    pub fn variant(&self, variant: Variant) -> Option<&'a Calibration> {
        let mut all = self.variants.iter();
        all.find(|(other, _)| *other == variant)
            .map(|(_, found)| found)
    }

    /// The calibration in two steps, if there is one.
    pub fn two_steps(&self) -> Option<&'a Calibration> {
        let is_result = self.result.method == Method::TwoStep;
        let own = is_result.then_some(self.result);
        own.or_else(|| self.variant(Variant::TwoStep))
    }

    /// What the joint adjustment found, whether its values are the result or not.
    pub fn joint_found(&self) -> Option<&'a Joint> {
        self.joint?.found.as_ref()
    }

    /// What the joint adjustment found where its values are not the result.
    pub fn refused(&self) -> Option<&'a Joint> {
        let is_refused = self.joint?.accepted().is_none();
        self.joint_found().filter(|_| is_refused)
    }
}

/// Two clouds compared with each other.
#[derive(Debug, Clone)]
pub struct Comparison {
    /// Name of the reference.
    pub reference: String,
    /// What was found, under the name of the cloud.
    pub found: Agreement,
}

/// Results of one drive.
#[derive(Debug, Clone, Default)]
pub struct Drive {
    /// Name.
    pub name: String,
    /// The poses in time order, the project's origin subtracted.
    pub poses: Vec<PoseRecord>,
    /// Result of the adjustment; `None` if the poses came from a file.
    pub solution: Option<Solution>,
    /// Rows of its logs without a measurement.
    pub rejected_rows: Vec<RejectedRow>,
    /// Agreement of its clouds.
    pub agreements: Agreements,
    /// What its raw logs contradict.
    pub preflight: Vec<Verdict>,
    /// Constants of its project that it contradicts.
    pub doubts: Vec<Doubt>,
    /// Its clouds, for the viewer.
    pub scene: Option<Scene>,
}

/// Where the sensors are on the body.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Platform {
    /// Axes of the body.
    pub axes: BodyAxes,
    /// Prisms and antennas, in the body frame, metres.
    pub marks: Vec<(String, Vec3)>,
    /// The far end of each scanner's field of view, in its frame, metres; empty where it is no fan.
    pub outlines_m: Vec<Vec<Vec3>>,
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct InputFile {
    /// As named by the project, absolute.
    pub path: String,
    /// Its size.
    pub bytes: u64,
    /// XXH128 of its content, as `xxhsum -H2` prints it; `None` where it could not be read.
    pub xxh128: Option<u128>,
}

/// A label and its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Fact {
    /// For example "IMU".
    pub label: String,
    /// For example "imu.csv, 30,000 samples at 100 Hz, 300 s".
    pub value: String,
}

stored!(struct Comparison { reference, found });
stored!(struct Fact { label, value });
stored!(struct Platform { axes, marks, outlines_m });
stored!(struct InputFile { path, bytes, xxh128 });
stored!(struct Drive { name, poses, solution, rejected_rows, agreements, preflight, doubts, scene });
