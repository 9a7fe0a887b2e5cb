//! `boresight compare`: two cloud files to distances at core points.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use serde_json::{Value, json};

use super::{Options, Outcome};
use crate::comparison::{CoreDistance, IndexedClouds, M3c2, Normals, Statistics, core_points};
use crate::error::{Error, Result};
use crate::format::{self, CorePoints};
use crate::geometry::Vec3;
use crate::output::Staging;
use crate::progress::Progress;
use crate::project::{Aggregation, ComparisonSettings};

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

/// M3C2 from one cloud to the other: statistics, and a table of the core points.
///
/// # Errors
/// Clouds that cannot be read or do not meet; settings that [`crate::comparison::m3c2`] refuses.
pub fn compare(
    comparison: &Comparison,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let settings = &comparison.settings;
    let staging = Staging::new(&options.out)?;
    let mut stages = Stages::new();

    progress.begin("reading the clouds", 0);
    let clouds = read(comparison);
    progress.end();
    let (compared, reference, core) = clouds?;
    stages.end("read");

    let core = core.unwrap_or_else(|| CorePoints {
        points: core_points(&reference, settings),
        normals: Vec::new(),
    });
    let normals = normals_of(comparison, &core, progress);
    progress.begin("indexing the clouds", 0);
    let clouds = IndexedClouds::new(&reference, &compared, normals, settings);
    progress.end();
    let clouds = clouds?;
    stages.end("index");

    progress.begin("comparing the clouds (M3C2)", core.points.len() as u64);
    let found = clouds.distances(&core.points, normals, progress);
    progress.end();
    let found = found?;
    let statistics = Statistics::of(&found)?;
    stages.end("compare");

    write_table(&staging.path("m3c2.csv"), &found)?;
    staging.commit()?;
    stages.end("write");

    let mut result = json!(statistics);
    result["stages"] = stages.into_json();
    result["peak_memory_bytes"] = json!(super::peak_memory_bytes());
    Ok(Outcome {
        result,
        summary: summary(&statistics, settings),
        files: vec![options.out.join("m3c2.csv")],
    })
}

/// Times of the stages, one after the other.
struct Stages {
    begun: Instant,
    seconds: Vec<(&'static str, f64)>,
}

impl Stages {
    fn new() -> Self {
        Self {
            begun: Instant::now(),
            seconds: Vec::new(),
        }
    }

    fn end(&mut self, stage: &'static str) {
        self.seconds
            .push((stage, self.begun.elapsed().as_secs_f64()));
        self.begun = Instant::now();
    }

    fn into_json(self) -> Value {
        let stages = self.seconds.into_iter();
        stages
            .map(|(stage, seconds)| (stage.to_owned(), json!({ "seconds": seconds })))
            .collect::<serde_json::Map<_, _>>()
            .into()
    }
}

type Clouds = (Vec<Vec3>, Vec<Vec3>, Option<CorePoints>);

fn read(comparison: &Comparison) -> Result<Clouds> {
    let points = |path: &Path| Ok::<_, Error>(format::read_cloud(path)?.points);
    let core = comparison.core.as_deref().map(format::read_core_points);
    Ok((
        points(&comparison.cloud)?,
        points(&comparison.reference)?,
        core.transpose()?,
    ))
}

fn normals_of<'a>(
    comparison: &Comparison,
    core: &'a CorePoints,
    progress: &dyn Progress,
) -> Normals<'a> {
    match comparison.normals {
        NormalSource::Core { .. } if !core.normals.is_empty() => {
            progress.say("normals are those in the file of the core points");
            Normals::Given(&core.normals)
        }
        NormalSource::Core { orientation } | NormalSource::Reference { orientation } => {
            Normals::MostPlanar { orientation }
        }
        NormalSource::Fixed(direction) => Normals::Fixed(direction),
    }
}

/// Rows that one thread turns into text at a time.
const ROWS: usize = 4096;

const HEADER: &str = "east_m,north_m,up_m,distance_m,level_of_detection_m,normal_x,normal_y,\
    normal_z,normal_radius_m,reference_spread_m,compared_spread_m,reference_count,compared_count\n";

/// One line for each core point, in their order; NaN where something is unknown.
fn write_table(path: &Path, found: &M3c2) -> Result<()> {
    let write = || -> std::io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        file.write_all(HEADER.as_bytes())?;
        // Some blocks of rows at a time: text needs more memory than numbers.
        for rows in found.core.chunks(64 * ROWS) {
            let blocks: Vec<Vec<u8>> = rows.par_chunks(ROWS).map(lines).collect();
            for block in blocks {
                file.write_all(&block)?;
            }
        }
        file.flush()
    };
    write().map_err(|error| Error::io(path, error))
}

fn lines(rows: &[CoreDistance]) -> Vec<u8> {
    let mut text = Vec::with_capacity(200 * rows.len());
    for row in rows {
        let (p, n) = (&row.point, &row.normal);
        let written = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{}",
            p.x,
            p.y,
            p.z,
            row.distance_m,
            row.level_of_detection_m,
            n.x,
            n.y,
            n.z,
            row.normal_radius_m,
            row.reference_spread_m,
            row.compared_spread_m,
            row.reference_count,
            row.compared_count
        );
        written.expect("a Vec takes all bytes");
    }
    text
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
