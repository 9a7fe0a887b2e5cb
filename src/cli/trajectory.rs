//! `boresight trajectory`

use super::context::{Context, ProjectArguments};
use super::online::OnlineFlags;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Estimate the trajectory from the logs of a project
#[derive(Debug, clap::Args)]
pub(super) struct Trajectory {
    #[command(flatten)]
    on: ProjectArguments,
    #[command(flatten)]
    online: OnlineFlags,
}

impl Trajectory {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        if self.online.online {
            return self.online.execute(&self.on, context);
        }
        context.with_project(&self.on, pipeline::trajectory)
    }
}
