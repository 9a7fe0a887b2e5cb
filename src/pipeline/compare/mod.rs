//! `boresight compare`: two cloud files to distances at core points.

mod cloud;
mod table;
mod tiled;

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::json;

use super::memory::Budget;
use super::{Options, Outcome};
use crate::comparison::{Aggregation, ComparisonSettings};
use crate::comparison::{IndexedClouds, Normals, Statistics, core_points};
use crate::error::{Error, Result};
use crate::format::{self, CorePoints};
use crate::geometry::Vec3;
use crate::output::Staging;
use crate::progress::Progress;
use tiled::Tiled;

/// What to compare, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The cloud to judge.
    pub cloud: PathBuf,
    /// The cloud to judge it by.
    pub reference: PathBuf,
    /// Core points in a file; without one they are the reference, thinned.
    pub core: Option<PathBuf>,
    /// Where normals come from.
    pub normals: NormalSource,
    /// Radii and the like.
    pub settings: ComparisonSettings,
    /// Memory to keep to, bytes; `None` for half of what the machine has free. Clouds that fit are
    /// compared in one piece, larger ones tile by tile; the numbers are the same. Some 150 MB are
    /// taken in any case, results and core points from a file are kept whole, and formats other than
    /// LAS and LAZ are read whole.
    pub memory_bytes: Option<u64>,
}

impl Comparison {
    /// The files that are read.
    pub fn inputs(&self) -> Vec<PathBuf> {
        let mut inputs = vec![self.cloud.clone(), self.reference.clone()];
        inputs.extend(self.core.clone());
        inputs
    }
}

/// Where the normals of the core points come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NormalSource {
    /// The file of the core points where it holds normals, else the reference; those found are
    /// turned to this direction.
    Core {
        /// Any length above zero.
        orientation: Vec3,
    },
    /// The reference, whatever the file of the core points holds.
    Reference {
        /// Any length above zero.
        orientation: Vec3,
    },
    /// One direction for all.
    Fixed(Vec3),
}

/// Memory for each point of the two clouds in one piece, bytes: as read, as indexed, and on the way
/// from one to the other.
const BYTES_A_POINT: u64 = 160;
/// A tile's points come with those of its halo, and those of the other cloud.
const BYTES_A_TILE_POINT: u64 = 4 * BYTES_A_POINT;

/// M3C2 from one cloud to the other: statistics, a table of the core points (`m3c2.csv`), and the
/// same as a cloud with extra dimensions (`m3c2.laz`).
///
/// # Errors
/// Clouds that cannot be read or do not meet; settings that [`crate::comparison::m3c2()`] refuses.
pub fn compare(
    comparison: &Comparison,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let settings = &comparison.settings;
    let names = ["m3c2.laz", "m3c2.csv"];
    let inputs = comparison.inputs();
    let staging = Staging::new(&options.out, &inputs, &names)?;
    let budget = Budget::new(comparison.memory_bytes);
    let clouds = [&comparison.cloud, &comparison.reference];
    let mut points = 0;
    for cloud in clouds {
        // The size of other formats, which are read whole in any case, is not known before.
        points = u64::saturating_add(points, format::points_named(cloud)?.unwrap_or(0));
    }
    let start = Instant::now();
    let core = comparison.core.as_deref().map(format::read_core_points);
    let core = core.transpose()?;
    let in_one_piece = budget.points(BYTES_A_POINT).min(u64::from(u32::MAX));
    let mut tiled = if points > in_one_piece {
        let normals = normals_of(comparison, core.as_ref(), progress);
        let tile_points = budget.tile_points(BYTES_A_TILE_POINT);
        tiled::compare(
            comparison,
            core.as_ref(),
            normals,
            tile_points,
            &staging,
            progress,
        )?
    } else {
        at_once(comparison, core, progress)?
    };
    let statistics = Statistics::of(&tiled.found)?;
    let spent_s = tiled.read_s + tiled.index_s + tiled.compare_s;
    // What is not of the others was spent on core points.
    tiled.read_s += (start.elapsed().as_secs_f64() - spent_s).max(0.0);

    let start = Instant::now();
    table::write(&staging.path("m3c2.csv"), &tiled.found)?;
    cloud::write(&staging.path("m3c2.laz"), &tiled.found, progress)?;
    staging.commit()?;
    let seconds = |seconds: f64| json!({ "seconds": seconds });
    let mut result = json!(statistics);
    result["stages"] = json!({
        "read": seconds(tiled.read_s),
        "index": seconds(tiled.index_s),
        "compare": seconds(tiled.compare_s),
        "write": seconds(start.elapsed().as_secs_f64()),
    });
    result["tiles"] = json!(tiled.tiles);
    result["memory_bytes"] = json!(budget.bytes);
    result["peak_memory_bytes"] = json!(super::peak_memory_bytes());
    Ok(Outcome {
        result,
        summary: summary(&statistics, settings),
        files: names.map(|name| options.out.join(name)).into(),
    })
}

