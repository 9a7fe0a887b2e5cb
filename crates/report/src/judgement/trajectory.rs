//! Verdicts on the adjusted trajectory: convergence, residuals, noise, clocks, outages, constants; and on the constants
//! of the project that the drive contradicts.

use crate::diagnostics::{
    NOTABLE_FACTOR, OUTAGE_FACTOR, PoseSigmas, chi_square_text, is_notable, sensor_name,
    sensors_shown,
};
use crate::number;
use crate::trajectory::{
    Constant, Doubt, PositionStep, RejectionReason, SensorDiagnostics, Solution,
};
use crate::verdict::{Severity, Verdict, capitalised};

/// The constant that scales the noise of the IMU, and the value beyond which it needs attention.
const NOISE_SCALE: &str = "imu.noise_scale";
/// Vibration doubles the noise of a datasheet, and samples that alias it triple it; more is another error.
const CARE_NOISE: f64 = 3.0;
/// Outages need attention if the standard deviation of the position exceeds this, metres: ten times what plants are
/// measured to.
const CARE_OUTAGE_M: f64 = 0.01;
/// A sensor needs attention if at least this share of its records is not used: outliers are a few per cent, and a total
/// station that looks for its prism loses some more.
const CARE_IGNORED: f64 = 0.2;
/// A constant whose error exceeds this is a fault, as no tape, level or datasheet is wrong by so much: metres, seconds,
/// radians, m/s², share.
const FAULT_LEVER_ARM_M: f64 = 0.05;
const FAULT_LATENCY_S: f64 = 0.03;
const FAULT_OFFSET_RAD: f64 = 0.02;
const FAULT_GRAVITY_M_S2: f64 = 0.1;
const FAULT_GYRO_SCALE: f64 = 0.02;

/// The verdict on a constant of the project that the drive contradicts.
pub fn doubt(doubt: &Doubt) -> Verdict {
    let fault = match doubt.constant {
        Constant::LeverArm(_) => FAULT_LEVER_ARM_M,
        Constant::TimeOffset(_) | Constant::TimeDrift(_) | Constant::HeadingTimeOffset => {
            FAULT_LATENCY_S
        }
        Constant::HeadingOffset => FAULT_OFFSET_RAD,
        Constant::GyroScale => FAULT_GYRO_SCALE,
        _ => FAULT_GRAVITY_M_S2,
    };
    let severity = if doubt.off() > fault && !doubt.is_used {
        Severity::Fault
    } else {
        Severity::Care
    };
    let verdict = Verdict::new(severity, &doubt.name, capitalised(&doubt.describe()));
    match doubt.values.as_slice() {
        [only] => verdict.with_value(only.value, only.sigma),
        _ => verdict,
    }
}

/// The verdict on positions that step and stay.
pub fn position_step(step: &PositionStep) -> Verdict {
    let [east, north, up] = [0, 1, 2].map(|axis| {
        let (mm, sigma_mm) = (1e3 * step.step_m[axis], 1e3 * step.sigma_m[axis]);
        format!("{mm:+.0} ± {sigma_mm:.0}")
    });
    let text = format!(
        "The positions of `{}` step by {} at {:.3} s (record {}): {east} mm east, {north} north, {up} up. Was a base or a fix \
         changed, or the tripod bumped? Estimated and corrected, with the positions before it as the right ones.",
        step.sensor,
        number::length(step.step_m.norm()),
        step.time_s,
        step.record,
    );
    let code = format!("{}.step", step.sensor);
    Verdict::care(&code, text).with_value(step.step_m.norm(), None)
}

/// A span as text, with times as in the logs.
fn span_text(from_s: f64, to_s: f64) -> String {
    format!("from {from_s:.1} s to {to_s:.1} s")
}

/// Maximum number of spans listed in one sentence.
const MAX_SPANS_LISTED: usize = 4;

/// Spans as text, the first few one by one.
fn spans_text(spans: &[(f64, f64)]) -> String {
    let named: Vec<String> = spans
        .iter()
        .take(MAX_SPANS_LISTED)
        .map(|(from_s, to_s)| span_text(*from_s, *to_s))
        .collect();
    match spans.len().saturating_sub(MAX_SPANS_LISTED) {
        0 => named.join(" and "),
        more => format!("{} and {more} more spans", named.join(", ")),
    }
}

