//! Outputs that appear whole or not at all.
//!
//! Everything is written to a hidden folder beside its destination, flushed to disk and then
//! renamed into place, file by file. If the process is killed in between, every file is either the
//! old or the new one, never a partial one; the next run removes what was left behind. A file that cannot be renamed does
//! not keep back the others.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use same_file::is_same_file;

use crate::error::{Error, Location, Problem, Result, STAGING};

/// Renamed last, so that it never refers to files that are not there yet.
const LAST: &str = "result.json";

/// Distinguishes the staging folders of one process.
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
/// It holds a lock that the system releases when the process ends, however it ends; a staging
/// folder whose lock is free is a leftover. If dropped without [`Staging::commit`], it leaves
/// nothing behind.
#[derive(Debug)]
pub struct Staging {
    dir: PathBuf,
    folder: PathBuf,
    lock_path: PathBuf,
    _lock: File,
    inputs: Vec<PathBuf>,
    protected: Vec<PathBuf>,
}

impl Staging {
    /// Creates `dir` if it is missing and a staging folder in it, and removes the staging folders
    /// of killed runs. `inputs` are the files that the work reads, `names` those that it will write
    /// into `dir`: an output that would overwrite an input is refused here, before the work begins,
    /// or by [`Staging::commit`] if it was not named.
    ///
    /// # Errors
    /// `dir` cannot be created or written; an output would overwrite an input.
    pub fn new(dir: &Path, inputs: &[PathBuf], names: &[impl AsRef<Path>]) -> Result<Self> {
        protect_inputs(dir, inputs, names)?;
        if dir.exists() && !dir.is_dir() {
            let (found, expected) = ("a file", "a folder for the results, or an unused name");
            return Err(Error::format(dir, Location::Whole, found, expected));
        }
        fs::create_dir_all(dir).map_err(|e| Error::io(dir, e))?;
        remove_leftovers(dir)?;
        let name = format!("{STAGING}{}", unique());
        let folder = dir.join(&name);
        let lock_path = dir.join(format!("{name}.lock"));
        // Another process may take the new file for a leftover and remove it before it is locked.
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
                // The lock is ours and protects nothing, so a failure to remove it does no harm.
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
            protected: Vec::new(),
        })
    }

    /// Makes [`Staging::commit`] refuse what [`refuse_kept`] does.
    pub fn keep(&mut self, protected: &[PathBuf]) {
        self.protected = protected.to_vec();
    }

    /// The path at which to write the future file `name` of the destination; `name` may include
    /// subfolders, which are created.
    pub fn path(&self, name: &str) -> PathBuf {
        let path = self.folder.join(name);
        if let Some(parent) = path.parent() {
            // A failure shows up when the file itself is opened, with its name.
            let _ = fs::create_dir_all(parent);
        }
        path
    }

    /// Flushes every staged file to disk and renames the files into the destination in the order of
    /// their names, `result.json` last.
    ///
    /// # Errors
    /// If a file would overwrite an input, or one that is to be kept, nothing is renamed. If a file cannot be flushed or
    /// renamed, all others are, and the first error is returned.
    pub fn commit(self) -> Result<()> {
        let mut names = Vec::new();
        list_files(&self.folder, Path::new(""), &mut names)?;
        protect_inputs(&self.dir, &self.inputs, &names)?;
        refuse_kept(&self.dir, &names, &self.protected)?;
        names.sort_by_key(|name| (name == Path::new(LAST), name.clone()));
        let mut outcome = Ok(());
        let mut ready = Vec::new();
        let mut folders = BTreeSet::new();
        for name in &names {
            match self.prepare(name) {
                Ok(folder) => {
                    folders.insert(folder);
                    ready.push(name);
                }
                Err(error) => outcome = outcome.and(Err(error)),
            }
        }
        // The renames follow each other directly: a kill in between is unlikely.
        for name in ready {
            let target = self.dir.join(name);
            let renamed = fs::rename(self.folder.join(name), &target);
            outcome = outcome.and(renamed.map_err(|e| Error::io(&target, e)));
        }
        for folder in &folders {
            outcome = outcome.and(sync_folder(folder));
        }
        outcome
    }

    /// Flushes a staged file and creates the folder of its destination, which is returned.
    fn prepare(&self, name: &Path) -> Result<PathBuf> {
        let staged = self.folder.join(name);
        File::open(&staged)
            .and_then(|file| file.sync_all())
            .map_err(|e| Error::io(&staged, e))?;
        let target = self.dir.join(name);
        let parent = target.parent().unwrap_or(&self.dir);
        fs::create_dir_all(parent).map_err(|e| Error::io(parent, e))?;
        Ok(parent.to_owned())
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        // A failure cannot be handled here; the next run tries again.
        let _ = fs::remove_dir_all(&self.folder);
        let _ = fs::remove_file(&self.lock_path);
    }
}

