//! Figures along the drive: trajectory, pose sigmas, residuals.

use super::axis::{Axis, decimate};
use super::chart::Plot;
use super::html::{self, escape};
use super::raster::{self, Bounds};
use super::track::Track;
use crate::calibration::Block;
use crate::calibration::Calibration;
use crate::diagnostics::{OUTAGE_FACTOR, PoseSigmas, degrees, quantity};
use crate::format::utc;
use crate::geometry::Vec3;
use crate::geometry::heading::heading_rad;
use crate::judgement;
use crate::number;
use crate::statistics::median;

/// Width of a full-width figure.
pub const FULL: f64 = 900.0;
/// Width of one of two figures side by side.
pub const HALF: f64 = 440.0;
/// Maximum number of vertices of a line.
pub const VERTICES: usize = 700;

/// Class of the i-th line of a figure.
pub fn series(i: usize) -> String {
    format!("s{}", i % 6)
}

/// Offset subtracted from large coordinates to keep tick labels short, metres.
pub fn shift(min: f64) -> f64 {
    if min.abs() < 10_000.0 {
        0.0
    } else {
        (min / 100.0).floor() * 100.0
    }
}

/// Label of a coordinate axis with its offset.
pub fn coordinate_label(name: &str, shift: f64) -> String {
    if shift == 0.0 {
        format!("{name} (m)")
    } else {
        let sign = if shift < 0.0 { '+' } else { '−' };
        format!("{name} {sign} {} m (m)", number::fixed(shift.abs(), 0))
    }
}

/// Offset subtracted from times to keep tick labels short, seconds: a full minute of Unix times.
pub fn time_shift(start_s: f64) -> f64 {
    if !start_s.is_finite() {
        0.0
    } else if utc(start_s).is_some() {
        (start_s / 60.0).floor() * 60.0
    } else {
        shift(start_s)
    }
}

/// Label of a time axis with its offset from the times of the logs.
pub fn time_label(shift: f64) -> String {
    if shift == 0.0 {
        return "time (s)".into();
    }
    if let Some(date) = utc(shift) {
        return format!("time after {date} UTC (s)");
    }
    let sign = if shift < 0.0 { '+' } else { '−' };
    format!("time {sign} {} s (s)", number::fixed(shift.abs(), 0))
}

/// Figure 5: the drives from above.
pub fn top_view(tracks: &[Track], background_m: &[Vec3]) -> String {
    let position = |d: &Track| -> Vec<[f64; 2]> {
        let poses = d.poses.iter();
        poses
            .map(|p| p.world_from_body.translation_m)
            .map(|t| [t.x, t.y])
            .collect()
    };
    let lines: Vec<Vec<[f64; 2]>> = tracks.iter().map(position).collect();
    let ground = background_m.iter().map(|p| [p.x, p.y]);
    let all = lines.iter().flatten().copied().chain(ground);
    let Some(bounds) = Bounds::around(all) else {
        return String::new();
    };
    let [x0, y0] = [shift(bounds.min[0]), shift(bounds.min[1])];
    let local = |p: &[f64; 2]| [p[0] - x0, p[1] - y0];
    let mut plot = Plot::map(
        FULL,
        640.0,
        Axis::over(
            &coordinate_label("east", x0),
            [bounds.min[0] - x0, bounds.max[0] - x0],
        ),
        Axis::over(
            &coordinate_label("north", y0),
            [bounds.min[1] - y0, bounds.max[1] - y0],
        ),
    );
    let heights = height_range(background_m);
    if let Some(heights) = heights {
        let image = raster::heights(background_m, heights, bounds, 600);
        plot.image(
            &image.uri,
            local(&image.extent.min),
            local(&image.extent.max),
        );
    }
    for (i, (track, line)) in tracks.iter().zip(&lines).enumerate() {
        let line: Vec<[f64; 2]> = simplify(line, bounds).iter().map(local).collect();
        plot.line(&series(i), &line);
        arrows(&mut plot, track, &series(i), [x0, y0], bounds);
    }
    let names = tracks.iter().enumerate();
    let entries: Vec<(String, String)> = names
        .map(|(i, track)| (series(i), track.name.to_owned()))
        .collect();
    let mut legend = html::legend(&entries);
    if let Some([low, high]) = heights {
        legend.push_str(&height_scale(low, high));
    }
    let svg = plot.finish("Trajectories from above");
    html::figure(
        &(legend + &svg),
        "Trajectories from above; arrows show the body's forward axis. Figure 5 of the paper.",
    )
}

/// The range of heights that holds nearly all ground points; `None` without any.
fn height_range(ground_m: &[Vec3]) -> Option<[f64; 2]> {
    let mut up: Vec<f64> = ground_m.iter().map(|p| p.z).collect();
    up.retain(|up| up.is_finite());
    up.sort_by(f64::total_cmp);
    let tail = up.len() / 100;
    Some([*up.get(tail)?, *up.get(up.len() - 1 - tail)?])
}

