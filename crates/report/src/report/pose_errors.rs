//! A trajectory compared with a reference: table, map, and errors over time.

use super::axis::{Axis, decimate};
use super::chart::Plot;
use super::content::ComparedPoses;
use super::figures::{FULL, VERTICES, coordinate_label, series, shift, time_label, time_shift};
use super::html::{self, escape};
use crate::number;

/// Height of a chart over time.
const HEIGHT: f64 = 240.0;

/// Table, then the map, then the errors over time; empty without poses.
pub fn section(poses: &ComparedPoses) -> String {
    let Some(first_s) = poses.time_s.first() else {
        return String::new();
    };
    let start_s = time_shift(*first_s);
    table(poses)
        + &map(poses)
        + &over_time(
            poses,
            start_s,
            "translation (mm)",
            &poses.translation_m,
            1e3,
        )
        + &over_time(
            poses,
            start_s,
            "rotation (°)",
            &poses.rotation_rad,
            1f64.to_degrees(),
        )
}

fn table(poses: &ComparedPoses) -> String {
    let rows = poses.rows.iter().map(|row| {
        let cells = row.values.iter();
        let cells: String = cells
            .map(|value| format!("<td>{}</td>", number::significant(*value, 3)))
            .collect();
        format!(
            "<tr><th scope=\"row\">{} ({})</th>{cells}</tr>\n",
            escape(&row.name),
            escape(&row.unit)
        )
    });
    let head = html::head(&[
        "",
        "RMSE",
        "mean",
        "median",
        "standard deviation",
        "least",
        "most",
    ]);
    html::table("numbers", &head, &rows.collect::<String>())
}

fn map(poses: &ComparedPoses) -> String {
    let tracks = [&poses.reference_m, &poses.estimate_m];
    let all = || tracks.iter().flat_map(|track| track.iter());
    let least = |k: usize| all().map(|p| p[k]).fold(f64::INFINITY, f64::min);
    let [x0, y0] = [shift(least(0)), shift(least(1))];
    let mut plot = Plot::map(
        FULL,
        520.0,
        Axis::over(&coordinate_label("east", x0), all().map(|p| p[0] - x0)),
        Axis::over(&coordinate_label("north", y0), all().map(|p| p[1] - y0)),
    );
    for (i, track) in tracks.iter().enumerate() {
        let dashed = if i == 1 { " dashed" } else { "" };
        let points: Vec<[f64; 2]> = track.iter().map(|p| [p[0] - x0, p[1] - y0]).collect();
        plot.line(
            &format!("{} fine{dashed}", series(i)),
            &decimate(&points, VERTICES),
        );
    }
    let names = ["reference", "estimate, aligned"];
    let entries = names.iter().enumerate();
    let entries: Vec<(String, String)> = entries
        .map(|(i, name)| (series(i), (*name).to_owned()))
        .collect();
    html::figure(
        &(html::legend(&entries) + &plot.finish("Both trajectories from above")),
        "Both trajectories from above.",
    )
}

fn over_time(
    poses: &ComparedPoses,
    start_s: f64,
    label: &str,
    values: &[f64],
    scale: f64,
) -> String {
    let points = poses.time_s.iter().zip(values);
    let points: Vec<[f64; 2]> = points
        .map(|(time_s, value)| [time_s - start_s, value * scale])
        .collect();
    let x = Axis::over(&time_label(start_s), points.iter().map(|p| p[0]));
    let y = Axis::rounded(label, points.iter().map(|p| p[1]).chain([0.0]));
    let mut plot = Plot::new(FULL, HEIGHT, x, y);
    plot.line(&format!("{} fine", series(0)), &decimate(&points, VERTICES));
    html::figure(
        &plot.finish(&format!("Error of the poses over time, {label}")),
        &format!("Absolute error of the poses after the alignment: {label}."),
    )
}
