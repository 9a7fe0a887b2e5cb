//! The work of one item.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};

use super::item::{self, Failure, Item, MountingsFrom, ProjectText, Task};
use crate::comparison::ComparisonSettings;
use crate::error::{Error, Location, Result};
use crate::output::Staging;
use crate::pipeline::{self, Options, Rig, Tile, hash_of};
use crate::progress::Progress;
use crate::project::Project;
use crate::tiles::peak_memory_bytes;
use crate::verdict::Verdict;

/// Runs an item: its results appear in its folder below `out`, `result.json` last. `root` is the campaign's folder. A
/// finished item is left unchanged. `memory_bytes` is the limit for stages that can work with less memory.
///
/// # Errors
/// Errors of the stages; for a refused item, the error that planning found.
pub fn work(
    item: &Item,
    root: &Path,
    out: &Path,
    memory_bytes: Option<u64>,
    progress: &dyn Progress,
) -> Result<()> {
    if item.is_finished(out) {
        return Ok(());
    }
    let started = Instant::now();
    check_inputs(item, root)?;
    let folder = item.folder(out);
    let options = Options {
        out: folder.clone(),
        seed: None,
        fresh: false,
        kept: Vec::new(),
    };
    let done = results(item, root, out, &options, memory_bytes, progress);
    let mut result = done.inspect_err(|_| {
        // Removes the folder only if it is empty.
        let _ = fs::remove_dir(&folder);
    })?;
    strip_times(&mut result);
    result["item"] = json!({ "kind": item.kind, "plot": item.plot, "date": item.date, "before": item.before,
        "inputs": item.inputs, "needs": item.needs });
    let work = json!({
        "seconds": started.elapsed().as_secs_f64(),
        "peak_memory_bytes": peak_memory_bytes(),
        "host": sysinfo::System::host_name(),
    });
    let staging = Staging::new(&folder, &[], &[item::RESULT, item::WORK])?;
    for (name, document) in [(item::RESULT, result), (item::WORK, work)] {
        let path = staging.path(name);
        fs::write(&path, format!("{document:#}\n")).map_err(|error| Error::io(&path, error))?;
    }
    staging.commit()?;
    remove_failure(item, out)
}

/// Writes the results of an item except for the two files that come last; returns the content of `result.json`.
fn results(
    item: &Item,
    root: &Path,
    out: &Path,
    options: &Options,
    memory_bytes: Option<u64>,
    progress: &dyn Progress,
) -> Result<Value> {
    Ok(match &item.task {
        Task::Calibration { project } => {
            // Only the main drive is processed, and only its files are inputs.
            let project = project.project(root)?.alone();
            project.check_files()?;
            let done = pipeline::calibrate(&project, options, progress)?;
            move_paths(&done.files, root, &options.out)?;
            done.result
        }
        Task::Drive {
            project,
            mountings,
            reference,
            tile_m,
        } => {
            let (project, rig, verdict) = placed(project, mountings, root, out)?;
            let project = match reference {
                Some(path) => project.with_reference(Some(root.join(path))),
                None => project,
            };
            project.check_files()?;
            let name = item.to_string();
            pipeline::field(&project, &rig, &name, *tile_m, verdict, options, progress)?.result
        }
        Task::Change { comparison } => change(item, comparison, memory_bytes, out, progress)?,
        Task::Overlap { project, mountings } => {
            let (project, rig, _) = placed(project, mountings, root, out)?;
            let project = project.with_reference(None);
            project.check_files()?;
            json!({ "overlap": pipeline::overlap(&project, &rig, progress)? })
        }
        Task::Refused(Failure { problem, remedy }) => {
            return Err(Error::data(problem, remedy.clone().unwrap_or_default()));
        }
    })
}

/// Makes the paths in texts relative to a campaign's folder, because items may also be run in copies of it.
fn move_paths(texts: &[PathBuf], root: &Path, folder: &Path) -> Result<()> {
    let staging = Staging::new(folder, &[], &[] as &[&str])?;
    let prefix = format!("{}/", root.display());
    for path in texts {
        let text = fs::read_to_string(path).map_err(|error| Error::io(path, error))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let staged = staging.path(&name);
        fs::write(&staged, text.replace(&prefix, "")).map_err(|error| Error::io(&staged, error))?;
    }
    staging.commit()
}

