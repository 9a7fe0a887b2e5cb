//! All files of what is named by one.

use std::path::{Path, PathBuf};

use super::detect::detect;
use super::file::file_of;
use super::recorded;

/// The files that are read where this path is named: the file of it, and those that belong to it, of which some may
/// be missing.
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    let file = file_of(path);
    let beside = detect(&file).ok().and_then(|format| format.0.beside);
    let others = beside.map_or(Vec::new(), |of| of(&file));
    let recorded = recorded::beside(&file);
    std::iter::once(file)
        .chain(others)
        .chain(recorded)
        .collect()
}
