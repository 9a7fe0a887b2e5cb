//! Whether the files of a folder are those of one drive.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::files::SortedFiles;
use super::turning::Turning;
use crate::error::{Error, Result};
use crate::format::Input;

/// Files that were recorded at the same time.
struct Group<'a> {
    end_s: f64,
    files: Vec<&'a Path>,
}

/// Checks that the files are those of one drive: the profiles of several would become as many scanners, on the poses of one.
///
/// # Errors
/// Two drives or more.
pub fn check(folder: &Path, files: &SortedFiles, name_of: impl Fn(&Path) -> String) -> Result<()> {
    let mut drives = by_time(files);
    let mut why = "";
    if drives.len() < 2 {
        drives = by_folder(files, name_of);
    }
    if drives.len() < 2 {
        drives = by_turning(folder, files);
        why = ", which turn differently at the same times";
    }
    if drives.len() < 2 {
        return Ok(());
    }
    let text = |files: &Vec<&Path>| {
        let names: Vec<String> = files
            .iter()
            .map(|path| path.display().to_string())
            .collect();
        names.join(", ")
    };
    let listed: Vec<String> = drives.iter().map(text).collect();
    let folders: BTreeSet<PathBuf> = drives.iter().flatten().map(|path| top(path)).collect();
    let have_folders = folders.len() == drives.len() && !folders.contains(Path::new(""));
    let remedy = if have_folders {
        let commands = folders
            .iter()
            .map(|top| format!("boresight init {}", folder.join(top).display()));
        format!(
            "make a project of each: {}",
            commands.collect::<Vec<_>>().join("; ")
        )
    } else {
        "move the files of each drive into a folder of its own, and make a project of each with boresight init FOLDER"
            .to_owned()
    };
    Err(Error::data(
        format!(
            "{} holds the files of {} drives: {}{why}",
            folder.display(),
            drives.len(),
            listed.join("; ")
        ),
        format!("{remedy}; [[drive]] or [[evaluation]] in one of them then names the others"),
    ))
}

/// The drives by the times of their files: sets of logs and profiles that do not overlap, each with profiles and with an
/// IMU or poses; without a scanner, with an IMU. Logs on another clock alone are no drive.
fn by_time(files: &SortedFiles) -> Vec<Vec<&Path>> {
    let motion = |path: &PathBuf| files.imu.contains(path) || files.poses.contains(path);
    let is_of_drive = |path: &PathBuf| {
        let positions = files.prism.iter().chain(&files.gnss);
        motion(path)
            || files.profiles.contains(path)
            || positions.chain(&files.heading).any(|p| p == path)
    };
    let spans = files.uses.iter().filter(|file| is_of_drive(&file.path));
    let mut spans: Vec<_> = spans
        .filter_map(|file| Some((file.span_s?, file.path.as_path())))
        .collect();
    spans.sort_by(|a, b| a.0[0].total_cmp(&b.0[0]));
    let mut groups: Vec<Group<'_>> = Vec::new();
    for ([first_s, last_s], path) in spans {
        match groups.last_mut().filter(|group| first_s <= group.end_s) {
            Some(group) => {
                group.end_s = group.end_s.max(last_s);
                group.files.push(path);
            }
            None => groups.push(Group {
                end_s: last_s,
                files: vec![path],
            }),
        }
    }
    let groups = groups.into_iter().map(|group| group.files);
    let has = |group: &[&Path], what: &dyn Fn(&PathBuf) -> bool| {
        group.iter().any(|path| what(&path.to_path_buf()))
    };
    let is_drive = |group: &Vec<&Path>| {
        if files.profiles.is_empty() {
            files.posed.is_empty() && has(group, &|path| files.imu.contains(path))
        } else {
            has(group, &motion) && has(group, &|path| files.profiles.contains(path))
        }
    };
    groups.filter(is_drive).collect()
}

/// The drives by their folders, if the profiles of a scanner are in several.
fn by_folder(files: &SortedFiles, name_of: impl Fn(&Path) -> String) -> Vec<Vec<&Path>> {
    let profiles = files.profiles.iter();
    let named: BTreeSet<(String, PathBuf)> = profiles
        .clone()
        .map(|path| (name_of(path), top(path)))
        .collect();
    let names: BTreeSet<&String> = named.iter().map(|(name, _)| name).collect();
    let tops: BTreeSet<&PathBuf> = named.iter().map(|(_, top)| top).collect();
    // Every scanner in a folder of its own is one drive.
    if names.len() == named.len() || tops.len() < 2 {
        return Vec::new();
    }
    let of = |folder: &PathBuf| -> Vec<&Path> {
        let inside = files.profiles.iter().filter(|path| top(path) == *folder);
        inside.map(PathBuf::as_path).collect()
    };
    tops.into_iter().map(of).collect()
}

/// The drives by the rates at which they turn: logs of an IMU or poses of the same times, as the time of the day and times
/// that start at 0 are in every drive.
fn by_turning<'a>(folder: &Path, files: &'a SortedFiles) -> Vec<Vec<&'a Path>> {
    if files.turnings.len() + files.poses.len() < 2 {
        return Vec::new();
    }
    let of_imus = files.turnings.iter();
    let of_imus = of_imus.map(|(path, turning)| (path, Cow::Borrowed(turning)));
    let of_poses = files.poses.iter().filter_map(|path| {
        let turning = Turning::of_poses(&Input::from(&folder.join(path)))?;
        Some((path, Cow::Owned(turning)))
    });
    let mut drives: Vec<(Cow<'_, Turning>, Vec<&Path>)> = Vec::new();
    for (path, turning) in of_imus.chain(of_poses) {
        match drives
            .iter_mut()
            .find(|(first, _)| !first.differs_from(&turning))
        {
            Some((_, paths)) => paths.push(path),
            None => drives.push((turning, vec![path])),
        }
    }
    drives.into_iter().map(|(_, paths)| paths).collect()
}

/// The first folder of a relative path; empty for a file.
fn top(path: &Path) -> PathBuf {
    let first = path.parent().and_then(|parent| parent.components().next());
    first
        .map(|first| PathBuf::from(first.as_os_str()))
        .unwrap_or_default()
}
