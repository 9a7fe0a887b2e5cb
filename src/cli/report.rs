//! `boresight report`

use std::path::PathBuf;

use super::context::Context;
use super::pdf::Pdf;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Write the page of a run again, without computing
///
/// The page is made of what the run kept in `report.kept`. Settings that concern nothing but the page are
/// read anew from the project, if it is still there.
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
        printer.print(&self.folder.join("report.html"), outcome)
    }
}
