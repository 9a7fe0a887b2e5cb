//! Tests of the joint adjustment: does a rigid mounting explain the observations?

use super::html::{self, escape};
use crate::calibration::Mounting;
use crate::diagnostics::{constant_text, is_imu};
use crate::geometry::Vec3;
use crate::joint::{DECIDING_BLOCK_S, GroupTest, Joint, MAX_BLOCK_RMS, max_imu_ratio};
use crate::judgement;
use crate::number;
use crate::results::Calibrations;

/// Ratios of groups other than the IMU are marked if they exceed 1 by this factor and by more than chance.
const NOTABLE_RATIO: f64 = 1.2;

/// The kind of observations in a group.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Imu,
    /// Poses from a file, instead of an IMU.
    Poses,
    Position,
    Heading,
    /// A scanner or the reference: their noise is estimated.
    Scan,
    Surface,
    Assumed,
}

impl Kind {
    fn of(group: &GroupTest, joint: &Joint) -> Self {
        let names_scanner = |m: &Mounting| m.name == group.name;
        let names_position = |name: &str| {
            joint.drives.iter().any(|d| {
                let mut sensors = d.residuals.iter();
                sensors.any(|s| s.sensor == name || format!("{}.{}", d.name, s.sensor) == name)
            })
        };
        let sensor = group.name.rsplit('.').next().unwrap_or_default();
        match sensor {
            _ if joint.drives.iter().any(|drive| drive.imu == group.name) => {
                if is_imu(&group.name) {
                    Self::Imu
                } else {
                    Self::Poses
                }
            }
            _ if names_position(&group.name) => Self::Position,
            "reference" => Self::Scan,
            _ if joint.mountings.iter().any(names_scanner) => Self::Scan,
            "heading" => Self::Heading,
            "surface" => Self::Surface,
            _ => Self::Assumed,
        }
    }

    /// The largest ratio that needs no attention; `None` if the ratio is 1 by construction.
    fn limit(self, group: &GroupTest) -> Option<f64> {
        let chance = 3.0 * (2.0 / group.redundancy).sqrt();
        match self {
            Self::Imu | Self::Poses => Some(max_imu_ratio(group.redundancy)),
            Self::Scan => None,
            _ => Some(NOTABLE_RATIO.max(1.0 + chance)),
        }
    }

    /// The meaning of a large ratio.
    fn meaning(self) -> &'static str {
        match self {
            Self::Imu => {
                "the mounting bends or slips, or the IMU is noisier under scans than alone"
            }
            Self::Poses => {
                "the mounting bends or slips, or the poses are less accurate than assumed"
            }
            Self::Position => {
                "lever arm or clock are off, or the reference lies elsewhere than the positions say"
            }
            Self::Heading => {
                "the offset of the antennas drifts, or errors outlast sigma_correlated_deg"
            }
            Self::Scan => "never large: this noise is estimated from the residuals",
            Self::Surface => "the reference has larger errors over decimetres than assumed",
            Self::Assumed => "biases, latencies or the reference are further off than was known",
        }
    }
}

/// The whole section; empty without a joint adjustment.
pub fn section(calibrations: &Calibrations) -> String {
    let Some(joint) = calibrations.joint_found() else {
        return String::new();
    };
    chi_squares(joint)
        + &blocks(joint)
        + &html::verdicts(&judgement::disagreements(calibrations))
        + coordinates(joint)
        + &reference(joint)
        + &constants(joint)
        + &course(calibrations, joint)
}

