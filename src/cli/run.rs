//! `boresight run`

use super::context::{Context, ProjectArguments};
use super::pdf::Pdf;
use super::watch::Watch;
use crate::error::Result;
use crate::pipeline::{self, Options, Outcome};

/// Run all stages on a project: trajectory, calibration, clouds, comparison, report
#[derive(Debug, clap::Args)]
pub(super) struct Run {
    #[command(flatten)]
    on: ProjectArguments,
    #[command(flatten)]
    repeat: Repeat,
    #[command(flatten)]
    pdf: Pdf,
    #[command(flatten)]
    watch: Watch,
}

/// Whether stages are run again.
#[derive(Debug, clap::Args)]
pub(super) struct Repeat {
    /// Run all stages again, even those that an earlier run with this folder finished from the same inputs
    #[arg(long)]
    fresh: bool,
}

impl Repeat {
    /// The options with this setting.
    pub fn apply_to(&self, options: &Options) -> Options {
        Options {
            fresh: self.fresh,
            ..options.clone()
        }
    }
}

impl Run {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let printer = self.pdf.printer()?;
        context.with_project(&self.on, |project, options, progress| {
            let page = options.out.join("report.html");
            self.watch.over(&context.terminal, &page, || {
                let outcome = pipeline::run(project, &self.repeat.apply_to(options), progress)?;
                printer.print(&page, &options.kept, outcome)
            })
        })
    }
}
