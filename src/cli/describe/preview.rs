//! What a run will find, as text.

use std::path::PathBuf;

use super::lines::Lines;
use crate::pipeline::preview::Preview;

/// Describes the counts and overlaps of the inputs of a run.
pub(in crate::cli) fn preview(preview: &Preview) -> String {
    let mut lines = Lines {
        text: String::new(),
        folder: PathBuf::new(),
    };
    lines.section("what a run finds");
    if let Some(trajectory) = &preview.trajectory {
        let [first_s, last_s] = trajectory.span_s;
        let poses = trajectory.poses;
        lines.value(
            "trajectory",
            format!("{poses} poses, {first_s:.1} s to {last_s:.1} s"),
        );
    }
    for scanner in &preview.scanners {
        let percent = 100.0 * scanner.outside as f64 / scanner.points.max(1) as f64;
        let span = scanner.span_s.map_or(String::new(), |[first_s, last_s]| {
            format!(", {first_s:.1} s to {last_s:.1} s")
        });
        lines.value(
            &format!("scanner {}", scanner.name),
            format!(
                "{} points{span}, {percent:.1} % outside the trajectory",
                scanner.points
            ),
        );
    }
    if preview.reference_points > 0 {
        lines.value("reference", format!("{} points", preview.reference_points));
    }
    for warning in &preview.warnings {
        lines.value("warning", warning);
    }
    for what in &preview.not_seen {
        lines.value("not looked at", what);
    }
    lines.text
}
