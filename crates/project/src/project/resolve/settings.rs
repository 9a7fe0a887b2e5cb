//! Checks of the settings of calibration, joint adjustment, comparison, acceptance and report.

use super::estimate::AUTO;
use super::table::Table;
use crate::calibration::CalibrationSettings;
use crate::comparison::ComparisonSettings;
use crate::error::Result;
use crate::joint::{JointSettings, MountingMotion, ReferenceSigma, Rung};
use crate::project::checked::FrameLogFile;
use crate::project::source::{Source, Step};
use crate::project::written::{self, Method, Written};
use crate::report::imprint::{self, Imprint};
use crate::sensor::MAX_FRAME_COLUMNS;
use crate::verdict::Acceptance;

/// With this many neighbours, 250,000 neighbourhoods take a gigabyte.
const MAX_NEIGHBOURS: usize = 1000;

/// The scales from coarse to fine; `None` for `"auto"`, which is also the default.
pub(super) fn voxel_sizes(
    source: &Source,
    written: &written::Calibration,
) -> Result<Option<Vec<f64>>> {
    const KEY: &str = "voxel_sizes_m";
    let table = Table::new(source, "calibration");
    let value_error = |found: &dyn std::fmt::Display, expected| {
        Err(table.error(KEY, format!("{KEY} = {found}"), expected))
    };
    let listed = match &written.voxel_sizes_m {
        None => return Ok(None),
        Some(toml::Value::String(word)) if word == AUTO => return Ok(None),
        Some(toml::Value::Array(listed)) => listed,
        Some(other) => {
            return value_error(other, "\"auto\" or a list of sizes from coarse to fine");
        }
    };
    let mut sizes = Vec::new();
    for one in listed {
        let size = match one {
            toml::Value::Float(size) => *size,
            toml::Value::Integer(size) => *size as f64,
            other => return value_error(other, "a number above 0"),
        };
        sizes.push(table.positive(KEY, size)?);
    }
    if sizes.is_empty() || sizes.windows(2).any(|pair| pair[1] >= pair[0]) {
        let found = toml::Value::from(sizes);
        return value_error(
            &found,
            "at least one size, each smaller than the previous one",
        );
    }
    Ok(Some(sizes))
}

/// Settings of the calibration: scales from coarse to fine, and neighbourhoods that can span a volume.
pub(super) fn calibration(
    source: &Source,
    written: &written::Calibration,
    voxel_sizes_m: Option<Vec<f64>>,
) -> Result<CalibrationSettings> {
    let table = Table::new(source, "calibration");
    let default = CalibrationSettings::default();
    Ok(CalibrationSettings {
        voxel_sizes_m: voxel_sizes_m.unwrap_or(default.voxel_sizes_m),
        neighbours: {
            let neighbours = at_least(
                &table,
                "neighbours",
                written.neighbours.unwrap_or(default.neighbours),
                4,
                ": three points always lie in a plane",
            )?;
            if neighbours > MAX_NEIGHBOURS {
                let expected =
                    format!("{MAX_NEIGHBOURS} or less: all neighbours are kept in memory");
                return Err(table.error(
                    "neighbours",
                    format!("neighbours = {neighbours}"),
                    &expected,
                ));
            }
            neighbours
        },
        method: written.method.unwrap_or_default().of_second_step(),
        max_iterations: at_least(
            &table,
            "max_iterations",
            written.max_iterations.unwrap_or(default.max_iterations),
            1,
            "",
        )?,
        pass_gap_s: table.positive(
            "pass_gap_s",
            written.pass_gap_s.unwrap_or(default.pass_gap_s),
        )?,
    })
}

