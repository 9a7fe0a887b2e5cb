//! What a surveyor checks of an adjusted trajectory, drawn from its solution: the same numbers go
//! into the page, `result.json` and the terminal.

use super::content::Verdict;
use super::number;
use crate::sensor::PoseRecord;
use crate::statistics::median;
use crate::trajectory::{RejectionReason, SensorDiagnostics, Solution};

/// Poses whose position sigma exceeds this many times the median lie in an outage.
pub const OUTAGE_FACTOR: f64 = 3.0;
/// Outages closer together than this are one, seconds.
const SAME_OUTAGE_S: f64 = 1.0;
/// Residuals this many times larger than their sigma says deserve a look.
const NOTABLE_FACTOR: f64 = 1.5;

/// One of the worst measurements, by the component with the largest test quantity.
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
    /// Of the residual.
    pub unit: &'static str,
    /// Predicted − measured.
    pub residual: f64,
    /// In standard deviations of the measurement.
    pub normalised: f64,
    /// In standard deviations of the residual: the test quantity of data snooping.
    pub test: f64,
    /// Whether it takes no part.
    pub rejected: bool,
}

/// Name of the component `index` of a sensor's residual with so many components.
pub fn component_name(sensor: &str, components: usize, index: usize) -> String {
    match (components, index) {
        (3, 0..3) => ["east", "north", "up"][index].to_owned(),
        _ => sensor.to_owned(),
    }
}

/// The measurements that fail the test of data snooping worst, worst first.
pub fn worst(solution: &Solution, count: usize) -> Vec<WorstMeasurement> {
    let found = solution.worst(count).into_iter();
    found
        .filter_map(|(sensor, residual)| {
            let by_size = |a: &(usize, &f64), b: &(usize, &f64)| a.1.abs().total_cmp(&b.1.abs());
            let (at, test) = residual.tests.iter().enumerate().max_by(by_size)?;
            Some(WorstMeasurement {
                sensor: sensor.to_owned(),
                record: residual.record,
                time_s: residual.time_s,
                component: component_name(sensor, residual.tests.len(), at),
                unit: solution.sensor(sensor).map_or("", |s| s.unit),
                residual: *residual.values.get(at)?,
                normalised: *residual.normalised.get(at)?,
                test: *test,
                rejected: residual.weight == 0.0,
            })
        })
        .collect()
}

/// How many records of one sensor take no part for one reason.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct RejectionCount {
    /// Name of the sensor.
    pub sensor: String,
    /// Why.
    pub reason: RejectionReason,
    /// Records.
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
            Some(found) => found.count += 1,
            None => counts.push(RejectionCount {
                sensor: rejection.sensor.clone(),
                reason: rejection.reason,
                count: 1,
            }),
        }
    }
    counts
}

/// Median and greatest of a standard deviation along the drive.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Spread {
    /// Half of the poses are known better.
    pub median: f64,
    /// The worst pose.
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

/// A time in which the position is known much worse than usual.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Outage {
    /// Seconds.
    pub from_s: f64,
    /// Seconds.
    pub to_s: f64,
    /// The largest position sigma within, metres.
    pub max_position_m: f64,
}

/// How well the poses of a drive are known.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PoseSigmas {
    /// Of the position in space, √(σ_east² + σ_north² + σ_up²), metres.
    pub position_m: Spread,
    /// Of the tilt, the larger of the rotations about east and north, degrees.
    pub tilt_deg: Spread,
    /// Of the heading, degrees.
    pub heading_deg: Spread,
    /// Times in which the position sigma exceeds [`OUTAGE_FACTOR`] times its median.
    pub outages: Vec<Outage>,
}

