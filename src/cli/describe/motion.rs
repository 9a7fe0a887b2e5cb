//! Description of logs, poses and limits of their sigmas.

use super::lines::{Lines, degrees, millimetres, short, vector};
use crate::geometry::Vec3;
use crate::project::{AccelUnit, GyroUnit, Logs, PosesFile, PositionLog};
use crate::sensor::{Observations, TotalStation, VerticalAngle};
use crate::trajectory::{Loss, Nodes, PoseLimits, PositionKind, PositionSettings};

pub(super) fn describe_logs(lines: &mut Lines, logs: &Logs) {
    let settings = &logs.settings;
    let noise = &settings.imu;
    lines.value("gravity", format!("{} m/s²", short(settings.gravity_m_s2)));
    lines.section("imu");
    lines.log(&logs.imu.path, logs.imu.time_offset_s);
    match logs.imu_units.accel {
        AccelUnit::MetresPerSecondSquared => {}
        AccelUnit::Gravity => lines.value("accelerations", "in g"),
        AccelUnit::Milligravity => lines.value("accelerations", "in mg"),
    }
    match logs.imu_units.gyro {
        GyroUnit::RadiansPerSecond => {}
        GyroUnit::DegreesPerSecond => lines.value("angular rates", "in °/s"),
    }
    let per_root_hour = noise.gyro_density.to_degrees() * 60.0;
    lines.value(
        "gyro noise",
        format!(
            "{} °/√h = {:.3e} rad/s/√Hz",
            short(per_root_hour),
            noise.gyro_density
        ),
    );
    lines.value(
        "accelerometer noise",
        format!("{:.3e} m/s²/√Hz", noise.accel_density),
    );
    lines.value(
        "gyro bias walk",
        format!("{:.3e} rad/s/√s", noise.gyro_bias_walk),
    );
    lines.value(
        "accelerometer bias walk",
        format!("{:.3e} m/s²/√s", noise.accel_bias_walk),
    );
    for (log, position) in logs.positions.iter().zip(&settings.positions) {
        describe_position(lines, log, position);
    }
    if let Some(log) = &logs.heading {
        let heading = &settings.heading;
        lines.section("heading");
        lines.log(&log.path, log.time_offset_s);
        lines.value("sigma", degrees(heading.sigma_rad));
        lines.value("sigma of pitch", degrees(heading.pitch_sigma_rad));
        let lasting = heading.sigma_correlated_rad;
        let lasting = (lasting > 0.0).then(|| degrees(lasting));
        lines.value("lasting errors", lasts(lasting, heading.correlation_s));
        lines.value("mounting offset", degrees(heading.mounting_offset_rad));
        lines.value("grid convergence", degrees(heading.grid_convergence_rad));
        lines.value("loss", loss(heading.loss));
    }
    lines.section("trajectory");
    let nodes = match settings.nodes {
        Nodes::Prism => "at positions, and at least one per second",
        Nodes::Imu => "at every IMU sample",
    };
    lines.value("nodes", nodes);
    let constants: Vec<String> = settings
        .estimate
        .iter()
        .map(|constant| constant.name(&settings.positions))
        .collect();
    let constants = if constants.is_empty() {
        "none".to_owned()
    } else {
        constants.join(", ")
    };
    lines.value("estimated constants", constants);
    let rest = if settings.zero_velocity {
        "velocity held at zero"
    } else {
        "not used"
    };
    lines.value("rest", rest);
}

