//! What the report shows: the results of the stages, and a few words about where they come from.
//!
//! Every section may be absent (`None` or an empty list) and is then left out of the page. Numbers
//! that are not finite are shown as a dash in tables and as a gap in figures.

use crate::calibration::{Calibration, Variant};
use crate::comparison::{Agreements, MountingKind};
use crate::geometry::{BodyFromScanner, Vec3};
use crate::progress::StageSeconds;
use crate::sensor::{PoseRecord, RejectedRow};
use crate::trajectory::Solution;

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
    /// What was read: one line a sensor, drive or setting worth knowing.
    pub inputs: Vec<Fact>,
    /// The calibration, and what it is held against.
    pub calibrations: Option<Calibrations<'a>>,
    /// The calibration drive, then the others.
    pub drives: &'a [Drive],
    /// The reference thinned, world frame, metres; drawn darker where it is higher.
    pub background_m: &'a [Vec3],
    /// Run time by stage, in order.
    pub stages: &'a [StageSeconds],
    /// Peak resident memory, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// Warnings in the order they were raised.
    pub warnings: &'a [String],
}

/// A calibration and what it is held against. All list the same scanners in the same order.
#[derive(Debug, Clone, Copy)]
pub struct Calibrations<'a> {
    /// The body_from_scanner of each scanner that clouds were compared under: initial, final, and
    /// the truth where it is known (simulation).
    pub mountings: &'a [(MountingKind, Vec<BodyFromScanner>)],
    /// What gave the result.
    pub result: &'a Calibration,
    /// The same drive under other conditions.
    pub beside: &'a [(Variant, Calibration)],
}

impl<'a> Calibrations<'a> {
    /// The mountings of this kind, if there are any.
    pub fn mountings(&self, kind: MountingKind) -> Option<&'a [BodyFromScanner]> {
        let mut all = self.mountings.iter();
        all.find(|(other, _)| *other == kind)
            .map(|(_, poses)| poses.as_slice())
    }

    /// The calibration beside the result under these conditions, if there is one.
    pub fn variant(&self, variant: Variant) -> Option<&'a Calibration> {
        let mut all = self.beside.iter();
        all.find(|(other, _)| *other == variant)
            .map(|(_, found)| found)
    }
}

/// What a run found of one drive.
#[derive(Debug, Clone, Default)]
pub struct Drive {
    /// Name.
    pub name: String,
    /// The poses in time order, the project's origin subtracted.
    pub poses: Vec<PoseRecord>,
    /// What the adjustment left; `None` where the poses came from a file.
    pub solution: Option<Solution>,
    /// Rows of its logs that hold no measurement.
    pub rejected_rows: Vec<RejectedRow>,
    /// How well its clouds agree.
    pub agreements: Agreements,
}

/// How a statement is to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// As it should be.
    Good,
    /// Somebody should look at it.
    Attention,
    /// Neither: said for information.
    Neutral,
}

/// One statement in words a field crew understands, for example "Left scanner: points agree with
/// the reference scan to 1.3 mm (before: 43 mm)".
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// How it is to be taken.
    pub status: Status,
    /// One or two sentences, with units.
    pub text: String,
}

impl Verdict {
    /// A statement that all is as it should be.
    pub fn good(text: impl Into<String>) -> Self {
        Self {
            status: Status::Good,
            text: text.into(),
        }
    }

    /// A statement that somebody should look at.
    pub fn attention(text: impl Into<String>) -> Self {
        Self {
            status: Status::Attention,
            text: text.into(),
        }
    }

    /// A statement for information.
    pub fn neutral(text: impl Into<String>) -> Self {
        Self {
            status: Status::Neutral,
            text: text.into(),
        }
    }
}

/// A label and its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Fact {
    /// For example "IMU".
    pub label: String,
    /// For example "imu.csv, 30,000 samples at 100 Hz, 300 s".
    pub value: String,
}