fn chi_squares(joint: &Joint) -> String {
    let mut body = String::new();
    for group in joint.groups.iter().filter(|group| group.ratio.is_some()) {
        let kind = Kind::of(group, joint);
        let limit = kind.limit(group);
        let is_large = limit
            .zip(group.ratio)
            .is_some_and(|(most, ratio)| ratio > most);
        let class = if is_large { " class=\"out\"" } else { "" };
        let expected = match limit {
            // Most priors are weak on purpose.
            Some(limit) if kind == Kind::Assumed => format!("at most {limit:.2}"),
            Some(limit) => format!("1, at most {limit:.2}"),
            None => "1, estimated".into(),
        };
        body.push_str(&format!(
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td><td{class}>{}</td><td>{expected}</td><td class=\"text\">{}</td></tr>\n",
            escape(group_name(&group.name)),
            number::count(group.rows),
            number::fixed(group.redundancy, 0),
            number::fixed(group.chi_square, 0),
            number::fixed(group.ratio.unwrap_or(f64::NAN), 2),
            kind.meaning()
        ));
    }
    let first = if joint.drives.iter().any(|drive| is_imu(&drive.imu)) {
        " Scans are so precise that a rigid model on a mounting that bends would push its errors into the poses: the IMU, which does not see the ground, then disagrees first."
    } else {
        ""
    };
    let head = "<tr><th scope=\"col\">observations</th><th scope=\"col\">rows</th><th scope=\"col\">redun-<br/>dancy</th><th scope=\"col\">χ²</th><th scope=\"col\">ratio</th><th scope=\"col\">should be</th><th scope=\"col\" class=\"text\">a large ratio means</th></tr>\n";
    format!(
        "<h3>Residuals by kind of observation</h3>\n{}",
        html::table("numbers sensors", head, &body)
    ) + &format!(
        "<p class=\"note\">Ratio: χ², the sum of the squared normalised residuals, over the redundancy, the number of observations that the others check.{first}</p>\n"
    )
}

/// Display name of a group.
fn group_name(name: &str) -> &str {
    match name {
        "imu" => "IMU",
        "surface" => "surface of the reference",
        "assumed" => "prior knowledge",
        other => other,
    }
}

fn blocks(joint: &Joint) -> String {
    let mut body = String::new();
    let several = joint.drives.len() > 1;
    for drive in &joint.drives {
        for (i, sensor) in drive.residuals.iter().enumerate() {
            let of_sensor = drive.positions.iter().filter(|b| b.sensor == sensor.sensor);
            for (j, blocks) in of_sensor.enumerate() {
                let name = match (j, several) {
                    (0, false) => escape(&sensor.sensor),
                    (0, true) => escape(&format!("{}, {}", sensor.sensor, drive.name)),
                    _ => String::new(),
                };
                let cells: String = blocks
                    .rms
                    .iter()
                    .map(|rms| block_cell(*rms, blocks.block_s))
                    .collect();
                body.push_str(&format!(
                    "<tr class=\"{}\"><th scope=\"row\">{name}</th><td>{}</td><td>{}</td>{cells}</tr>\n",
                    if i + j > 0 && j == 0 { "first" } else { "" },
                    number::with_unit(number::shortest(blocks.block_s), "s"),
                    number::count(blocks.blocks),
                ));
            }
        }
    }
    if body.is_empty() {
        return body;
    }
    let head = "<tr><th scope=\"col\">positions</th><th scope=\"col\">means over</th><th scope=\"col\">blocks</th><th scope=\"col\">east</th><th scope=\"col\">north</th><th scope=\"col\">up</th></tr>\n";
    format!(
        "<h3>Residuals of the positions in blocks of time</h3>\n{}<p class=\"note\">Root mean square of the means over blocks, in their standard deviations: white errors leave 1 at every length, and less where few other observations check them. What grows with the length lasts: over {DECIDING_BLOCK_S:.0} s, more than {MAX_BLOCK_RMS:.0} refuses the joint adjustment.</p>\n",
        html::table("numbers", head, &body)
    )
}

fn block_cell(rms: f64, block_s: f64) -> String {
    let is_large = block_s == DECIDING_BLOCK_S && rms > MAX_BLOCK_RMS;
    let class = if is_large { " class=\"out\"" } else { "" };
    format!("<td{class}>{}</td>", number::fixed(rms, 2))
}

/// The coordinate system of the coordinates of regions.
fn coordinates(joint: &Joint) -> &'static str {
    if joint.regions.is_empty() {
        ""
    } else {
        "<p class=\"note\">East and north are those of the clouds and of the reference's file.</p>\n"
    }
}

