//! Mountings for other programs: URDF, static transforms of ROS 2, and pipelines of PDAL.
//!
//! All of them hold body_from_scanner itself: the origin and the axes of the scanner in the frame of the
//! body, metres. Numbers are written in the shortest form that reads back as the same number,
//! without exponents.

use std::collections::BTreeSet;
use std::fmt::Write;

use serde::Serialize;

use crate::error::{Error, Result};
use crate::geometry::BodyFromScanner;
use crate::geometry::attitude::roll_pitch_yaw;

/// A robot in URDF with a link for the body and a link for each scanner, connected by fixed joints.
/// `rpy` are radians about the fixed axes x, y, z, as URDF defines them: R = Rz(y) Ry(p) Rx(r).
///
/// # Errors
/// Names that are empty, equal or not valid as names of frames; transforms that are not finite.
pub fn urdf(body: &str, scanners: &[(String, BodyFromScanner)]) -> Result<String> {
    check(body, scanners)?;
    let body = xml(body);
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<robot name=\"{body}\">\n  <link name=\"{body}\"/>\n"
    );
    for (name, mounting) in scanners {
        let name = xml(name);
        let [x, y, z] = mounting.translation_m.as_slice() else {
            continue;
        };
        let xyz = [*x, *y, *z].map(decimal).join(" ");
        let rpy = roll_pitch_yaw(&mounting.rotation).map(decimal).join(" ");
        text += &format!(
            "  <link name=\"{name}\"/>\n  <joint name=\"{name}_joint\" type=\"fixed\">\n    \
             <parent link=\"{body}\"/>\n    <child link=\"{name}\"/>\n    \
             <origin xyz=\"{xyz}\" rpy=\"{rpy}\"/>\n  </joint>\n"
        );
    }
    text += "</robot>\n";
    Ok(text)
}

/// A launch file of ROS 2 in Python, for Humble and later: one `static_transform_publisher` for each
/// scanner, with the body as its parent.
///
/// # Errors
/// Those of [`urdf`].
pub fn ros_launch(body: &str, scanners: &[(String, BodyFromScanner)]) -> Result<String> {
    check(body, scanners)?;
    let mut text =
        "from launch import LaunchDescription\nfrom launch_ros.actions import Node\n\n\n\
                    def generate_launch_description():\n    return LaunchDescription([\n"
            .to_owned();
    for (i, (name, mounting)) in scanners.iter().enumerate() {
        // Names of nodes may have letters, digits and underscores only.
        let word = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let node: String = name.chars().map(word).collect();
        text += &format!(
            "        Node(\n            package=\"tf2_ros\",\n            \
             executable=\"static_transform_publisher\",\n            \
             name=\"mounting_{i}_{node}\",\n            arguments=[\n"
        );
        let (t, q) = (&mounting.translation_m, &mounting.rotation);
        for (key, value) in [
            ("x", t.x),
            ("y", t.y),
            ("z", t.z),
            ("qx", q.i),
            ("qy", q.j),
            ("qz", q.k),
            ("qw", q.w),
        ] {
            text += &format!("                \"--{key}\", \"{}\",\n", decimal(value));
        }
        text += &format!(
            "                \"--frame-id\", {},\n                \"--child-frame-id\", {},\n            \
             ],\n        ),\n",
            quoted(body),
            quoted(name)
        );
    }
    text += "    ])\n";
    Ok(text)
}

/// The same transforms in YAML, with the fields of a `tf2_msgs/msg/TFMessage`.
///
/// # Errors
/// Those of [`urdf`].
pub fn ros_transforms(body: &str, scanners: &[(String, BodyFromScanner)]) -> Result<String> {
    check(body, scanners)?;
    if scanners.is_empty() {
        return Ok("transforms: []\n".to_owned());
    }
    let mut text = "transforms:\n".to_owned();
    for (name, mounting) in scanners {
        text += &format!(
            "- header:\n    stamp: {{sec: 0, nanosec: 0}}\n    frame_id: {}\n  child_frame_id: {}\n  \
             transform:\n    translation:\n",
            quoted(body),
            quoted(name)
        );
        let (t, q) = (&mounting.translation_m, &mounting.rotation);
        for (key, value) in [("x", t.x), ("y", t.y), ("z", t.z)] {
            text += &format!("      {key}: {}\n", decimal(value));
        }
        text += "    rotation:\n";
        for (key, value) in [("x", q.i), ("y", q.j), ("z", q.k), ("w", q.w)] {
            text += &format!("      {key}: {}\n", decimal(value));
        }
    }
    Ok(text)
}

