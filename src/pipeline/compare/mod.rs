//! `boresight compare`: distances between two cloud files at core points.

pub mod change;
mod cloud;
mod columns;
mod table;

use std::path::Path;
use std::time::Instant;

use serde_json::json;

use super::{Options, Outcome, page, scales};
use crate::comparison::{Aggregation, ComparisonSettings, Statistics};
use crate::error::{Error, Problem, Result};
use crate::format::CloudRows;
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::report;
use crate::tiles::{self, Compared, Comparison, Orientation, peak_memory_bytes};

/// Cosine from the orientation below which noise decides to which side a computed normal points: 75°.
const ACROSS: f64 = 0.26;
/// Share of such normals below which nothing is said.
const NOTABLE_SHARE: f64 = 0.01;

/// Computes M3C2 between two clouds: statistics, a table of the core points (`m3c2.csv`), and a
/// cloud of the core points with extra dimensions (`m3c2.laz`).
///
/// # Errors
/// Clouds that cannot be read or do not overlap; settings invalid for
/// [`crate::comparison::m3c2()`].
pub fn compare(
    comparison: &Comparison,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let names = ["m3c2.laz", "m3c2.csv", "compare.html"];
    let staging = options.staging(&comparison.inputs(), &names)?;
    let work = tiles::compare(comparison, &staging, progress)?;
    let settings = &work.settings;
    let statistics =
        Statistics::of(&work.m3c2).map_err(|error| with_options(error, settings, comparison))?;
    let start = Instant::now();
    table::write(&staging.path("m3c2.csv"), &work.m3c2)?;
    cloud::write(
        &staging.path("m3c2.laz"),
        &work.m3c2,
        &comparison.reference,
        progress,
    )?;
    let page = report::render(&page::comparison(comparison, &work, statistics.clone()));
    let path = staging.path("compare.html");
    std::fs::write(&path, page).map_err(|error| Error::io(&path, error))?;
    progress.check()?;
    staging.commit()?;
    let seconds = |seconds: f64| json!({ "seconds": seconds });
    let across = normals_across(&work);
    let mut result = json!(statistics);
    result["normals_across_orientation"] = json!(across);
    result["viewpoints_m"] = json!(scales::viewpoints(&work));
    result["settings"] = json!(settings);
    result["measured"] = json!(work.measured);
    result["stages"] = json!({
        "read": seconds(work.read_s),
        "index": seconds(work.index_s),
        "compare": seconds(work.compare_s),
        "write": seconds(start.elapsed().as_secs_f64()),
    });
    result["tiles"] = json!(work.tiles);
    result["memory_bytes"] = json!(work.memory_bytes);
    result["peak_memory_bytes"] = json!(peak_memory_bytes());
    Ok(Outcome {
        result,
        summary: summary(&statistics, settings)
            + &scales::told(comparison, &work)
            + &arbitrary_signs(across, statistics.n, work.orientation.as_ref()),
        files: names.map(|name| options.out.join(name)).into(),
        ..Outcome::default()
    })
}

/// The error of clouds that do not overlap, with the options of the command as its remedy; any other as it is.
fn with_options(error: Error, settings: &ComparisonSettings, comparison: &Comparison) -> Error {
    match error {
        Error::Data {
            kind: kind @ Problem::NoOverlap,
            problem,
            ..
        } => Error::of(
            kind,
            problem + &other_unit(comparison),
            format!(
                "check that both clouds are in the same frame and overlap; if they lie more than {} m apart, give more with \
                 --max-distance-m; if their points lie far apart, wider neighbourhoods and cylinders with \
                 --normal-radii-m and --cylinder-radius-m (here {} m and {} m)",
                settings.max_distance_m,
                scales::list(&settings.normal_radii_m),
                settings.cylinder_radius_m
            ),
        ),
        Error::Data {
            kind: kind @ Problem::TooFew,
            problem,
            ..
        } => Error::of(
            kind,
            problem,
            format!(
                "give a reference with more points, or wider neighbourhoods with --normal-radii-m (here {} m)",
                scales::list(&settings.normal_radii_m)
            ),
        ),
        other => other,
    }
}

