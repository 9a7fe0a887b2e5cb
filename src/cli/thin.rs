//! `boresight thin`

use std::path::PathBuf;

use super::context::{Context, out_folder};
use super::values::positive;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Keep one point a voxel of a cloud: the one nearest to the voxel's centre
///
/// Writes `<name>-thinned.laz`. Points of LAS and LAZ files keep everything they carry, bit by bit.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub(super) struct Thin {
    /// The cloud to thin
    cloud: PathBuf,
    /// Edge of the voxels
    #[arg(long, value_name = "M", value_parser = positive)]
    voxel_m: f64,
    /// Folder of the result [default: `out` beside the cloud]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Thin {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let out = out_folder(&self.out, &self.cloud);
        let inputs = [self.cloud.clone()];
        context.logged(&out, &inputs, |options| {
            pipeline::thin(&self.cloud, self.voxel_m, options, &context.terminal)
        })
    }
}
