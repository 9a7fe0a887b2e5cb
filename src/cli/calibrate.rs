//! `boresight calibrate`

use super::context::{Context, ProjectArguments};
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Calibrate the mountings of all scanners of a project
#[derive(Debug, clap::Args)]
pub(super) struct Calibrate {
    #[command(flatten)]
    on: ProjectArguments,
}

impl Calibrate {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        context.with_project(&self.on, pipeline::calibrate)
    }
}
