//! Content of the report: the findings, with title, command and inputs.

use std::borrow::Cow;
use std::path::Path;
use std::time::SystemTime;

use super::drives::name_of;
use super::findings::{Extras, Findings};
use super::scales;
use crate::comparison::{
    Against, Aggregation, Agreement, Detection, DistanceMap, MountingKind, Statistics,
};
use crate::error::Result;
use crate::project::{Motion, Project};
use crate::report::content::{self, Content, Fact, Platform};
use crate::report::scene::Scene;
use crate::results::Drive;
use crate::tiles::{Compared, Comparison, peak_memory_bytes};

/// Content of the page of a run, or of a calibration.
///
/// # Errors
/// The logo cannot be read.
pub fn content<'a>(
    project: &Project,
    findings: &'a Findings,
    extras: &Extras,
) -> Result<Content<'a>> {
    let mut content = Content {
        command: extras.command.clone(),
        project: project.path.display().to_string(),
        seed: extras.seed,
        made_s: Some(findings.made_s),
        files: Cow::Borrowed(&findings.files),
        platform: Some(platform(
            project,
            findings.scenes.first().and_then(Option::as_ref),
        )),
        inputs: inputs(project, &findings.drives),
        calibrations: Some(Cow::Borrowed(&findings.calibrations)),
        drives: Cow::Borrowed(&findings.drives),
        scenes: Cow::Borrowed(&findings.scenes),
        background_m: Cow::Borrowed(&findings.background_m),
        stages: Cow::Borrowed(&findings.stages),
        peak_memory_bytes: peak_memory_bytes(),
        warnings: Cow::Borrowed(&findings.warnings),
        verdicts: findings.verdicts.clone(),
        ..Content::default()
    };
    settings_of(project, &mut content)?;
    Ok(content)
}

/// The time of the system clock, seconds since 1970; 0 if it is earlier.
pub fn now_s() -> f64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    since.map_or(0.0, |since| since.as_secs_f64())
}

/// Sets the content that a project specifies for the page alone and on which no result depends.
///
/// # Errors
/// The logo cannot be read.
pub fn settings_of(project: &Project, content: &mut Content) -> Result<()> {
    content.title = format!("Calibration of {}", name_of(project));
    content.imprint = project.imprint.clone();
    content.logo = project.imprint.logo_uri()?;
    Ok(())
}

/// The positions of the sensors on the body, and the fans of the scanners from the points of `scene`.
pub fn platform(project: &Project, scene: Option<&Scene>) -> Platform {
    let marks = match &project.motion {
        Motion::Logs(logs) => {
            let positions = logs.settings.positions.iter();
            positions.map(|p| (p.name.clone(), p.lever_arm_m)).collect()
        }
        Motion::Poses(_) => Vec::new(),
    };
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
        made_s: Some(now_s()),
        inputs: log_facts(project),
        drives: Cow::Borrowed(drives),
        ..Content::default()
    })
}

/// Content of the page of two clouds that were compared.
pub fn comparison(
    comparison: &Comparison,
    work: &Compared,
    statistics: Statistics,
) -> Content<'static> {
    let name = |path: &Path| {
        let name = path.file_name().unwrap_or(path.as_os_str());
        name.to_string_lossy().into_owned()
    };
    let (cloud, reference) = (name(&comparison.cloud), name(&comparison.reference));
    let mut inputs = vec![
        fact("cloud", comparison.cloud.display().to_string()),
        fact("reference", comparison.reference.display().to_string()),
    ];
    inputs.extend(settings_facts(comparison, work));
    Content {
        made_s: Some(now_s()),
        title: format!("{cloud} against {reference}"),
        command: format!(
            "boresight compare {} {}",
            comparison.cloud.display(),
            comparison.reference.display()
        ),
        inputs,
        comparison: Some(content::Comparison {
            reference,
            agreement: Agreement {
                scanner: cloud,
                against: Against::Reference,
                mounting: MountingKind::Final,
                statistics,
                coverage: f64::NAN,
                distances: DistanceMap::of(&work.m3c2),
            },
        }),
        peak_memory_bytes: peak_memory_bytes(),
        ..Content::default()
    }
}

/// The settings of a comparison, each with its option.
fn settings_facts(comparison: &Comparison, work: &Compared) -> Vec<Fact> {
    let settings = &work.settings;
    let mut facts = Vec::new();
    if let Some(core) = &comparison.core {
        facts.push(fact("core points (--core)", core.display().to_string()));
    }
    facts.push(scales::normals(comparison, work));
    for scale in scales::scales(comparison, work) {
        let origin = if scale.is_given { "given" } else { "measured" };
        let label = format!("{} ({})", scale.name, scale.option);
        facts.push(fact(&label, format!("{} m, {origin}", scale.value_m)));
    }
    if let Some(measured) = &work.measured {
        facts.push(fact("what is measured", scales::reasons(measured)));
    }
    let (middle, option) = match settings.aggregation {
        Aggregation::Mean => ("mean and standard deviation", "default"),
        Aggregation::Median => ("median and inter-quartile range", "--robust"),
    };
    facts.push(fact("points of a cylinder", format!("{middle} ({option})")));
    let (distribution, option) = match settings.detection {
        Detection::Normal => ("normal distribution", "default"),
        Detection::Student => ("Student's t", "--student"),
    };
    facts.push(fact(
        "level of detection",
        format!("{distribution} ({option})"),
    ));
    if settings.one_sided {
        let text = "along the normal only (--one-sided)";
        facts.push(fact("cylinders", text.to_owned()));
    }
    facts.push(fact(
        "points for a distance (--min-points)",
        format!("{} or more of each cloud", settings.min_points),
    ));
    facts.push(fact(
        "registration error (--registration-error-m)",
        format!("{} m", settings.registration_error_m),
    ));
    facts
}

/// A label and its value.
pub fn fact(label: &str, value: String) -> Fact {
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
