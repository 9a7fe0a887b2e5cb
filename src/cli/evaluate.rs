//! `boresight evaluate`

use std::path::PathBuf;

use super::context::{Context, Force, out_folder};
use super::convert::axes;
use super::pdf::Pdf;
use super::values::{above_zero, finite};
use crate::error::Result;
use crate::geometry::{BodyAxes, Projection};
use crate::pipeline::{self, Outcome, TrajectoryFiles};
use crate::trajectory_error::{Alignment, Comparison, Over};

/// Evaluate a trajectory against a reference: absolute and relative errors (ATE, RPE)
///
/// The trajectory with fewer poses is kept as it is; the other is interpolated at its times. Relative errors do not
/// depend on the alignment.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub(super) struct Evaluate {
    /// The trajectory to judge, in any format of poses
    estimate: PathBuf,
    /// The reference, in any format of poses
    reference: PathBuf,
    /// Folder for the results [default: `out` next to the estimate]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// How the estimate is moved before absolute errors are taken
    #[arg(long, value_enum, default_value = "se3")]
    align: Align,
    /// Relative errors over this time, seconds [default: 1]
    #[arg(long, value_name = "S", value_parser = above_zero, conflicts_with = "over_m")]
    over_s: Option<f64>,
    /// Relative errors over this length of the reference's path, metres
    #[arg(long, value_name = "M", value_parser = above_zero)]
    over_m: Option<f64>,
    /// Longest interval in which poses are interpolated, seconds [default: 2.5 median intervals]
    #[arg(long, value_name = "S", value_parser = above_zero)]
    max_gap_s: Option<f64>,
    /// Time of the reference minus that of the estimate, seconds
    #[arg(long, value_name = "S", value_parser = finite, default_value = "0", allow_hyphen_values = true)]
    time_offset_s: f64,
    /// Projected coordinate system for poses with latitude and longitude, for example EPSG:25832
    #[arg(long, value_name = "SYSTEM")]
    crs: Option<String>,
    /// Axes of the body for poses with latitude and longitude: FRD or FLU [default: FRD]
    #[arg(long, value_name = "AXES", value_parser = axes)]
    axes: Option<BodyAxes>,
    #[command(flatten)]
    pdf: Pdf,
    #[command(flatten)]
    force: Force,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Align {
    /// Not at all
    None,
    /// Rotation and translation with the least squares of the positions (Umeyama without scale)
    Se3,
    /// The same, but turned about the vertical only
    Yaw,
    /// The first pose onto its reference
    Origin,
}

impl From<Align> for Alignment {
    fn from(align: Align) -> Self {
        match align {
            Align::None => Self::None,
            Align::Se3 => Self::Se3,
            Align::Yaw => Self::Yaw,
            Align::Origin => Self::Origin,
        }
    }
}

impl Evaluate {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let printer = self.pdf.printer()?;
        let out = out_folder(&self.out, &self.estimate);
        let over_time = Over::Time(self.over_s.unwrap_or(1.0));
        let files = TrajectoryFiles {
            estimate: self.estimate.clone(),
            reference: self.reference.clone(),
            crs: self.crs.as_deref().map(Projection::new).transpose()?,
            axes: self.axes.unwrap_or_default(),
            comparison: Comparison {
                alignment: self.align.into(),
                over: self.over_m.map_or(over_time, Over::Distance),
                max_gap_s: self.max_gap_s,
                time_offset_s: self.time_offset_s,
            },
        };
        context.logged(&out, &files.inputs(), self.force, |options| {
            let outcome = pipeline::evaluate(&files, options, &context.terminal)?;
            let page = options.out.join("evaluation.html");
            printer.print(&page, &options.kept, outcome)
        })
    }
}
