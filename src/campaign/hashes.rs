//! The hashes of the inputs of a campaign; each file is read once.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{Result, unless_cancelled};
use crate::output::write_whole;
use crate::pipeline::{hash_of, size};
use crate::progress::Progress;

/// The hash of a file with the properties that it had when it was read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Known {
    bytes: u64,
    /// The modification time, nanoseconds since 1970.
    changed_ns: i128,
    hash: String,
}

/// The file in the folder of the results where hashes are stored.
const FILE: &str = "hashes.json";

/// Hashes of the files of a campaign's folder by their names. A file with the same size and time as in an earlier call
/// is not read again. A file that cannot be read has no hash; the item that needs it reports the error.
///
/// # Errors
/// The hashes cannot be stored; [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn hashes(
    files: &[String],
    root: &Path,
    out: &Path,
    progress: &dyn Progress,
) -> Result<BTreeMap<String, String>> {
    let path = out.join(FILE);
    let stored = fs::read_to_string(&path).ok();
    // A file that is not a list of hashes is replaced.
    let stored: BTreeMap<String, Known> = stored
        .and_then(|text| serde_json::from_str(&text).ok())
        .unwrap_or_default();
    let listed: Vec<_> = files
        .iter()
        .map(|file| (file, properties(&root.join(file))))
        .collect();
    let unchanged = |file: &String, (bytes, changed_ns): (u64, i128)| {
        stored
            .get(file)
            .filter(|known| (known.bytes, known.changed_ns) == (bytes, changed_ns))
    };
    let is_new = |(file, properties): &&(&String, Option<(u64, i128)>)| {
        properties.is_some_and(|properties| unchanged(file, properties).is_none())
    };
    let total = listed
        .iter()
        .filter(is_new)
        .map(|(file, _)| size(&root.join(file)))
        .sum();
    let stage = progress.stage("reading inputs", total);
    let known = listed.par_iter().map(|(file, properties)| {
        let Some(properties) = *properties else {
            return Ok(None);
        };
        if let Some(known) = unchanged(file, properties) {
            return Ok(Some(((*file).clone(), known.clone())));
        }
        let hash = unless_cancelled(hash_of(&root.join(file), &|bytes| stage.advance(bytes)))?;
        Ok(hash.map(|hash| {
            let known = Known {
                bytes: properties.0,
                changed_ns: properties.1,
                hash: format!("{hash:032x}"),
            };
            ((*file).clone(), known)
        }))
    });
    let known: BTreeMap<String, Known> = known
        .collect::<Result<Vec<_>>>()?
        .into_iter()
        .flatten()
        .collect();
    drop(stage);
    let text = serde_json::to_string_pretty(&known).unwrap_or_default();
    write_whole(&path, (text + "\n").as_bytes())?;
    Ok(known
        .into_iter()
        .map(|(file, known)| (file, known.hash))
        .collect())
}

/// Size and modification time of a file; `None` if it does not exist.
fn properties(path: &Path) -> Option<(u64, i128)> {
    let metadata = path.metadata().ok().filter(fs::Metadata::is_file)?;
    let changed = metadata.modified().ok()?;
    let changed_ns = match changed.duration_since(SystemTime::UNIX_EPOCH) {
        Ok(since) => since.as_nanos().cast_signed(),
        // Copies may have times before 1970.
        Err(before) => -before.duration().as_nanos().cast_signed(),
    };
    Some((metadata.len(), changed_ns))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    #[test]
    fn only_changed_files_are_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let (root, out) = (folder.path(), folder.path().join("out"));
        fs::write(root.join("a"), "one").unwrap();
        fs::write(root.join("b"), "two").unwrap();
        let files = ["a", "b", "missing"].map(str::to_owned);
        let first = hashes(&files, root, &out, &Silent).unwrap();
        assert_eq!(first.len(), 2);
        assert_eq!(first["a"].len(), 32);
        // The stored hash is used, which shows that the file was not read again.
        let stored = fs::read_to_string(out.join(FILE))
            .unwrap()
            .replace(&first["a"], "kept");
        fs::write(out.join(FILE), stored).unwrap();
        fs::write(root.join("b"), "three").unwrap();
        let second = hashes(&files, root, &out, &Silent).unwrap();
        assert_eq!(second["a"], "kept");
        assert_ne!(second["b"], first["b"]);
    }

    #[test]
    fn a_file_from_before_1970_has_a_hash() {
        let folder = tempfile::tempdir().unwrap();
        let (root, out) = (folder.path(), folder.path().join("out"));
        fs::write(root.join("a"), "one").unwrap();
        let file = fs::File::options()
            .write(true)
            .open(root.join("a"))
            .unwrap();
        let old = SystemTime::UNIX_EPOCH - std::time::Duration::from_millis(1500);
        file.set_modified(old).unwrap();
        let files = ["a".to_owned()];
        let first = hashes(&files, root, &out, &Silent).unwrap();
        assert_eq!(first.len(), 1);
        assert_eq!(hashes(&files, root, &out, &Silent).unwrap(), first);
    }
}
