//! `boresight demo`

use std::path::PathBuf;

use super::context::Context;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Simulate three drives over a test field and run everything on them, in a minute or two
#[derive(Debug, clap::Args)]
pub(super) struct Demo {
    /// Folder of the drives and the results
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
}

impl Demo {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        context.logged(&self.out, &[], |options| {
            pipeline::demo(options, &context.terminal)
        })
    }
}
