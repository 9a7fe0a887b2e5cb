//! `boresight convert`: clouds, poses and mountings in the formats of other programs.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::Outcome;
use super::profiles::warn_of_remarks;
use crate::error::{Error, Location, Result};
use crate::format::{self, CloudRows, ExtraKind, Format, Input, LasLosses};
use crate::geometry::{BodyAxes, BodyFromScanner, Projection};
use crate::output::Staging;
use crate::progress::Progress;
use crate::project::{self, Mountings};
use crate::sensor::PoseRecord;

/// Options of a conversion. An option that does not apply is an error.
#[derive(Debug, Clone, Default)]
pub struct Conversion {
    /// The projected coordinate reference system of poses, if one side has latitudes and longitudes.
    pub crs: Option<Projection>,
    /// Axes of the body. For poses, the axes on the side that is not SBET, FRD by default; for mountings, the axes of
    /// the output, by default those of the project.
    pub axes: Option<BodyAxes>,
    /// Name of the body frame in URDF and ROS; by default `body`.
    pub body: Option<String>,
    /// The only scanner to write, if the format holds just one.
    pub scanner: Option<String>,
}

impl Conversion {
    /// Refuses options that do not apply to a conversion; `allowed` are those that do.
    fn check(&self, allowed: &[&str]) -> Result<()> {
        let given = [
            ("--crs", self.crs.is_some()),
            ("--axes", self.axes.is_some()),
            ("--body", self.body.is_some()),
            ("--scanner", self.scanner.is_some()),
        ];
        match given
            .iter()
            .find(|(name, given)| *given && !allowed.contains(name))
        {
            Some((name, _)) => Err(Error::data(
                format!("{name} does not apply to this conversion"),
                "--crs is for SBET and other geographic poses, --axes for poses with roll, pitch and heading and for \
                 mountings, --body for URDF and ROS, --scanner for PDAL",
            )),
            None => Ok(()),
        }
    }

    fn body(&self) -> &str {
        self.body.as_deref().unwrap_or("body")
    }
}

type WritePoses = fn(&Path, &[PoseRecord], &Conversion) -> Result<()>;
type Print = fn(&[(String, BodyFromScanner)], &Conversion) -> Result<String>;

/// Extensions of files of poses; those of tables may also belong to clouds.
const POSES: [(&str, WritePoses); 4] = [
    (".csv", |path, poses, _| {
        format::write_trajectory(path, poses)
    }),
    (".parquet", |path, poses, _| {
        format::write_trajectory(path, poses)
    }),
    (".tum", |path, poses, _| format::write_tum(path, poses)),
    (SBET, write_sbet),
];
const SBET: &str = ".sbet";

/// Extensions of files of mountings, with their options.
const MOUNTINGS: [(&str, (Print, &[&str])); 4] = [
    (
        ".urdf",
        (
            |all, with| format::urdf(with.body(), all),
            &["--axes", "--body"],
        ),
    ),
    (
        ".launch.py",
        (
            |all, with| format::ros_launch(with.body(), all),
            &["--axes", "--body"],
        ),
    ),
    (
        ".yaml",
        (
            |all, with| format::ros_transforms(with.body(), all),
            &["--axes", "--body"],
        ),
    ),
    (".json", (pdal, &["--axes", "--scanner"])),
];

/// The entry whose extension a file name has.
fn by_extension<T: Copy>(path: &Path, known: &[(&str, T)]) -> Option<T> {
    let name = path.file_name()?.to_str()?.to_lowercase();
    let entry = known.iter().find(|(end, _)| name.ends_with(end))?;
    Some(entry.1)
}

/// Converts `input` to `output`, in the format of its extension: clouds as `.las`, `.laz`, `.copc.laz`, `.e57`, `.ply`,
/// `.parquet`, `.csv`; poses as `.tum`, `.sbet`, `.parquet`, `.csv`; the mountings of a project or of
/// `calibration.toml` as `.urdf`, `.launch.py`, `.yaml` (ROS 2), `.json` (PDAL).
///
/// # Errors
/// An input that cannot be read, or that cannot be written in this format; an output that is also the input.
pub fn convert(
    input: &Path,
    output: &Path,
    with: &Conversion,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let file = &Input::from(input);
    let format = format::detect(file)?;
    let folder = match output.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    let staging = Staging::new(folder, &[input.to_owned()], &[&*name])?;
    let staged = staging.path(&name);
    // Errors of the file in the staging folder name the requested output.
    let summary = written(file, output, &staged, format, with, progress)
        .map_err(|error| error.renamed(&staged, output))?;
    progress.check()?;
    staging.commit()?;
    let output: PathBuf = output.to_owned();
    Ok(Outcome {
        result: json!({ "input": input, "output": output, "from": format, "what": summary }),
        summary,
        files: vec![output],
        ..Outcome::default()
    })
}

