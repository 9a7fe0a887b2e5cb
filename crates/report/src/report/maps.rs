//! Figures 6 and 7: coloured maps of M3C2 distances and their histograms.

use super::axis::Axis;
use super::chart::Plot;
use super::figures::{coordinate_label, shift};
use super::html::{self, escape};
use super::raster::{self, Bounds, Raster};
use super::tables::mounting_name;
use crate::comparison::{Agreement, Histogram, MountingKind};
use crate::number;
use crate::results::Drive;
use crate::verdict::capitalised;

/// Maximum number of pixels of a map in either direction.
pub(super) const PIXELS: usize = 420;
/// Width of one of three panels side by side.
const THIRD: f64 = 310.0;
/// Bins of a histogram.
const BINS: usize = 50;

/// All maps: those of the first drive with an explanation, then those of the other drives, folded.
pub fn maps(drives: &[Drive]) -> String {
    let mut out = String::new();
    for drive in drives {
        let pairs = drive.agreements.pairs();
        let figures: String = pairs.map(|pair| map(&drive.name, pair)).collect();
        if out.is_empty() && !figures.is_empty() {
            out = figures + NOTE;
        } else {
            out.push_str(&html::details(&format!("Maps of {}", drive.name), &figures));
        }
    }
    out
}

const NOTE: &str = "<p class=\"note\">Signed M3C2 distance of every core point, seen from above; the colour scale is below the histogram. Magnified maps show the distances that remain; of two steps and the joint adjustment both are magnified alike. Figures 6 and 7 of the paper.</p>\n";

/// Draws one pair of clouds with each mounting side by side, each above its histogram. Two steps and the joint
/// adjustment share a scale of their own; without them, initial and final mounting share a scale, and the map of the
/// final mounting is repeated beside them at a larger scale.
fn map(drive: &str, agreements: &[Agreement]) -> String {
    let shown = |agreement: &&Agreement| agreement.mounting != MountingKind::Truth;
    let panels: Vec<&Agreement> = agreements.iter().filter(shown).collect();
    let positions = panels.iter().flat_map(|panel| core(panel)).map(|(p, _)| p);
    let (Some(last), Some(bounds)) = (panels.last(), Bounds::around(positions)) else {
        return String::new();
    };
    let is_joint = panels.iter().any(|p| p.mounting == MountingKind::TwoStep);
    let common_m = |panels: &[&Agreement]| {
        let limits = panels.iter().map(|panel| limit_m(panel));
        limits.fold(0.0, f64::max)
    };
    let whole_m = common_m(&panels);
    let first = panels.partition_point(|p| is_joint && p.mounting < MountingKind::TwoStep);
    let own_m = common_m(&panels[first..]);
    let mut cells = String::new();
    for (i, panel) in panels.iter().enumerate() {
        let name = mounting_name(panel.mounting, is_joint);
        let magnified = is_joint && i >= first && own_m <= 0.5 * whole_m;
        let limit_m = if magnified { own_m } else { whole_m };
        cells.push_str(&cell(name, panel, bounds, limit_m, magnified));
    }
    let last_m = limit_m(last);
    if !is_joint && panels.len() > 1 && last_m <= 0.5 * whole_m {
        let name = mounting_name(last.mounting, is_joint);
        cells.push_str(&cell(name, last, bounds, last_m, true));
    }
    format!(
        "<figure>\n<h3>{}, {}</h3>\n<div class=\"panels\">{cells}</div>\n</figure>\n",
        escape(&last.pair()),
        escape(drive)
    )
}

/// Draws a single comparison with its colour scale; its heading names the clouds.
pub fn alone(agreement: &Agreement) -> String {
    let Some(bounds) = Bounds::around(core(agreement).map(|(p, _)| p)) else {
        return String::new();
    };
    let limit_m = limit_m(agreement);
    let summary = number::with_unit(number::millimetres(agreement.statistics.rmse_m), "mm");
    format!(
        "<h3>{} <small>RMSE {summary}</small></h3>\n<figure>\n{}{}<figcaption>M3C2 distances that are left.</figcaption>\n</figure>\n",
        escape(&capitalised(&agreement.pair())),
        top_view("what is left", agreement, bounds, limit_m),
        scale(limit_m)
    )
}

/// The colour scale of distances up to this limit.
pub(super) fn scale(limit_m: f64) -> String {
    let stops: Vec<String> = (0..=10)
        .map(|i| raster::diverging_css(f64::from(i) / 5.0 - 1.0))
        .collect();
    let limit = number::shortest(1e3 * limit_m);
    html::ramp(&format!("−{limit}"), &stops, &format!("+{limit} mm"))
}

/// The colour scale of levels of detection up to this limit.
pub(super) fn grades(limit_m: f64) -> String {
    let stops: Vec<String> = (0..=8)
        .map(|i| raster::grade_css(f64::from(i) / 8.0))
        .collect();
    let limit = number::with_unit(number::shortest(1e3 * limit_m), "mm");
    html::ramp("0", &stops, &limit)
}

