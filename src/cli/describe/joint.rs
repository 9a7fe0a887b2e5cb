//! Description of the joint adjustment and of its own settings.

use super::lines::{Lines, degrees, millimetres};
use crate::project::Project;

pub(super) fn describe(lines: &mut Lines, project: &Project) {
    let settings = &project.joint;
    lines.section("joint adjustment");
    let finest = project.calibration.voxel_sizes_m.last();
    let size = millimetres(settings.surfel_size_m(finest.copied().unwrap_or_default()));
    let size = match (settings.surfel_m, project.has_auto_scales) {
        (Some(_), _) => size,
        (None, true) => "ten times the spacing of points, half of that on rough ground".to_owned(),
        (None, false) => {
            format!("{size} (ten times the finest voxel), half of that on rough ground")
        }
    };
    lines.value("size of surfels", size);
    lines.value("iterations", format!("at most {}", settings.max_iterations));
}

/// The assumed errors of the whole reference, if they are used.
pub(super) fn describe_reference(lines: &mut Lines, project: &Project) {
    let sigma = &project.joint.reference;
    if project.is_joint || !sigma.assumed {
        let assumed = if sigma.assumed { " (assumed)" } else { "" };
        let shift = millimetres(sigma.shift_m);
        lines.value("sigma of its shift", format!("{shift}{assumed}"));
        let tilt = degrees(sigma.tilt_rad);
        lines.value("sigma of its tilt", format!("{tilt}{assumed}"));
    }
    if let Some(sigma_m) = sigma.surface_m {
        lines.value("sigma of its surface", millimetres(sigma_m));
    }
}

/// The step of a run, if it has a joint adjustment.
pub(super) fn step(project: &Project) -> Option<String> {
    let drives = project.drives.iter().map(|drive| drive.name.as_str());
    let drives: Vec<&str> = drives.collect();
    let with = if drives.is_empty() {
        String::new()
    } else {
        format!(", together with {}", drives.join(", "))
    };
    let step = format!("adjust trajectory and mountings in one{with}");
    project.is_joint.then_some(step)
}
