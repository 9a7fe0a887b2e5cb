//! Content of the report: the findings, with title, command and inputs.

use super::drives::name_of;
use super::findings::{Extras, Findings};
use crate::error::Result;
use crate::project::{Motion, Project};
use crate::report::content::{Calibrations, Content, Drive, Fact};
use crate::report::platform::Platform;
use crate::tiles::peak_memory_bytes;

/// Content of the report of a whole run.
///
/// # Errors
/// The logo cannot be read.
pub fn content<'a>(
    project: &Project,
    findings: &'a Findings,
    extras: &Extras,
) -> Result<Content<'a>> {
    Ok(Content {
        title: format!("Calibration of {}", name_of(project)),
        command: extras.command.clone(),
        project: project.path.display().to_string(),
        seed: extras.seed,
        imprint: project.imprint.clone(),
        logo: project.imprint.logo_uri()?,
        made_s: Some(findings.made_s),
        csv: Vec::new(),
        files: &findings.files,
        platform: Some(platform(project, findings.drives.first())),
        inputs: inputs(project, &findings.drives),
        calibrations: Some(Calibrations {
            mountings: &findings.mountings,
            result: &findings.calibration,
            joint: findings.joint.as_ref(),
            variants: &findings.variants,
        }),
        drives: &findings.drives,
        background_m: &findings.background_m,
        stages: &findings.stages,
        peak_memory_bytes: peak_memory_bytes(),
        placement: &findings.placement,
        warnings: &findings.warnings,
        verdicts: findings.verdicts.clone(),
    })
}

/// Where the sensors are on the body; the fans are those of the points of `drive`.
pub fn platform(project: &Project, drive: Option<&Drive>) -> Platform {
    let marks = match &project.motion {
        Motion::Logs(logs) => {
            let positions = logs.settings.positions.iter();
            positions.map(|p| (p.name.clone(), p.lever_arm_m)).collect()
        }
        Motion::Poses(_) => Vec::new(),
    };
    let scene = drive.and_then(|drive| drive.scene.as_ref());
    let outline = |name: &str| {
        let mut fans = scene?.fans.iter();
        let fan = fans.find(|fan| fan.name == name)?;
        Some(fan.outline_m.clone())
    };
    let scanners = project.scanners.iter();
    Platform {
        axes: project.axes,
        marks,
        outlines_m: scanners
            .map(|scanner| outline(&scanner.name).unwrap_or_default())
            .collect(),
    }
}

/// Content of the page of a trajectory.
///
/// # Errors
/// The logo cannot be read.
pub fn trajectory<'a>(
    project: &Project,
    drives: &'a [Drive],
    command: String,
) -> Result<Content<'a>> {
    Ok(Content {
        title: format!("Trajectory of {}", name_of(project)),
        command,
        project: project.path.display().to_string(),
        imprint: project.imprint.clone(),
        logo: project.imprint.logo_uri()?,
        inputs: log_facts(project),
        drives,
        ..Content::default()
    })
}

fn fact(label: &str, value: String) -> Fact {
    Fact {
        label: label.into(),
        value,
    }
}

/// The files with logs or poses.
fn log_facts(project: &Project) -> Vec<Fact> {
    let mut facts = Vec::new();
    match &project.motion {
        Motion::Logs(logs) => {
            facts.push(fact("IMU", logs.imu.path.display().to_string()));
            for (log, settings) in logs.positions.iter().zip(&logs.settings.positions) {
                facts.push(fact(&settings.name, log.path.display().to_string()));
            }
            if let Some(heading) = &logs.heading {
                facts.push(fact("heading", heading.path.display().to_string()));
            }
        }
        Motion::Poses(file) => facts.push(fact("trajectory", file.path.display().to_string())),
    }
    facts
}

fn inputs(project: &Project, drives: &[Drive]) -> Vec<Fact> {
    let mut facts = log_facts(project);
    for Drive { name, poses, .. } in drives {
        if let (Some(first), Some(last)) = (poses.first(), poses.last()) {
            let seconds = last.time_s - first.time_s;
            let value = format!("{} poses over {seconds:.1} s", poses.len());
            facts.push(fact(name, value));
        }
    }
    for scanner in &project.scanners {
        let files: Vec<_> = scanner
            .profiles
            .iter()
            .map(|p| p.display().to_string())
            .collect();
        let label = format!("scanner {}", scanner.name);
        facts.push(fact(&label, files.join(", ")));
    }
    let reference = project
        .reference
        .as_ref()
        .map(|r| r.path.display().to_string());
    facts.push(fact(
        "reference",
        reference.unwrap_or_else(|| "none".into()),
    ));
    facts
}
