//! Diagnostics of an adjusted trajectory, computed from its solution: the same numbers go
//! into the page, `result.json` and the terminal.

use crate::number;
use crate::sensor::PoseRecord;
use crate::statistics::median;
use crate::trajectory::{EstimatedConstant, RejectionReason, SensorDiagnostics, Solution};

/// An outage has position sigmas of more than this many times the median.
pub const OUTAGE_FACTOR: f64 = 3.0;
/// Outages closer together than this are merged, seconds.
const SAME_OUTAGE_S: f64 = 1.0;
/// Residuals this many times larger than expected need attention.
pub const NOTABLE_FACTOR: f64 = 1.5;

/// One of the worst measurements, with the component of the largest test quantity.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct WorstMeasurement {
    /// Name of the sensor.
    pub sensor: String,
    /// Number of the record in the log, from 1.
    pub record: usize,
    /// Seconds.
    pub time_s: f64,
    /// `east`, `north`, `up`, or the name of the angle.
    pub component: String,
    /// Unit of the residual.
    pub unit: String,
    /// Predicted − measured.
    pub residual: f64,
    /// In standard deviations of the measurement.
    pub normalised: f64,
    /// In standard deviations of the residual: the test quantity of data snooping.
    pub test: f64,
    /// Whether the measurement was rejected.
    pub rejected: bool,
}

/// Name of component `index` of a sensor's residual with this many components.
pub fn component_name(sensor: &str, components: usize, index: usize) -> String {
    match (components, index) {
        (3, 0..3) => ["east", "north", "up"][index].to_owned(),
        _ => sensor.to_owned(),
    }
}

/// The measurements that fail the test of data snooping worst, worst first.
pub fn worst(solution: &Solution, count: usize) -> Vec<WorstMeasurement> {
    let worst = solution.worst(count).into_iter();
    worst
        .filter_map(|(sensor, residual)| {
            let by_size = |a: &(usize, &f64), b: &(usize, &f64)| a.1.abs().total_cmp(&b.1.abs());
            let (at, test) = residual.tests.iter().enumerate().max_by(by_size)?;
            Some(WorstMeasurement {
                sensor: sensor.to_owned(),
                record: residual.record,
                time_s: residual.time_s,
                component: component_name(sensor, residual.tests.len(), at),
                unit: solution
                    .sensor(sensor)
                    .map_or(String::new(), |s| s.unit.clone()),
                residual: *residual.values.get(at)?,
                normalised: *residual.normalised.get(at)?,
                test: *test,
                rejected: residual.weight == 0.0,
            })
        })
        .collect()
}

/// Number of records of one sensor rejected for one reason.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct RejectionCount {
    /// Name of the sensor.
    pub sensor: String,
    /// Reason.
    pub reason: RejectionReason,
    /// Number of records.
    pub count: usize,
}

/// Rejections by sensor and reason, in the order in which they first occur.
pub fn rejection_counts(solution: &Solution) -> Vec<RejectionCount> {
    let mut counts: Vec<RejectionCount> = Vec::new();
    for rejection in &solution.rejections {
        let same = counts
            .iter_mut()
            .find(|c| c.sensor == rejection.sensor && c.reason == rejection.reason);
        match same {
            Some(entry) => entry.count += 1,
            None => counts.push(RejectionCount {
                sensor: rejection.sensor.clone(),
                reason: rejection.reason,
                count: 1,
            }),
        }
    }
    counts
}

/// Median and maximum of a standard deviation along the drive.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Spread {
    /// Median over the poses.
    pub median: f64,
    /// Maximum over the poses.
    pub max: f64,
}

impl Spread {
    fn of(values: Vec<f64>) -> Self {
        let max = values.iter().copied().max_by(f64::total_cmp);
        Self {
            median: median(values).unwrap_or(f64::NAN),
            max: max.unwrap_or(f64::NAN),
        }
    }
}

/// A span of time with unusually large position sigmas.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Outage {
    /// Seconds.
    pub from_s: f64,
    /// Seconds.
    pub to_s: f64,
    /// The largest position sigma, metres.
    pub max_position_m: f64,
}

/// Standard deviations of the poses of a drive.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PoseSigmas {
    /// Standard deviation of the 3D position, √(σ_east² + σ_north² + σ_up²), metres.
    pub position_m: Spread,
    /// Standard deviation of the tilt, the larger of the rotations about east and north, degrees.
    pub tilt_deg: Spread,
    /// Standard deviation of the heading, degrees.
    pub heading_deg: Spread,
    /// Spans in which the position sigma exceeds [`OUTAGE_FACTOR`] times its median.
    pub outages: Vec<Outage>,
}