/// A stage of a PDAL pipeline, with its fields in the order of the JSON.
#[derive(Serialize)]
struct Stage {
    #[serde(rename = "type")]
    kind: &'static str,
    matrix: String,
}

/// A pipeline of PDAL.
#[derive(Serialize)]
struct Pipeline {
    pipeline: [Stage; 1],
}

/// A pipeline of PDAL that transforms the points of one scanner to the frame of the body:
/// `filters.transformation` with body_from_scanner as a row-major 4 × 4 matrix. It has no reader and
/// no writer, for use in `pdal translate scanner.las body.las --json mounting.json`.
///
/// # Errors
/// A transform that is not finite.
pub fn pdal_pipeline(mounting: &BodyFromScanner) -> Result<String> {
    check_finite("the scanner", mounting)?;
    let (r, t) = (
        mounting.rotation.to_rotation_matrix(),
        mounting.translation_m,
    );
    let mut matrix = String::new();
    for row in 0..3 {
        let cells = [r[(row, 0)], r[(row, 1)], r[(row, 2)], t[row]].map(decimal);
        matrix += &cells.join(" ");
        matrix.push(' ');
    }
    matrix += "0.0 0.0 0.0 1.0";
    let kind = "filters.transformation";
    let stage = Stage { kind, matrix };
    let pipeline = Pipeline { pipeline: [stage] };
    let text = serde_json::to_string_pretty(&pipeline);
    // Strings and a fixed structure cannot fail.
    Ok(text.unwrap_or_default() + "\n")
}

/// Checks that tf2 and all these formats can represent the names, and that the mountings are finite.
fn check(body: &str, scanners: &[(String, BodyFromScanner)]) -> Result<()> {
    let mut names = BTreeSet::new();
    for name in std::iter::once(body).chain(scanners.iter().map(|(name, _)| name.as_str())) {
        let breaks = |c: char| {
            c.is_control() || matches!(c, '\u{2028}' | '\u{2029}' | '\u{fffe}' | '\u{ffff}')
        };
        let reason = if name.is_empty() {
            "a frame without a name"
        } else if name.contains(breaks) {
            "it has control characters"
        } else if name.trim() != name {
            "it begins or ends with a space"
        } else if name.starts_with(['/', '-']) {
            "it begins with / or -"
        } else if !names.insert(name) {
            "two frames have this name"
        } else {
            continue;
        };
        return Err(Error::data(
            format!("the name {name:?} of a frame cannot be used: {reason}"),
            "give the body and its scanners different names, such as base_link and left",
        ));
    }
    let mut mountings = scanners.iter();
    mountings.try_for_each(|(name, mounting)| check_finite(name, mounting))
}

fn check_finite(name: &str, mounting: &BodyFromScanner) -> Result<()> {
    let (t, q) = (&mounting.translation_m, &mounting.rotation.coords);
    if t.iter().chain(q.iter()).all(|v| v.is_finite()) {
        return Ok(());
    }
    Err(Error::data(
        format!("the mounting of {name} is not finite"),
        "write a mounting whose values are known",
    ))
}

/// A number with a decimal point and without an exponent: YAML reads `1` as an integer and `1e-7` as a
/// string.
fn decimal(value: f64) -> String {
    // Minus zero becomes zero.
    let mut text = (value + 0.0).to_string();
    if !text.contains('.') {
        text += ".0";
    }
    text
}

/// A string in double quotes that JSON, YAML and Python all read.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

