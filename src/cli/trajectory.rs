//! `boresight trajectory`

use super::{Context, OnProject};
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Estimate the trajectory from the logs of a project
#[derive(Debug, clap::Args)]
pub(super) struct Trajectory {
    #[command(flatten)]
    on: OnProject,
}

impl Trajectory {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        context.on_project(&self.on, pipeline::trajectory)
    }
}
