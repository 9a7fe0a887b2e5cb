//! `boresight georeference`

use super::context::{Context, ProjectArguments};
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Georeference the profiles of a project with its mountings
#[derive(Debug, clap::Args)]
pub(super) struct Georeference {
    #[command(flatten)]
    on: ProjectArguments,
}

impl Georeference {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        context.with_project(&self.on, pipeline::georeference)
    }
}