/// What to say of clouds one of which is some 1000 times as large as the other; empty for others.
fn other_unit(comparison: &Comparison) -> String {
    const SIZES: std::ops::Range<f64> = 300.0..3000.0;
    let size = |path: &Path| -> Option<f64> {
        let rows = CloudRows::open(path).ok()?;
        Some((rows.shape().high - rows.shape().low).norm())
    };
    let sizes = size(&comparison.reference).zip(size(&comparison.cloud));
    let ratio = sizes.map_or(1.0, |(reference, cloud)| cloud / reference);
    let (large, small) = if SIZES.contains(&ratio) {
        (&comparison.cloud, &comparison.reference)
    } else if SIZES.contains(&ratio.recip()) {
        (&comparison.reference, &comparison.cloud)
    } else {
        return String::new();
    };
    format!(
        "; {} is {:.0} times as large as {}: is it in millimetres?",
        large.display(),
        ratio.max(ratio.recip()),
        small.display()
    )
}

/// Number of distances whose computed normals lie across the direction that they are oriented towards.
fn normals_across(work: &Compared) -> usize {
    let towards = |point: &Vec3| match &work.orientation {
        Some(Orientation::Direction(direction)) => *direction,
        Some(Orientation::SeenFrom(places)) => {
            let offsets = places.iter().map(|place| place - point);
            let nearest = offsets.min_by(|a, b| a.norm().total_cmp(&b.norm()));
            nearest.unwrap_or(Vec3::zeros())
        }
        Some(Orientation::Scanners) | None => Vec3::zeros(),
    };
    let computed = work
        .m3c2
        .core
        .iter()
        .filter(|point| point.distance_m.is_finite() && point.normal_radius_m.is_finite());
    let across = computed.filter(|core| {
        let towards = towards(&core.point);
        core.normal.dot(&towards).abs() < ACROSS * towards.norm()
    });
    across.count()
}

/// What to do about normals across the orientation; empty if there are few.
fn arbitrary_signs(across: usize, distances: usize, orientation: Option<&Orientation>) -> String {
    let share = across as f64 / distances as f64;
    if share < NOTABLE_SHARE {
        return String::new();
    }
    let percent = 100.0 * share;
    match orientation {
        Some(Orientation::SeenFrom(_)) => format!(
            "\n{across} distances ({percent:.0} %) have normals within 15° of a right angle to the line of sight from the \
             nearest viewpoint: their signs are arbitrary. Name the places from which such surfaces were seen with \
             --viewpoint."
        ),
        _ => format!(
            "\n{across} distances ({percent:.0} %) have normals within 15° of a right angle to the orientation, as on walls \
             and trunks seen with the orientation up: their signs are arbitrary, and their mean is near 0 whatever has \
             changed. Name the places from which the surfaces were seen with --viewpoint east,north,up, or a direction \
             towards them with --orientation."
        ),
    }
}

fn summary(statistics: &Statistics, settings: &ComparisonSettings) -> String {
    let millimetres = |metres: f64| format!("{:.2} mm", metres * 1e3);
    let aggregation = match settings.aggregation {
        Aggregation::Mean => "",
        Aggregation::Median => ", medians",
    };
    let significant = if statistics.significant_share.is_nan() {
        "not available: too few points everywhere".to_owned()
    } else {
        format!("exceeded by {:.1} %", 100.0 * statistics.significant_share)
    };
    let registration = match settings.registration_error_m {
        0.0 => "no error of the registration is in it (--registration-error-m)".to_owned(),
        error_m => format!("{} for the registration are in it", millimetres(error_m)),
    };
    format!(
        "distance of the cloud from the reference (M3C2{aggregation})\n  RMSE                 {}\n  \
         mean                 {}\n  standard deviation   {}\n  median               {}\n  \
         level of detection   {significant}\n  core points          {} of {} have a distance\n\
         The standard deviation is that of a single distance about their mean, noise of both clouds included, not \
         that of the mean.\nThe level of detection is half a 95 % interval: where nothing has changed, 5 % of the \
         distances are larger than their own; {}.",
        millimetres(statistics.rmse_m),
        millimetres(statistics.mean_m),
        millimetres(statistics.std_m),
        millimetres(statistics.median_m),
        statistics.n,
        statistics.core_points,
        registration
    )
}
