//! The comparison of two clouds outside of a run: numbers, histogram, and maps of the distances and of their levels of
//! detection.

use super::content::Comparison;
use super::html::{self, escape};
use super::maps::{PIXELS, core, grades, histogram, limit_m, plan, scale, top_view};
use super::raster::{self, Bounds};
use crate::number;

/// Share of the levels of detection within the colours of their map, percent.
const SHOWN_PERCENT: usize = 97;

/// Numbers, then the maps side by side; empty without distances.
pub fn section(comparison: &Comparison) -> String {
    let agreement = &comparison.agreement;
    let positions = core(agreement).map(|(place, _)| place);
    let Some(bounds) = Bounds::around(positions) else {
        return String::new();
    };
    let limit_m = limit_m(agreement);
    let mut cells = cell(
        "distances",
        "colours to ±",
        limit_m,
        top_view("distances", agreement, bounds, limit_m)
            + &scale(limit_m)
            + &histogram(agreement, limit_m),
    );
    let levels_m: Vec<f64> = agreement.distances.levels_of_detection_m().collect();
    let mut known: Vec<f64> = levels_m.iter().copied().filter(|m| m.is_finite()).collect();
    known.sort_by(f64::total_cmp);
    if let Some(most) = known.get(known.len() * SHOWN_PERCENT / 100) {
        let most_m = number::nice_above(most.max(1e-4));
        let places = core(agreement).map(|(place, _)| place);
        let points: Vec<([f64; 2], f64)> = places.zip(levels_m).collect();
        let image = raster::graded(&points, most_m, bounds, PIXELS);
        let map = plan("Map of the levels of detection", bounds, &[image]);
        let scale = grades(most_m);
        cells.push_str(&cell(
            "level of detection",
            "colours to",
            most_m,
            map + &scale,
        ));
    }
    format!(
        "{}<figure>\n<div class=\"panels\">{cells}</div>\n</figure>\n<p class=\"note\">Seen from above. A distance \
         is positive where {} lies beyond {} in the direction of the normal. Where nothing has changed, 5 % of the \
         distances are larger than their own level of detection.</p>\n",
        numbers(comparison),
        escape(&agreement.scanner),
        escape(&comparison.reference),
    )
}

fn cell(name: &str, sign: &str, limit_m: f64, figures: String) -> String {
    let limit = number::with_unit(number::shortest(1e3 * limit_m), "mm");
    format!("<div><h4>{name} <small>{sign} {limit}</small></h4>\n{figures}</div>\n")
}

/// The statistics, each with its definition.
fn numbers(comparison: &Comparison) -> String {
    let statistics = &comparison.agreement.statistics;
    let length = |metres: f64| number::with_unit(number::millimetres(metres), "mm");
    let share = if statistics.significant_share.is_nan() {
        number::DASH.to_owned()
    } else {
        number::fixed(100.0 * statistics.significant_share, 1) + " %"
    };
    let rows = [
        (
            "RMSE",
            length(statistics.rmse_m),
            "root mean square of the distances, noise of both clouds included",
        ),
        (
            "mean",
            length(statistics.mean_m),
            "how far the clouds lie apart on the whole",
        ),
        (
            "standard deviation",
            length(statistics.std_m),
            "of a single distance about the mean, not of the mean",
        ),
        (
            "median",
            length(statistics.median_m),
            "half of the distances are smaller",
        ),
        (
            "NMAD",
            length(statistics.nmad_m),
            "as the standard deviation, but edges and gaps do not decide it",
        ),
        (
            "beyond the level of detection",
            share,
            "of the distances: half a 95 % interval of each",
        ),
        (
            "core points with a distance",
            format!(
                "{} of {}",
                number::count(statistics.n),
                number::count(statistics.core_points)
            ),
            "the others have too few points of a cloud around them",
        ),
    ];
    let rows: String = rows
        .iter()
        .map(|(name, value, text)| {
            format!("<tr><th scope=\"row\">{name}</th><td>{value}</td><td class=\"text\">{text}</td></tr>\n")
        })
        .collect();
    html::table("numbers", "", &rows)
}