/// East, north and distance of the core points that have a distance, metres.
pub(super) fn core(agreement: &Agreement) -> impl Iterator<Item = ([f64; 2], f64)> + Clone {
    let all = agreement.distances.points();
    all.map(|(point, distance_m)| ([point.x, point.y], distance_m))
}

/// A map above its histogram, with the limit of its colours and whether it is magnified.
fn cell(
    name: &str,
    agreement: &Agreement,
    bounds: Bounds,
    limit_m: f64,
    magnified: bool,
) -> String {
    let statistics = &agreement.statistics;
    let summary = format!(
        "RMSE {}, mean {}",
        number::with_unit(number::millimetres(statistics.rmse_m), "mm"),
        number::with_unit(number::signed(number::millimetres(statistics.mean_m)), "mm")
    );
    let limit = number::with_unit(number::shortest(1e3 * limit_m), "mm");
    let sign = if magnified {
        "magnified to"
    } else {
        "colours to"
    };
    format!(
        "<div><h4>{name} <small>{summary}<br/>{sign} ± {limit}</small></h4>\n{}{}</div>\n",
        top_view(name, agreement, bounds, limit_m),
        histogram(agreement, limit_m)
    )
}

/// A round limit that includes 97 % of the distances, at least 1 mm.
pub(super) fn limit_m(agreement: &Agreement) -> f64 {
    let mut sizes: Vec<f64> = core(agreement)
        .map(|(_, distance_m)| distance_m.abs())
        .collect();
    sizes.sort_by(f64::total_cmp);
    let most = sizes.get((sizes.len() * 97) / 100).copied().unwrap_or(1e-3);
    number::nice_above(most.max(1e-3))
}

pub(super) fn top_view(name: &str, agreement: &Agreement, bounds: Bounds, limit_m: f64) -> String {
    let points: Vec<([f64; 2], f64)> = core(agreement).collect();
    let image = raster::coloured(&points, limit_m, bounds, PIXELS);
    plan(&format!("Map of distances, {name}"), bounds, &[image])
}

/// Images of the ground, the first at the back.
pub(super) fn plan(title: &str, bounds: Bounds, images: &[Raster]) -> String {
    let [x0, y0] = [shift(bounds.min[0]), shift(bounds.min[1])];
    let local = |p: [f64; 2]| [p[0] - x0, p[1] - y0];
    let (low, high) = (local(bounds.min), local(bounds.max));
    let mut plot = Plot::map(
        THIRD,
        330.0,
        Axis::over(&coordinate_label("east", x0), [low[0], high[0]]),
        Axis::over(&coordinate_label("north", y0), [low[1], high[1]]),
    );
    for image in images {
        plot.image(&image.uri, local(image.extent.min), local(image.extent.max));
    }
    plot.finish(title)
}

/// Histogram of the distances within the colour scale, with bars in the colours of the map and the
/// colour scale below the axis.
pub(super) fn histogram(agreement: &Agreement, limit_m: f64) -> String {
    let distances_m = core(agreement).map(|(_, distance_m)| distance_m);
    let bins = Histogram::of(distances_m, (-limit_m, limit_m), BINS);
    let n = agreement.statistics.n;
    let x = Axis::over("distance (mm)", [-1e3 * limit_m, 1e3 * limit_m]);
    let width = (x.max - x.min) / BINS as f64;
    let share = |count: u64| 100.0 * count as f64 / n as f64;
    let most = bins.counts.iter().copied().max().unwrap_or(0);
    let y = Axis::rounded("share (%)", [0.0, share(most)]);
    let start = x.min;
    let mut plot = Plot::new(THIRD, 170.0, x, y);
    for (i, count) in bins.counts.iter().enumerate() {
        let x0 = start + width * i as f64;
        let middle_m = 1e-3 * (x0 + 0.5 * width);
        let fill = raster::diverging_css(middle_m / limit_m);
        plot.bar(&fill, x0, x0 + width, share(*count));
        plot.under(&fill, x0, x0 + width);
    }
    let note = format!(
        "<p class=\"aside\">{} % of {} points beyond the scale</p>\n",
        number::fixed(share(bins.below + bins.above), 1),
        number::count(n)
    );
    plot.finish("Histogram of distances") + &note
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::compared;

    fn agreement(distances_m: &[f64]) -> Agreement {
        let core = distances_m.iter().zip(0..);
        let core = core.map(|(distance_m, i)| [f64::from(i), *distance_m, 1e-3]);
        compared::agreement(&core.collect::<Vec<_>>())
    }

    #[test]
    fn the_limit_is_round_and_ignores_the_tail() {
        let mut distances = vec![0.0015; 99];
        distances.push(0.4);
        distances.push(f64::NAN);
        assert!((limit_m(&agreement(&distances)) - 2e-3).abs() < 1e-12);
        assert_eq!(limit_m(&agreement(&[1e-6])), 1e-3);
    }

    #[test]
    fn equal_distances_still_make_a_bar() {
        let svg = histogram(&agreement(&[0.001; 7]), 0.002);
        assert!(svg.contains("<rect"), "{svg}");
        assert!(!svg.contains("NaN"));
    }
}
