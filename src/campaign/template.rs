//! A project template that is read as if it were in the folder of each drive.

use std::path::Path;

use toml::Value;

use super::listing::Listing;
use super::pattern::Pattern;
use crate::error::{Error, Location, Problem, Result};

/// Keys whose values are file names.
const FILES: [&str; 3] = ["file", "profiles", "logo"];

/// The text, with names that contain a `*` replaced by those of the matching files below `folder`.
///
/// # Errors
/// Text that is not TOML; a name that no file matches.
pub fn filled(text: &str, template: &Path, folder: &str, listing: &Listing) -> Result<String> {
    if !text.contains('*') {
        return Ok(text.to_owned());
    }
    let mut table: toml::Table = toml::from_str(text).map_err(|error| {
        let found = format!("invalid TOML ({})", error.message().replace('\n', "; "));
        Error::format(template, Location::Whole, found, "valid TOML")
    })?;
    fill_table(&mut table, &|name| find(name, folder, listing))?;
    Ok(table.to_string())
}

type Find<'a> = dyn Fn(&str) -> Result<Vec<String>> + 'a;

fn fill_table(table: &mut toml::Table, find: &Find<'_>) -> Result<()> {
    for (key, value) in table.iter_mut() {
        match value {
            Value::Table(inner) => fill_table(inner, find)?,
            Value::String(_) | Value::Array(_) if FILES.contains(&key.as_str()) => {
                *value = names(value, find)?
            }
            Value::Array(list) => {
                for inner in list.iter_mut().filter_map(Value::as_table_mut) {
                    fill_table(inner, find)?;
                }
            }
            _ => {}
        }
    }
    Ok(())
}

/// Expands a name or a list of names; a single file stays a name instead of a list.
fn names(value: &Value, find: &Find<'_>) -> Result<Value> {
    let given: Vec<&Value> = value
        .as_array()
        .map_or(vec![value], |list| list.iter().collect());
    let mut files = Vec::new();
    for name in given {
        match name.as_str() {
            Some(pattern) if pattern.contains('*') => {
                files.extend(find(pattern)?.into_iter().map(Value::String))
            }
            _ => files.push(name.clone()),
        }
    }
    Ok(match <[Value; 1]>::try_from(files) {
        Ok([one]) => one,
        Err(all) => Value::Array(all),
    })
}

/// Matching files below the folder, relative to it.
fn find(name: &str, folder: &str, listing: &Listing) -> Result<Vec<String>> {
    let refused =
        |(found, expected): (String, &str)| Error::data(found, format!("expected {expected}"));
    let pattern = Pattern::new(name).map_err(refused)?;
    let relative = |file: &str| file[folder.len() + 1..].to_owned();
    let files = listing.below(folder).map(relative);
    let matches: Vec<String> = files
        .filter(|file| pattern.place_of(file).is_some())
        .collect();
    if matches.is_empty() {
        Err(Error::of(
            Problem::TooFew,
            format!("no file `{name}` in {folder}"),
            "add it, or change the name in the template",
        ))
    } else {
        Ok(matches)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_filled_from_the_folder() {
        let files = [
            "p/1/scans/a_l.bin",
            "p/1/scans/b_l.bin",
            "p/1/scans/a_r.bin",
            "p/1/poses.trj",
        ];
        let listing: Listing = files.map(str::to_owned).into_iter().collect();
        let text = "[trajectory]\nfile = \"*.trj\"\n[[scanner]]\nname = \"left*\"\nprofiles = \"scans/*_l.bin\"\n\
                    [[scanner]]\nname = \"right\"\nprofiles = [\"scans/*_r.bin\"]\n";
        let filled = filled(text, Path::new("robot.toml"), "p/1", &listing).unwrap();
        let table: toml::Table = toml::from_str(&filled).unwrap();
        assert_eq!(table["trajectory"]["file"].as_str(), Some("poses.trj"));
        assert_eq!(table["scanner"][0]["profiles"].as_array().unwrap().len(), 2);
        assert_eq!(table["scanner"][0]["name"].as_str(), Some("left*"));
        assert_eq!(
            table["scanner"][1]["profiles"].as_str(),
            Some("scans/a_r.bin")
        );
        let missing = super::filled(
            "file = \"*.csv\"\n",
            Path::new("robot.toml"),
            "p/1",
            &listing,
        );
        assert!(missing.unwrap_err().to_string().contains("*.csv"));
    }
}
