//! Outputs that appear whole or not at all.
//!
//! Everything is written to a hidden folder beside its destination, flushed to the disk and then
//! renamed into place, file by file. Whoever is killed in between leaves each file either old or
//! new, never half; what was left behind is removed by the next run.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use same_file::is_same_file;

use crate::error::{Error, Location, Problem, Result};

/// Start of the names of staging folders; the lock beside each ends in `.lock`.
const PREFIX: &str = ".staging-";
/// Renamed last, so that it never speaks of files that are not there yet.
const LAST: &str = "result.json";

/// Distinguishes what one process writes at the same time.
static COUNTER: AtomicU64 = AtomicU64::new(0);

fn unique() -> String {
    format!(
        "{}-{}",
        std::process::id(),
        COUNTER.fetch_add(1, Ordering::Relaxed)
    )
}

/// A hidden folder in which the files of one result are written before they appear.
///
/// While it lives it holds a lock that the system releases with the process, however it ends; a
/// staging folder whose lock is free belongs to nobody. Dropped without [`Staging::commit`], it
/// leaves nothing behind.
#[derive(Debug)]
pub struct Staging {
    dir: PathBuf,
    folder: PathBuf,
    lock_path: PathBuf,
    _lock: File,
    inputs: Vec<PathBuf>,
}

impl Staging {
    /// Creates `dir` where it is missing and a staging folder in it, and removes those of runs
    /// that were killed. `inputs` are the files that the work reads and `names` those that it is
    /// going to write into `dir`: what would replace an input is refused here, before the work, and
    /// what was not named at the latest by [`Staging::commit`].
    ///
    /// # Errors
    /// `dir` cannot be created or written; see also [`keep_inputs`].
    pub fn new(dir: &Path, inputs: &[PathBuf], names: &[impl AsRef<Path>]) -> Result<Self> {
        keep_inputs(dir, inputs, names)?;
        if dir.exists() && !dir.is_dir() {
            let (found, expected) = ("a file", "a folder for the results, or a name still free");
            return Err(Error::format(dir, Location::Whole, found, expected));
        }
        fs::create_dir_all(dir).map_err(|e| Error::io(dir, e))?;
        remove_leftovers(dir)?;
        let name = format!("{PREFIX}{}", unique());
        let folder = dir.join(&name);
        let lock_path = dir.join(format!("{name}.lock"));
        // Another process may take the new file for a leftover before it is locked, and remove it.
        let lock = loop {
            let lock = File::create(&lock_path).map_err(|e| Error::io(&lock_path, e))?;
            lock.lock().map_err(|e| Error::io(&lock_path, e))?;
            if lock_path.exists() {
                break lock;
            }
        };
        match fs::create_dir(&folder) {
            Ok(()) => {}
            Err(e) => {
                // The lock is ours and nothing stands behind it; its removal may fail as well.
                let _ = fs::remove_file(&lock_path);
                return Err(Error::io(&folder, e));
            }
        }
        Ok(Self {
            dir: dir.to_owned(),
            folder,
            lock_path,
            _lock: lock,
            inputs: inputs.to_vec(),
        })
    }

    /// Where to write what shall become `name` in the destination; `name` may lie in subfolders,
    /// which are created.
    pub fn path(&self, name: &str) -> PathBuf {
        let path = self.folder.join(name);
        if let Some(parent) = path.parent() {
            // A failure shows when the file itself is opened, with its name.
            let _ = fs::create_dir_all(parent);
        }
        path
    }