/// Checks that none of the files `names` in `dir` is one of `inputs`, under whatever name or link,
/// so that no output overwrites an input.
///
/// # Errors
/// Names the input and the output that would overwrite it.
pub fn protect_inputs(dir: &Path, inputs: &[PathBuf], names: &[impl AsRef<Path>]) -> Result<()> {
    for target in names.iter().map(|name| dir.join(name)) {
        // Pipes are not regular files, and opening one could block forever.
        let same = |input: &&PathBuf| {
            target.is_file() && input.is_file() && is_same_file(input, &target).unwrap_or(false)
        };
        if let Some(input) = inputs.iter().find(same) {
            return Err(Error::of(
                Problem::WouldReplaceInput,
                format!(
                    "{} is an input and would be overwritten by the result {}",
                    input.display(),
                    target.display()
                ),
                "choose another name or another folder for the results",
            ));
        }
    }
    Ok(())
}

/// Names of the files and folders in `dir`, in order and without staging folders; none if `dir` cannot be read.
pub fn names_in(dir: &Path) -> BTreeSet<PathBuf> {
    let entries = fs::read_dir(dir).into_iter().flatten().flatten();
    let names = entries.map(|entry| PathBuf::from(entry.file_name()));
    names
        .filter(|name| !name.to_string_lossy().starts_with(STAGING))
        .collect()
}

/// Checks that none of the files `names` exists in `dir`, so that no file of the user is replaced.
///
/// # Errors
/// Names the first that exists.
pub fn refuse_existing(dir: &Path, names: &[impl AsRef<Path>]) -> Result<()> {
    let mut paths = names.iter().map(|name| dir.join(name));
    // A link that leads nowhere is a file of the user, too.
    match paths.find(|path| path.symlink_metadata().is_ok()) {
        None => Ok(()),
        Some(path) => Err(Error::of(
            Problem::WouldReplaceFile,
            format!("{} exists, and would be replaced", path.display()),
            "choose another name or another folder for the results; if files that exist there are not needed, use --force to \
             replace them",
        )),
    }
}

/// As [`refuse_existing`], but only for those of the files that are one of the files `kept` in `dir`, or in one of the
/// folders.
///
/// # Errors
/// Names the first that exists.
pub fn refuse_kept(dir: &Path, names: &[impl AsRef<Path>], kept: &[PathBuf]) -> Result<()> {
    let names = names.iter().map(AsRef::as_ref);
    let kept: Vec<&Path> = names
        .filter(|name: &&Path| kept.iter().any(|kept| name.starts_with(kept)))
        .collect();
    refuse_existing(dir, &kept)
}

