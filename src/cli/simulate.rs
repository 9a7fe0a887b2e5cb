//! `boresight simulate`

use std::path::PathBuf;

use super::context::Context;
use crate::error::{Error, Location, Result};
use crate::pipeline::{self, Outcome};
use crate::simulation::{Extent, Scenario};

/// Write simulated drives as sensor files, together with the truth
#[derive(Debug, clap::Args)]
pub(super) struct Simulate {
    /// `demo`, `full` (the paper's size) or a scenario file
    #[arg(long, value_name = "NAME|FILE", default_value = "demo")]
    scenario: String,
    /// Draw ground, robot, sensors and route with this seed instead
    #[arg(long, value_name = "SEED", conflicts_with = "scenario")]
    random: Option<u64>,
    /// Folder for the drives
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace the drives that are in the folder
    #[arg(long)]
    force: bool,
}

impl Simulate {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let written = self.out.join("scenario.toml");
        let scenario = PathBuf::from(&self.scenario);
        // Replacing the scenario itself is reported later.
        let is_input = same_file::is_same_file(&written, &scenario).unwrap_or(false);
        if written.exists() && !is_input && !self.force {
            return Err(Error::format(
                &self.out,
                Location::Whole,
                "simulated drives",
                "an unused name, or --force to replace them",
            ));
        }
        context.logged(&self.out, &[scenario], |options| {
            let scenario = match self.random {
                Some(seed) => Scenario::random(seed, &Extent::FULL),
                None => Scenario::load(&self.scenario)?,
            };
            pipeline::simulate(scenario, options, &context.terminal)
        })
    }
}
