//! Checks of prisms and GNSS antennas.

use super::scanners::check_letters;
use super::table::Table;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::project::checked::{LogFile, PositionLog};
use crate::project::quality::{DIFFERENTIAL_SIGMA_M, FLOAT_SIGMA_M, QualityNoise, SINGLE_SIGMA_M};
use crate::project::shapes::Numbers;
use crate::project::source::Source;
use crate::project::written::{self, ObservationKind, Written};
use crate::sensor::{Observations, TotalStation};
use crate::trajectory::{PositionKind, PositionSettings};

/// Names that would clash with prefixes of other constants, for example `heading.time_offset`.
const TAKEN: [&str; 4] = ["frame", "heading", "imu", "trajectory"];
/// Default standard deviation of a moving prism, metres.
const PRISM_SIGMA_M: f64 = 0.005;
/// Default standard deviation of a carefully measured lever arm, metres.
const LEVER_ARM_SIGMA_M: f64 = 0.002;
/// Default standard deviations of RTK: east, north, up, metres.
const GNSS_SIGMA_M: [f64; 3] = [0.02, 0.02, 0.04];

/// Converts seconds of arc to radians.
pub(in crate::project) fn arcsec_to_radians(arcsec: f64) -> f64 {
    (arcsec / 3600.0).to_radians()
}

/// All prisms, then all antennas, in the order of the file, with unique names.
pub(super) fn positions(
    source: &Source,
    written: &Written,
) -> Result<Vec<(PositionLog, PositionSettings)>> {
    let (prisms, antennas) = (&written.prism.0, &written.gnss.0);
    let mut sensors = Vec::new();
    for (index, written) in prisms.iter().enumerate() {
        let table = table_of(source, "prism", index, prisms.len());
        sensors.push(prism(
            &table,
            written,
            name(&table, written.name.as_deref(), prisms.len(), &sensors)?,
        )?);
    }
    for (index, written) in antennas.iter().enumerate() {
        let table = table_of(source, "gnss", index, antennas.len());
        sensors.push(gnss(
            &table,
            written,
            name(&table, written.name.as_deref(), antennas.len(), &sensors)?,
        )?);
    }
    Ok(sensors)
}

fn table_of<'a>(source: &'a Source, name: &'a str, index: usize, count: usize) -> Table<'a> {
    Table {
        index: (count > 1).then_some(index),
        ..Table::new(source, name)
    }
}

/// The given name, or the name of the table if there is only one such table.
fn name(
    table: &Table<'_>,
    given: Option<&str>,
    count: usize,
    others: &[(PositionLog, PositionSettings)],
) -> Result<String> {
    let name = match given {
        Some(name) => name,
        None if count == 1 => table.name,
        None => {
            return Err(table.error(
                "file",
                format!("one of {count} [[{}]] without a name", table.name),
                "`name`, to distinguish them",
            ));
        }
    };
    check_letters(table, name, "")?;
    let is_other = |other: &str| other.eq_ignore_ascii_case(name);
    if others.iter().any(|(_, other)| is_other(&other.name)) || TAKEN.iter().any(|t| is_other(t)) {
        return Err(table.error(
            "name",
            format!("the name {name:?}, which is already taken"),
            "a unique name",
        ));
    }
    Ok(name.to_owned())
}

/// Standard deviations, which must be above 0.
fn sigmas(table: &Table<'_>, key: &str, given: Option<Numbers>, default: [f64; 3]) -> Result<Vec3> {
    let Numbers(values) = given.unwrap_or(Numbers(default));
    for value in values {
        table.positive(key, value)?;
    }
    Ok(values.into())
}

fn lever_arm_sigma(table: &Table<'_>, given: Option<f64>) -> Result<f64> {
    table.not_negative("sigma_lever_arm_m", given.unwrap_or(LEVER_ARM_SIGMA_M))
}

/// Standard deviations and correlation time of the time-correlated part of the errors.
fn correlated(
    table: &Table<'_>,
    sigma_m: Option<Numbers>,
    has_lasting: bool,
    correlation_s: Option<f64>,
) -> Result<(Vec3, f64)> {
    let key = "sigma_correlated_m";
    let Numbers(values) = sigma_m.unwrap_or(Numbers([0.0; 3]));
    for value in values {
        table.not_negative(key, value)?;
    }
    let correlation_s = table.correlation(key, has_lasting, correlation_s)?;
    Ok((values.into(), correlation_s))
}

fn gnss(
    table: &Table<'_>,
    gnss: &written::Gnss,
    name: String,
) -> Result<(PositionLog, PositionSettings)> {
    let LogFile {
        path,
        time_offset_s,
    } = table.log(&gnss.file, gnss.time_offset_s)?;
    let given = [
        gnss.sigma_correlated_m,
        gnss.sigma_float_m,
        gnss.sigma_differential_m,
        gnss.sigma_single_m,
    ];
    let has_lasting = given.iter().any(Option::is_some);
    let (sigma_correlated_m, correlation_s) = correlated(
        table,
        gnss.sigma_correlated_m,
        has_lasting,
        gnss.correlation_s,
    )?;
    let sigma = |key, given, default| sigmas(table, key, given, default);
    let log = PositionLog {
        path,
        time_offset_s,
        observations: Observations::Cartesian,
        by_quality: QualityNoise {
            float_m: sigma("sigma_float_m", gnss.sigma_float_m, FLOAT_SIGMA_M)?,
            differential_m: sigma(
                "sigma_differential_m",
                gnss.sigma_differential_m,
                DIFFERENTIAL_SIGMA_M,
            )?,
            single_m: sigma("sigma_single_m", gnss.sigma_single_m, SINGLE_SIGMA_M)?,
            correlation_s,
        },
    };
    let settings = PositionSettings {
        name,
        kind: PositionKind::Gnss,
        sigma_m: sigmas(table, "sigma_m", gnss.sigma_m, GNSS_SIGMA_M)?,
        sigma_correlated_m,
        correlation_s,
        lever_arm_m: table.on_body("lever_arm_m", gnss.lever_arm_m)?,
        sigma_lever_arm_m: lever_arm_sigma(table, gnss.sigma_lever_arm_m)?,
        station_m: None,
        loss: gnss.loss.unwrap_or_default(),
    };
    Ok((log, settings))
}

