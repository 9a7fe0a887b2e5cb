//! `boresight calibrate`

use super::context::{Context, ProjectArguments};
use super::pdf::Pdf;
use super::watch::Watch;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Calibrate the mountings of all scanners of a project
#[derive(Debug, clap::Args)]
pub(super) struct Calibrate {
    #[command(flatten)]
    on: ProjectArguments,
    #[command(flatten)]
    pdf: Pdf,
    #[command(flatten)]
    watch: Watch,
}

impl Calibrate {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let printer = self.pdf.printer()?;
        context.with_project(&self.on, |project, options, progress| {
            let page = options.out.join("calibration.html");
            self.watch.over(&context.terminal, &page, || {
                let outcome = pipeline::calibrate(project, options, progress)?;
                printer.print(&page, outcome)
            })
        })
    }
}