/// The estimated offset of the whole reference, and its prior.
fn reference(joint: &Joint) -> String {
    let Some(estimate) = &joint.reference else {
        return String::new();
    };
    let prior = &estimate.prior;
    let (assumed, remedy) = if prior.assumed {
        (
            " (assumed)",
            " The project gives none, so these are assumed: give <code>reference.sigma_m</code> and <code>reference.sigma_deg</code>.",
        )
    } else {
        ("", "")
    };
    let list = |values: [f64; 3], sigmas: [f64; 3], digits: usize| {
        let text = |(value, sigma): (f64, f64)| {
            let value = number::signed(number::fixed(value, digits));
            format!("{value} ± {}", number::sigma(sigma))
        };
        values
            .into_iter()
            .zip(sigmas)
            .map(text)
            .collect::<Vec<_>>()
            .join(", ")
    };
    let mm = |v: &Vec3| (1e3 * v).into();
    let deg = |v: &Vec3| v.map(f64::to_degrees).into();
    let estimate = if prior.shift_m.max(prior.tilt_rad) > 0.0 {
        format!(
            " It was found {}\u{202f}mm off to the east, north and up, and turned by {}° about them.",
            list(mm(&estimate.shift_m), mm(&estimate.shift_sigma_m), 2),
            list(deg(&estimate.turn_rad), deg(&estimate.turn_sigma_rad), 4),
        )
    } else {
        String::new()
    };
    format!(
        "<p class=\"note\">The reference as a whole may be shifted by ± {}\u{202f}mm and turned by ± {}°{assumed} against the world of the poses.{estimate} A shift up shows hardly in the data and enters the heights of the scanners one to one: their standard deviations hold it.{remedy}</p>\n",
        number::shortest(1e3 * prior.shift_m),
        number::shortest(prior.tilt_rad.to_degrees()),
    )
}

/// Constants and latencies that are estimated together with mountings and trajectory.
fn constants(joint: &Joint) -> String {
    let mut body = String::new();
    let mut row = |name: &str, value: &str, sigma: Option<&str>, start: &str, unit: &str| {
        let sigma = match sigma {
            Some(sigma) => format!("<span class=\"sigma\">± {sigma}</span>"),
            None => String::new(),
        };
        body.push_str(&format!(
            "<tr><th scope=\"row\">{}</th><td class=\"result\">{value}{sigma}</td><td>{start}</td><td class=\"text\">{}</td></tr>\n",
            escape(name),
            escape(unit)
        ));
    };
    for constant in &joint.constants {
        let text = constant_text(constant);
        row(
            &constant.name,
            &text.value,
            text.sigma.as_deref(),
            &text.start,
            &text.unit,
        );
    }
    for (mounting, late) in joint.mountings.iter().zip(&joint.late_s) {
        if let Some((value, sigma)) = late {
            let name = format!("{}: latency beyond time_offset_s", mounting.name);
            let text = number::signed(number::fixed(1e3 * value, 3));
            row(&name, &text, Some(&number::sigma(1e3 * sigma)), "0", "ms");
        }
    }
    if body.is_empty() {
        return body;
    }
    let head = "<tr><th scope=\"col\">constant</th><th scope=\"col\">estimated</th><th scope=\"col\">project</th><th scope=\"col\" class=\"text\">unit</th></tr>\n";
    format!(
        "<h3>Constants estimated in the joint adjustment</h3>\n{}",
        html::table("numbers constants", head, &body)
    )
}

/// Size and course of the adjustment.
fn course(calibrations: &Calibrations, joint: &Joint) -> String {
    let seconds = calibrations
        .joint
        .as_ref()
        .map_or(f64::NAN, |report| report.seconds);
    format!(
        "<p class=\"note\">The joint adjustment: {} unknowns, {} rows of scans, {} patches of the surface, {} iterations, {}; {}.</p>\n",
        number::count(joint.unknowns),
        number::count(joint.rows),
        number::count(joint.surfels),
        number::count(joint.iterations),
        number::duration(seconds),
        joint.stop
    )
}
