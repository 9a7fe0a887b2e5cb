//! Shape features of all neighbourhoods of a cloud, written with its points.

use std::path::Path;
use std::time::Instant;

use super::rows::{FeatureRow, RowStore, SortedRows};
use super::source::CloudSource;
use super::stage::stage;
use super::store::TileStore;
use super::surroundings::surroundings;
use crate::cloud::shape::Feature;
use crate::cloud::{NeighbourIndex, Neighbourhood};
use crate::error::Result;
use crate::format::memory::Budget;
use crate::format::{ExtraDimension, ExtraKind};
use crate::output::Staging;
use crate::progress::Progress;

/// Memory for each point of a cloud processed in one piece, or of a tile with its halo, bytes:
/// points, index, features twice. Measured with 3 million points: less than 260.
const BYTES_A_POINT: u64 = 300;
/// A tile with its halo may have twice as many points as the tile alone.
const BYTES_A_TILE_POINT: u64 = 2 * BYTES_A_POINT;

/// What to compute, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureSettings {
    /// Which points are neighbours.
    pub neighbourhood: Neighbourhood,
    /// The features to write, in this order.
    pub features: Vec<Feature>,
    /// Memory limit, bytes; `None` for half of the free memory. A cloud that fits is processed in
    /// one piece, a larger one tile by tile; the results are the same. About 150 MB, and 20 MB per
    /// thread while the file is read, are used in any case; formats other than LAS and LAZ are read
    /// whole.
    pub memory_bytes: Option<u64>,
}

impl Default for FeatureSettings {
    fn default() -> Self {
        Self {
            neighbourhood: Neighbourhood::Nearest(50),
            features: vec![
                Feature::Omnivariance,
                Feature::Linearity,
                Feature::Planarity,
                Feature::Sphericity,
                Feature::Verticality,
                Feature::ChangeOfCurvature,
                Feature::Normal,
            ],
            memory_bytes: None,
        }
    }
}

/// Size of the work and times of its stages.
#[derive(Debug, Clone, Copy)]
pub struct FeatureSummary {
    /// Number of points.
    pub points: u64,
    /// Number of tiles; 1 if processed in one piece.
    pub tiles: usize,
    /// Points with neighbours beyond the halo of their tile.
    pub beyond_halo: u64,
    /// The memory limit, bytes.
    pub memory_bytes: u64,
    /// Time to read the points and sort them into tiles, seconds.
    pub read_s: f64,
    /// Time to compute neighbourhoods and features, seconds.
    pub features_s: f64,
    /// Time to write, seconds.
    pub write_s: f64,
}

/// Computes the features of every point of the file `cloud` and writes `output` (LAS or LAZ): the
/// points in their order with all their fields (LAS, LAZ) or with time and intensity (other
/// formats), and the features as extra dimensions in 32-bit floating point, with a relative
/// rounding error of 6 · 10⁻⁸. Data that do not fit in memory go to `staging`.
///
/// # Errors
/// A cloud that cannot be read, or cannot be written as LAS or LAZ.
pub fn features(
    cloud: &Path,
    settings: &FeatureSettings,
    staging: &Staging,
    output: &Path,
    progress: &dyn Progress,
) -> Result<FeatureSummary> {
    let start = Instant::now();
    let budget = Budget::new(settings.memory_bytes);
    let cloud = CloudSource::open(cloud, progress)?;
    let mut work = FeatureSummary {
        points: cloud.len(),
        tiles: 1,
        beyond_halo: 0,
        memory_bytes: budget.bytes,
        read_s: start.elapsed().as_secs_f64(),
        features_s: 0.0,
        write_s: 0.0,
    };
    let dimensions = dimensions(&settings.features);
    let write = |row: &mut dyn FnMut(u64) -> Result<FeatureRow>| {
        let mut fill = |index: u64, values: &mut [f64]| {
            row(index)?.fill(&settings.features, values);
            Ok(true)
        };
        cloud.write(output, &dimensions, &mut fill, progress)
    };
    if work.points <= budget.points(BYTES_A_POINT).min(u64::from(u32::MAX)) {
        let rows = in_one_piece(&cloud, settings, &mut work, progress)?;
        work.write_s = write(&mut |index| Ok(rows[index as usize]))?;
    } else {
        let most_points = budget.tile_points(BYTES_A_TILE_POINT);
        let mut rows = by_tiles(&cloud, settings, most_points, staging, &mut work, progress)?;
        work.write_s = write(&mut |index| rows.row(index))?;
    }
    Ok(work)
}

fn in_one_piece(
    cloud: &CloudSource,
    settings: &FeatureSettings,
    work: &mut FeatureSummary,
    progress: &dyn Progress,
) -> Result<Vec<FeatureRow>> {
    let start = Instant::now();
    let points = cloud.points(progress)?;
    work.read_s += start.elapsed().as_secs_f64();
    let (rows, seconds) = stage(progress, "features", work.points, || {
        let index = NeighbourIndex::new(&points);
        drop(points);
        let neighbourhood = settings.neighbourhood;
        index.surroundings_of_all(&index, neighbourhood, progress, |_, near| {
            FeatureRow::of(near, &settings.features)
        })
    })?;
    work.features_s = seconds;
    Ok(rows)
}

/// Processes a cloud on disk in tiles of `most_points`, in a folder of the staging area.
fn by_tiles(
    cloud: &CloudSource,
    settings: &FeatureSettings,
    most_points: usize,
    staging: &Staging,
    work: &mut FeatureSummary,
    progress: &dyn Progress,
) -> Result<SortedRows> {
    let start = Instant::now();
    let store = TileStore::of(cloud, &staging.path("tiles"), most_points, progress)?;
    work.read_s += start.elapsed().as_secs_f64();
    let (rows, seconds) = stage(progress, "features", work.points, || {
        let mut rows = RowStore::create(&staging.path("rows"), work.points, most_points)?;
        let solved = surroundings(
            &store,
            settings.neighbourhood,
            most_points,
            progress,
            |near| FeatureRow::of(near, &settings.features),
            |index, row| rows.put(index, &row),
        )?;
        (work.tiles, work.beyond_halo) = (solved.tiles, solved.deferred);
        rows.sorted()
    })?;
    work.features_s = seconds;
    progress.say(&format!(
        "{} points in {} tiles, {} of them with neighbours beyond the halo of their tile",
        work.points, work.tiles, work.beyond_halo
    ));
    Ok(rows)
}

/// The extra dimensions for the features.
fn dimensions(features: &[Feature]) -> Vec<ExtraDimension> {
    let columns = features.iter().flat_map(|feature| {
        feature
            .columns()
            .iter()
            .map(move |column| (feature, column))
    });
    columns
        .map(|(feature, (name, text))| {
            let kind = match feature {
                Feature::Neighbours => ExtraKind::U32,
                _ => ExtraKind::F32,
            };
            ExtraDimension::new(name, kind, text)
        })
        .collect()
}
