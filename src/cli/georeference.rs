//! `boresight georeference`

use super::context::{Context, OnProject};
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Turn the profiles of a project into clouds, with the mountings it holds
#[derive(Debug, clap::Args)]
pub(super) struct Georeference {
    #[command(flatten)]
    on: OnProject,
}

impl Georeference {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        context.on_project(&self.on, pipeline::georeference)
    }
}
