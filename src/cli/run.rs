//! `boresight run`

use super::context::{Context, ProjectArguments};
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Run all stages on a project: trajectory, calibration, clouds, comparison, report
#[derive(Debug, clap::Args)]
pub(super) struct Run {
    #[command(flatten)]
    on: ProjectArguments,
}

impl Run {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        context.with_project(&self.on, pipeline::run)
    }
}
