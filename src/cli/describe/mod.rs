//! Description of a project: every value with its unit, and the steps of a run.

mod joint;
mod lines;
mod motion;
mod preview;

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::calibration::{Method, MountingForms, PARAMETER_NAMES};
use crate::comparison::{Aggregation, ComparisonSettings, Detection};
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::{BodyAxes, BodyFromScanner, EulerConvention};
use crate::project::{Motion, Project, Scanner};
use lines::{Lines, millimetres, short, vector};
pub(super) use preview::preview;

/// Describes a `calibration.toml`, as a document and as text.
pub(super) fn mountings(path: &Path, scanners: &[(String, BodyFromScanner)]) -> (Value, String) {
    let mut lines = Lines {
        text: format!("calibration {}\n", path.display()),
        folder: PathBuf::new(),
    };
    let mut forms = Map::new();
    for (name, mounting) in scanners {
        lines.section(&format!("scanner {name}"));
        let translation_m = vector(&mounting.translation_m);
        lines.value("translation", format!("{translation_m} m"));
        for (convention, angles_deg) in rotations(mounting) {
            let convention = convention.name();
            lines.value("rotation", format!("{angles_deg} ° ({convention})"));
        }
        let form = json!({ "body_from_scanner": MountingForms::from(mounting) });
        forms.insert(name.clone(), form);
    }
    let document = json!({
        "path": path.display().to_string(),
        "format": "calibration",
        "scanners": forms,
    });
    (document, lines.text.trim_end().to_owned())
}

/// The angles of a mounting in each convention, as text.
fn rotations(mounting: &BodyFromScanner) -> [(EulerConvention, String); 2] {
    EulerConvention::ALL.map(|convention| {
        let angles_deg = euler_deg_from_rotation(convention, &mounting.rotation);
        (convention, angles_deg.map(short).join(", "))
    })
}

/// Describes `project` as text.
pub(super) fn project(project: &Project) -> String {
    let mut lines = Lines {
        text: format!("project {}\n", project.path.display()),
        folder: project.path.parent().unwrap_or(Path::new("")).to_owned(),
    };
    lines.section("frame");
    let axes = match project.axes {
        BodyAxes::Frd => "FRD: x forward, y right, z down",
        BodyAxes::Flu => "FLU: x forward, y left, z up",
    };
    lines.value("body axes", axes);
    let origin_m = project.origin_m.unwrap_or_default();
    lines.value("origin", format!("{} m", vector(&origin_m)));
    match &project.motion {
        Motion::Logs(logs) => motion::describe_logs(&mut lines, logs),
        Motion::Poses(poses) => {
            motion::describe_poses(&mut lines, poses, project.joint.correlation_s);
        }
    }
    motion::describe_limits(&mut lines, &project.limits);
    for scanner in &project.scanners {
        describe_scanner(&mut lines, scanner);
    }
    if let Some(reference) = &project.reference {
        lines.section("reference");
        lines.file("file", &reference.path);
        joint::describe_reference(&mut lines, project);
    }
    if !(project.scanners.is_empty() && project.reference.is_none()) {
        describe_calibration(&mut lines, project);
        if project.is_joint {
            joint::describe(&mut lines, project);
        }
        describe_comparison(&mut lines, &project.comparison);
    }
    for (kind, drives) in [
        ("drive", &project.drives),
        ("evaluation", &project.evaluations),
    ] {
        for other in drives {
            lines.section(&format!("{kind} {}", other.name));
            lines.file("project", &other.project);
        }
    }
    lines.section("what `boresight run` will do");
    for (index, step) in steps(project).iter().enumerate() {
        lines.text.push_str(&format!("  {}. {step}\n", index + 1));
    }
    lines.text
}

/// The steps of a run of `project`, in order.
pub(super) fn steps(project: &Project) -> Vec<String> {
    let mut steps = Vec::new();
    match &project.motion {
        Motion::Logs(logs) => {
            let mut sensors = vec!["IMU"];
            sensors.extend(logs.settings.positions.iter().map(|p| p.name.as_str()));
            sensors.extend(logs.heading.as_ref().map(|_| "heading"));
            let last = sensors.pop().unwrap_or_default();
            let sensors = sensors.join(", ");
            steps.push(format!("estimate the trajectory from {sensors} and {last}"));
        }
        Motion::Poses(_) => steps.push("read the trajectory".to_owned()),
    }
    let names: Vec<&str> = project.scanners.iter().map(|s| s.name.as_str()).collect();
    if names.is_empty() {
        return steps;
    }
    let against = match (&project.reference, names.len()) {
        (Some(_), 1) => "against the reference",
        (Some(_), _) => "against the reference and each other",
        (None, 1) => {
            "against its own passes; without a reference its height is unobservable and is held"
        }
        (None, _) => {
            "against each other; without a reference their common height is unobservable and is held"
        }
    };
    let scales = if project.has_auto_scales {
        String::new()
    } else {
        format!(" on {} scales", project.calibration.voxel_sizes_m.len())
    };
    steps.push(format!("calibrate {}{scales} {against}", names.join(", ")));
    steps.extend(joint::step(project));
    let clouds: Vec<String> = names
        .iter()
        .map(|name| format!("cloud-{name}.laz"))
        .collect();
    steps.push(format!("georeference: {}", clouds.join(", ")));
    if project.reference.is_some() {
        steps.push("compare each cloud with the reference (M3C2), before and after".to_owned());
    }
    if names.len() > 1 {
        steps.push("compare the scanners with each other (M3C2)".to_owned());
    }
    for evaluation in &project.evaluations {
        steps.push(format!("evaluate the mountings on {}", evaluation.name));
    }
    steps.push("write the report".to_owned());
    steps
}