impl PoseSigmas {
    /// Of these poses in time order; `None` where no pose has sigmas.
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

/// Whether the sensor's residuals agree with its sigma by the test of χ²; `None` where nothing
/// checks them.
pub fn passes(sensor: &SensorDiagnostics) -> Option<bool> {
    sensor.variance_component.map(|_| sensor.passes())
}

/// The outcome of the test of χ² in plain words.
pub fn sigma_words(sensor: &SensorDiagnostics) -> String {
    let Some(component) = sensor.variance_component else {
        return "nothing checks it".into();
    };
    let factor = component.sqrt();
    match (sensor.passes(), factor >= 1.0) {
        (true, _) => "as its sigma says".into(),
        (_, true) => format!("{factor:.2} times larger than its sigma says"),
        (_, false) => format!("{:.2} times smaller than its sigma says", 1.0 / factor),
    }
}

/// Whether the residuals are so much larger than their sigma says that somebody should look.
pub fn is_notable(sensor: &SensorDiagnostics) -> bool {
    let factor = sensor.variance_component.map_or(0.0, f64::sqrt);
    !sensor.passes() && factor > NOTABLE_FACTOR
}

/// Sensors that took part, or whose records were all left out.
pub fn sensors_shown(solution: &Solution) -> impl Iterator<Item = &SensorDiagnostics> {
    let all = solution.sensors.iter();
    all.filter(|s| s.count + s.rejected + s.ignored > 0)
}

/// Name of a sensor in tables for people.
pub fn sensor_name(name: &str) -> &str {
    match name {
        "imu" => "IMU",
        "bias_walk" => "bias walk",
        other => other,
    }
}

/// A value with the unit that people read: millimetres, degrees.
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

/// An angle of `value` degrees with so many significant digits; its sign follows without a space.
pub fn degrees(value: f64, digits: i32) -> String {
    match value.is_finite() {
        true => format!("{}°", number::significant(value, digits)),
        false => number::DASH.into(),
    }
}

/// Value, sigma and start of a constant to the digits that its sigma deserves, and their unit.
pub struct ConstantWords {
    /// What the drive says; that of the project where the drive does not determine it.
    pub value: String,
    /// Its standard deviation.
    pub sigma: Option<String>,
    /// What the project says.
    pub start: String,
    /// Of all three.
    pub unit: &'static str,
}

/// An estimated constant in the units that people read.
pub fn constant_words(constant: &crate::trajectory::EstimatedConstant) -> ConstantWords {
    let (factor, unit) = match constant.unit {
        "rad" => (1f64.to_degrees(), "°"),
        "s" => (1e3, "ms"),
        other => (1.0, other),
    };
    let sigma = constant.sigma.map(|sigma| factor * sigma);
    // Two digits of the sigma, and the value to the same decimal.
    let decimals = sigma
        .filter(|s| *s > 0.0 && s.is_finite())
        .map_or(4, |s| (1.0 - s.log10().floor()).clamp(0.0, 9.0) as usize);
    ConstantWords {
        value: number::fixed(factor * constant.value, decimals),
        sigma: sigma.map(|sigma| number::fixed(sigma, decimals)),
        start: number::shortest(factor * constant.start),
        unit,
    }
}

/// The times of a span as in the logs.
fn span_words(from_s: f64, to_s: f64) -> String {
    format!("from {from_s:.1} s to {to_s:.1} s")
}

/// Most spans named in one sentence.
const NAMED_SPANS: usize = 4;

/// Spans in words, the first few by their times.
fn spans_words(spans: &[(f64, f64)]) -> String {
    let named: Vec<String> = spans
        .iter()
        .take(NAMED_SPANS)
        .map(|(from_s, to_s)| span_words(*from_s, *to_s))
        .collect();
    match spans.len().saturating_sub(NAMED_SPANS) {
        0 => named.join(" and "),
        more => format!("{} and {more} times more", named.join(", ")),
    }
}

/// What to know about the adjustment, in sentences.
pub fn verdicts(solution: &Solution, sigmas: Option<&PoseSigmas>) -> Vec<Verdict> {
    let mut lines = Vec::new();
    let ended = format!(
        "The adjustment of the trajectory {} after {} iterations over {} nodes.",
        solution.stop,
        solution.iterations,
        number::count(solution.nodes)
    );
    lines.push(match solution.converged {
        true => Verdict::good(ended),
        false => Verdict::attention(format!("{ended} Its sigmas mean nothing.")),
    });
    let measuring = |s: &&SensorDiagnostics| matches!(s.unit, "m" | "rad");
    for sensor in sensors_shown(solution).filter(measuring) {
        let name = sensor_name(&sensor.name);
        if is_notable(sensor) {
            lines.push(Verdict::attention(format!(
                "The residuals of {name} are {}: its sigma in the project is too small, or an \
                 error is not modelled (latency, lever arm, mounting offset).",
                sigma_words(sensor)
            )));
        }
        let all = sensor.count + sensor.rejected;
        if sensor.rejected > 0 {
            lines.push(Verdict::neutral(format!(
                "{} of {} records of {name} do not fit the others and take no part.",
                number::count(sensor.rejected),
                number::count(all)
            )));
        }
    }
    for jump in &solution.clock_jumps {
        lines.push(Verdict::attention(format!(
            "The clock of {} jumps by {} ms at {:.1} s: corrected.",
            sensor_name(&jump.sensor),
            number::fixed(1e3 * jump.size_s, 0),
            jump.time_s
        )));
    }
    if !solution.imu_gaps_s.is_empty() {
        lines.push(Verdict::attention(format!(
            "The IMU is silent {}.",
            spans_words(&solution.imu_gaps_s)
        )));
    }
    if let Some(sigmas) = sigmas
        && !sigmas.outages.is_empty()
    {
        let spans: Vec<(f64, f64)> = sigmas.outages.iter().map(|o| (o.from_s, o.to_s)).collect();
        let worst_m = sigmas.outages.iter().map(|o| o.max_position_m);
        lines.push(Verdict::attention(format!(
            "The position is known worse than {OUTAGE_FACTOR:.0} times the usual {} mm {}: to {} \
             mm at worst.",
            number::millimetres(sigmas.position_m.median),
            spans_words(&spans),
            number::millimetres(worst_m.fold(0.0, f64::max))
        )));
    }
    let open: Vec<&str> = solution
        .constants
        .iter()
        .filter(|c| c.sigma.is_none())
        .map(|c| c.name.as_str())
        .collect();
    if !open.is_empty() {
        lines.push(Verdict::attention(format!(
            "Not determined by this drive, and held at the project's value: {}.",
            open.join(", ")
        )));
    }
    lines
}
