//! `campaign.toml`: the file as written, and the checked settings.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::pattern::Pattern;
use crate::comparison::ComparisonSettings;
use crate::error::Result;
use crate::project::{self, Source, Step, WrittenComparison};

/// Default side of a tile, metres: some plots, or a minute of a drive.
const TILE_M: f64 = 20.0;

/// `campaign.toml`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    campaign: Table,
    #[serde(default)]
    comparison: WrittenComparison,
}

/// `[campaign]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    title: Option<String>,
    drives: String,
    project: Option<PathBuf>,
    calibration: Option<String>,
    calibration_project: Option<String>,
    reference: Option<String>,
    compare_with_before: Option<bool>,
    tile_m: Option<f64>,
    drift: Option<bool>,
}

/// The contents of a campaign and the work on each drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Campaign {
    /// The file, absolute.
    pub path: PathBuf,
    /// Heading of the page.
    pub title: String,
    /// Project files of the drives, or their folders.
    pub drives: Pattern,
    /// The project of drives that are given as folders: it is read as if it were in each of them.
    pub template: Option<PathBuf>,
    /// `calibration.toml` files whose mountings replace those of the projects.
    pub calibration: Option<Pattern>,
    /// Projects that are calibrated first.
    pub calibration_project: Option<Pattern>,
    /// Reference clouds.
    pub reference: Option<Pattern>,
    /// Whether each plot is compared with its previous date.
    pub compare_with_before: bool,
    /// Side of the tiles of the clouds, metres.
    pub tile_m: f64,
    /// Whether the mountings are monitored by the ground that several scanners see.
    pub drift: bool,
    /// Settings of the comparisons between dates.
    pub comparison: ComparisonSettings,
}

impl Campaign {
    /// Reads and checks a campaign file. The files that it names are not opened.
    ///
    /// # Errors
    /// Names the file, the line, what was found and what was expected.
    pub fn read(path: &Path) -> Result<Self> {
        let source = &Source::read(path)?;
        let Written {
            campaign: table,
            comparison,
        } = source.parsed()?;
        let steps = |key| [Step::Key("campaign"), Step::Key(key)];
        let error = |key, found: String, expected| source.error(&steps(key), found, expected);
        let pattern = |key, text: &str| {
            let refused = |(found, expected)| error(key, found, expected);
            let is_outside =
                Path::new(text).is_absolute() || text.split('/').any(|part| part == "..");
            let pattern = Pattern::new(text).map_err(refused)?;
            if is_outside && pattern.is_open() {
                Err(error(
                    key,
                    format!("`{text}`, which leads out of the campaign's folder"),
                    "a pattern of paths below it",
                ))
            } else {
                Ok(pattern)
            }
        };
        let optional =
            |key, text: &Option<String>| text.as_ref().map(|text| pattern(key, text)).transpose();
        let drives = pattern("drives", &table.drives)?;
        if !drives.has_date() {
            let found = format!("`{}` without `{{date}}`", table.drives);
            return Err(error(
                "drives",
                found,
                "a pattern such as \"{date}/{plot}/project.toml\"",
            ));
        }
        if table.calibration.is_some() && table.calibration_project.is_some() {
            let found = "both `calibration` and `calibration_project`".into();
            return Err(error("calibration_project", found, "one of them"));
        }
        let tile_m = table.tile_m.unwrap_or(TILE_M);
        if !(tile_m.is_finite() && tile_m > 0.0) {
            return Err(error(
                "tile_m",
                format!("tile_m = {tile_m}"),
                "a number above 0",
            ));
        }
        Ok(Self {
            title: table.title.clone().unwrap_or_else(|| "Campaign".into()),
            drives,
            template: table.project.as_ref().map(|file| source.absolute(file)),
            calibration: optional("calibration", &table.calibration)?,
            calibration_project: optional("calibration_project", &table.calibration_project)?,
            reference: optional("reference", &table.reference)?,
            compare_with_before: table.compare_with_before.unwrap_or(true),
            tile_m,
            drift: table.drift.unwrap_or(false),
            comparison: project::comparison(source, &comparison)?,
            path: source.path.clone(),
        })
    }

    /// The folder of the file: patterns are relative to it.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new("."))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> std::result::Result<Campaign, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("campaign.toml");
        std::fs::write(&path, text).unwrap();
        Campaign::read(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn keys_have_defaults_and_mistakes_have_lines() {
        let campaign = read(
            "[campaign]\ndrives = \"{plot}/{date}\"\n[comparison]\ncylinder_radius_m = 0.01\n",
        )
        .unwrap();
        assert!(campaign.compare_with_before && campaign.tile_m == TILE_M);
        assert_eq!(campaign.comparison.cylinder_radius_m, 0.01);
        let cases = [
            ("[campaign]\ndrive = \"{date}\"\n", "line 2"),
            ("[campaign]\ndrives = \"{plot}\"\n", "without `{date}`"),
            ("[campaign]\ndrives = \"{day}\"\n", "`{plot}`, `{date}`"),
            (
                "[campaign]\ndrives = \"../{date}\"\n",
                "out of the campaign's folder",
            ),
            ("[campaign]\ndrives = \"{date}\"\ntile_m = 0.0\n", "line 3"),
            (
                "[campaign]\ndrives = \"{date}\"\ncalibration = \"a\"\ncalibration_project = \"b\"\n",
                "one of them",
            ),
            ("", "campaign"),
        ];
        for (text, expected) in cases {
            let error = read(text).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