    /// Flushes every staged file to the disk and renames them into the destination in the order
    /// of their names, `result.json` last.
    ///
    /// # Errors
    /// A file would replace an input, and none is renamed; a file cannot be flushed or renamed, and
    /// those already renamed are complete.
    pub fn commit(self) -> Result<()> {
        let mut names = Vec::new();
        list_files(&self.folder, Path::new(""), &mut names)?;
        keep_inputs(&self.dir, &self.inputs, &names)?;
        names.sort_by_key(|name| (name == Path::new(LAST), name.clone()));
        for name in &names {
            let staged = self.folder.join(name);
            File::open(&staged)
                .and_then(|file| file.sync_all())
                .map_err(|e| Error::io(&staged, e))?;
        }
        let mut folders = BTreeSet::new();
        for name in &names {
            let target = self.dir.join(name);
            let parent = target.parent().unwrap_or(&self.dir);
            fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
            folders.insert(parent.to_owned());
        }
        // Nothing slow stands between the renames: a kill in between is unlikely.
        for name in &names {
            let target = self.dir.join(name);
            fs::rename(self.folder.join(name), &target).map_err(|e| Error::io(&target, e))?;
        }
        folders.iter().try_for_each(|folder| sync_folder(folder))
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        // Nothing can be done about a failure here; the next run tries again.
        let _ = fs::remove_dir_all(&self.folder);
        let _ = fs::remove_file(&self.lock_path);
    }
}

/// Checks that none of the files `names` in `dir` is one of `inputs`, under whatever name and through
/// whatever links: nothing replaces what it was made from.
///
/// # Errors
/// Names the input, and what would replace it.
pub fn keep_inputs(dir: &Path, inputs: &[PathBuf], names: &[impl AsRef<Path>]) -> Result<()> {
    for target in names.iter().map(|name| dir.join(name)) {
        // Pipes are no files, and opening them might wait forever.
        let same = |input: &&PathBuf| {
            target.is_file() && input.is_file() && is_same_file(input, &target).unwrap_or(false)
        };
        if let Some(input) = inputs.iter().find(same) {
            return Err(Error::of(
                Problem::WouldReplaceInput,
                format!(
                    "{} is an input, and would be replaced by the result {}",
                    input.display(),
                    target.display()
                ),
                "choose another folder for the results (--out)",
            ));
        }
    }
    Ok(())
}

/// Removes staging folders in `dir` whose lock nobody holds.
fn remove_leftovers(dir: &Path) -> Result<()> {
    for entry in fs::read_dir(dir).map_err(|e| Error::io(dir, e))? {
        let path = entry.map_err(|e| Error::io(dir, e))?.path();
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            continue;
        };
        let Some(folder) = name
            .strip_suffix(".lock")
            .filter(|name| name.starts_with(PREFIX))
        else {
            continue;
        };
        // Gone in the meantime: its owner or another run has cleaned up.
        let Ok(lock) = File::open(&path) else {
            continue;
        };
        if lock.try_lock().is_ok() {
            let _ = fs::remove_dir_all(dir.join(folder));
            let _ = fs::remove_file(&path);
        }
    }
    Ok(())
}

/// Collects the files under `root/below`, as paths relative to `root`.
fn list_files(root: &Path, below: &Path, names: &mut Vec<PathBuf>) -> Result<()> {
    let folder = root.join(below);
    for entry in fs::read_dir(&folder).map_err(|e| Error::io(&folder, e))? {
        let entry = entry.map_err(|e| Error::io(&folder, e))?;
        let name = below.join(entry.file_name());
        if entry.path().is_dir() {
            list_files(root, &name, names)?;
        } else {
            names.push(name);
        }
    }
    Ok(())
}

/// Makes renames in `folder` survive a loss of power, where the system lets folders be synced.
fn sync_folder(folder: &Path) -> Result<()> {
    if cfg!(unix) {
        File::open(folder)
            .and_then(|file| file.sync_all())
            .map_err(|e| Error::io(folder, e))?;
    }
    Ok(())
}