/// Writes `staged`, which becomes `output`; returns a description of the content.
fn written(
    input: &Input,
    output: &Path,
    staged: &Path,
    format: Format,
    with: &Conversion,
    progress: &dyn Progress,
) -> Result<String> {
    let poses = by_extension(output, &POSES).filter(|_| format.has_poses());
    if format.has_cloud() && format::is_cloud_name(output) {
        with.check(&[])?;
        return cloud(input, staged, format, progress);
    }
    if let Some(write) = poses {
        let is_geographic =
            format.has_geographic_poses() || by_extension(output, &[(SBET, ())]).is_some();
        with.check(if is_geographic {
            &["--crs", "--axes"]
        } else if format.has_navigation_angles() {
            &["--axes"]
        } else {
            &[]
        })?;
        let axes = with.axes.unwrap_or_default();
        let poses = format::read_projected_trajectory(input, axes, with.crs.as_ref())?;
        warn_of_remarks(
            &input.path().display().to_string(),
            std::slice::from_ref(input),
            progress,
        );
        warn_of_local(&poses, with, progress);
        write(staged, &poses, with)?;
        return Ok(format!("{} poses", poses.len()));
    }
    if let Some((print, options)) =
        by_extension(output, &MOUNTINGS).filter(|_| format.id() == "project")
    {
        with.check(options)?;
        let Mountings {
            mut scanners,
            axes,
            is_unusable,
        } = project::mountings(input.path())?;
        if is_unusable {
            progress.warn("this calibration is marked as not usable");
        }
        let axes = turned(&mut scanners, axes, with)?;
        let text = print(&scanners, with)?;
        std::fs::write(staged, text).map_err(|error| Error::io(staged, error))?;
        return Ok(format!("{} scanners on a body with {axes}", scanners.len()));
    }
    Err(Error::data(
        format!(
            "{}: {format} cannot be written as {}",
            input.path().display(),
            output.display()
        ),
        "write a cloud as .las, .laz, .copc.laz, .e57, .ply, .parquet or .csv; poses as .tum, .sbet, .parquet or \
         .csv; the mountings of a project or a calibration as .urdf, .launch.py, .yaml or .json",
    ))
}

/// Mountings as the text of a file, in the format of its extension: `.urdf`, `.launch.py`, `.yaml` (ROS 2), `.json`
/// (PDAL). Axes are not turned.
///
/// # Errors
/// A name with another extension; names of scanners that the format cannot hold; not exactly one scanner for PDAL.
pub fn mountings_text(
    path: &Path,
    scanners: &[(String, BodyFromScanner)],
    with: &Conversion,
) -> Result<String> {
    let (print, _) = by_extension(path, &MOUNTINGS).ok_or_else(|| {
        Error::format(
            path,
            Location::Whole,
            "a name with another extension",
            "a name that ends in .urdf, .launch.py, .yaml or .json",
        )
    })?;
    print(scanners, with)
}

/// Turns mountings to the requested axes; returns them with the name of the axes.
fn turned(
    scanners: &mut [(String, BodyFromScanner)],
    axes: Option<BodyAxes>,
    with: &Conversion,
) -> Result<&'static str> {
    let written = match (axes, with.axes) {
        (None, Some(_)) => {
            return Err(Error::data(
                "a calibration alone does not contain the axes of its body",
                "convert the project with its mountings, or leave out --axes",
            ));
        }
        (Some(present), Some(wanted)) if present != wanted => {
            for (_, mounting) in scanners {
                // FRD and FLU differ by half a turn about x, in either direction.
                let turn = BodyAxes::Frd.body_from_flu();
                mounting.rotation = turn * mounting.rotation;
                mounting.translation_m = turn * mounting.translation_m;
            }
            Some(wanted)
        }
        (present, _) => present,
    };
    Ok(match written {
        Some(BodyAxes::Frd) => "x forward, y right, z down (ROS has z up: --axes FLU)",
        Some(BodyAxes::Flu) => "x forward, y left, z up",
        None => "the axes of its project, which a calibration alone does not contain",
    })
}

/// Warns of coordinates near the origin of an official system, which are probably local.
fn warn_of_local(poses: &[PoseRecord], with: &Conversion, progress: &dyn Progress) {
    const NEAR_M: f64 = 10_000.0;
    let is_official = |crs: &Projection| crs.name().to_uppercase().starts_with("EPSG");
    let Some(first) = poses.first() else {
        return;
    };
    let at = first.world_from_body.translation_m;
    if with.crs.as_ref().is_some_and(is_official) && at.x.abs().max(at.y.abs()) < NEAR_M {
        progress.warn(&format!(
            "east {:.1} m, north {:.1} m lie near the origin of the projected system: are these local coordinates?",
            at.x, at.y
        ));
    }
}

