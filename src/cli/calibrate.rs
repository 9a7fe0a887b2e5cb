//! `boresight calibrate`

use super::context::{Context, OnProject};
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Calibrate the mountings of all scanners of a project
#[derive(Debug, clap::Args)]
pub(super) struct Calibrate {
    #[command(flatten)]
    on: OnProject,
}

impl Calibrate {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        context.on_project(&self.on, pipeline::calibrate)
    }
}
