//! `boresight calibrate`

use super::context::{Context, ProjectArguments};
use super::pdf::Pdf;
use super::watch::Watch;
use crate::calibration;
use crate::error::Result;
use crate::pipeline::{self, Outcome};

/// Calibrate the mountings of all scanners of a project as `run` does, without writing clouds
#[derive(Debug, clap::Args)]
pub(super) struct Calibrate {
    #[command(flatten)]
    on: ProjectArguments,
    /// How the mountings are estimated [default: the project's `calibration.method`, joint unless given]
    #[arg(long, value_enum)]
    method: Option<Method>,
    #[command(flatten)]
    pdf: Pdf,
    #[command(flatten)]
    watch: Watch,
}

/// The methods of `calibration.method`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Method {
    /// One adjustment of trajectory and mountings
    Joint,
    /// The mountings after the trajectory
    TwoStep,
    /// As the paper
    Paper,
}

impl From<Method> for calibration::Method {
    fn from(method: Method) -> Self {
        match method {
            Method::Joint => Self::Joint,
            Method::TwoStep => Self::TwoStep,
            Method::Paper => Self::Paper,
        }
    }
}

impl Calibrate {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let printer = self.pdf.printer()?;
        context.with_project(&self.on, |project, options, progress| {
            let page = options.out.join("calibration.html");
            self.watch.over(&context.terminal, &page, || {
                let project = match self.method {
                    Some(method) => &pipeline::with_method(project, method.into(), progress),
                    None => project,
                };
                let outcome = pipeline::calibrate(project, options, progress)?;
                printer.print(&page, &options.kept, outcome)
            })
        })
    }
}