/// Checks that inputs have not changed since the item was named.
///
/// # Errors
/// The file that has changed.
fn check_inputs(item: &Item, root: &Path) -> Result<()> {
    for input in &item.inputs {
        let path = root.join(&input.path);
        // An unreadable file is reported by the stage that needs it.
        let (Some(known), Ok(now)) = (&input.hash, hash_of(&path, &|_| Ok(()))) else {
            continue;
        };
        if *known != format!("{now:032x}") {
            return Err(Error::data(
                format!(
                    "{} has changed since the campaign was planned",
                    path.display()
                ),
                "run the campaign again: the changed drive is then a new item",
            ));
        }
    }
    Ok(())
}

/// Removes the temporary files that a process left in the item's folder when it ended in the middle of the work.
pub fn clean(item: &Item, out: &Path) {
    let folder = item.folder(out);
    if folder.is_dir() && !item.is_finished(out) {
        // Another process that runs the same item keeps its files; remaining files are removed by the next attempt.
        drop(Staging::new(&folder, &[], &[] as &[&str]));
        let _ = fs::remove_dir(&folder);
    }
}

/// Removes the failure of an earlier attempt at the item.
///
/// # Errors
/// The file cannot be removed.
fn remove_failure(item: &Item, out: &Path) -> Result<()> {
    let path = item::failure_of(out, &item.name);
    match fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::io(&path, error)),
        _ => Ok(()),
    }
}

/// Removes times and memory, which differ between runs and are written to [`item::WORK`].
fn strip_times(result: &mut Value) {
    match result {
        Value::Object(map) => {
            map.retain(|key, _| {
                !matches!(key.as_str(), "seconds" | "stages" | "peak_memory_bytes")
            });
            map.values_mut().for_each(strip_times);
        }
        Value::Array(list) => list.iter_mut().for_each(strip_times),
        _ => {}
    }
}

/// The project of a drive, its scanners, and the verdict on their mountings.
fn placed(
    project: &ProjectText,
    mountings: &MountingsFrom,
    root: &Path,
    out: &Path,
) -> Result<(Project, Rig, Option<Verdict>)> {
    // A calibration is not evaluated in a campaign.
    let project = project.project(root)?.alone();
    let calibration = match mountings {
        MountingsFrom::Project => None,
        MountingsFrom::File(path) => Some(root.join(path)),
        MountingsFrom::Item(name) => Some(item::folder_of(out, name).join("calibration.toml")),
    };
    let (rig, verdict) = match calibration {
        Some(path) => {
            let rig = Rig::calibrated(&project, &path)?;
            (rig, pipeline::marked_unusable(&path)?)
        }
        None => (Rig::new(&project), None),
    };
    Ok((project, rig, verdict))
}

/// Compares the tiles of two drives.
fn change(
    item: &Item,
    settings: &ComparisonSettings,
    memory_bytes: Option<u64>,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Value> {
    let [earlier, later] = item.needs.as_slice() else {
        return Err(Error::data(
            "a change without two drives",
            "plan the campaign again",
        ));
    };
    let [earlier, later] = [earlier, later].map(|name| tiles_of(out, name));
    let tiles = [earlier?, later?];
    let dates = [&item.before, &item.date].map(|date| date.as_deref().unwrap_or_default());
    let plot = item.plot.as_deref().unwrap_or_default();
    let statistics = pipeline::compare::change::change(
        [&tiles[0], &tiles[1]],
        plot,
        dates,
        settings,
        memory_bytes,
        &item.folder(out),
        progress,
    )?;
    Ok(json!({ "change": statistics }))
}

/// The files of a drive's tiles.
fn tiles_of(out: &Path, name: &str) -> Result<Vec<PathBuf>> {
    let folder = item::folder_of(out, name);
    let path = folder.join(item::RESULT);
    let text = fs::read_to_string(&path).map_err(|error| Error::io(&path, error))?;
    let tiles: Option<Vec<Tile>> = serde_json::from_str::<Value>(&text)
        .ok()
        .and_then(|mut result| serde_json::from_value(result["tiles"].take()).ok());
    let tiles = tiles.ok_or_else(|| {
        let (found, expected) = ("no list of tiles", "the result of a drive");
        Error::format(&path, Location::Whole, found, expected)
    })?;
    let files = tiles
        .iter()
        .map(|tile| folder.join("tiles").join(&tile.file));
    Ok(files.collect())
}
