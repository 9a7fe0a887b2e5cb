//! Figures 6 and 7: coloured maps of M3C2 distances and their histograms.

use super::axis::Axis;
use super::chart::Plot;
use super::content::{DistanceMap, MapPanel};
use super::figures::{coordinate_label, shift};
use super::html::{self, escape};
use super::number;
use super::raster::{self, Bounds};
use super::tables::mounting_name;
use crate::statistics::{mean, rms};

/// Most pixels of a map in either direction.
const PIXELS: usize = 420;
/// Width of one of three panels side by side.
const THIRD: f64 = 310.0;
/// Bins of a histogram.
const BINS: usize = 50;

/// All maps: those of the first drive, then those of the others folded, and what they show.
pub fn maps(list: &[DistanceMap]) -> String {
    let mut drives: Vec<&str> = list.iter().map(|map| map.drive.as_str()).collect();
    drives.dedup();
    let mut out = String::new();
    for (i, drive) in drives.iter().enumerate() {
        let of_drive = list.iter().filter(|map| map.drive == *drive);
        let figures: String = of_drive.map(map).collect();
        if i == 0 {
            out.push_str(&figures);
            out.push_str(NOTE);
        } else {
            out.push_str(&html::details(&format!("Maps of {drive}"), &figures));
        }
    }
    out
}

const NOTE: &str = "<p class=\"note\">Signed M3C2 distance of every core point from above; the colours stand under the axis of the histogram. The first maps share one scale, which shows what the calibration changed; the last is magnified to show what is left. Figures 6 and 7 of the paper.</p>\n";

/// One map with its panels side by side, each over its histogram.
fn map(map: &DistanceMap) -> String {
    let positions = map
        .panels
        .iter()
        .flat_map(|panel| &panel.points)
        .filter(|p| p.distance_m.is_finite())
        .map(|p| p.position_m);
    let Some(bounds) = Bounds::around(positions) else {
        return String::new();
    };
    let given = map.colour_limit_m.filter(|l| *l > 0.0 && l.is_finite());
    let common_m = given.unwrap_or_else(|| {
        let limits = map.panels.iter().map(default_limit);
        limits.fold(0.0, f64::max)
    });
    let mut cells = String::new();
    for panel in &map.panels {
        cells.push_str(&cell(panel, bounds, common_m, ""));
    }
    if let (None, [_, .., last]) = (given, map.panels.as_slice()) {
        let own_m = default_limit(last);
        if own_m <= 0.5 * common_m {
            cells.push_str(&cell(last, bounds, own_m, ", magnified"));
        }
    }
    format!(
        "<figure>\n<h3>{}, {}</h3>\n<div class=\"panels\">{cells}</div>\n</figure>\n",
        escape(&map.pair),
        escape(&map.drive)
    )
}

fn cell(panel: &MapPanel, bounds: Bounds, limit_m: f64, addition: &str) -> String {
    let values = sorted_distances(panel);
    if values.is_empty() {
        return String::new();
    }
    let summary = if addition.is_empty() {
        format!(
            "RMSE {}, mean {}",
            number::with_unit(number::millimetres(rms(values.iter().copied())), "mm"),
            number::with_unit(number::signed(number::millimetres(mean(&values))), "mm")
        )
    } else {
        let limit = number::with_unit(number::shortest(1e3 * limit_m), "mm");
        format!("colours to ± {limit}")
    };
    format!(
        "<div><h4>{}{addition} <small>{summary}</small></h4>\n{}{}</div>\n",
        mounting_name(panel.mounting),
        top_view(panel, bounds, limit_m),
        histogram(&values, limit_m)
    )
}

