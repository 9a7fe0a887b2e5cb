//! `boresight demo`

use std::path::PathBuf;

use super::context::{Context, Force};
use super::pdf::Pdf;
use super::run::Repeat;
use super::watch::Watch;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Simulate three drives over a test field and run everything on them, in a minute or two
#[derive(Debug, clap::Args)]
pub(super) struct Demo {
    /// Folder for the drives and the results
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    #[command(flatten)]
    repeat: Repeat,
    #[command(flatten)]
    pdf: Pdf,
    #[command(flatten)]
    watch: Watch,
    #[command(flatten)]
    force: Force,
}

impl Demo {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let printer = self.pdf.printer()?;
        context.logged(&self.out, &[], self.force, |options| {
            context.claim(&options.out)?;
            let page = options.out.join("report.html");
            self.watch.over(&context.terminal, &page, || {
                let outcome = pipeline::demo(&self.repeat.apply_to(options), &context.terminal)?;
                printer.print(&page, &options.kept, outcome)
            })
        })
    }
}
