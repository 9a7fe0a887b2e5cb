//! `boresight convert`

use std::path::{Path, PathBuf};

use super::context::{Context, Force};
use crate::error::Result;
use crate::geometry::{BodyAxes, Projection};
use crate::pipeline::{self, Conversion, Outcome};

/// Write a cloud, poses or mountings in the format of another program, given by the extension of OUTPUT
///
/// Clouds: .las, .laz, .copc.laz, .e57, .ply, .parquet, .csv. Poses: .tum, .sbet, .parquet, .csv. Mountings of a
/// project or of calibration.toml: .urdf, .launch.py and .yaml (ROS 2), .json (PDAL).
#[derive(Debug, clap::Args)]
pub(super) struct Convert {
    /// A cloud, a trajectory, a project or a calibration
    input: PathBuf,
    /// The file to write
    output: PathBuf,
    /// Projected system of the poses, for SBET: EPSG:25832 or +proj=…
    #[arg(long, value_name = "SYSTEM")]
    crs: Option<String>,
    /// Axes of the body, FRD or FLU: for poses, on the side that is not SBET [default: FRD]; for mountings, in the
    /// output [default: the project's]
    #[arg(long, value_name = "AXES", value_parser = axes)]
    axes: Option<BodyAxes>,
    /// Name of the body's frame in URDF and ROS [default: body]
    #[arg(long, value_name = "NAME")]
    body: Option<String>,
    /// The scanner whose mounting goes into a PDAL pipeline
    #[arg(long, value_name = "NAME")]
    scanner: Option<String>,
    #[command(flatten)]
    force: Force,
}

pub(super) fn axes(text: &str) -> std::result::Result<BodyAxes, String> {
    match text {
        "FRD" => Ok(BodyAxes::Frd),
        "FLU" => Ok(BodyAxes::Flu),
        other => Err(format!("`{other}` is neither FRD nor FLU")),
    }
}

impl Convert {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let crs = self.crs.as_deref().map(Projection::new).transpose()?;
        let with = Conversion {
            crs,
            axes: self.axes,
            body: self.body.clone(),
            scanner: self.scanner.clone(),
        };
        let folder = match self.output.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let name = self.output.file_name().unwrap_or_default();
        let inputs = std::slice::from_ref(&self.input);
        self.force.check(folder, inputs, &[name])?;
        pipeline::convert(&self.input, &self.output, &with, &context.terminal)
            .map_err(|error| error.within(inputs))
    }
}