impl PoseSigmas {
    /// Summarises poses in time order; `None` if no pose has sigmas.
    pub fn of(poses: &[PoseRecord]) -> Option<Self> {
        let known: Vec<(f64, f64, f64, f64)> = poses
            .iter()
            .filter_map(|pose| {
                let sigma = pose.sigma.as_ref()?;
                let tilt = sigma.rotation_rad.x.max(sigma.rotation_rad.y);
                Some((
                    pose.time_s,
                    sigma.position_m.norm(),
                    tilt.to_degrees(),
                    sigma.rotation_rad.z.to_degrees(),
                ))
            })
            .collect();
        if known.is_empty() {
            return None;
        }
        let position_m = Spread::of(known.iter().map(|k| k.1).collect());
        let limit_m = OUTAGE_FACTOR * position_m.median;
        let mut outages: Vec<Outage> = Vec::new();
        for &(time_s, sigma_m, ..) in known.iter().filter(|k| k.1 > limit_m) {
            match outages.last_mut() {
                Some(last) if time_s - last.to_s < SAME_OUTAGE_S => {
                    last.to_s = time_s;
                    last.max_position_m = last.max_position_m.max(sigma_m);
                }
                _ => outages.push(Outage {
                    from_s: time_s,
                    to_s: time_s,
                    max_position_m: sigma_m,
                }),
            }
        }
        Some(Self {
            position_m,
            tilt_deg: Spread::of(known.iter().map(|k| k.2).collect()),
            heading_deg: Spread::of(known.iter().map(|k| k.3).collect()),
            outages,
        })
    }
}

/// Whether the sensor's residuals pass the χ² test of its sigma; `None` without redundancy.
pub fn passes(sensor: &SensorDiagnostics) -> Option<bool> {
    sensor.variance_component.map(|_| sensor.passes())
}

/// The outcome of the χ² test in words.
pub fn chi_square_text(sensor: &SensorDiagnostics) -> String {
    let Some(component) = sensor.variance_component else {
        return "not checked".into();
    };
    let factor = component.sqrt();
    match (sensor.passes(), factor >= 1.0) {
        (true, _) => "as expected".into(),
        (_, true) => format!("{factor:.2} times larger than expected"),
        (_, false) => format!("{:.2} times smaller than expected", 1.0 / factor),
    }
}

/// Whether the residuals are so much larger than expected that they need attention.
pub fn is_notable(sensor: &SensorDiagnostics) -> bool {
    let factor = sensor.variance_component.map_or(0.0, f64::sqrt);
    !sensor.passes() && factor > NOTABLE_FACTOR
}

/// Sensors with any records, used or not.
pub fn sensors_shown(solution: &Solution) -> impl Iterator<Item = &SensorDiagnostics> {
    let all = solution.sensors.iter();
    all.filter(|s| s.count + s.rejected + s.ignored > 0)
}

/// Whether a group of observations, by its name, is that of an IMU. Drives with poses from a file have none.
pub fn is_imu(group: &str) -> bool {
    group.rsplit('.').next() == Some("imu")
}

/// Display name of a sensor.
pub fn sensor_name(name: &str) -> &str {
    match name {
        "imu" => "IMU",
        "bias_walk" => "bias walk",
        other => other,
    }
}

/// A value in display units: millimetres, degrees.
pub fn quantity(value: f64, unit: &str) -> String {
    match unit {
        "m" => number::with_unit(number::millimetres(value), "mm"),
        "m/s" => number::with_unit(number::significant(1e3 * value, 3), "mm/s"),
        "m/s²" => number::with_unit(number::significant(1e3 * value, 3), "mm/s²"),
        "rad" => degrees(value.to_degrees(), 3),
        "rad/s" => number::with_unit(number::significant(value.to_degrees(), 3), "°/s"),
        _ => number::DASH.into(),
    }
}

/// An angle of `value` degrees with this many significant digits; the degree sign follows without a
/// space.
pub fn degrees(value: f64, digits: i32) -> String {
    if value.is_finite() {
        format!("{}°", number::significant(value, digits))
    } else {
        number::DASH.into()
    }
}

/// Value, sigma and initial value of a constant, rounded to its sigma, and their unit.
pub struct ConstantText {
    /// Estimated value; the project's if the drive does not determine the constant.
    pub value: String,
    /// Its standard deviation.
    pub sigma: Option<String>,
    /// Value in the project.
    pub start: String,
    /// Unit of all three.
    pub unit: String,
}

/// An estimated constant in display units.
pub fn constant_text(constant: &EstimatedConstant) -> ConstantText {
    let (factor, unit) = constant.shown_in();
    let sigma = constant.sigma.map(|sigma| factor * sigma);
    // Sigma to two significant digits, the value to the same decimal.
    let decimals = sigma
        .filter(|s| *s > 0.0 && s.is_finite())
        .map_or(4, |s| (1.0 - s.log10().floor()).clamp(0.0, 9.0) as usize);
    ConstantText {
        value: number::fixed(factor * constant.value, decimals),
        sigma: sigma.map(|sigma| number::fixed(sigma, decimals)),
        start: number::shortest(factor * constant.start),
        unit: unit.into(),
    }
}
