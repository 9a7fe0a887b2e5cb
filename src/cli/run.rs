//! `boresight run`

use super::context::{Context, OnProject};
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Run all stages on a project: trajectory, calibration, clouds, comparison, report
#[derive(Debug, clap::Args)]
pub(super) struct Run {
    #[command(flatten)]
    on: OnProject,
}

impl Run {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        context.on_project(&self.on, pipeline::run)
    }
}
