//! What the report shows, as plain data, so that any stage can fill it.
//!
//! Every section may be absent (`None` or an empty list) and is then left out of the page. Numbers
//! that are not finite are shown as a dash in tables and as a gap in figures.

use super::diagnostics::PoseSigmas;
use crate::geometry::{BodyFromScanner, Mat3};
use crate::sensor::PoseRecord;
use crate::trajectory::Solution;

/// The whole report.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Content {
    /// Heading of the page, for example "Calibration of drive-1".
    pub title: String,
    /// Program and version, for example "boresight 0.1.0".
    pub version: String,
    /// Date of the run as text; empty where the bytes of the page must not depend on it.
    pub date: String,
    /// The command as typed.
    pub command: String,
    /// Path of the project file as typed.
    pub project: String,
    /// Seed of every random draw.
    pub seed: Option<u64>,
    /// The verdict, most important line first.
    pub summary: Vec<Verdict>,
    /// What was read: one line a sensor, drive or setting worth knowing.
    pub inputs: Vec<Fact>,
    /// The paper's Table I, one a scanner.
    pub mountings: Vec<MountingTable>,
    /// The paper's Table II: M3C2 statistics by pair of clouds, drive and mounting. Rows of one
    /// pair and drive stand together in the order given.
    pub distances: Vec<DistanceRow>,
    /// Figure 5 and the standard deviations of the poses.
    pub trajectory: Option<TrajectoryFigure>,
    /// Figures 6 and 7: M3C2 maps and histograms, one a pair of clouds and drive.
    pub maps: Vec<DistanceMap>,
    /// The adjustment that gave the result, then others run beside it for comparison.
    pub methods: Vec<MethodRun>,
    /// Correlations of the estimated parameters.
    pub correlation: Option<CorrelationMatrix>,
    /// What the data could and could not determine, in plain words.
    pub observability: Vec<Verdict>,
    /// Residuals along the drive: is the mounting constant?
    pub residuals: Option<ResidualFigure>,
    /// Run time by stage, in order.
    pub stages: Vec<StageTime>,
    /// Peak resident memory, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// Warnings in the order they were raised.
    pub warnings: Vec<String>,
}

/// How a statement is to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Status {
    /// As it should be.
    #[default]
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

/// Table I of one scanner: its mounting at several stages of knowledge.
#[derive(Debug, Clone, PartialEq)]
pub struct MountingTable {
    /// Name of the scanner.
    pub scanner: String,
    /// Columns in order, for example initial, without reference, with reference, exact poses.
    pub estimates: Vec<MountingEstimate>,
    /// The true body_from_scanner where it is known (simulation): adds its own column and the
    /// errors of the others.
    pub truth: Option<BodyFromScanner>,
}

/// One mounting of one scanner.
#[derive(Debug, Clone, PartialEq)]
pub struct MountingEstimate {
    /// Heading of the column, for example "with reference".
    pub label: String,
    /// The mounting.
    pub body_from_scanner: BodyFromScanner,
    /// Standard deviations of the translation along the body axes, metres; `None` where it was
    /// not estimated.
    pub translation_sigma_m: [Option<f64>; 3],
    /// Covariance of the rotation vector φ in R_bs Exp(φ), rad², rows and columns of held
    /// components zero; `None` where the rotation was not estimated. The page carries it over to
    /// both Euler conventions.
    pub rotation_covariance_rad2: Option<Mat3>,
    /// How each of tx, ty, tz, rx, ry, rz came about; rx, ry, rz mark α, β, γ in the table.
    pub origin: [ParameterOrigin; 6],
    /// The result of the run: its column is emphasised.
    pub is_result: bool,
}

/// Where the value of a parameter comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ParameterOrigin {
    /// Written by the user and not estimated in this column (the initial values).
    #[default]
    Given,
    /// Estimated from the data.
    Estimated,
    /// Held at its value because the user asked so.
    Fixed,
    /// Not observable from the data: held at its initial value.
    NotObservable,
}

/// Which mounting the clouds of a comparison were made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum MountingKind {
    /// The initial values of the project.
    Initial,
    /// The result of the run.
    Final,
    /// The true mounting, on the same poses (simulation).
    Truth,
}

/// One row of Table II.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceRow {
    /// The two clouds, for example "left to reference" or "left against right".
    pub pair: String,
    /// Name of the drive.
    pub drive: String,
    /// Mounting behind the clouds.
    pub mounting: MountingKind,
    /// Signed M3C2 distances over the core points.
    pub statistics: DistanceStatistics,
}

/// Statistics of signed M3C2 distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceStatistics {
    /// Mean, metres.
    pub mean_m: f64,
    /// Standard deviation about the mean, metres.
    pub std_m: f64,
    /// Root mean square about zero, metres.
    pub rmse_m: f64,
    /// Median, metres.
    pub median_m: f64,
    /// Core points with a distance.
    pub n: usize,
}

