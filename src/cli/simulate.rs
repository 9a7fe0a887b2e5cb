//! `boresight simulate`

use std::path::PathBuf;

use super::context::Context;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Write simulated drives as sensor files, with the truth beside them
#[derive(Debug, clap::Args)]
pub(super) struct Simulate {
    /// `demo`, `full` (the paper's size) or a scenario file
    #[arg(long, value_name = "NAME|FILE", default_value = "demo")]
    scenario: String,
    /// Folder of the drives
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Simulate {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let scenario = PathBuf::from(&self.scenario);
        context.logged(&self.out, &[scenario], |options| {
            pipeline::simulate(&self.scenario, options, &context.terminal)
        })
    }
}
