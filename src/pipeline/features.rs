//! `boresight features`: adds the shape of the neighbourhood to every point of a cloud.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::{Options, Outcome};
use crate::cloud::Neighbourhood;
use crate::error::{Error, Location, Result};
use crate::progress::Progress;
use crate::tiles::{self, FeatureSettings, FeatureSummary, peak_memory_bytes};

/// Computes the features of every point of `cloud` and writes `NAME-features.laz`, as
/// [`tiles::features`] does.
///
/// # Errors
/// A cloud that cannot be read, or written as LAZ.
pub fn features(
    cloud: &Path,
    settings: &FeatureSettings,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let name = file_name(cloud)?;
    let target = options.out.join(&name);
    let staging = options.staging(&[cloud.to_owned()], &[&name])?;
    let output = staging.path(&name);
    let work = tiles::features(cloud, settings, &staging, &output, progress)?;
    warn_of_few(&work, settings, progress);
    staging.commit()?;
    Ok(outcome(&work, settings, target))
}

fn file_name(cloud: &Path) -> Result<String> {
    let stem = cloud.file_stem().ok_or_else(|| {
        Error::format(
            cloud,
            Location::Whole,
            "a path without a file name",
            "a cloud",
        )
    })?;
    Ok(format!("{}-features.laz", stem.to_string_lossy()))
}

fn warn_of_few(work: &FeatureSummary, settings: &FeatureSettings, progress: &dyn Progress) {
    if let Neighbourhood::Nearest(k) = settings.neighbourhood
        && (k as u64) > work.points
    {
        progress.warn(&format!(
            "the cloud has {} points: every neighbourhood is the whole cloud instead of the {k} nearest \
             points",
            work.points
        ));
    }
}

fn outcome(work: &FeatureSummary, settings: &FeatureSettings, target: PathBuf) -> Outcome {
    let names: Vec<&str> = settings.features.iter().map(|f| f.name()).collect();
    let neighbourhood = match settings.neighbourhood {
        Neighbourhood::Nearest(k) => format!("{k} nearest points"),
        Neighbourhood::Within(radius) => format!("points within {radius} m"),
    };
    let rate = work.points as f64 / work.features_s.max(1e-9) / 1e6;
    let summary = format!(
        "features of {} points, from the {neighbourhood}\n  features   {}\n  tiles      {}\n  time       \
         {:.1} s reading, {:.1} s features ({rate:.2} million points/s), {:.1} s writing",
        work.points,
        names.join(", "),
        work.tiles,
        work.read_s,
        work.features_s,
        work.write_s,
    );
    let (k, radius_m) = match settings.neighbourhood {
        Neighbourhood::Nearest(k) => (Some(k), None),
        Neighbourhood::Within(radius) => (None, Some(radius)),
    };
    Outcome {
        result: json!({
            "points": work.points,
            "neighbours": k,
            "radius_m": radius_m,
            "features": names,
            "tiles": work.tiles,
            "points_beyond_halo": work.beyond_halo,
            "memory_bytes": work.memory_bytes,
            "stages": {
                "read": { "seconds": work.read_s },
                "features": { "seconds": work.features_s },
                "write": { "seconds": work.write_s },
            },
            "peak_memory_bytes": peak_memory_bytes(),
            "file": target,
        }),
        summary,
        files: vec![target],
        ..Outcome::default()
    }
}