/// The finite distances of a panel in ascending order, metres.
fn sorted_distances(panel: &MapPanel) -> Vec<f64> {
    let all = panel.points.iter().map(|p| p.distance_m);
    let mut values: Vec<f64> = all.filter(|d| d.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// A round limit that holds 97 % of the distances, at least 1 mm.
fn default_limit(panel: &MapPanel) -> f64 {
    let mut sizes = sorted_distances(panel);
    for d in &mut sizes {
        *d = d.abs();
    }
    sizes.sort_by(f64::total_cmp);
    let most = sizes.get((sizes.len() * 97) / 100).copied().unwrap_or(1e-3);
    number::nice_above(most.max(1e-3))
}

fn top_view(panel: &MapPanel, bounds: Bounds, limit_m: f64) -> String {
    let [x0, y0] = [shift(bounds.min[0]), shift(bounds.min[1])];
    let local = |p: [f64; 2]| [p[0] - x0, p[1] - y0];
    let (low, high) = (local(bounds.min), local(bounds.max));
    let mut plot = Plot::map(
        THIRD,
        330.0,
        Axis::over(&coordinate_label("east", x0), [low[0], high[0]]),
        Axis::over(&coordinate_label("north", y0), [low[1], high[1]]),
    );
    let points: Vec<([f64; 2], f64)> = panel
        .points
        .iter()
        .map(|p| (p.position_m, p.distance_m))
        .collect();
    let image = raster::coloured(&points, limit_m, bounds, PIXELS);
    plot.image(&image.uri, local(image.extent.min), local(image.extent.max));
    plot.finish(&format!(
        "Map of distances, {}",
        mounting_name(panel.mounting)
    ))
}

/// Histogram of ascending distances between the ends of the colour scale, bars in the colours of
/// the map, and all of these under the axis.
fn histogram(values_m: &[f64], limit_m: f64) -> String {
    let n = values_m.len();
    let x = Axis::over("distance (mm)", [-1e3 * limit_m, 1e3 * limit_m]);
    let width = (x.max - x.min) / BINS as f64;
    let mut bins = [0usize; BINS];
    let mut beyond = 0usize;
    for d in values_m {
        if d.abs() <= limit_m {
            let place = (1e3 * d - x.min) / width;
            bins[(place as usize).min(BINS - 1)] += 1;
        } else {
            beyond += 1;
        }
    }
    let share = |count: usize| 100.0 * count as f64 / n as f64;
    let most = bins.iter().copied().max().unwrap_or(0);
    let y = Axis::rounded("share (%)", [0.0, share(most)]);
    let start = x.min;
    let mut plot = Plot::new(THIRD, 170.0, x, y);
    for (i, count) in bins.iter().enumerate() {
        let x0 = start + width * i as f64;
        let middle_m = 1e-3 * (x0 + 0.5 * width);
        let fill = raster::diverging_css(middle_m / limit_m);
        plot.bar(&fill, x0, x0 + width, share(*count));
        plot.under(&fill, x0, x0 + width);
    }
    let note = format!(
        "<p class=\"aside\">{} % of {} points beyond the scale</p>\n",
        number::fixed(share(beyond), 1),
        number::count(n)
    );
    plot.finish("Histogram of distances") + &note
}

#[cfg(test)]
mod tests {
    use super::super::content::{MapPoint, MountingKind};
    use super::*;

    fn panel(distances_m: &[f64]) -> MapPanel {
        let points = distances_m.iter().enumerate().map(|(i, d)| MapPoint {
            position_m: [i as f64, 0.0],
            distance_m: *d,
        });
        MapPanel {
            mounting: MountingKind::Final,
            points: points.collect(),
        }
    }

    #[test]
    fn the_limit_is_round_and_ignores_the_tail() {
        let mut distances = vec![0.0015; 99];
        distances.push(0.4);
        distances.push(f64::NAN);
        assert!((default_limit(&panel(&distances)) - 2e-3).abs() < 1e-12);
        assert_eq!(default_limit(&panel(&[])), 1e-3);
    }

    #[test]
    fn equal_distances_still_make_a_bar() {
        let svg = histogram(&[0.001; 7], 0.002);
        assert!(svg.contains("<rect"), "{svg}");
        assert!(!svg.contains("NaN"));
    }
}