/// Whether trajectory and mountings are adjusted jointly. If not, keys that only the joint adjustment
/// uses are errors: they would be ignored silently.
pub(super) fn is_joint(source: &Source, written: &Written) -> Result<bool> {
    if written.calibration.method.unwrap_or_default() == Method::Joint {
        return Ok(true);
    }
    let estimates = |scanner: &written::Scanner| scanner.estimate.iter().flatten().count() > 0;
    let without = "without the joint adjustment";
    let expected = "calibration.method = \"joint\" (the default)";
    if let Some(index) = written.scanner.iter().position(estimates) {
        let table = Table {
            index: Some(index),
            ..Table::new(source, "scanner")
        };
        return Err(table.error("estimate", format!("estimate {without}"), expected));
    }
    if !written.drive.is_empty() {
        return Err(source.error(
            &[Step::Key("drive")],
            format!("[[drive]] {without}"),
            expected,
        ));
    }
    if written.bending.is_some() {
        return Err(source.error(
            &[Step::Key("bending")],
            format!("[bending] {without}"),
            expected,
        ));
    }
    Ok(false)
}

/// The log of further quantities that may bend the frame.
pub(super) fn bending(source: &Source, written: &Written) -> Result<Option<FrameLogFile>> {
    let Some(bending) = &written.bending else {
        return Ok(None);
    };
    let table = Table::new(source, "bending");
    let columns = &bending.columns;
    let twice = columns.len() == 2 && columns[0] == columns[1];
    if !(1..=MAX_FRAME_COLUMNS).contains(&columns.len())
        || twice
        || columns.contains(&"time_s".into())
    {
        return Err(table.error(
            "columns",
            format!("columns = {columns:?}"),
            "the names of one or two columns of the log, other than time_s",
        ));
    }
    Ok(Some(FrameLogFile {
        log: table.log(&bending.file, bending.time_offset_s)?,
        columns: columns.clone(),
    }))
}

/// Settings of the joint adjustment: lengths and times above 0, standard deviations that may be 0.
pub(super) fn joint(source: &Source, written: &Written) -> Result<JointSettings> {
    let table = Table::new(source, "joint");
    let default = JointSettings::default();
    let surfel_m = written.joint.surfel_m;
    let correlation_s = written.trajectory.as_ref().and_then(|t| t.correlation_s);
    Ok(JointSettings {
        surfel_m: surfel_m
            .map(|size| table.positive("surfel_m", size))
            .transpose()?,
        max_iterations: at_least(
            &table,
            "max_iterations",
            written
                .joint
                .max_iterations
                .unwrap_or(default.max_iterations),
            1,
            "",
        )?,
        mounting: mounting_motion(written.joint.mounting.unwrap_or_default()),
        reference: reference_sigma(source, written.reference.as_ref())?,
        correlation_s: Table::new(source, "trajectory").positive(
            "correlation_s",
            correlation_s.unwrap_or(default.correlation_s),
        )?,
    })
}

fn mounting_motion(written: written::MountingMotion) -> MountingMotion {
    let only = |rung| MountingMotion {
        least: rung,
        most: rung,
    };
    match written {
        written::MountingMotion::Auto => MountingMotion::default(),
        written::MountingMotion::Rigid => only(Rung::Rigid),
        written::MountingMotion::Compliance => only(Rung::Compliance),
        written::MountingMotion::SlowKnots => only(Rung::SlowKnots),
        written::MountingMotion::DenseKnots => only(Rung::DenseKnots),
    }
}

fn reference_sigma(
    source: &Source,
    written: Option<&written::Reference>,
) -> Result<ReferenceSigma> {
    let default = ReferenceSigma::default();
    let Some(reference) = written else {
        return Ok(default);
    };
    let table = Table::new(source, "reference");
    let sigma = |key, value: Option<f64>| value.map(|x| table.not_negative(key, x)).transpose();
    let shift_m = sigma("sigma_m", reference.sigma_m)?;
    let tilt_deg = sigma("sigma_deg", reference.sigma_deg)?;
    Ok(ReferenceSigma {
        shift_m: shift_m.unwrap_or(default.shift_m),
        tilt_rad: tilt_deg.map_or(default.tilt_rad, f64::to_radians),
        assumed: shift_m.is_none() && tilt_deg.is_none(),
        surface_m: sigma("sigma_surface_m", reference.sigma_surface_m)?,
    })
}