/// Figure 5: the drives from above, and how well their poses are known.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TrajectoryFigure {
    /// One line a drive. The page thins what is drawn; give all poses or an even subset.
    pub drives: Vec<DriveTrack>,
    /// The reference thinned: east, north, up, metres; drawn darker where it is higher.
    pub background_m: Vec<[f64; 3]>,
    /// Objects with a known outline, for example the planes.
    pub outlines: Vec<Outline>,
}

/// The poses of one drive.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveTrack {
    /// Name of the drive.
    pub name: String,
    /// Poses in time order; their sigmas and biases, where given, make the plots of these.
    pub poses: Vec<PoseRecord>,
    /// How well all poses are known, not only those drawn.
    pub sigmas: Option<PoseSigmas>,
    /// What the adjustment left; `None` where the poses came from a file.
    pub solution: Option<Solution>,
}

/// An outline seen from above.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Written at its middle, for example "30°"; may be empty.
    pub label: String,
    /// Corners in order, not repeated at the end: east, north, metres.
    pub corners_m: Vec<[f64; 2]>,
}

/// Figures 6 and 7 for one pair of clouds on one drive.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceMap {
    /// The two clouds, as in [`DistanceRow::pair`].
    pub pair: String,
    /// Name of the drive.
    pub drive: String,
    /// Side by side in order, commonly initial and final.
    pub panels: Vec<MapPanel>,
    /// End of the symmetric colour scale of all panels, metres; chosen from the last panel where
    /// `None`.
    pub colour_limit_m: Option<f64>,
}

/// One coloured map.
#[derive(Debug, Clone, PartialEq)]
pub struct MapPanel {
    /// Mounting behind the clouds.
    pub mounting: MountingKind,
    /// The core points; those without a distance (not finite) are left out.
    pub points: Vec<MapPoint>,
}

/// A core point with its distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPoint {
    /// East, north, metres.
    pub position_m: [f64; 2],
    /// Signed M3C2 distance, metres.
    pub distance_m: f64,
}

/// One adjustment over all its scales.
#[derive(Debug, Clone, PartialEq)]
pub struct MethodRun {
    /// For example "reweighted" or "paper".
    pub method: String,
    /// Whether every scale converged.
    pub converged: bool,
    /// How it ended, in words; may be empty.
    pub ending: String,
    /// What [`ScaleRun::cost`] is.
    pub measure: CostMeasure,
    /// Coarse to fine.
    pub scales: Vec<ScaleRun>,
}

/// What a method minimises, as a mean over its neighbourhoods so that numbers of points drop out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CostMeasure {
    /// Geometric mean of the thicknesses √(λ₃ + s²), metres.
    #[default]
    Thickness,
    /// Root mean square of the omnivariances (λ₁ λ₂ λ₃)^⅓, m².
    Omnivariance,
}

/// One scale of an adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct ScaleRun {
    /// Edge of the voxels, metres.
    pub voxel_m: f64,
    /// Points after thinning.
    pub points: usize,
    /// Neighbourhoods in the cost.
    pub neighbourhoods: usize,
    /// Iterations taken.
    pub iterations: usize,
    /// What the method minimises, in the unit of its [`CostMeasure`], before the first iteration
    /// and after each.
    pub cost: Vec<f64>,
    /// Run time, seconds.
    pub seconds: f64,
    /// Largest error of a translation component after this scale where the truth is known,
    /// metres, over all scanners and observable parameters.
    pub max_translation_error_m: Option<f64>,
    /// Likewise of a rotation component, radians.
    pub max_rotation_error_rad: Option<f64>,
}

/// Correlations of the estimated parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelationMatrix {
    /// For example "left tx".
    pub labels: Vec<String>,
    /// `values[i][j]` in [−1, 1]; not finite where one of the two was not estimated.
    pub values: Vec<Vec<f64>>,
}

/// Residuals along the drive.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualFigure {
    /// Whether the mounting seems constant, and why.
    pub verdict: Verdict,
    /// One line a scanner (and drive).
    pub series: Vec<ResidualSeries>,
}

/// Residuals of one scanner in blocks of time.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualSeries {
    /// For example "left".
    pub label: String,
    /// In time order.
    pub blocks: Vec<ResidualBlock>,
}

/// Residuals in one block of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResidualBlock {
    /// Middle of the block, seconds.
    pub time_s: f64,
    /// Mean signed distance to the reference or to the other passes, metres.
    pub mean_m: f64,
    /// Standard deviation that poses and noise alone would give this mean, metres; the page
    /// draws ± 2 of it.
    pub expected_sigma_m: f64,
}

/// Run time of one stage.
#[derive(Debug, Clone, PartialEq)]
pub struct StageTime {
    /// For example "trajectory".
    pub name: String,
    /// Seconds.
    pub seconds: f64,
}