/// The verdicts on the adjustment.
pub fn verdicts(solution: &Solution, sigmas: Option<&PoseSigmas>) -> Vec<Verdict> {
    let mut lines = Vec::new();
    let ended = format!(
        "The adjustment of the trajectory {} after {} iterations over {} nodes.",
        solution.stop,
        solution.iterations,
        number::count(solution.nodes)
    );
    lines.push(if solution.converged {
        Verdict::good("trajectory.convergence", ended)
    } else {
        Verdict::fault(
            "trajectory.convergence",
            format!("{ended} Its standard deviations are invalid."),
        )
    });
    let measuring = |s: &&SensorDiagnostics| matches!(s.unit.as_str(), "m" | "rad");
    for sensor in sensors_shown(solution).filter(measuring) {
        let name = sensor_name(&sensor.name);
        if is_notable(sensor) {
            let text = format!(
                "The residuals of {name} are {}: its standard deviation in the project is too small, or an \
                 error is not modelled (latency, lever arm, mounting offset).",
                chi_square_text(sensor)
            );
            let verdict = Verdict::care(format!("{}.noise", sensor.name), text);
            lines.push(verdict.with_value(sensor.rms_normalised, None));
        }
        let all = sensor.count + sensor.rejected;
        let repeated = solution.rejections.iter().filter(|rejection| {
            rejection.sensor == sensor.name && rejection.reason == RejectionReason::Repeated
        });
        let repeated = repeated.count();
        if repeated > 0 {
            let text = format!(
                "{} of {} records of {name} repeat the position before them to the last digit, or are zero, as loggers \
                 write while lock is lost: they are not used.",
                number::count(repeated),
                number::count(all + sensor.ignored)
            );
            lines.push(Verdict::note(format!("{}.repeated", sensor.name), text));
        }
        let outside = sensor.ignored - repeated;
        let ignored = outside as f64 / (all + sensor.ignored) as f64;
        if ignored > CARE_IGNORED {
            let text = format!(
                "{} of {} records of {name} are not used, as they lie before or after the IMU's log or out of the \
                 order of time: is a log cut off?",
                number::count(outside),
                number::count(all + sensor.ignored)
            );
            let verdict = Verdict::care(format!("{}.ignored", sensor.name), text);
            lines.push(verdict.with_value(ignored, None));
        }
        if sensor.rejected > 0 {
            let text = format!(
                "{} of {} records of {name} contradict the others and were rejected.",
                number::count(sensor.rejected),
                number::count(all)
            );
            lines.push(Verdict::note(format!("{}.rejected", sensor.name), text));
        }
    }
    let noise = solution.constants.iter().find(|c| c.name == NOISE_SCALE);
    if let Some((scale, sigma)) = noise.and_then(|scale| Some((scale, scale.sigma?)))
        && scale.value > NOTABLE_FACTOR
    {
        let text = format!(
            "The IMU is {} times as noisy as assumed, by its noise in [imu] of the project or, without it, by that of an SBG \
             Ellipse-D (vibration?): its noise was scaled.",
            number::significant(scale.value, 2)
        );
        let verdict = if scale.value > CARE_NOISE {
            Verdict::care(NOISE_SCALE, text)
        } else {
            Verdict::note(NOISE_SCALE, text)
        };
        lines.push(verdict.with_value(scale.value, Some(sigma)));
    }
    for jump in &solution.clock_jumps {
        let text = format!(
            "The clock of {} jumps by {} ms at {:.1} s: corrected.",
            sensor_name(&jump.sensor),
            number::fixed(1e3 * jump.size_s, 0),
            jump.time_s
        );
        let verdict = Verdict::care(format!("{}.clock_jump", jump.sensor), text);
        lines.push(verdict.with_value(jump.size_s, None));
    }
    if !solution.imu_gaps_s.is_empty() {
        let text = format!(
            "The IMU has no samples {}.",
            spans_text(&solution.imu_gaps_s)
        );
        lines.push(Verdict::care("imu.gaps", text));
    }
    if let Some(sigmas) = sigmas
        && !sigmas.outages.is_empty()
    {
        let spans: Vec<(f64, f64)> = sigmas.outages.iter().map(|o| (o.from_s, o.to_s)).collect();
        let worst_m = sigmas.outages.iter().map(|o| o.max_position_m);
        let worst_m = worst_m.fold(0.0, f64::max);
        let text = format!(
            "The standard deviation of the position exceeds {OUTAGE_FACTOR:.0} times its median of \
             {} mm {}: up to {} mm.",
            number::millimetres(sigmas.position_m.median),
            spans_text(&spans),
            number::millimetres(worst_m)
        );
        let severity = if worst_m > CARE_OUTAGE_M {
            Severity::Care
        } else {
            Severity::Note
        };
        let verdict = Verdict::new(severity, "trajectory.outage", text);
        lines.push(verdict.with_value(worst_m, None));
    }
    let open: Vec<&str> = solution
        .constants
        .iter()
        .filter(|c| c.sigma.is_none())
        .map(|c| c.name.as_str())
        .collect();
    if !open.is_empty() {
        let text = format!(
            "Not determined by this drive and held at the project's value: {}.",
            open.join(", ")
        );
        lines.push(Verdict::care("trajectory.undetermined", text));
    }
    lines
}