fn describe_scanner(lines: &mut Lines, scanner: &Scanner) {
    lines.section(&format!("scanner {}", scanner.name));
    for path in &scanner.profiles {
        lines.file("profiles", path);
    }
    lines.offset(scanner.time_offset_s);
    if let Some(field) = &scanner.point_times.field {
        lines.value("times of points", format!("field `{field}`"));
    }
    if let Some(unit_s) = scanner.point_times.unit_s {
        lines.value("unit of these times", format!("{unit_s:e} s"));
    }
    let mounting = &scanner.body_from_scanner;
    lines.value(
        "initial translation",
        format!("{} m", vector(&mounting.translation_m)),
    );
    for (convention, angles) in rotations(mounting) {
        let name = convention.name();
        let typed = if convention == scanner.convention {
            ", as in the project"
        } else {
            ""
        };
        lines.value("initial rotation", format!("{angles} ° ({name}{typed})"));
    }
    let fixed: Vec<&str> = PARAMETER_NAMES
        .into_iter()
        .zip(scanner.fixed)
        .filter_map(|(name, fixed)| fixed.then_some(name))
        .collect();
    if !fixed.is_empty() {
        lines.value("fixed", fixed.join(", "));
    }
    if scanner.estimate_time_offset {
        lines.value("estimated", "time offset, besides the mounting");
    }
}

fn describe_calibration(lines: &mut Lines, project: &Project) {
    let settings = &project.calibration;
    lines.section("calibration");
    let method = match settings.method {
        _ if project.is_joint => {
            "joint: one adjustment of trajectory and mountings, after two steps"
        }
        Method::TwoStep | Method::Joint => {
            "two steps: reweighted least squares on the estimated trajectory"
        }
        Method::Paper => "the paper's: Gauss-Newton on omnivariances, numeric derivatives",
    };
    lines.value("method", method);
    let sizes: Vec<String> = settings
        .voxel_sizes_m
        .iter()
        .map(|size| short(size * 1e3))
        .collect();
    let sizes = if project.has_auto_scales {
        "chosen from the points".to_owned()
    } else {
        format!("{} mm", sizes.join(", "))
    };
    lines.value("voxel sizes", sizes);
    lines.value("neighbours", settings.neighbours);
    lines.value(
        "iterations per scale",
        format!("at most {}", settings.max_iterations),
    );
    lines.value(
        "new pass after",
        format!("{} s", short(settings.pass_gap_s)),
    );
}

fn describe_comparison(lines: &mut Lines, settings: &ComparisonSettings) {
    lines.section("comparison");
    lines.value(
        "spacing of core points",
        millimetres(settings.core_spacing_m),
    );
    let radii: Vec<String> = settings
        .normal_radii_m
        .iter()
        .map(|r| short(r * 1e3))
        .collect();
    lines.value("radii of normals", format!("{} mm", radii.join(", ")));
    lines.value(
        "radius of the cylinder",
        millimetres(settings.cylinder_radius_m),
    );
    lines.value("largest distance", millimetres(settings.max_distance_m));
    lines.value(
        "registration error",
        millimetres(settings.registration_error_m),
    );
    let (middle, spread) = match settings.aggregation {
        Aggregation::Mean => ("mean", "standard deviation"),
        Aggregation::Median => ("median", "inter-quartile range"),
    };
    lines.value("statistics", format!("{middle} and {spread}"));
    let distribution = match settings.detection {
        Detection::Normal => "normal distribution",
        Detection::Student => "Student's t",
    };
    lines.value("level of detection", distribution.to_owned());
    if settings.one_sided {
        lines.value("cylinders", "along the normal only".to_owned());
    }
    if settings.min_points > 1 {
        lines.value(
            "points per distance",
            format!("{} or more", settings.min_points),
        );
    }
}
