//! The comparison of a plot on two dates.

use std::path::{Path, PathBuf};

use super::cloud;
use crate::comparison::{ComparisonSettings, Statistics};
use crate::error::{Error, Problem, Result};
use crate::format::{self, CloudWriter};
use crate::geometry::Vec3;
use crate::output::Staging;
use crate::pipeline::page;
use crate::progress::Progress;
use crate::report::{self, Content};
use crate::tiles::{self, Comparison, NormalSource, Orientation};

/// The page of a change.
pub const PAGE: &str = "change.html";
/// The cloud of its core points with distances.
pub const CLOUD: &str = "change.laz";

/// Compares the tiles of a plot on two dates, the earlier first, and writes the core points and a page into `folder`.
/// Equal inputs give equal bytes, wherever their files are and with any limit of the memory.
///
/// # Errors
/// A drive without points; as for [`super::compare`].
pub fn change(
    tiles_of: [&[PathBuf]; 2],
    plot: &str,
    [earlier, later]: [&str; 2],
    settings: &ComparisonSettings,
    memory_bytes: Option<u64>,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Statistics> {
    let staging = Staging::new(folder, &[], &[CLOUD, PAGE])?;
    let joined = ["earlier.las", "later.las"].map(|name| staging.path(name));
    let [reference, cloud] = [0, 1].map(|i| join(tiles_of[i], &joined[i]));
    let comparison = Comparison {
        cloud: cloud?,
        reference: reference?,
        core: None,
        normals: NormalSource::Core {
            orientation: Orientation::Direction(Vec3::z()),
        },
        settings: settings.clone().into(),
        memory_bytes,
    };
    let work = tiles::compare(&comparison, &staging, progress)?;
    let statistics = Statistics::of(&work.m3c2)?;
    let reference = &comparison.reference;
    cloud::write(&staging.path(CLOUD), &work.m3c2, reference, progress)?;
    for path in joined.iter().filter(|path| path.exists()) {
        std::fs::remove_file(path).map_err(|error| Error::io(path, error))?;
    }
    let shown = Comparison {
        cloud: later.into(),
        reference: earlier.into(),
        ..comparison
    };
    let content = Content {
        title: format!("{plot}: from {earlier} to {later}"),
        command: String::new(),
        made_s: None,
        peak_memory_bytes: None,
        ..page::comparison(&shown, &work, statistics.clone())
    };
    let path = staging.path(PAGE);
    std::fs::write(&path, report::render(&content)).map_err(|error| Error::io(&path, error))?;
    progress.check()?;
    staging.commit()?;
    Ok(statistics)
}

/// The points of all tiles in one file: the only tile itself, or the file `to`.
fn join(tiles: &[PathBuf], to: &Path) -> Result<PathBuf> {
    match tiles {
        [] => Err(Error::of(
            Problem::TooFew,
            "a drive has no points",
            "see its page",
        )),
        [one] => Ok(one.clone()),
        [first, ..] => {
            let mut corner = None;
            format::stream_las(first, &mut |points| {
                corner = corner.or_else(|| points.first().copied());
                Ok(())
            })?;
            let mut writer = CloudWriter::create(to, corner.unwrap_or_default())?;
            for tile in tiles {
                format::stream_las(tile, &mut |points| {
                    let mut points = points.iter();
                    points.try_for_each(|point| writer.write(point, 0.0, 0.0, 0))
                })?;
            }
            writer.finish()?;
            Ok(to.to_owned())
        }
    }
}