fn describe_position(lines: &mut Lines, log: &PositionLog, settings: &PositionSettings) {
    let kind = match settings.kind {
        PositionKind::Prism => "prism",
        PositionKind::Gnss => "gnss",
    };
    lines.section(&if settings.name == kind {
        kind.to_owned()
    } else {
        format!("{kind} {}", settings.name)
    });
    lines.log(&log.path, log.time_offset_s);
    if let Observations::Polar(station) = &log.observations {
        describe_polar(lines, station);
    } else {
        let sigma = sigma_of_axes(&settings.sigma_m);
        lines.value("sigma", format!("{sigma} if the log has none"));
        if log.observations == Observations::Cartesian && settings.kind == PositionKind::Prism {
            lines.value("observations", "coordinates");
        }
        if settings.kind == PositionKind::Gnss {
            let noise = &log.by_quality;
            let others = [
                ("sigma of float", &noise.float_m),
                ("sigma of differential", &noise.differential_m),
                ("sigma of single", &noise.single_m),
            ];
            for (name, sigma_m) in others {
                lines.value(name, sigma_of_axes(sigma_m));
            }
        }
        if let Some(station) = &settings.station_m {
            lines.value("station", format!("{} m", vector(station)));
        }
    }
    let lasting = (settings.sigma_correlated_m.amax() > 0.0)
        .then(|| sigma_of_axes(&settings.sigma_correlated_m));
    lines.value("lasting errors", lasts(lasting, settings.correlation_s));
    let lever_arm = vector(&settings.lever_arm_m);
    lines.value("lever arm in the body", format!("{lever_arm} m"));
    lines.value("loss", loss(settings.loss));
}

fn sigma_of_axes(sigma_m: &Vec3) -> String {
    if sigma_m.x == sigma_m.y && sigma_m.y == sigma_m.z {
        millimetres(sigma_m.x)
    } else {
        format!("{} mm (east, north, up)", vector(&(sigma_m * 1e3)))
    }
}

/// The sigma of correlated errors, and their correlation time.
fn lasts(sigma: Option<String>, correlation_s: f64) -> String {
    sigma.map_or_else(
        || "none".to_owned(),
        |sigma| format!("{sigma} over {} s (correlation time)", short(correlation_s)),
    )
}

fn describe_polar(lines: &mut Lines, station: &TotalStation) {
    lines.value(
        "observations",
        "slope distance, horizontal and vertical angle",
    );
    lines.value("station", format!("{} m", vector(&station.station_m)));
    lines.value(
        "horizontal zero",
        format!(
            "{} clockwise from grid north",
            degrees(station.orientation_rad)
        ),
    );
    let vertical = match station.vertical {
        VerticalAngle::Zenith => "from the zenith",
        VerticalAngle::Elevation => "from the horizon, upwards",
    };
    lines.value("vertical angles", vertical);
    lines.value(
        "reflector constant",
        millimetres(station.reflector_constant_m),
    );
    lines.value(
        "sigma of distances",
        format!(
            "{} + {} ppm",
            millimetres(station.sigma_distance_m),
            short(station.sigma_distance_ppm)
        ),
    );
    let arcsec = station.sigma_angle_rad.to_degrees() * 3600.0;
    lines.value("sigma of angles", format!("{}″", short(arcsec)));
    lines.value("sigma of tracking", millimetres(station.sigma_prism_m));
}

fn loss(loss: Loss) -> &'static str {
    match loss {
        Loss::None => "quadratic (least squares)",
        Loss::Huber => "linear for large residuals (Huber)",
        Loss::Cauchy => "logarithmic for large residuals (Cauchy)",
        Loss::Truncated => "constant for large residuals (truncated)",
    }
}

pub(super) fn describe_limits(lines: &mut Lines, limits: &PoseLimits) {
    let bounds = [
        ("largest position sigma", limits.position_m.map(millimetres)),
        ("largest rotation sigma", limits.rotation_rad.map(degrees)),
    ];
    for (name, bound) in bounds {
        if let Some(bound) = bound {
            lines.value(name, format!("{bound}; points beyond are left out"));
        }
    }
}

pub(super) fn describe_poses(lines: &mut Lines, poses: &PosesFile, correlation_s: f64) {
    lines.section("trajectory");
    for path in poses.paths() {
        lines.file("file", path);
    }
    lines.offset(poses.time_offset_s);
    let else_unknown = |sigma: Option<String>| {
        sigma.map_or("from the file, if it has them".to_owned(), |sigma| {
            format!("{sigma} if the file has none")
        })
    };
    lines.value(
        "sigma of positions",
        else_unknown(poses.sigma_position_m.map(millimetres)),
    );
    lines.value(
        "sigma of rotations",
        else_unknown(poses.sigma_rotation_rad.map(degrees)),
    );
    lines.value(
        "errors last",
        format!("{} s (correlation time)", short(correlation_s)),
    );
}
