//! `calibration.toml`: the mountings as tables for a project, with what a reader who has only this file needs.

use std::path::{Path, PathBuf};

use super::findings::Findings;
use crate::calibration::Calibration;
use crate::error::Result;
use crate::format::utc;
use crate::geometry::{BodyAxes, EulerConvention};
use crate::number;
use crate::project::{Project, Scanner, scanners_to_toml};
use crate::results::Drive;
use crate::verdict::{Headline, Verdict};

/// The tables of the scanners, below comments: the verdicts that need attention, where the values are from, frames and
/// angles in words, and standard deviations. The comments do not contain the time of the computation: equal inputs
/// give equal bytes.
///
/// # Errors
/// See [`scanners_to_toml`].
pub fn text(project: &Project, findings: &Findings) -> Result<String> {
    let mut scanners = findings.rig.scanners(project);
    let folder = project.path.parent().unwrap_or(Path::new(""));
    for path in scanners
        .iter_mut()
        .flat_map(|scanner| &mut scanner.profiles)
    {
        *path = beside(path, folder);
    }
    let mut comments = verdicts(&findings.verdicts);
    comments.push(String::new());
    comments.extend(origin(project, findings.drives.first()));
    comments.extend(frames(project.axes, &scanners));
    comments.extend(sigmas(&findings.calibrations.result));
    comments.push(
        "The paths of the profiles are relative to the project, into which the tables can be pasted.".to_owned(),
    );
    let lines = comments.iter().map(|line| match line.as_str() {
        "" => "#\n".to_owned(),
        line => format!("# {line}\n"),
    });
    Ok(lines.collect::<String>() + "\n" + &scanners_to_toml(&scanners)?)
}

/// The headline, and the verdicts that need attention.
fn verdicts(verdicts: &[Verdict]) -> Vec<String> {
    let marked = verdicts.iter().filter(|v| v.severity.is_marked());
    let marked = marked.map(|verdict| format!("! {}", verdict.text.replace('\n', " ")));
    let headline = Headline::of(verdicts).text().to_owned();
    std::iter::once(headline).chain(marked).collect()
}

/// The program, and the project with the time of its drive.
fn origin(project: &Project, drive: Option<&Drive>) -> Vec<String> {
    let name = project.path.file_name().unwrap_or_default();
    let mut lines = vec![format!(
        "Mountings by boresight {}, from {}.",
        env!("CARGO_PKG_VERSION"),
        name.to_string_lossy()
    )];
    if let Some(drive) = drive
        && let (Some(first), Some(last)) = (drive.poses.first(), drive.poses.last())
    {
        let (from_s, to_s) = (first.time_s, last.time_s);
        // The clock of the logs may be that of GPS, which is 18 s ahead of UTC and has the same dates.
        let dates = utc(from_s)
            .zip(utc(to_s))
            .map_or_else(String::new, |(from, to)| {
                format!(", which are {from} to {to} if they count from 1970")
            });
        lines.push(format!(
            "Drive `{}`: times {from_s:.3} s to {to_s:.3} s of its logs{dates}.",
            drive.name
        ));
    }
    lines
}

/// The frames and the angles in words.
fn frames(axes: BodyAxes, scanners: &[Scanner]) -> Vec<String> {
    let axes = match axes {
        BodyAxes::Frd => "FRD: x forward, y right, z down",
        BodyAxes::Flu => "FLU: x forward, y left, z up",
    };
    let mut lines = vec![
        format!(
            "Body: axes {axes}; origin and axes are those of the IMU, or of the poses if there is none."
        ),
        "Scanner: the axes in which its points are recorded; a profile lies in x and z.".to_owned(),
        "A point: x_body = R x_scanner + translation_m, in metres.".to_owned(),
    ];
    for (convention, text) in [
        (
            EulerConvention::Zyx,
            "rotation_deg with the convention zyx: α, β, γ in degrees, R = Rz(γ) Ry(β) Rx(α).",
        ),
        (
            EulerConvention::Bonn,
            "rotation_deg with the convention bonn: α, β, γ in degrees, R = (Rz(γ) Ry(β) Rx(α))ᵀ.",
        ),
    ] {
        if scanners
            .iter()
            .any(|scanner| scanner.convention == convention)
        {
            lines.push(text.to_owned());
        }
    }
    lines
}

/// The standard deviations of each mounting.
fn sigmas(calibration: &Calibration) -> Vec<String> {
    let mut lines = vec![
        "Standard deviations (1 σ) of x, y, z and of α, β, γ; – where the data leave a value open:"
            .to_owned(),
    ];
    for (index, mounting) in calibration.mountings.iter().enumerate() {
        let values = calibration.sigmas(index, mounting.convention);
        let text = |range: std::ops::Range<usize>, factor: f64| {
            let values = values[range].iter().map(|value| {
                value.map_or_else(
                    || number::DASH.to_owned(),
                    |value| number::sigma(value * factor),
                )
            });
            values.collect::<Vec<_>>().join(", ")
        };
        lines.push(format!(
            "  {}: {} mm; {}°",
            mounting.name,
            text(0..3, 1e3),
            text(3..6, 1f64.to_degrees())
        ));
    }
    lines
}

/// A path relative to `folder`, if it lies in it.
fn beside(path: &Path, folder: &Path) -> PathBuf {
    path.strip_prefix(folder)
        .map_or_else(|_| path.to_owned(), Path::to_owned)
}
