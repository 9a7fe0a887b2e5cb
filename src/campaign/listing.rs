//! The files of a campaign's folder.

use std::collections::BTreeSet;
use std::path::Path;

use super::pattern::{Pattern, Place};
use crate::error::{Error, Result};

/// Depth of the subfolders that are searched.
const DEEPEST: usize = 8;

/// The files below a folder, relative to it, with `/` between folders.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Listing(BTreeSet<String>);

impl FromIterator<String> for Listing {
    fn from_iter<T: IntoIterator<Item = String>>(files: T) -> Self {
        Self(files.into_iter().collect())
    }
}

impl Listing {
    /// Lists a folder, without hidden folders and without the folder of the results, `without`.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn of_folder(folder: &Path, without: &Path) -> Result<Self> {
        let mut listing = Self::default();
        listing.add(folder, "", without, DEEPEST)?;
        Ok(listing)
    }

    fn add(&mut self, folder: &Path, prefix: &str, without: &Path, depth: usize) -> Result<()> {
        let failed = |error| Error::io(folder, error);
        for entry in std::fs::read_dir(folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let (path, name) = (entry.path(), entry.file_name());
            // Names that are not UTF-8 cannot be matched by a pattern.
            let Some(name) = name.to_str().filter(|name| !name.starts_with('.')) else {
                continue;
            };
            let relative = format!("{prefix}{name}");
            if path.is_file() {
                self.0.insert(relative);
            } else if path.is_dir() && depth > 0 && path != without {
                self.add(&path, &format!("{relative}/"), without, depth - 1)?;
            }
        }
        Ok(())
    }

    /// Whether the file exists.
    pub fn has(&self, file: &str) -> bool {
        self.0.contains(file)
    }

    /// Files below a folder.
    pub fn below<'a>(&'a self, folder: &'a str) -> impl Iterator<Item = &'a str> {
        let prefix = format!("{folder}/");
        let files = self.0.range(prefix.clone()..);
        files
            .map(String::as_str)
            .take_while(move |file| file.starts_with(&prefix))
    }

    /// Files and folders that match the pattern, in order.
    pub fn matching(&self, pattern: &Pattern) -> Vec<(Place, String)> {
        let depth = pattern.depth();
        let mut paths: Vec<&str> = Vec::new();
        for file in &self.0 {
            let mut ends = file
                .match_indices('/')
                .map(|(at, _)| at)
                .chain([file.len()]);
            let path = ends.nth(depth - 1).map(|end| &file[..end]);
            // Files of one folder are consecutive.
            if path.is_some() && path != paths.last().copied() {
                paths.extend(path);
            }
        }
        let places = paths.into_iter();
        places
            .filter_map(|path| Some((pattern.place_of(path)?, path.to_owned())))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_and_folders_match() {
        let files = [
            "a/2025-05-01/l.bin",
            "a/2025-05-01/r.bin",
            "a/2025-05-02/l.bin",
            "a/notes.txt",
            "b/x",
        ];
        let listing: Listing = files.map(str::to_owned).into_iter().collect();
        let matches = listing.matching(&Pattern::new("{plot}/{date}").unwrap());
        let paths: Vec<&str> = matches.iter().map(|(_, path)| path.as_str()).collect();
        assert_eq!(paths, ["a/2025-05-01", "a/2025-05-02"]);
        let matches = listing.matching(&Pattern::new("a/*.txt").unwrap());
        assert_eq!(matches.len(), 1);
        assert_eq!(listing.below("a/2025-05-01").count(), 2);
    }

    #[test]
    fn hidden_files_and_results_are_not_listed() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a/x.bin", ".hidden/y.bin", "out/z.bin", "a/.w"] {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "x").unwrap();
        }
        let listing = Listing::of_folder(folder.path(), &folder.path().join("out")).unwrap();
        assert_eq!(listing, ["a/x.bin".to_owned()].into_iter().collect());
    }
}
