//! Checks that the cloud writers make before they write.

use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::cloud::sink::{CloudPoint, CloudShape};

/// Checks that the position of a point is finite: readers would take the point for one that was not measured.
///
/// # Errors
/// A position that is not finite.
pub(crate) fn check_position(path: &Path, point: &CloudPoint<'_>) -> Result<()> {
    let p = point.position;
    if p.iter().all(|v| v.is_finite()) {
        return Ok(());
    }
    Err(Error::data(
        format!(
            "{}: the point ({}, {}, {}) m at {} s is not finite",
            path.display(),
            p.x,
            p.y,
            p.z,
            point.time_s
        ),
        "leave out points without a position",
    ))
}

/// The names of the dimensions of `shape` for a format whose names have only ASCII letters, digits,
/// `-` and `_` and begin with a letter or `_`. Each other character becomes `_`, and a `_` is put before
/// a first character that is a digit or `-`. `reserved` are the names of the standard values.
///
/// # Errors
/// A name that is empty, not unique or reserved; case is ignored, since readers may ignore it.
pub(crate) fn plain_names(
    path: &Path,
    shape: &CloudShape,
    reserved: &[&str],
) -> Result<Vec<String>> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    let mut names: Vec<String> = Vec::new();
    for dimension in &shape.dimensions {
        let mut name = dimension.name.replace(|c| !is_plain(c), "_");
        if name.starts_with(|c: char| c.is_ascii_digit() || c == '-') {
            name.insert(0, '_');
        }
        let is_taken = |other: &&str| other.eq_ignore_ascii_case(&name);
        let mut others = reserved.iter().copied().chain(names.iter().map(|n| &**n));
        if name.is_empty() || others.any(|other| is_taken(&other)) {
            return Err(Error::format(
                path,
                Location::Whole,
                format!("the dimension `{}`, written as `{name}`", dimension.name),
                format!(
                    "names that differ from each other and from {}",
                    reserved.join(", ")
                ),
            ));
        }
        names.push(name);
    }
    Ok(names)
}
