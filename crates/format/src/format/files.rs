//! All files that are read together with a file.

use std::path::{Path, PathBuf};

use super::detect::detect;
use super::file::file_of;
use super::recorded;

/// All files that are read for this path: its own file, and the files that belong to it. Some of these may be
/// missing.
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    let file = file_of(path);
    let list_companions = detect(&file).ok().and_then(|format| format.0.beside);
    let companions = list_companions.map_or(Vec::new(), |list| list(&file));
    let recorded = recorded::beside(&file);
    std::iter::once(file)
        .chain(companions)
        .chain(recorded)
        .collect()
}
