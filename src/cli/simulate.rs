//! `boresight simulate`

use std::path::PathBuf;

use super::context::{Context, Force};
use crate::error::Result;
use crate::pipeline::{self, Outcome};
use crate::simulation::{Extent, Scenario, output_names};

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
    #[command(flatten)]
    force: Force,
}

impl Simulate {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let inputs = [PathBuf::from(&self.scenario)];
        context.logged(&self.out, &inputs, self.force, |options| {
            let scenario = match self.random {
                Some(seed) => Scenario::random(seed, &Extent::FULL),
                None => Scenario::load(&self.scenario)?,
            };
            // Drives are data, which no later command replaces by itself.
            self.force
                .check_all(&self.out, &inputs, &output_names(&scenario))?;
            pipeline::simulate(scenario, options, &context.terminal)
        })
    }
}
