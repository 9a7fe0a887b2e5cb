//! `boresight thin`

use std::path::PathBuf;

use super::context::{Context, Force, out_folder};
use super::values::positive;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Thin a cloud to one point per voxel: the one nearest the voxel's centre
///
/// Writes `<name>-thinned.laz`. Points of LAS and LAZ files keep all their attributes unchanged.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub(super) struct Thin {
    /// The cloud to thin
    cloud: PathBuf,
    /// Size of the voxels
    #[arg(long, value_name = "M", value_parser = positive)]
    voxel_m: f64,
    /// Folder for the result [default: `out` next to the cloud]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

impl Thin {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let out = out_folder(&self.out, &self.cloud);
        let inputs = [self.cloud.clone()];
        context.logged(&out, &inputs, self.force, |options| {
            pipeline::thin(&self.cloud, self.voxel_m, options, &context.terminal)
        })
    }
}
