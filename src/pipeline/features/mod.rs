//! Cloud to the same cloud with the shape of every neighbourhood beside each point.

mod rows;

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::json;

use super::memory::Budget;
use super::tile_store::TileStore;
use super::{Options, Outcome, peak_memory_bytes, tiled};
use crate::cloud::shape::Feature;
use crate::cloud::{NeighbourIndex, Neighbourhood, PointCloud};
use crate::error::{Error, Location, Result};
use crate::format::{self, ExtraDimension, ExtraKind};
use crate::output::Staging;
use crate::progress::Progress;
use rows::{FeatureRow, RowStore};

/// Memory for each point of a cloud that is worked on in one piece, or of a tile with its halo,
/// bytes: points, index, features twice. Less than 260 measured with 3 million points.
const BYTES_A_POINT: u64 = 300;
/// Of a tile's points with halo there may be twice as many as of its own.
const BYTES_A_TILE_POINT: u64 = 2 * BYTES_A_POINT;

/// What to compute and how.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureSettings {
    /// Which points are neighbours.
    pub neighbourhood: Neighbourhood,
    /// What to write, in this order.
    pub features: Vec<Feature>,
    /// Memory to keep to, bytes; `None` for half of what the machine has free. A cloud that fits is
    /// worked on in one piece, a larger one tile by tile; the numbers are the same. Some 150 MB are
    /// taken in any case, and formats other than LAS and LAZ are read whole.
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

/// How the neighbourhoods were worked through, and what each stage took.
#[derive(Debug, Clone, Copy, Default)]
struct Work {
    points: u64,
    tiles: usize,
    aside: u64,
    read_s: f64,
    features_s: f64,
    write_s: f64,
}

/// Computes the features of every point of `cloud` and writes `NAME-features.laz`: the points in
/// their order with all that they carry (LAS, LAZ) or with time and intensity (other formats), and
/// the features as extra dimensions, 32-bit floating point, which rounds to 6 · 10⁻⁸ of a value.
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
    let staging = Staging::new(&options.out, &[cloud.to_owned()], &[&name])?;
    let budget = Budget::new(settings.memory_bytes);
    let in_one_piece = budget.points(BYTES_A_POINT).min(u64::from(u32::MAX));
    let tile_points = budget.tile_points(BYTES_A_TILE_POINT);
    let output = staging.path(&name);
    let work = match format::points_named(cloud)? {
        Some(points) if points > in_one_piece => {
            let input = Input::File(cloud, points);
            by_tiles(&input, settings, tile_points, &staging, &output, progress)
        }
        named => {
            let start = Instant::now();
            progress.begin("reading the cloud", 0);
            let read = format::read_cloud(cloud);
            progress.end();
            let read = read?;
            let read_s = start.elapsed().as_secs_f64();
            let points = read.points.len() as u64;
            let work = if points > in_one_piece {
                let input = Input::Memory(&read);
                by_tiles(&input, settings, tile_points, &staging, &output, progress)
            } else {
                let file = named.map(|_| cloud);
                at_once(read, file, settings, &output, progress)
            };
            work.map(|work| Work {
                read_s: work.read_s + read_s,
                ..work
            })
        }
    }?;
    warn_of_few(&work, settings, progress);
    staging.commit()?;
    Ok(answer(&work, settings, budget.bytes, target))
}

/// Where the points come from, and again when they are written.
enum Input<'a> {
    /// A LAS or LAZ file with its number of points.
    File(&'a Path, u64),
    Memory(&'a PointCloud),
}

impl Input<'_> {
    fn len(&self) -> u64 {
        match self {
            Self::File(_, points) => *points,
            Self::Memory(cloud) => cloud.points.len() as u64,
        }
    }

    /// Writes the points with their features.
    fn write(
        &self,
        output: &Path,
        features: &[Feature],
        mut row: impl FnMut(u64) -> Result<FeatureRow>,
        progress: &dyn Progress,
    ) -> Result<f64> {
        let start = Instant::now();
        let dimensions = dimensions(features);
        let mut fill = |index: u64, values: &mut [f64]| {
            row(index)?.fill(features, values);
            Ok(true)
        };
        progress.begin("writing the features", self.len());
        let written = match self {
            Self::File(path, _) => format::copy_las(path, output, &dimensions, &mut fill, progress),
            Self::Memory(cloud) => {
                format::cloud_to_las(cloud, output, &dimensions, &mut fill, progress)
            }
        };
        progress.end();
        written.map(|_| start.elapsed().as_secs_f64())
    }
}

