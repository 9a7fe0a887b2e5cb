//! Maps of the level of detection, which is the smallest distance that the clouds can show, and of their coverage.

use super::html::{self, escape};
use super::maps::{PIXELS, grades, plan};
use super::raster::{self, Bounds};
use crate::comparison::{Against, Agreement, MountingKind};
use crate::geometry::Vec3;
use crate::number;
use crate::results::Drive;
use crate::statistics::quantile;

/// The colour of uncovered ground.
const BARE: [u8; 4] = [128, 128, 128, 110];

/// A map for each pair of clouds of the first drive with the estimated mountings; empty without distances.
pub fn maps(drives: &[Drive], background_m: &[Vec3]) -> String {
    let panels = drives.iter().take(1).flat_map(|drive| {
        let all = drive.agreements.under(MountingKind::Final);
        all.map(|agreement| panel(agreement, background_m))
    });
    let panels: String = panels.collect();
    if panels.is_empty() {
        return panels;
    }
    let figure = html::figure(
        &format!("<div class=\"panels\">{panels}</div>\n"),
        "Level of detection at 95 % of the M3C2 distances with the mountings found, from above: a smaller distance at a place may be chance. Grey: the reference where there is no distance, for want of points of the scanner.",
    );
    format!("<h3>How small a distance can be seen</h3>\n{figure}")
}

fn panel(agreement: &Agreement, background_m: &[Vec3]) -> String {
    let points = agreement.distances.points();
    let levels = points.zip(agreement.distances.levels_of_detection_m());
    let known: Vec<([f64; 2], f64, f64)> = levels
        .map(|((p, distance_m), level_m)| ([p.x, p.y], distance_m, level_m))
        .filter(|(_, _, level_m)| level_m.is_finite())
        .collect();
    let ground: Vec<[f64; 2]> = match agreement.against {
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

    let mut images = Vec::new();
    if !ground.is_empty() {
        images.push(raster::plain(&ground, bounds, PIXELS, BARE));
    }
    let values: Vec<([f64; 2], f64)> = known.iter().map(|k| (k.0, k.2)).collect();
    images.push(raster::graded(&values, limit_m, bounds, PIXELS));
    let scale = grades(limit_m);
    let percent = |share: f64| number::with_unit(number::fixed(100.0 * share, 0), "%");
    format!(
        "<div><h4>{} <small>median {}; {} of the field covered; {} of the distances exceed it</small></h4>\n{}{scale}</div>\n",
        escape(&agreement.pair()),
        number::with_unit(number::millimetres(median_m), "mm"),
        percent(agreement.coverage),
        percent(beyond as f64 / known.len() as f64),
        plan(
            &format!("Level of detection, {}", agreement.pair()),
            bounds,
            &images
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::compared::agreement;

    #[test]
    fn the_map_tells_what_is_covered_and_what_exceeds() {
        let core = |i| [f64::from(i), if i < 3 { 2e-3 } else { 0.0 }, 1e-3];
        let agreement = Agreement {
            coverage: 0.5,
            ..agreement(&(0..10).map(core).collect::<Vec<_>>())
        };
        let text = panel(&agreement, &[Vec3::new(20.0, 0.0, 0.0)]);
        assert!(
            text.contains("30\u{202f}%") || text.contains("30 %") || text.contains("30\u{a0}%"),
            "{text}"
        );
        assert_eq!(text.matches("<image").count(), 2);
        let alone = panel(&agreement, &[]);
        assert_eq!(alone.matches("<image").count(), 1);
    }
}