/// Writes one file so that at any moment `path` holds either its old or its new content. Its folder
/// is created where it is missing.
///
/// # Errors
/// The folder cannot be written; `path` is then as it was.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let parent = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let staging = Staging::new(parent, &[], &[&*name])?;
    let staged = staging.path(&name);
    fs::write(&staged, bytes).map_err(|e| Error::io(&staged, e))?;
    staging.commit()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(dir)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn nothing_shows_before_the_commit_and_everything_after() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let staging = Staging::new(&out, &[], &["result.json"]).unwrap();
        fs::write(staging.path("result.json"), "{}").unwrap();
        fs::write(staging.path("drive-1/imu.csv"), "a").unwrap();
        assert!(!out.join("result.json").exists() && !out.join("drive-1").exists());
        staging.commit().unwrap();
        assert_eq!(names(&out), ["drive-1", "result.json"]);
        assert_eq!(
            fs::read_to_string(out.join("drive-1/imu.csv")).unwrap(),
            "a"
        );
    }

    #[test]
    fn a_dropped_staging_leaves_nothing_and_old_results_stay() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("result.json"), "old").unwrap();
        let staging = Staging::new(dir.path(), &[], &["kept"]).unwrap();
        fs::write(staging.path("result.json"), "new").unwrap();
        drop(staging);
        assert_eq!(names(dir.path()), ["result.json"]);
        assert_eq!(
            fs::read_to_string(dir.path().join("result.json")).unwrap(),
            "old"
        );
    }

    #[test]
    fn leftovers_of_the_dead_are_removed_and_those_of_the_living_are_not() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join(".staging-1-0")).unwrap();
        fs::write(dir.path().join(".staging-1-0/half.laz"), "half").unwrap();
        fs::write(dir.path().join(".staging-1-0.lock"), "").unwrap();
        let living = Staging::new(dir.path(), &[], &["kept"]).unwrap();
        fs::write(living.path("kept"), "kept").unwrap();
        let second = Staging::new(dir.path(), &[], &["kept"]).unwrap();
        assert!(!dir.path().join(".staging-1-0").exists());
        drop(second);
        living.commit().unwrap();
        assert_eq!(names(dir.path()), ["kept"]);
    }

    #[test]
    #[cfg(unix)]
    fn inputs_are_kept_under_every_name() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir(at("out")).unwrap();
        fs::write(at("in.csv"), "input").unwrap();
        let inputs = [at("in.csv")];
        let refused = |out: &Path, name: &str| {
            let error = Staging::new(out, &inputs, &[name]).unwrap_err().to_string();
            assert!(error.contains("in.csv is an input"), "{error}");
        };
        refused(dir.path(), "in.csv");
        refused(&at("out"), "../in.csv");
        std::os::unix::fs::symlink(at("in.csv"), at("out/soft.csv")).unwrap();
        refused(&at("out"), "soft.csv");
        fs::hard_link(at("in.csv"), at("out/hard.csv")).unwrap();
        refused(&at("out"), "hard.csv");
        std::os::unix::fs::symlink(dir.path(), at("link")).unwrap();
        refused(&at("link"), "in.csv");
        // A copy is another file; and nothing was left behind by what was refused.
        fs::copy(at("in.csv"), at("out/copy.csv")).unwrap();
        Staging::new(&at("out"), &inputs, &["copy.csv", "new.csv"]).unwrap();
        assert_eq!(names(&at("out")), ["copy.csv", "hard.csv", "soft.csv"]);
        // What was not named is refused before anything is renamed.
        let staging = Staging::new(dir.path(), &inputs, &["a.csv"]).unwrap();
        fs::write(staging.path("a.csv"), "result").unwrap();
        fs::write(staging.path("in.csv"), "result").unwrap();
        let error = staging.commit().unwrap_err().to_string();
        assert!(error.contains("in.csv is an input"), "{error}");
        assert_eq!(names(dir.path()), ["in.csv", "link", "out"]);
        assert_eq!(fs::read_to_string(at("in.csv")).unwrap(), "input");
    }

    #[test]
    fn a_single_file_is_replaced_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        write_whole(&path, b"first").unwrap();
        write_whole(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(names(dir.path()), ["a.txt"]);
        let error = write_whole(&path.join("b.txt"), b"x").unwrap_err();
        assert!(error.to_string().contains("found a file"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"second");
    }
}