/// The cloud in memory in one piece; `file` is where it came from, if that is LAS or LAZ.
fn at_once(
    mut cloud: PointCloud,
    file: Option<&Path>,
    settings: &FeatureSettings,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Work> {
    let points = cloud.points.len() as u64;
    if file.is_some() {
        // The file is read again when it is written.
        cloud.time_s = Vec::new();
        cloud.intensity = Vec::new();
    }
    let start = Instant::now();
    progress.begin("features", points);
    let index = NeighbourIndex::new(&cloud.points);
    let rows = index.surroundings_of_all(&index, settings.neighbourhood, progress, |_, near| {
        FeatureRow::of(near, &settings.features)
    });
    progress.end();
    drop(index);
    let features_s = start.elapsed().as_secs_f64();
    let input = match file {
        Some(path) => Input::File(path, points),
        None => Input::Memory(&cloud),
    };
    let row = |index: u64| Ok(rows[index as usize]);
    let write_s = input.write(output, &settings.features, row, progress)?;
    Ok(Work {
        points,
        tiles: 1,
        aside: 0,
        read_s: 0.0,
        features_s,
        write_s,
    })
}

/// The cloud on disk in tiles, in a folder of the staging area.
fn by_tiles(
    input: &Input<'_>,
    settings: &FeatureSettings,
    tile_points: usize,
    staging: &Staging,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Work> {
    let start = Instant::now();
    progress.begin("sorting the cloud into tiles", input.len());
    let folder = staging.path("tiles");
    let store = match input {
        Input::File(path, _) => TileStore::of_file(&folder, tile_points, path, progress),
        Input::Memory(cloud) => TileStore::of_points(&folder, tile_points, &cloud.points, progress),
    };
    progress.end();
    let store = store?;
    let read_s = start.elapsed().as_secs_f64();

    let start = Instant::now();
    progress.begin("features", input.len());
    let mut rows = RowStore::create(&staging.path("rows"), input.len(), tile_points)?;
    let solved = tiled::surroundings(
        &store,
        settings.neighbourhood,
        tile_points,
        progress,
        |near| FeatureRow::of(near, &settings.features),
        |index, row| rows.put(index, &row),
    );
    progress.end();
    let solved = solved?;
    drop(store);
    let mut rows = rows.sorted()?;
    let features_s = start.elapsed().as_secs_f64();

    let write_s = input.write(
        output,
        &settings.features,
        |index| rows.row(index),
        progress,
    )?;
    progress.say(&format!(
        "{} points in {} tiles, {} of them with neighbours beyond the halo of their tile",
        input.len(),
        solved.tiles,
        solved.aside
    ));
    Ok(Work {
        points: input.len(),
        tiles: solved.tiles,
        aside: solved.aside,
        read_s,
        features_s,
        write_s,
    })
}

/// The extra dimensions that features are written as.
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

fn file_name(cloud: &Path) -> Result<String> {
    let stem = cloud
        .file_stem()
        .ok_or_else(|| Error::format(cloud, Location::Whole, "no name of a file", "a cloud"))?;
    Ok(format!("{}-features.laz", stem.to_string_lossy()))
}

fn warn_of_few(work: &Work, settings: &FeatureSettings, progress: &dyn Progress) {
    if let Neighbourhood::Nearest(k) = settings.neighbourhood
        && (k as u64) > work.points
    {
        progress.warn(&format!(
            "the cloud has {} points: every neighbourhood is the whole cloud, not its {k} nearest \
             points",
            work.points
        ));
    }
}

fn answer(work: &Work, settings: &FeatureSettings, memory: u64, target: PathBuf) -> Outcome {
    let names: Vec<&str> = settings.features.iter().map(|f| f.name()).collect();
    let neighbourhood = match settings.neighbourhood {
        Neighbourhood::Nearest(k) => format!("{k} nearest points"),
        Neighbourhood::Within(radius) => format!("points within {radius} m"),
    };
    let rate = work.points as f64 / work.features_s.max(1e-9) / 1e6;
    let summary = format!(
        "features of {} points, from the {neighbourhood}\n  features   {}\n  pieces     {}\n  time       \
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
            "points_beyond_halo": work.aside,
            "memory_bytes": memory,
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
    }
}
