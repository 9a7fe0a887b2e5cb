//! `boresight evaluate`: errors of a trajectory against a reference.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::page::{self, fact};
use super::profiles::warn_of_remarks;
use super::{Options, Outcome};
use crate::error::{Error, Result};
use crate::format::{self, Input};
use crate::geometry::{BodyAxes, Projection};
use crate::number;
use crate::progress::Progress;
use crate::report;
use crate::report::content::{ComparedPoses, Content, ErrorRow};
use crate::sensor::PoseRecord;
use crate::trajectory_error::{
    Alignment, Association, Comparison, Over, Spread, TrajectoryErrors, compare,
};

/// The page.
const PAGE: &str = "evaluation.html";
/// The table of the poses.
const TABLE: &str = "trajectory-errors.csv";
/// Median rotation beyond which the bodies probably have different axes, radians.
const OTHER_AXES_RAD: f64 = 0.8;

/// Two trajectories, and how they are compared.
#[derive(Debug, Clone)]
pub struct TrajectoryFiles {
    /// The trajectory to judge.
    pub estimate: PathBuf,
    /// What it is compared with.
    pub reference: PathBuf,
    /// The projected system of geographic poses.
    pub crs: Option<Projection>,
    /// Axes of the body for geographic poses.
    pub axes: BodyAxes,
    /// Alignment and the rest.
    pub comparison: Comparison,
}

impl TrajectoryFiles {
    /// The input files.
    pub fn inputs(&self) -> Vec<PathBuf> {
        vec![self.estimate.clone(), self.reference.clone()]
    }

    fn read(&self, path: &Path, progress: &dyn Progress) -> Result<Vec<PoseRecord>> {
        let input = Input::from(path);
        let poses = format::read_projected_trajectory(&input, self.axes, self.crs.as_ref())?;
        warn_of_remarks(&path.display().to_string(), &[input], progress);
        Ok(poses)
    }
}

/// Compares two trajectories: statistics, a table of the poses (`trajectory-errors.csv`), and a page.
///
/// # Errors
/// Files that cannot be read; those of [`compare`].
pub fn evaluate(
    files: &TrajectoryFiles,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let staging = options.staging(&files.inputs(), &[TABLE, PAGE])?;
    let estimate = files.read(&files.estimate, progress)?;
    let reference = files.read(&files.reference, progress)?;
    let errors = compare(&estimate, &reference, &files.comparison)?;
    let rows = rows(&errors, files.comparison.over);
    let path = staging.path(TABLE);
    std::fs::write(&path, table(&errors)).map_err(|error| Error::io(&path, error))?;
    let path = staging.path(PAGE);
    let page = report::render(&content(files, &errors, rows.clone()));
    std::fs::write(&path, page).map_err(|error| Error::io(&path, error))?;
    progress.check()?;
    staging.commit()?;
    Ok(Outcome {
        result: document(files, &errors),
        summary: summary(files, &errors, &rows),
        files: [TABLE, PAGE].map(|name| options.out.join(name)).into(),
        ..Outcome::default()
    })
}

fn alignment_name(alignment: Alignment) -> &'static str {
    match alignment {
        Alignment::None => "none",
        Alignment::Se3 => "se3",
        Alignment::Yaw => "yaw",
        Alignment::Origin => "origin",
    }
}

/// The errors in numbers, in the units that are printed.
fn rows(errors: &TrajectoryErrors, over: Over) -> Vec<ErrorRow> {
    let row = |name: &str, unit: &str, spread: &Spread, factor: f64| {
        let Spread {
            rmse,
            mean,
            median,
            std,
            min,
            max,
        } = *spread;
        ErrorRow {
            name: name.to_owned(),
            unit: unit.to_owned(),
            values: [rmse, mean, median, std, min, max].map(|value| value * factor),
        }
    };
    let degrees = 1f64.to_degrees();
    let mut rows = vec![
        row("ATE, translation", "mm", &errors.translation_m, 1e3),
        row("ATE, rotation", "°", &errors.rotation_rad, degrees),
    ];
    if let Some(relative) = &errors.relative {
        let over = match over {
            Over::Time(delta_s) => format!("RPE over {delta_s} s"),
            Over::Distance(delta_m) => format!("RPE over {delta_m} m"),
        };
        let name = format!("{over}, translation");
        rows.push(row(&name, "mm", &relative.translation_m, 1e3));
        let name = format!("{over}, rotation");
        rows.push(row(&name, "°", &relative.rotation_rad, degrees));
    }
    rows
}