fn height_scale(low_m: f64, high_m: f64) -> String {
    let text = |height_m| number::with_unit(number::fixed(height_m, 2), "m");
    html::ramp(
        &format!("reference, height {}", text(low_m)),
        &[0.0, 1.0].map(raster::shade_css),
        &text(high_m),
    )
}

/// Drops points that are closer to the last remaining point than a thousandth of the figure.
fn simplify(track: &[[f64; 2]], bounds: Bounds) -> Vec<[f64; 2]> {
    let size = (bounds.max[0] - bounds.min[0]).max(bounds.max[1] - bounds.min[1]);
    let mut out: Vec<[f64; 2]> = Vec::new();
    for (i, p) in track.iter().enumerate() {
        let is_near = out
            .last()
            .is_some_and(|last| (p[0] - last[0]).hypot(p[1] - last[1]) < 1e-3 * size);
        if !is_near || i + 1 == track.len() {
            out.push(*p);
        }
    }
    out
}

/// Draws arrows along a drive, evenly spaced.
fn arrows(plot: &mut Plot, drive: &Track, class: &str, origin: [f64; 2], bounds: Bounds) {
    let size = (bounds.max[0] - bounds.min[0]).max(bounds.max[1] - bounds.min[1]);
    let spacing = size / 22.0;
    let mut travelled = f64::INFINITY;
    let mut last: Option<[f64; 2]> = None;
    for pose in &drive.poses {
        let t = pose.world_from_body.translation_m;
        let p = [t.x - origin[0], t.y - origin[1]];
        if let Some(q) = last {
            travelled += (p[0] - q[0]).hypot(p[1] - q[1]);
        }
        if !(p[0].is_finite() && p[1].is_finite()) {
            continue;
        }
        last = Some(p);
        if travelled >= spacing {
            travelled = 0.0;
            let heading = heading_rad(&pose.world_from_body.rotation);
            plot.arrow(&format!("arrow {class}"), p, heading, 15.0);
        }
    }
}

/// Standard deviations of the poses over time, two charts per drive.
pub fn pose_sigmas(tracks: &[Track]) -> String {
    let mut shown = String::new();
    let mut folded = String::new();
    for drive in tracks {
        let Some(start) = drive.poses.first().map(|p| time_shift(p.time_s)) else {
            continue;
        };
        let outages = drive.sigmas.iter().flat_map(|s| &s.outages);
        let outages: Vec<(f64, f64)> = outages.map(|o| (o.from_s, o.to_s)).collect();
        if !drive.poses.iter().any(|p| p.sigma.is_some()) {
            continue;
        }
        let curve = |pick: &dyn Fn(&crate::sensor::PoseSigma) -> f64| -> Vec<[f64; 2]> {
            let points = drive.poses.iter().map(|p| {
                let value = p.sigma.as_ref().map_or(f64::NAN, pick);
                [p.time_s - start, value]
            });
            decimate(&points.collect::<Vec<_>>(), VERTICES)
        };
        let position: [Vec<[f64; 2]>; 3] =
            std::array::from_fn(|axis| curve(&move |s| s.position_m[axis] * 1e3));
        let rotation: [Vec<[f64; 2]>; 3] =
            std::array::from_fn(|axis| curve(&move |s| s.rotation_rad[axis].to_degrees()));
        let chart = |curves: &[Vec<[f64; 2]>; 3], label: &str, names: [&str; 3]| {
            let values = || curves.iter().flatten().map(|p| p[1]);
            let y = if spans_decades(values()) {
                Axis::logarithmic(label, values())
            } else {
                Axis::rounded(label, values().chain([0.0]))
            };
            let x = Axis::over(
                &time_label(start),
                drive.poses.iter().map(|p| p.time_s - start),
            );
            let mut plot = Plot::new(HALF, 240.0, x, y);
            let mut entries = Vec::new();
            for (from, to) in &outages {
                plot.shade("gap", from - start, to - start);
            }
            for (i, curve) in curves.iter().enumerate() {
                let dashed = if i == 1 { " dashed" } else { "" };
                plot.line(&format!("{} fine{dashed}", series(i)), curve);
                entries.push((series(i), names[i].to_owned()));
            }
            if !outages.is_empty() {
                entries.push(("gap".into(), "outage".into()));
            }
            html::legend(&entries) + &plot.finish(label)
        };
        let left = chart(&position, "σ of position (mm)", ["east", "north", "up"]);
        let right = chart(
            &rotation,
            "σ of rotation (°)",
            ["about east", "about north", "heading"],
        );
        let out = if shown.is_empty() {
            &mut shown
        } else {
            &mut folded
        };
        out.push_str(&html::figure(
            &format!("<div class=\"pair\"><div>{left}</div><div>{right}</div></div>\n"),
            &format!(
                "Standard deviations of the poses of {}{}.{}",
                escape(drive.name),
                drive
                    .sigmas
                    .as_ref()
                    .map_or_else(String::new, sigma_summary),
                if outages.is_empty() {
                    String::new()
                } else {
                    format!(
                        " Outage: the position sigma exceeds {OUTAGE_FACTOR:.0} times its median."
                    )
                }
            ),
        ));
    }
    shown + &html::details("Standard deviations of the other drives", &folded)
}

