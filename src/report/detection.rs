//! How small a distance the clouds can show, and where they show none: maps of the level of detection and of what
//! is covered.

use super::axis::Axis;
use super::chart::Plot;
use super::content::Drive;
use super::figures::{coordinate_label, shift};
use super::html::{self, escape};
use super::number;
use super::raster::{self, Bounds};
use crate::comparison::{Against, Agreement, MountingKind};
use crate::geometry::Vec3;
use crate::statistics::quantile;

/// Maximum number of pixels of a map in either direction.
const PIXELS: usize = 420;
/// Width of one of three panels side by side.
const THIRD: f64 = 310.0;
/// What is not covered.
const BARE: [u8; 4] = [128, 128, 128, 110];

/// A map for each pair of clouds of the first drive with the mountings found; empty without distances.
pub fn maps(drives: &[Drive], background_m: &[Vec3]) -> String {
    let found = drives.iter().take(1).flat_map(|drive| {
        let all = drive.agreements.under(MountingKind::Final);
        all.map(|found| panel(found, background_m))
    });
    let panels: String = found.collect();
    if panels.is_empty() {
        return panels;
    }
    let figure = html::figure(
        &format!("<div class=\"panels\">{panels}</div>\n"),
        "Level of detection at 95 % of the M3C2 distances with the mountings found, from above: a smaller distance at a place may be chance. Grey: the reference where there is no distance, for want of points of the scanner.",
    );
    format!("<h3>How small a distance can be seen</h3>\n{figure}")
}

fn panel(found: &Agreement, background_m: &[Vec3]) -> String {
    let points = found.distances.points();
    let levels = points.zip(found.distances.levels_of_detection_m());
    let known: Vec<([f64; 2], f64, f64)> = levels
        .map(|((p, distance_m), level_m)| ([p.x, p.y], distance_m, level_m))
        .filter(|(_, _, level_m)| level_m.is_finite())
        .collect();
    let ground: Vec<[f64; 2]> = match found.against {
        Against::Reference => background_m.iter().map(|p| [p.x, p.y]).collect(),
        Against::Scanner(_) => Vec::new(),
    };
    let all = known.iter().map(|k| k.0).chain(ground.iter().copied());
    let Some(bounds) = Bounds::around(all) else {
        return String::new();
    };
    let mut sizes: Vec<f64> = known.iter().map(|k| k.2).collect();
    sizes.sort_by(f64::total_cmp);
    if sizes.is_empty() {
        return String::new();
    }
    let (median_m, most_m) = (quantile(&sizes, 0.5), quantile(&sizes, 0.85));
    let limit_m = number::nice_above(most_m.max(1e-4));
    let beyond = known.iter().filter(|k| k.1.abs() > k.2).count();

    let [x0, y0] = [shift(bounds.min[0]), shift(bounds.min[1])];
    let local = |p: [f64; 2]| [p[0] - x0, p[1] - y0];
    let (low, high) = (local(bounds.min), local(bounds.max));
    let mut plot = Plot::map(
        THIRD,
        330.0,
        Axis::over(&coordinate_label("east", x0), [low[0], high[0]]),
        Axis::over(&coordinate_label("north", y0), [low[1], high[1]]),
    );
    if !ground.is_empty() {
        let bare = raster::plain(&ground, bounds, PIXELS, BARE);
        plot.image(&bare.uri, local(bare.extent.min), local(bare.extent.max));
    }
    let values: Vec<([f64; 2], f64)> = known.iter().map(|k| (k.0, k.2)).collect();
    let image = raster::graded(&values, limit_m, bounds, PIXELS);
    plot.image(&image.uri, local(image.extent.min), local(image.extent.max));
    let stops: Vec<String> = (0..=8)
        .map(|i| raster::grade_css(f64::from(i) / 8.0))
        .collect();
    let scale = format!(
        "<div class=\"heights\">0 <span class=\"ramp\" style=\"background:linear-gradient(to right,{})\"></span> {}</div>\n",
        stops.join(","),
        number::with_unit(number::shortest(1e3 * limit_m), "mm")
    );
    let percent = |share: f64| number::with_unit(number::fixed(100.0 * share, 0), "%");
    format!(
        "<div><h4>{} <small>median {}; {} of the field covered; {} of the distances exceed it</small></h4>\n{}{scale}</div>\n",
        escape(&found.pair()),
        number::with_unit(number::millimetres(median_m), "mm"),
        percent(found.coverage),
        percent(beyond as f64 / known.len() as f64),
        plot.finish(&format!("Level of detection, {}", found.pair())),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparison::{CoreDistance, DistanceMap, M3c2, Statistics};

    #[test]
    fn the_map_tells_what_is_covered_and_what_exceeds() {
        let core = (0..10).map(|i| CoreDistance {
            point: Vec3::new(f64::from(i), 0.0, 0.0),
            normal: Vec3::z(),
            normal_radius_m: 0.04,
            distance_m: if i < 3 { 2e-3 } else { 0.0 },
            level_of_detection_m: 1e-3,
            reference_spread_m: 1e-3,
            compared_spread_m: 1e-3,
            reference_count: 10,
            compared_count: 10,
        });
        let distances = M3c2 {
            core: core.collect(),
        };
        let found = Agreement {
            coverage: 0.5,
            scanner: "left".into(),
            against: Against::Reference,
            mounting: MountingKind::Final,
            statistics: Statistics::of(&distances).unwrap(),
            distances: DistanceMap::of(&distances),
        };
        let text = panel(&found, &[Vec3::new(20.0, 0.0, 0.0)]);
        assert!(
            text.contains("30\u{202f}%") || text.contains("30 %") || text.contains("30\u{a0}%"),
            "{text}"
        );
        assert_eq!(text.matches("<image").count(), 2);
        let alone = panel(&found, &[]);
        assert_eq!(alone.matches("<image").count(), 1);
    }
}
