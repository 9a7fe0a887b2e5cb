//! Figures 6 and 7: coloured maps of M3C2 distances and their histograms.

use super::axis::Axis;
use super::chart::Plot;
use super::content::{DistanceMap, MapPanel};
use super::figures::{HALF, coordinate_label, shift};
use super::html::escape;
use super::number;
use super::raster::{self, Bounds};
use super::tables::mounting_name;

/// Most pixels of a map in either direction.
const PIXELS: usize = 420;
/// Bins of a histogram.
const BINS: usize = 50;

/// All maps and what they show.
pub fn maps(list: &[DistanceMap]) -> String {
    let mut out: String = list.iter().map(map).collect();
    if !out.is_empty() {
        out.push_str(
            "<p class=\"note\">Signed M3C2 distance of every core point from above, and its histogram. All panels of a figure share one colour scale; each histogram has its own axis. Figures 6 and 7 of the paper.</p>\n",
        );
    }
    out
}

/// One map with its panels side by side, colour scale and histograms.
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
    let limit_m = map
        .colour_limit_m
        .filter(|l| *l > 0.0 && l.is_finite())
        .unwrap_or_else(|| default_limit(map.panels.last()));
    let mut cells = String::new();
    for panel in &map.panels {
        let values = sorted_distances(panel);
        if values.is_empty() {
            continue;
        }
        cells.push_str(&format!(
            "<div><h4>{} <small>RMSE {}, mean {}</small></h4>\n{}{}</div>\n",
            mounting_name(panel.mounting),
            number::with_unit(number::millimetres(rms(&values)), "mm"),
            number::with_unit(number::signed(number::millimetres(mean(&values))), "mm"),
            top_view(panel, bounds, limit_m),
            histogram(&values, limit_m)
        ));
    }
    let body = format!(
        "{}<div class=\"pair\">{cells}</div>\n",
        colour_scale(limit_m)
    );
    format!(
        "<figure>\n<h3>{}, {}</h3>\n{body}</figure>\n",
        escape(&map.pair),
        escape(&map.drive)
    )
}

/// The finite distances of a panel in ascending order, metres.
fn sorted_distances(panel: &MapPanel) -> Vec<f64> {
    let all = panel.points.iter().map(|p| p.distance_m);
    let mut values: Vec<f64> = all.filter(|d| d.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    values
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// A round limit that holds 97 % of the distances, at least 1 mm.
fn default_limit(panel: Option<&MapPanel>) -> f64 {
    let mut sizes: Vec<f64> = panel.map(sorted_distances).unwrap_or_default();
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
        HALF,
        430.0,
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

/// Histogram of ascending distances over the middle 99 % of them, bars in the colours of the map.
fn histogram(values_m: &[f64], limit_m: f64) -> String {
    let n = values_m.len();
    let tail = n / 200;
    let (low, high) = (values_m[tail], values_m[n - 1 - tail]);
    // Not narrower than 0.1 mm, so that equal distances still make a bar.
    let spare = (0.05e-3 - 0.5 * (high - low)).max(0.0);
    let x = Axis::rounded("distance (mm)", [1e3 * (low - spare), 1e3 * (high + spare)]);
    let width = (x.max - x.min) / BINS as f64;
    let mut bins = [0usize; BINS];
    let mut outside = 0usize;
    for d in values_m {
        let place = (1e3 * d - x.min) / width;
        if place >= 0.0 && place <= BINS as f64 {
            bins[(place as usize).min(BINS - 1)] += 1;
        } else {
            outside += 1;
        }
    }
    let share = |count: usize| 100.0 * count as f64 / n as f64;
    let most = bins.iter().copied().max().unwrap_or(0);
    let y = Axis::rounded("share (%)", [0.0, share(most)]);
    let start = x.min;
    let mut plot = Plot::new(HALF, 190.0, x, y);
    for (i, count) in bins.iter().enumerate() {
        let x0 = start + width * i as f64;
        let middle_m = 1e-3 * (x0 + 0.5 * width);
        let fill = raster::diverging_css(middle_m / limit_m);
        plot.bar(&fill, x0, x0 + width, share(*count));
    }
    let beyond = values_m.iter().filter(|d| d.abs() > limit_m).count();
    let note = format!(
        "<p class=\"aside\">{} % beyond the colour scale; {} of {} core points outside this axis.</p>\n",
        number::fixed(share(beyond), 1),
        number::count(outside),
        number::count(n)
    );
    plot.finish("Histogram of distances") + &note
}

/// The colour scale with its limits.
fn colour_scale(limit_m: f64) -> String {
    let stops: Vec<String> = (0..=12)
        .map(|i| raster::diverging_css(f64::from(i) / 6.0 - 1.0))
        .collect();
    let text = |share: f64| number::signed(number::shortest(share * limit_m * 1e3));
    format!(
        "<div class=\"scale\"><span class=\"ramp\" style=\"background:linear-gradient(to right,{})\"></span>\
         <span class=\"ends\"><span>≤ {}</span><span>{}</span><span>0</span><span>{}</span><span>≥ {}</span></span>\
         <span class=\"unit\">distance (mm)</span></div>\n",
        stops.join(","),
        text(-1.0),
        text(-0.5),
        text(0.5),
        text(1.0)
    )
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
        assert!((default_limit(Some(&panel(&distances))) - 2e-3).abs() < 1e-12);
        assert_eq!(default_limit(Some(&panel(&[]))), 1e-3);
        assert_eq!(default_limit(None), 1e-3);
    }

    #[test]
    fn equal_distances_still_make_a_bar() {
        let svg = histogram(&[0.001; 7], 0.002);
        assert!(svg.contains("<rect"), "{svg}");
        assert!(!svg.contains("NaN"));
    }
}