fn prism(
    table: &Table<'_>,
    prism: &written::Prism,
    name: String,
) -> Result<(PositionLog, PositionSettings)> {
    let LogFile {
        path,
        time_offset_s,
    } = table.log(&prism.file, prism.time_offset_s)?;
    let station_m = prism
        .station_m
        .map(|station| table.vector("station_m", station))
        .transpose()?;
    let observations = observations(table, prism, station_m)?;
    let sigma_m = match &observations {
        // Every fix has its own covariance; this is a typical value at short range.
        Observations::Polar(station) => {
            Vec3::repeat(station.sigma_prism_m.hypot(station.sigma_distance_m))
        }
        _ => sigmas(table, "sigma_m", prism.sigma_m, [PRISM_SIGMA_M; 3])?,
    };
    let (sigma_correlated_m, correlation_s) = correlated(
        table,
        prism.sigma_correlated_m,
        prism.sigma_correlated_m.is_some(),
        prism.correlation_s,
    )?;
    let log = PositionLog {
        path,
        time_offset_s,
        observations,
        by_quality: QualityNoise {
            float_m: FLOAT_SIGMA_M.into(),
            differential_m: DIFFERENTIAL_SIGMA_M.into(),
            single_m: SINGLE_SIGMA_M.into(),
            correlation_s,
        },
    };
    let settings = PositionSettings {
        name,
        kind: PositionKind::Prism,
        sigma_m,
        sigma_correlated_m,
        correlation_s,
        lever_arm_m: table.on_body("lever_arm_m", prism.lever_arm_m)?,
        sigma_lever_arm_m: lever_arm_sigma(table, prism.sigma_lever_arm_m)?,
        station_m,
        loss: prism.loss.unwrap_or_default(),
    };
    Ok((log, settings))
}

/// The kind of observations: polar if the orientation of the instrument is given.
fn observations(
    table: &Table<'_>,
    prism: &written::Prism,
    station_m: Option<Vec3>,
) -> Result<Observations> {
    let noise = [
        ("sigma_distance_m", prism.sigma_distance_m),
        ("sigma_distance_ppm", prism.sigma_distance_ppm),
        ("sigma_angle_arcsec", prism.sigma_angle_arcsec),
    ];
    let Some(orientation_deg) = prism.station_orientation_deg else {
        if prism.observations == Some(ObservationKind::Polar) {
            return Err(table.error(
                "observations",
                "polar observations without station_orientation_deg",
                "station_m and station_orientation_deg",
            ));
        }
        let vertical = ("vertical_angle", prism.vertical_angle.is_some());
        let constant = ("reflector_constant_m", prism.reflector_constant_m.is_some());
        let noise = noise.map(|(key, value)| (key, value.is_some()));
        let polar = [vertical, constant].into_iter().chain(noise);
        if let Some((key, _)) = polar.into_iter().find(|(_, given)| *given) {
            return Err(table.error(
                key,
                format!("{key} without station_orientation_deg"),
                "station_m and station_orientation_deg for a polar log",
            ));
        }
        return Ok(match prism.observations {
            Some(_) => Observations::Cartesian,
            None => Observations::AsFound,
        });
    };
    if prism.observations == Some(ObservationKind::Cartesian) {
        return Err(table.error(
            "station_orientation_deg",
            "station_orientation_deg together with observations = \"cartesian\"",
            "one of the two: coordinates are not transformed",
        ));
    }
    let Some(station_m) = station_m else {
        return Err(table.error(
            "station_orientation_deg",
            "station_orientation_deg without station_m",
            "both: the instrument's position and the azimuth of its zero",
        ));
    };
    // If any noise of the instrument is given, no default for tracking is added.
    let has_noise = noise.iter().any(|(_, value)| value.is_some());
    let default = if has_noise { 0.0 } else { PRISM_SIGMA_M };
    let Numbers([sigma_prism_m, y, z]) = prism.sigma_m.unwrap_or(Numbers([default; 3]));
    if sigma_prism_m != y || y != z {
        return Err(table.error(
            "sigma_m",
            "three values of sigma_m",
            "one value, as polar observations give the rest of the covariance",
        ));
    }
    let noise_of = |(key, value): (&str, Option<f64>), default| {
        table.not_negative(key, value.unwrap_or(default))
    };
    Ok(Observations::Polar(TotalStation {
        station_m,
        orientation_rad: table
            .finite("station_orientation_deg", Some(orientation_deg))?
            .to_radians(),
        vertical: prism.vertical_angle.unwrap_or_default(),
        reflector_constant_m: table.finite("reflector_constant_m", prism.reflector_constant_m)?,
        sigma_distance_m: table
            .positive("sigma_distance_m", prism.sigma_distance_m.unwrap_or(0.001))?,
        sigma_distance_ppm: noise_of(noise[1], 1.0)?,
        sigma_angle_rad: arcsec_to_radians(table.positive(
            "sigma_angle_arcsec",
            prism.sigma_angle_arcsec.unwrap_or(1.0),
        )?),
        sigma_prism_m: table.not_negative("sigma_m", sigma_prism_m)?,
    }))
}