fn summary(files: &TrajectoryFiles, errors: &TrajectoryErrors, rows: &[ErrorRow]) -> String {
    let head = ["RMSE", "mean", "median", "std", "least", "most"].map(str::to_owned);
    let mut lines = vec![(String::new(), head)];
    lines.extend(rows.iter().map(|row| {
        let name = format!("{} ({})", row.name, row.unit);
        (name, row.values.map(|value| number::significant(value, 3)))
    }));
    let cells = lines.iter().flat_map(|(_, cells)| cells);
    let widest = cells.map(|cell| cell.chars().count()).max().unwrap_or(0);
    // At least two blanks stand between columns.
    let width = (widest + 2).max(10);
    let mut out = String::new();
    for (name, cells) in lines {
        // Writing to a String cannot fail.
        let _ = write!(out, "{name:<32}");
        for cell in cells {
            let _ = write!(out, "{cell:>width$}");
        }
        out.push('\n');
    }
    if errors.relative.is_none() {
        out.push_str("No two poses are as far apart as relative errors are asked for (--over-s, --over-m).\n");
    }
    out.push_str(&association(files, &errors.association));
    if errors.rotation_rad.median > OTHER_AXES_RAD {
        out.push_str(
            "\nHalf of the attitudes differ by more than 45°: the bodies of the two files probably have different axes, \
             for example z up and z down.",
        );
    }
    out
}

/// Which poses were compared, in words.
fn association(files: &TrajectoryFiles, association: &Association) -> String {
    let interpolated = if association.interpolates_reference {
        "the reference is interpolated at the times of the estimate"
    } else {
        "the estimate is interpolated at the times of the reference"
    };
    let mut out = format!(
        "{} pairs of poses, aligned by {} (--align); {interpolated}, across {} s at most (--max-gap-s)",
        association.pairs.len(),
        alignment_name(files.comparison.alignment),
        number::significant(association.max_gap_s, 3)
    );
    for (count, why) in [
        (association.outside, "outside the common time"),
        (association.in_gaps, "in gaps"),
    ] {
        if count > 0 {
            out.push_str(&format!("; {count} left out {why}"));
        }
    }
    out + "."
}

fn document(files: &TrajectoryFiles, errors: &TrajectoryErrors) -> Value {
    let pair = |translation_m: &Spread, rotation_rad: &Spread| {
        let degrees = |radians: f64| radians.to_degrees();
        json!({
            "translation_m": translation_m,
            "rotation_deg": {
                "rmse": degrees(rotation_rad.rmse),
                "mean": degrees(rotation_rad.mean),
                "median": degrees(rotation_rad.median),
                "std": degrees(rotation_rad.std),
                "min": degrees(rotation_rad.min),
                "max": degrees(rotation_rad.max),
            },
        })
    };
    let association = &errors.association;
    let q = errors.alignment.rotation.coords;
    let relative = errors.relative.as_ref().map(|relative| {
        let mut value = pair(&relative.translation_m, &relative.rotation_rad);
        let (key, delta) = match files.comparison.over {
            Over::Time(delta_s) => ("over_s", delta_s),
            Over::Distance(delta_m) => ("over_m", delta_m),
        };
        value[key] = json!(delta);
        value["median_apart"] = json!(relative.apart);
        value["n"] = json!(relative.count);
        value
    });
    json!({
        "n": association.pairs.len(),
        "outside": association.outside,
        "in_gaps": association.in_gaps,
        "max_gap_s": association.max_gap_s,
        "interpolated": if association.interpolates_reference { "reference" } else { "estimate" },
        "alignment": {
            "kind": alignment_name(files.comparison.alignment),
            "translation_m": errors.alignment.translation_m,
            "quaternion_xyzw": [q.x, q.y, q.z, q.w],
        },
        "ate": pair(&errors.translation_m, &errors.rotation_rad),
        "rpe": relative,
    })
}

fn table(errors: &TrajectoryErrors) -> String {
    let mut out = String::from("time_s,path_m,east_m,north_m,up_m,translation_m,rotation_deg\n");
    for pose in &errors.poses {
        let offset = pose.offset_m;
        out.push_str(&format!(
            "{},{:.4},{:.6},{:.6},{:.6},{:.6},{:.6}\n",
            pose.time_s,
            pose.path_m,
            offset.x,
            offset.y,
            offset.z,
            offset.norm(),
            pose.rotation_rad.to_degrees()
        ));
    }
    out
}

fn content(
    files: &TrajectoryFiles,
    errors: &TrajectoryErrors,
    rows: Vec<ErrorRow>,
) -> Content<'static> {
    let (estimate, reference) = (files.estimate.display(), files.reference.display());
    let poses = &errors.poses;
    let place = |offset: f64| {
        let places = poses.iter().map(move |pose| {
            let place = pose.reference_m + pose.offset_m * offset;
            [place.x, place.y]
        });
        places.collect()
    };
    Content {
        made_s: Some(page::now_s()),
        title: format!("{estimate} against {reference}"),
        command: format!("boresight evaluate {estimate} {reference}"),
        inputs: vec![
            fact("estimate", estimate.to_string()),
            fact("reference", reference.to_string()),
            fact("poses", association(files, &errors.association)),
        ],
        compared_poses: Some(ComparedPoses {
            rows,
            time_s: poses.iter().map(|pose| pose.time_s).collect(),
            reference_m: place(0.0),
            estimate_m: place(1.0),
            translation_m: poses.iter().map(|pose| pose.offset_m.norm()).collect(),
            rotation_rad: poses.iter().map(|pose| pose.rotation_rad).collect(),
        }),
        ..Content::default()
    }
}
