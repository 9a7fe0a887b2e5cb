//! Verdicts on contradictions in the logs of a drive.

use super::{recording, trajectory};
use crate::geometry::BodyAxes;
use crate::preflight::{
    Contradiction, HeldAxis, ImuSensor, LateLog, LogFindings, PositionNoise, RoundedPositions,
    TimeScales, VerticalAxis,
};
use crate::verdict::{Severity, Verdict};

/// The verdicts on raw logs; if they contradict nothing, the one that says so.
pub fn raw(findings: &LogFindings) -> Vec<Verdict> {
    let mut verdicts = before_constants(findings);
    if findings.contradictions.is_empty() {
        let consistent = Verdict::good(
            "logs.consistent",
            "Units, axes, signs and clocks of the logs do not contradict each other or the project.",
        );
        verdicts.insert(0, consistent);
    }
    verdicts
}

/// The verdicts on the logs of a drive, without those on constants of the project.
pub(super) fn before_constants(findings: &LogFindings) -> Vec<Verdict> {
    let contradictions = findings.contradictions.iter().map(contradiction);
    let steps = findings.steps.iter().map(trajectory::position_step);
    let clocks = findings.clocks.iter().flat_map(recording::verdicts);
    contradictions.chain(steps).chain(clocks).collect()
}

/// The verdicts on the logs of a drive other than the main one.
pub(super) fn on_other(drive: &str, findings: &LogFindings) -> Vec<Verdict> {
    let doubts = findings.doubts.iter().map(trajectory::doubt);
    let all = before_constants(findings).into_iter().chain(doubts);
    all.map(|verdict| verdict.on(drive)).collect()
}

/// The axes of a sensor, and the coordinates of positions.
pub(super) const AXES: [&str; 3] = ["x", "y", "z"];
const COORDINATES: [&str; 3] = ["east", "north", "up"];

/// The verdict on a contradiction in raw logs.
pub fn contradiction(found: &Contradiction) -> Verdict {
    let severity = if found.spoils_poses() {
        Severity::Fault
    } else {
        Severity::Care
    };
    let of = |code: &str, text: String| Verdict::new(severity, code, text);
    match found {
        Contradiction::Held(axis) => of("imu.held", held(axis)).with_value(axis.value, None),
        Contradiction::Rounded(positions) => of(
            &format!("{}.rounded", positions.position),
            rounded(positions),
        )
        .with_value(positions.step_m, None),
        Contradiction::Late(log) => {
            of(&format!("{}.time_offset", log.name), late(log)).with_value(-log.late_s, None)
        }
        Contradiction::Axes(axis) => of("frame.body", vertical(axis)).with_value(axis.cosine, None),
        Contradiction::OppositeHeadings { are_from_east } => {
            of("heading.sign", opposite_headings(*are_from_east))
        }
        Contradiction::LeftHanded { position } => of(
            &format!("{position}.axes"),
            format!(
                "The course of `{position}` turns to the left where the gyro turns to the right: its coordinates are \
                 left-handed. Are east and north exchanged, or one of them negated?"
            ),
        ),
        Contradiction::DrivenDirection { position, off_rad } => {
            let text = format!(
                "According to its headings, the body drives {:.0}° off the direction in which it points (course of \
                 `{position}`): are the antennas exchanged or across, or does it drive backwards?",
                off_rad.to_degrees()
            );
            of("heading.direction", text.replace('-', "−")).with_value(*off_rad, None)
        }
        Contradiction::Noise(found) => of(&format!("{}.noise", found.position), noise(found))
            .with_value(found.factors.max(), None),
    }
}

fn held(axis: &HeldAxis) -> String {
    let (name, unit) = match axis.sensor {
        ImuSensor::Gyro => ("gyro", "rad/s"),
        ImuSensor::Accel => ("accel", "m/s²"),
    };
    format!(
        "{}: {name}_{} stays at {} {unit} for {} of the {} samples during motion, while {name}_{} scatters by {:.1e} \
         {unit}: it was not measured. Record all three axes.",
        axis.file,
        AXES[axis.axis],
        axis.value,
        axis.held,
        axis.samples,
        AXES[axis.noisy_axis],
        axis.noise
    )
}

fn rounded(positions: &RoundedPositions) -> String {
    let likely = positions
        .single_from_m
        .map(|from_m| format!(", as in single precision (32 bits) from {from_m:.0} m on"));
    format!(
        "{}: {} of `{}` is written in steps of {:.4} m{}, but the stated standard deviation is {:.4} m: what lies \
         between the steps is lost. Write the log anew with all digits.",
        positions.file,
        COORDINATES[positions.axis],
        positions.position,
        positions.step_m,
        likely.unwrap_or_default(),
        positions.sigma_m
    )
}

/// The names of two time scales.
pub(super) fn time_scales(scales: TimeScales) -> &'static str {
    match scales {
        TimeScales::GpsUtc => "GPS and UTC",
        TimeScales::TaiGps => "TAI and GPS",
        TimeScales::TaiUtc => "TAI and UTC",
    }
}

fn late(log: &LateLog) -> String {
    let why = log.scales.map(|scales| {
        let (names, seconds) = (time_scales(scales), scales.difference_s());
        format!(" ({names} differ by {seconds} s)")
    });
    let (name, late_s) = (&log.name, log.late_s);
    format!(
        "Judging by its turns, `{name}` is {:.1} s {} than the other logs{}: a run corrects it. Add {:+.1} to [{name}] \
         time_offset_s.",
        late_s.abs(),
        if late_s > 0.0 { "later" } else { "earlier" },
        why.unwrap_or_default(),
        -late_s
    )
}

fn vertical(axis: &VerticalAxis) -> String {
    let (given, other, points) = match axis.given {
        BodyAxes::Frd => ("FRD", "FLU", "up"),
        BodyAxes::Flu => ("FLU", "FRD", "down"),
    };
    if axis.is_opposite() {
        format!(
            "According to gravity, the z axis of the IMU points {points}, but frame.body is \"{given}\": write body = \
             \"{other}\"."
        )
    } else {
        format!(
            "According to gravity, the {} axis of the IMU is vertical, but with frame.body = \"{given}\" it is z: are \
             the columns of the IMU exchanged, or is it mounted on its side? Rotate its log into body axes.",
            AXES[axis.axis]
        )
    }
}

fn opposite_headings(are_from_east: bool) -> String {
    let likely = if are_from_east {
        "they count counter-clockwise from east: write 90 − heading"
    } else {
        "they count counter-clockwise: negate them"
    };
    format!(
        "The headings turn to the left where the gyro turns to the right: {likely}. A run leaves them out."
    )
}

fn noise(found: &PositionNoise) -> String {
    let [east, north, up] = found.sigma_m.into();
    format!(
        "Neighbouring fixes of `{}` scatter up to {:.0} times as much as its standard deviations say: a run raises \
         them. Write sigma_m = [{east:.4}, {north:.4}, {up:.4}].",
        found.position,
        found.factors.max()
    )
}

#[cfg(test)]
mod tests;