/// Text escaped as the value of an XML attribute.
fn xml(text: &str) -> String {
    let mut escaped = String::new();
    for c in text.chars() {
        // Writing to a string cannot fail.
        let _ = match c {
            '&' => write!(escaped, "&amp;"),
            '<' => write!(escaped, "&lt;"),
            '>' => write!(escaped, "&gt;"),
            '"' => write!(escaped, "&quot;"),
            other => write!(escaped, "{other}"),
        };
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{EulerConvention, Rotation, Vec3, euler::rotation_from_euler_deg};

    fn mountings() -> Vec<(String, BodyFromScanner)> {
        let turned = rotation_from_euler_deg(EulerConvention::Bonn, [-143.769, -0.369, 89.833]);
        let level = Rotation::from_euler_angles(0.25, 0.0, 0.0);
        vec![
            (
                "left <\"&'ü\\>".to_owned(),
                BodyFromScanner::new(turned, Vec3::new(1.254, -0.545, 1e-9)),
            ),
            (
                "right".to_owned(),
                BodyFromScanner::new(level, Vec3::new(1.0, 0.0, -2.5)),
            ),
        ]
    }

    /// The numbers between two marks.
    fn numbers(text: &str, from: &str, to: &str) -> Vec<f64> {
        let (_, rest) = text.split_once(from).unwrap();
        let (cells, _) = rest.split_once(to).unwrap();
        cells
            .split_whitespace()
            .map(|cell| cell.parse().unwrap())
            .collect()
    }

    #[test]
    fn a_robot_has_the_mountings_at_its_joints() {
        let text = urdf("base_link", &mountings()).unwrap();
        let left = &mountings()[0].1;
        assert_eq!(
            numbers(&text, "xyz=\"", "\""),
            left.translation_m.as_slice()
        );
        let rpy = numbers(&text, "rpy=\"", "\"");
        let back = Rotation::from_euler_angles(rpy[0], rpy[1], rpy[2]);
        assert!(back.angle_to(&left.rotation) < 1e-7);
        assert!((back.coords - left.rotation.coords).norm() < 1e-15);
        assert!(text.contains("<child link=\"left &lt;&quot;&amp;'ü\\&gt;\"/>"));
        assert!(text.contains("rpy=\"0.25 0.0 0.0\""), "{text}");
    }

    #[test]
    fn transforms_of_ros_are_complete() {
        let launch = ros_launch("base_link", &mountings()).unwrap();
        assert!(launch.contains(r#""--frame-id", "base_link","#));
        assert!(
            launch.contains(r#""--child-frame-id", "left <\"&'ü\\>","#),
            "{launch}"
        );
        assert!(
            launch.contains(r#"name="mounting_0_left________","#),
            "{launch}"
        );
        assert!(launch.contains(r#""--z", "0.000000001","#), "{launch}");
        let yaml = ros_transforms("base_link", &mountings()).unwrap();
        let (_, right) = yaml.split_once("child_frame_id: \"right\"\n").unwrap();
        let q = mountings()[1].1.rotation;
        let expected = format!(
            "  transform:\n    translation:\n      x: 1.0\n      y: 0.0\n      z: -2.5\n    \
             rotation:\n      x: {}\n      y: 0.0\n      z: 0.0\n      w: {}\n",
            q.i, q.w
        );
        assert_eq!(right, expected);
        assert_eq!(ros_transforms("base", &[]).unwrap(), "transforms: []\n");
    }

    #[test]
    fn a_pipeline_has_the_matrix_by_rows() {
        let mounting = mountings()[0].1;
        let text = pdal_pipeline(&mounting).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["pipeline"][0]["type"], "filters.transformation");
        let matrix = json["pipeline"][0]["matrix"].as_str().unwrap();
        let cells: Vec<f64> = matrix
            .split(' ')
            .map(|cell| cell.parse().unwrap())
            .collect();
        let expected =
            nalgebra::Isometry3::from_parts(mounting.translation_m.into(), mounting.rotation);
        let expected = expected.to_homogeneous().transpose();
        assert_eq!(cells, expected.as_slice());
    }

    #[test]
    fn names_that_break_a_format_are_refused() {
        let one = |name: &str| vec![(name.to_owned(), BodyFromScanner::identity())];
        for (name, why) in [
            ("", "without a name"),
            ("a\nb", "control characters"),
            ("a\u{2028}b", "control characters"),
            (" a", "a space"),
            ("/left", "/ or -"),
            ("--x", "/ or -"),
            ("body", "two frames"),
        ] {
            for write in [urdf, ros_launch, ros_transforms] {
                let error = write("body", &one(name)).unwrap_err().to_string();
                assert!(error.contains(why), "{name}: {error}");
            }
        }
        let mut broken = one("left");
        broken[0].1.translation_m.x = f64::NAN;
        assert!(urdf("body", &broken).is_err() && pdal_pipeline(&broken[0].1).is_err());
    }
}
