//! `boresight georeference`

use std::path::PathBuf;

use super::context::{Context, ProjectArguments};
use crate::error::Result;
use crate::pipeline::{self, Outcome, Placement};

/// Georeference the profiles of a project with its mountings and poses, or with those of a run
#[derive(Debug, clap::Args)]
pub(super) struct Georeference {
    #[command(flatten)]
    on: ProjectArguments,
    /// Mountings instead of the project's: a `calibration.toml` of `run` or `calibrate`
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Poses instead of estimating them: a trajectory file, such as the adjusted poses of `run`
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
}

impl Georeference {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let (project, out) = self.on.read()?;
        let (calibration, trajectory) = (self.calibration.as_deref(), self.trajectory.as_deref());
        let placement = Placement::new(&project, calibration, trajectory)?;
        context.logged(&out, placement.inputs(), self.on.force, |options| {
            pipeline::georeference(&placement, options, &context.terminal)
        })
    }
}