/// Both clouds in memory in one piece.
fn at_once(
    comparison: &Comparison,
    core: Option<CorePoints>,
    progress: &dyn Progress,
) -> Result<Tiled> {
    let settings = &comparison.settings;
    let start = Instant::now();
    progress.begin("reading the clouds", 0);
    let read = |path: &Path| Ok::<_, Error>(format::read_cloud(path)?.points);
    let clouds =
        read(&comparison.cloud).and_then(|cloud| Ok((cloud, read(&comparison.reference)?)));
    progress.end();
    let (compared, reference) = clouds?;
    let core = core.unwrap_or_else(|| CorePoints {
        points: core_points(&reference, settings),
        normals: Vec::new(),
    });
    let normals = normals_of(comparison, Some(&core), progress);
    let read_s = start.elapsed().as_secs_f64();

    let start = Instant::now();
    progress.begin("indexing the clouds", 0);
    let clouds = IndexedClouds::new(&reference, &compared, normals, settings);
    progress.end();
    let clouds = clouds?;
    drop((reference, compared));
    let index_s = start.elapsed().as_secs_f64();

    let start = Instant::now();
    progress.begin("comparing the clouds (M3C2)", core.points.len() as u64);
    let found = clouds.distances(&core.points, normals, progress);
    progress.end();
    Ok(Tiled {
        found: found?,
        tiles: 1,
        read_s,
        index_s,
        compare_s: start.elapsed().as_secs_f64(),
    })
}

fn normals_of<'a>(
    comparison: &Comparison,
    core: Option<&'a CorePoints>,
    progress: &dyn Progress,
) -> Normals<'a> {
    let given = core.map_or(&[][..], |core| &core.normals);
    match comparison.normals {
        NormalSource::Core { .. } if !given.is_empty() => {
            progress.say("normals are those in the file of the core points");
            Normals::Given(given)
        }
        NormalSource::Core { orientation } | NormalSource::Reference { orientation } => {
            Normals::MostPlanar { orientation }
        }
        NormalSource::Fixed(direction) => Normals::Fixed(direction),
    }
}

fn summary(statistics: &Statistics, settings: &ComparisonSettings) -> String {
    let millimetres = |metres: f64| format!("{:.2} mm", metres * 1e3);
    let aggregation = match settings.aggregation {
        Aggregation::Mean => "",
        Aggregation::Median => ", medians",
    };
    let significant = if statistics.significant_share.is_nan() {
        "of no distance: nowhere enough points".to_owned()
    } else {
        format!("{:.1} % beyond it", 100.0 * statistics.significant_share)
    };
    format!(
        "distance of the cloud from the reference (M3C2{aggregation})\n  RMSE                 {}\n  \
         mean                 {}\n  standard deviation   {}\n  median               {}\n  \
         level of detection   {significant}\n  core points          {} of {} have a distance",
        millimetres(statistics.rmse_m),
        millimetres(statistics.mean_m),
        millimetres(statistics.std_m),
        millimetres(statistics.median_m),
        statistics.n,
        statistics.core_points
    )
}