/// Converts a cloud. LAS and LAZ are copied with all fields; otherwise clouds have positions, times, intensities and,
/// if they come from LAS or LAZ, extra dimensions.
fn cloud(input: &Input, output: &Path, format: Format, progress: &dyn Progress) -> Result<String> {
    let end = output.to_string_lossy().to_lowercase();
    let is_las = end.ends_with(".las") || end.ends_with(".laz");
    // LAS holds the unit of the coordinate system; the other formats have metres.
    let rows = if format.is_las() && is_las {
        CloudRows::open_in_unit_of_file(input)?
    } else {
        CloudRows::open(input)?
    };
    let is_copy = format.is_las() && is_las && !end.ends_with(".copc.laz");
    let remarks = if is_copy {
        rows.remarks_on_header()
    } else {
        rows.remarks().to_vec()
    };
    for remark in remarks {
        progress.warn(&format!("{}: {remark}", input.path().display()));
    }
    let is_wide = |kind| matches!(kind, ExtraKind::I64 | ExtraKind::U64);
    let wide = rows.shape().dimensions.iter().filter(|d| is_wide(d.kind));
    let wide: Vec<&str> = wide.map(|dimension| dimension.name.as_str()).collect();
    if end.ends_with(".ply") && !wide.is_empty() {
        progress.warn(&format!(
            "PLY has no integers of 64 bits: {} are written as double, which rounds them above 2^53",
            wide.join(", ")
        ));
    }
    let points = rows.len();
    let frame = format::describe_frame(input)?;
    if !is_copy && frame.contains("read as metres") {
        progress.warn(&format!("{}: {frame}", input.path().display()));
    }
    if !is_copy && frame.contains("GeoTIFF keys") {
        progress
            .warn("the coordinate system is not written: it is given by GeoTIFF keys, not as WKT");
    }
    let left_out = match rows.left_out() {
        fields if !is_copy && !fields.is_empty() => {
            format!("; {fields} are left out, if there are any")
        }
        _ => String::new(),
    };
    let _stage = progress.stage("converting the cloud", points);
    if is_copy {
        format::copy_las(input.path(), output, &[], &mut |_, _| Ok(true), progress)?;
    } else {
        let shape = rows.shape().clone();
        let mut sink = format::create_cloud(output, &shape)?;
        let mut losses = LasLosses::default();
        rows.for_each(progress, &mut |point| {
            let mut point = *point;
            if is_las {
                // What no point has is not a gap.
                let time_s = if shape.has_time { point.time_s } else { 0.0 };
                let intensity = if shape.has_intensity {
                    point.intensity
                } else {
                    0.0
                };
                (point.time_s, point.intensity) = losses.filled(time_s, intensity);
            }
            sink.push(&point)
        })?;
        sink.finish()?;
        losses.warn(progress);
    }
    Ok(format!("{points} points{left_out}"))
}

fn write_sbet(path: &Path, poses: &[PoseRecord], with: &Conversion) -> Result<()> {
    let crs = with.crs.as_ref().ok_or_else(|| {
        Error::data(
            "SBET has latitudes and longitudes, and the projected system of the poses is unknown",
            "give it with --crs, for example --crs EPSG:25832",
        )
    })?;
    let mut poses = poses.to_vec();
    for pose in &mut poses {
        pose.world_from_body.rotation *= with.axes.unwrap_or_default().body_from_flu();
    }
    format::write_sbet(path, &poses, crs)
}

/// The mounting as a matrix for PDAL; a pipeline has only one.
fn pdal(all: &[(String, BodyFromScanner)], with: &Conversion) -> Result<String> {
    let scanner = match &with.scanner {
        Some(name) => all.iter().find(|(other, _)| other == name),
        None => all.first().filter(|_| all.len() == 1),
    };
    let names: Vec<&str> = all.iter().map(|(name, _)| name.as_str()).collect();
    let names = names.join(", ");
    let (_, mounting) = scanner.ok_or_else(|| {
        Error::data(
            match &with.scanner {
                Some(name) => format!("there is no scanner `{name}`, only {names}"),
                None => {
                    format!("a PDAL pipeline can hold the mounting of one scanner only, not those of {names}")
                }
            },
            "name one of them with --scanner",
        )
    })?;
    format::pdal_pipeline(mounting)
}