/// Removes staging folders in `dir` whose lock is free.
fn remove_leftovers(dir: &Path) -> Result<()> {
    for entry in fs::read_dir(dir).map_err(|e| Error::io(dir, e))? {
        let path = entry.map_err(|e| Error::io(dir, e))?.path();
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            continue;
        };
        let Some(folder) = name
            .strip_suffix(".lock")
            .filter(|name| name.starts_with(STAGING))
        else {
            continue;
        };
        // Already removed by its owner or by another run.
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

/// Makes renames in `folder` survive a power failure, on systems that can sync folders.
fn sync_folder(folder: &Path) -> Result<()> {
    if cfg!(unix) {
        File::open(folder)
            .and_then(|file| file.sync_all())
            .map_err(|e| Error::io(folder, e))?;
    }
    Ok(())
}

/// Writes one file so that `path` always holds either its old or its new content. Its folder is
/// created if it is missing.
///
/// # Errors
/// The folder cannot be written; `path` is then unchanged.
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
    fn leftovers_of_killed_runs_are_removed_and_staging_in_use_is_not() {
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
    fn a_file_that_cannot_be_renamed_does_not_keep_back_the_others() {
        let dir = tempfile::tempdir().unwrap();
        // A folder and a file stand where a file and a folder shall be.
        fs::create_dir_all(dir.path().join("b.csv/of the user")).unwrap();
        fs::write(dir.path().join("c"), "of the user").unwrap();
        let staging = Staging::new(dir.path(), &[], &["a.csv"]).unwrap();
        for name in ["a.csv", "b.csv", "c/c.csv", "d/d.csv", "result.json"] {
            fs::write(staging.path(name), "result").unwrap();
        }
        let error = staging.commit().unwrap_err().to_string();
        let c = dir.path().join("c").display().to_string();
        assert!(error.starts_with(&c), "{error}");
        assert_eq!(
            names(dir.path()),
            ["a.csv", "b.csv", "c", "d", "result.json"]
        );
        assert_eq!(names(&dir.path().join("d")), ["d.csv"]);
        assert_eq!(fs::read(dir.path().join("c")).unwrap(), b"of the user");
        assert_eq!(names(&dir.path().join("b.csv")), ["of the user"]);
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
        // A copy is another file; refused runs left nothing behind.
        fs::copy(at("in.csv"), at("out/copy.csv")).unwrap();
        Staging::new(&at("out"), &inputs, &["copy.csv", "new.csv"]).unwrap();
        assert_eq!(names(&at("out")), ["copy.csv", "hard.csv", "soft.csv"]);
        // An output that was not named is refused before anything is renamed.
        let staging = Staging::new(dir.path(), &inputs, &["a.csv"]).unwrap();
        fs::write(staging.path("a.csv"), "result").unwrap();
        fs::write(staging.path("in.csv"), "result").unwrap();
        let error = staging.commit().unwrap_err().to_string();
        assert!(error.contains("in.csv is an input"), "{error}");
        assert_eq!(names(dir.path()), ["in.csv", "link", "out"]);
        assert_eq!(fs::read_to_string(at("in.csv")).unwrap(), "input");
    }

    #[test]
    fn existing_files_are_kept_on_request() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("b.csv"), "user").unwrap();
        refuse_existing(dir.path(), &["a.csv"]).unwrap();
        assert_eq!(names_in(dir.path()), BTreeSet::from(["b.csv".into()]));
        assert_eq!(names_in(&dir.path().join("new")), BTreeSet::new());
        let error = refuse_existing(dir.path(), &["a.csv", "b.csv"]).unwrap_err();
        assert!(error.to_string().contains("b.csv exists"), "{error}");
        let mut staging = Staging::new(dir.path(), &[], &["a.csv"]).unwrap();
        staging.keep(&["b.csv".into(), "c".into()]);
        for name in ["a.csv", "b.csv"] {
            fs::write(staging.path(name), "result").unwrap();
        }
        let error = staging.commit().unwrap_err();
        assert!(error.to_string().contains("--force"), "{error}");
        assert_eq!(names(dir.path()), ["b.csv"]);
        assert_eq!(
            fs::read_to_string(dir.path().join("b.csv")).unwrap(),
            "user"
        );
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
