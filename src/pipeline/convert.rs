//! `boresight convert`: clouds, poses and mountings in the formats of other programs.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::Outcome;
use crate::error::{Error, Location, Result};
use crate::format::{self, CloudRows};
use crate::geometry::{BodyAxes, BodyFromScanner, Projection};
use crate::output::Staging;
use crate::progress::Progress;
use crate::project;
use crate::sensor::PoseRecord;

/// What a conversion needs beside its files.
#[derive(Debug, Clone, Default)]
pub struct Conversion {
    /// The projected coordinate reference system of poses, where one side has latitudes and longitudes.
    pub crs: Option<Projection>,
    /// Axes of the body of poses and mountings.
    pub axes: BodyAxes,
    /// What the frame of the body is called in URDF and ROS.
    pub body: String,
    /// The one scanner to write, where the format holds one.
    pub scanner: Option<String>,
}

type WritePoses = fn(&Path, &[PoseRecord], &Conversion) -> Result<()>;
type Print = fn(&[(String, BodyFromScanner)], &Conversion) -> Result<String>;

/// Ends of names for poses; those of tables are also names of clouds.
const POSES: [(&str, WritePoses); 4] = [
    (".csv", |path, poses, _| {
        format::write_trajectory(path, poses)
    }),
    (".parquet", |path, poses, _| {
        format::write_trajectory(path, poses)
    }),
    (".tum", |path, poses, _| format::write_tum(path, poses)),
    (".sbet", write_sbet),
];

/// Ends of names for mountings.
const MOUNTINGS: [(&str, Print); 4] = [
    (".urdf", |all, with| format::urdf(&with.body, all)),
    (".launch.py", |all, with| {
        format::ros_launch(&with.body, all)
    }),
    (".yaml", |all, with| format::ros_transforms(&with.body, all)),
    (".json", pdal),
];

fn of_end<T: Copy>(path: &Path, known: &[(&str, T)]) -> Option<T> {
    let name = path.file_name()?.to_str()?.to_lowercase();
    let found = known.iter().find(|(end, _)| name.ends_with(end))?;
    Some(found.1)
}

/// Writes what `input` holds to `output`, in the format that the end of its name asks for: clouds as `.las`,
/// `.laz`, `.copc.laz`, `.e57`, `.ply`, `.parquet`, `.csv`; poses as `.tum`, `.sbet`, `.parquet`, `.csv`; the
/// mountings of a project or of `calibration.toml` as `.urdf`, `.launch.py`, `.yaml` (ROS 2), `.json` (PDAL).
///
/// # Errors
/// An input that cannot be read, or that cannot be written in this format; an output that is the input.
pub fn convert(
    input: &Path,
    output: &Path,
    with: &Conversion,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let found = format::detect(input)?;
    let folder = match output.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    let staging = Staging::new(folder, &[input.to_owned()], &[&*name])?;
    let staged = staging.path(&name);
    let poses = of_end(output, &POSES).filter(|_| found.has_poses());
    let summary = if found.has_cloud() && format::is_cloud_name(output) {
        cloud(input, &staged, progress)?
    } else if let Some(write) = poses {
        let poses = format::read_projected_trajectory(input, with.axes, with.crs.as_ref())?;
        write(&staged, &poses, with)?;
        format!("{} poses", poses.len())
    } else if let Some(print) = of_end(output, &MOUNTINGS) {
        let mountings = project::mountings(input)?;
        let text = print(&mountings, with)?;
        std::fs::write(&staged, text).map_err(|error| Error::io(&staged, error))?;
        let count = mountings.len();
        format!("{count} scanners, in the axes of the project's body: z down unless it says FLU")
    } else {
        let expected = "a cloud as .las, .laz, .copc.laz, .e57, .ply, .parquet or .csv; poses as .tum, \
                        .sbet, .parquet or .csv; mountings as .urdf, .launch.py, .yaml or .json";
        return Err(Error::format(
            output,
            Location::Whole,
            format!(
                "an end in which {} ({found}) cannot be written",
                input.display()
            ),
            expected,
        ));
    };
    staging.commit()?;
    let output: PathBuf = output.to_owned();
    Ok(Outcome {
        result: json!({ "input": input, "output": output, "from": found, "what": summary }),
        summary,
        files: vec![output],
        ..Outcome::default()
    })
}

/// LAS and LAZ are copied with all fields, everything else with times, intensities and extra dimensions.
fn cloud(input: &Path, output: &Path, progress: &dyn Progress) -> Result<String> {
    let rows = CloudRows::open(input)?;
    let points = rows.len();
    let stage = progress.stage("converting the cloud", points);
    let end = output.to_string_lossy().to_lowercase();
    let is_plain_las =
        end.ends_with(".las") || end.ends_with(".laz") && !end.ends_with(".copc.laz");
    if format::detect(input)?.is_las() && is_plain_las {
        format::copy_las(input, output, &[], &mut |_, _| Ok(true), progress)?;
    } else {
        let mut sink = format::create_cloud(output, rows.shape())?;
        rows.for_each(progress, &mut |point| sink.push(point))?;
        sink.finish()?;
    }
    drop(stage);
    Ok(format!("{points} points"))
}

fn write_sbet(path: &Path, poses: &[PoseRecord], with: &Conversion) -> Result<()> {
    let crs = with.crs.as_ref().ok_or_else(|| {
        Error::data(
            "SBET has latitudes and longitudes, and the projected system of the poses is not named",
            "name it with --crs, such as --crs EPSG:25832",
        )
    })?;
    let mut poses = poses.to_vec();
    for pose in &mut poses {
        pose.world_from_body.rotation *= with.axes.body_from_flu();
    }
    format::write_sbet(path, &poses, crs)
}

/// PDAL has one matrix for a cloud.
fn pdal(all: &[(String, BodyFromScanner)], with: &Conversion) -> Result<String> {
    let found = match &with.scanner {
        Some(name) => all.iter().find(|(other, _)| other == name),
        None => all.first().filter(|_| all.len() == 1),
    };
    let names: Vec<&str> = all.iter().map(|(name, _)| name.as_str()).collect();
    let (_, mounting) = found.ok_or_else(|| {
        Error::data(
            format!(
                "a pipeline of PDAL has the mounting of one scanner, not of {}",
                names.join(", ")
            ),
            "name one of them with --scanner",
        )
    })?;
    format::pdal_pipeline(mounting)
}