fn at_least(
    table: &Table<'_>,
    key: &str,
    value: usize,
    least: usize,
    reason: &str,
) -> Result<usize> {
    if value >= least {
        return Ok(value);
    }
    Err(table.error(
        key,
        format!("{key} = {value}"),
        &format!("{least} or more{reason}"),
    ))
}

/// The limits of `[acceptance]`.
pub(super) fn acceptance(source: &Source, written: &written::Acceptance) -> Result<Acceptance> {
    let table = Table::new(source, "acceptance");
    let default = Acceptance::default();
    let positive = |key, value: Option<f64>, default| table.positive(key, value.unwrap_or(default));
    let rotation = match written.sigma_rotation_deg {
        Some(degrees) => table.positive("sigma_rotation_deg", degrees)?.to_radians(),
        None => default.sigma_rotation_rad,
    };
    let coverage = positive("coverage", written.coverage, default.coverage)?;
    if coverage > 1.0 {
        return Err(table.error("coverage", coverage.to_string(), "a share from 0 to 1"));
    }
    let sigma = written.sigma_translation_m;
    Ok(Acceptance {
        sigma_translation_m: positive("sigma_translation_m", sigma, default.sigma_translation_m)?,
        sigma_rotation_rad: rotation,
        distance_m: positive("distance_m", written.distance_m, default.distance_m)?,
        coverage,
    })
}

/// The texts and the logo of `[report]`.
pub(super) fn imprint(source: &Source, written: &written::Report) -> Result<Imprint> {
    let table = Table::new(source, "report");
    for (key, text) in [
        ("title", &written.title),
        ("author", &written.author),
        ("organisation", &written.organisation),
    ] {
        if text.as_ref().is_some_and(|text| text.trim().is_empty()) {
            return Err(table.error(
                key,
                format!("an empty {key}"),
                "a text; otherwise omit the key",
            ));
        }
    }
    let logo = written.logo.as_ref().map(|path| source.absolute(path));
    if let Some(path) = &logo
        && imprint::media_type(path).is_none()
    {
        let found = format!("logo = {:?}", path.display().to_string());
        return Err(table.error(
            "logo",
            found,
            "a file that ends in .png, .jpg, .jpeg, .webp or .svg",
        ));
    }
    Ok(Imprint {
        title: written.title.clone(),
        author: written.author.clone(),
        organisation: written.organisation.clone(),
        logo,
    })
}

/// Settings of the comparison: lengths above 0.
pub fn comparison(source: &Source, written: &written::Comparison) -> Result<ComparisonSettings> {
    let table = Table::new(source, "comparison");
    let default = ComparisonSettings::default();
    let positive = |key, value: Option<f64>, default| table.positive(key, value.unwrap_or(default));
    let normal_radii_m = written
        .normal_radii_m
        .clone()
        .unwrap_or(default.normal_radii_m);
    if normal_radii_m.is_empty() {
        return Err(table.error("normal_radii_m", "an empty list", "at least one radius"));
    }
    for &radius in &normal_radii_m {
        table.positive("normal_radii_m", radius)?;
    }
    Ok(ComparisonSettings {
        core_spacing_m: positive(
            "core_spacing_m",
            written.core_spacing_m,
            default.core_spacing_m,
        )?,
        normal_radii_m,
        cylinder_radius_m: positive(
            "cylinder_radius_m",
            written.cylinder_radius_m,
            default.cylinder_radius_m,
        )?,
        max_distance_m: positive(
            "max_distance_m",
            written.max_distance_m,
            default.max_distance_m,
        )?,
        registration_error_m: table.not_negative(
            "registration_error_m",
            written
                .registration_error_m
                .unwrap_or(default.registration_error_m),
        )?,
        aggregation: written.aggregation.unwrap_or(default.aggregation),
        detection: written.detection.unwrap_or(default.detection),
        one_sided: written.one_sided.unwrap_or(default.one_sided),
        min_points: match written.min_points {
            Some(0) => return Err(table.error("min_points", "min_points = 0", "1 or more")),
            points => points.unwrap_or(default.min_points),
        },
    })
}
