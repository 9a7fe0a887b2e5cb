//! `boresight report`

use std::path::PathBuf;

use super::context::Context;
use super::pdf::Pdf;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Write the page of a run again, without computing
///
/// The page is made from `report.kept`, in which the run keeps its content. Settings that concern only the page are
/// read from the project again, if it still exists.
#[derive(Debug, clap::Args)]
pub(super) struct Report {
    /// The folder with the results of `run` or `demo`
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    #[command(flatten)]
    pdf: Pdf,
}

impl Report {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let printer = self.pdf.printer()?;
        let outcome = pipeline::report(&self.folder, &context.terminal)?;
        printer.print(&self.folder.join("report.html"), &[], outcome)
    }
}