/// Whether positive values span so wide a range that a linear axis would hide the smaller ones.
fn spans_decades(values: impl Iterator<Item = f64>) -> bool {
    /// Smallest share of a linear axis at which the median is still legible.
    const SHARE: f64 = 0.05;
    let values: Vec<f64> = values.filter(|v| v.is_finite() && *v > 0.0).collect();
    let most = values.iter().copied().fold(0.0, f64::max);
    median(values).is_some_and(|median| median < SHARE * most)
}

/// Medians and largest values.
fn sigma_summary(sigmas: &PoseSigmas) -> String {
    format!(
        " (median and largest): 3D position {} and {}, tilt {} and {}, heading {} and {}",
        quantity(sigmas.position_m.median, "m"),
        quantity(sigmas.position_m.max, "m"),
        degrees(sigmas.tilt_deg.median, 2),
        degrees(sigmas.tilt_deg.max, 2),
        degrees(sigmas.heading_deg.median, 2),
        degrees(sigmas.heading_deg.max, 2)
    )
}

/// Median residuals along the drive with the band expected from the poses; empty without any.
pub fn residuals(calibration: &Calibration) -> String {
    let Some(constancy) = &calibration.constancy else {
        return String::new();
    };
    let mut out = html::verdicts(judgement::constancy(calibration).as_slice());
    let blocks = || constancy.blocks.iter().flatten();
    if blocks().next().is_none() {
        return out;
    }
    let ends = blocks().flat_map(|b| {
        let bound = 2e3 * b.expected_sigma_m;
        let median = 1e3 * b.median_m;
        [-bound, bound, median, -median, -0.5, 0.5]
    });
    let y = Axis::rounded("median residual (mm)", ends);
    let start = blocks().map(|b| b.time_s).fold(f64::INFINITY, f64::min);
    let start = time_shift(start);
    let x = Axis::over(&time_label(start), blocks().map(|b| b.time_s - start));
    let entries = [
        ("band".to_owned(), "expected, ± 2 σ".to_owned()),
        ("s0".to_owned(), "median of the block".to_owned()),
        ("s1".to_owned(), "outside".to_owned()),
    ];
    let mut charts = String::new();
    for (mounting, list) in calibration.mountings.iter().zip(&constancy.blocks) {
        let mut plot = Plot::new(FULL, 210.0, x.clone(), y.clone());
        let band: Vec<[f64; 3]> = list
            .iter()
            .map(|b| {
                let bound = 2e3 * b.expected_sigma_m;
                [b.time_s - start, -bound, bound]
            })
            .collect();
        plot.band("band", &band);
        plot.line("zero", &[[x.min, 0.0], [x.max, 0.0]]);
        let (outside, inside): (Vec<_>, Vec<_>) = list
            .iter()
            .partition(|b| b.median_m.abs() > 2.0 * b.expected_sigma_m);
        let points = |list: &[&Block]| -> Vec<[f64; 2]> {
            let shown = list.iter().map(|b| [b.time_s - start, 1e3 * b.median_m]);
            shown.collect()
        };
        let curve = with_gaps(&points(&list.iter().collect::<Vec<_>>()));
        plot.line("s0 fine", &decimate(&curve, VERTICES));
        if list.len() <= VERTICES {
            plot.dots("dot s0", 2.6, &points(&inside));
            plot.dots("dot s1", 3.0, &points(&outside));
        }
        charts.push_str(&format!(
            "<h4>{}: {} of {} blocks outside</h4>\n{}",
            escape(&mounting.name),
            outside.len(),
            list.len(),
            plot.finish(&mounting.name)
        ));
    }
    out.push_str(&html::figure(
        &(html::legend(&entries) + &charts),
        "Median residual in blocks of time. If the mounting is constant, about 95 % of the dots lie in the band; a pattern along the drive means that the mounting moves or that the errors of the poses are larger than their standard deviations suggest.",
    ));
    out
}

/// Inserts a gap between points that are more than twice the shortest step apart.
fn with_gaps(curve: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let steps = curve.windows(2).map(|w| w[1][0] - w[0][0]);
    let shortest = steps.filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min);
    let mut out = Vec::with_capacity(curve.len());
    for (i, p) in curve.iter().enumerate() {
        if i > 0 && p[0] - curve[i - 1][0] > 2.1 * shortest {
            out.push([0.5 * (p[0] + curve[i - 1][0]), f64::NAN]);
        }
        out.push(*p);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_the_unix_epoch_are_dates() {
        let start = time_shift(1_795_440_571.5);
        assert_eq!(start, 1_795_440_540.0);
        assert_eq!(time_label(start), "time after 2026-11-23 13:29:00 UTC (s)");
        assert_eq!(time_label(time_shift(51.0)), "time (s)");
        assert_eq!(
            time_label(time_shift(313_912.0)),
            "time − 313\u{202f}900 s (s)"
        );
    }
}
