//! The outcome of a campaign: the index of its tiles, and its page.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::item::{self, Failure, Item, Kind};
use super::settings::Campaign;
use crate::drift::{Chart, ChartSettings, Overlap};
use crate::error::{Error, Location, Result};
use crate::format::{self, Extent};
use crate::judgement;
use crate::output::Staging;
use crate::pipeline::{self, Outcome, Tile};
use crate::report::campaign::{self as page, CampaignPage, ChangeLine, DriveLine, FailureLine};
use crate::verdict::Headline;

/// The page of a campaign.
pub const PAGE: &str = "campaign.html";
/// The content of the page, for programs.
pub const LIST: &str = "campaign.json";
/// The index of the tiles.
pub const INDEX: &str = "index.parquet";
/// The results of a campaign as a whole.
pub const RESULTS: [&str; 3] = [PAGE, LIST, INDEX];

/// Reads the results of the items from `out` and writes the index, the list and the page there. Failures of items that
/// are no longer planned, because their inputs have changed, are removed.
///
/// # Errors
/// A result that cannot be read, a file that cannot be written.
pub fn conclude(campaign: &Campaign, items: &[Item], out: &Path) -> Result<Outcome> {
    let staging = Staging::new(out, std::slice::from_ref(&campaign.path), &RESULTS)?;
    let mut page = CampaignPage {
        title: campaign.title.clone(),
        made_s: Some(pipeline::now_s()),
        ..CampaignPage::default()
    };
    let (mut extents, mut list, mut overlaps) = (Vec::new(), Vec::new(), Vec::new());
    let mut wkts: BTreeSet<Option<String>> = BTreeSet::new();
    for item in items {
        let result = document(item.folder(out).join(item::RESULT))?;
        let failed = document(item::failure_of(out, &item.name))?;
        let state = match (&result, &failed) {
            (Some(document), _) => {
                match document.parts() {
                    Ok(parts) => {
                        add(item, &document.content, parts.headline, &mut page);
                        if !parts.tiles.is_empty() {
                            wkts.insert(document.content["crs_wkt"].as_str().map(str::to_owned));
                        }
                        let date = || item.date.clone().unwrap_or_default();
                        overlaps.extend(parts.overlap.map(|overlap| (date(), overlap)));
                        extents.extend(parts.tiles.into_iter().map(|tile| extent(item, tile)));
                    }
                    Err(error) => {
                        let why = Failure::from(&error).relative_to(out);
                        page.failures.push(line(item.to_string(), why));
                    }
                }
                "finished"
            }
            (None, Some(failed)) => {
                let why = failed.part::<Failure>("error")?;
                page.failures
                    .extend(why.map(|why| line(item.to_string(), why)));
                "failed"
            }
            (None, None) => {
                page.waiting += 1;
                "waiting"
            }
        };
        list.push(
            json!({ "name": item.name, "kind": item.kind, "plot": item.plot, "date": item.date,
            "before": item.before, "state": state }),
        );
    }
    if !overlaps.is_empty() {
        match Chart::new(&overlaps, &[], &ChartSettings::default()) {
            Ok(chart) => page.drift = Some(chart),
            // The other items do not depend on the drift watch.
            Err(error) => {
                let watch = "drift watch".to_owned();
                page.failures.push(line(watch, Failure::from(&error)));
            }
        }
    }
    let mut written = vec![out.join(PAGE), out.join(LIST)];
    // A program that was built without Parquet writes no index.
    if cfg!(feature = "parquet") {
        let wkt = wkts.first().filter(|_| wkts.len() == 1);
        let wkt = wkt.and_then(Option::as_deref);
        format::write_extents(&staging.path(INDEX), &extents, wkt)?;
        page.index = Some(INDEX.to_owned());
        written.push(out.join(INDEX));
    }
    let result = json!({ "title": campaign.title, "items": list, "failed": page.failures.len(),
        "waiting": page.waiting, "drift": page.drift, "points": page.drives.iter().map(|drive| drive.points).sum::<u64>() });
    for (name, text) in [(LIST, format!("{result:#}\n")), (PAGE, page::render(&page))] {
        let path = staging.path(name);
        fs::write(&path, text).map_err(|error| Error::io(&path, error))?;
    }
    staging.commit()?;
    remove_stale_failures(items, out)?;
    Ok(Outcome {
        result,
        summary: summary(&page, items),
        files: written,
        verdicts: None,
    })
}

/// Removes the failures of all items that are not in the list.
fn remove_stale_failures(items: &[Item], out: &Path) -> Result<()> {
    let folder = out.join("failed");
    let Ok(entries) = fs::read_dir(&folder) else {
        return Ok(());
    };
    let planned: BTreeSet<&str> = items.iter().map(|item| item.name.as_str()).collect();
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_stem().and_then(|name| name.to_str());
        if name.is_none_or(|name| !planned.contains(name)) {
            fs::remove_file(&path).map_err(|error| Error::io(&path, error))?;
        }
    }
    // The folder is removed only if it is empty.
    let _ = fs::remove_dir(&folder);
    Ok(())
}

fn summary(page: &CampaignPage, items: &[Item]) -> String {
    let mut text = format!("{} items: {} failed", items.len(), page.failures.len());
    let unusable = page.drives.iter();
    let unusable = unusable.filter(|drive| drive.headline == Headline::Unusable);
    let unusable = unusable.count();
    if unusable > 0 {
        text += &format!(", {unusable} of {} drives not usable", page.drives.len());
    }
    if page.waiting > 0 {
        text += &format!(", {} not done yet", page.waiting);
    }
    for verdict in page.drift.iter().flat_map(judgement::drift) {
        if verdict.severity.is_marked() {
            text += &format!("\n! {}", verdict.text);
        }
    }
    for failure in &page.failures {
        text += &format!("\n  {}: {}", failure.item, failure.problem);
    }
    text
}

fn line(item: String, Failure { problem, remedy }: Failure) -> FailureLine {
    FailureLine {
        item,
        problem,
        remedy,
    }
}

/// The result of an item.
struct Document {
    path: PathBuf,
    content: Value,
}

impl Document {
    /// A part of the document, if it exists.
    fn part<T: DeserializeOwned>(&self, key: &str) -> Result<Option<T>> {
        let Some(part) = self.content.get(key) else {
            return Ok(None);
        };
        T::deserialize(part)
            .map(Some)
            .map_err(|error| self.error(format!("an unreadable `{key}` ({error})")))
    }

    fn parts(&self) -> Result<Parts> {
        Ok(Parts {
            headline: self.part("headline")?,
            tiles: self.part("tiles")?.unwrap_or_default(),
            overlap: self.part("overlap")?,
        })
    }

    fn error(&self, found: String) -> Error {
        Error::format(
            &self.path,
            Location::Whole,
            found,
            "a result written by an item",
        )
    }
}

/// The parts of a result that the page needs, if this kind of item has them.
struct Parts {
    headline: Option<Headline>,
    tiles: Vec<Tile>,
    overlap: Option<Overlap>,
}

/// A document, if the file exists.
fn document(path: PathBuf) -> Result<Option<Document>> {
    let text = match fs::read_to_string(&path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        other => other.map_err(|error| Error::io(&path, error))?,
    };
    let mut document = Document {
        path,
        content: Value::Null,
    };
    document.content = serde_json::from_str(&text)
        .map_err(|error| document.error(format!("invalid JSON ({error})")))?;
    Ok(Some(document))
}

fn extent(item: &Item, tile: Tile) -> Extent {
    Extent {
        plot: item.plot.clone().unwrap_or_default(),
        date: item.date.clone().unwrap_or_default(),
        path: format!("items/{}/tiles/{}", item.name, tile.file),
        item: item.name.clone(),
        points: tile.points,
        low_m: tile.low_m,
        high_m: tile.high_m,
    }
}

/// Adds the results of a finished item to the page.
fn add(item: &Item, result: &Value, headline: Option<Headline>, page: &mut CampaignPage) {
    let (plot, date) = (
        item.plot.clone().unwrap_or_default(),
        item.date.clone().unwrap_or_default(),
    );
    let number = |value: &Value, key: &str| value[key].as_f64().unwrap_or(f64::NAN);
    match item.kind {
        Kind::Calibration | Kind::Overlap => {}
        Kind::Drive => {
            let list = |key: &str| result[key].as_array().cloned().unwrap_or_default();
            let marked = list("verdicts")
                .into_iter()
                .filter(|verdict| matches!(verdict["severity"].as_str(), Some("care" | "fault")));
            page.drives.push(DriveLine {
                plot,
                date,
                page: format!("items/{}/{}", item.name, pipeline::field::PAGE),
                points: result["points"].as_u64().unwrap_or_default(),
                headline: headline.unwrap_or(Headline::Unusable),
                marked: marked
                    .filter_map(|verdict| verdict["text"].as_str().map(str::to_owned))
                    .collect(),
                agreement: list("agreement")
                    .iter()
                    .filter_map(|pair| {
                        Some((
                            pair["pair"].as_str()?.to_owned(),
                            number(pair, "m3c2_rmse_m"),
                        ))
                    })
                    .collect(),
            });
        }
        Kind::Change => {
            let change = &result["change"];
            page.changes.push(ChangeLine {
                plot,
                before: item.before.clone().unwrap_or_default(),
                date,
                page: format!("items/{}/{}", item.name, pipeline::compare::change::PAGE),
                mean_m: number(change, "mean_m"),
                median_m: number(change, "median_m"),
                significant_share: number(change, "significant_share"),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::ScannerFromScanner;
    use crate::campaign::{MountingsFrom, ProjectText, Task};
    use crate::drift::ScannerOverlap;
    use nalgebra::{Matrix6, Vector6};

    fn overlap(x_m: f64) -> Overlap {
        let scanner = ScannerOverlap {
            name: "right".into(),
            in_use: ScannerFromScanner::identity(),
            offset: Vector6::new(x_m, 0.0, 0.0, 0.0, 0.0, 0.0),
            covariance: Matrix6::identity() * 1e-8,
            determined: [true; 6],
            blocks: 40,
            spots: 1000,
            lag_s: 0.1,
            normal: Matrix6::identity(),
            vertical: Matrix6::identity(),
            total: Matrix6::identity(),
        };
        Overlap {
            first: "left".into(),
            scanners: vec![scanner],
        }
    }

    fn item(day: u32) -> Item {
        let project = ProjectText {
            path: format!("{day}/project.toml"),
            text: String::new(),
        };
        let item = Item {
            name: String::new(),
            kind: Kind::Overlap,
            plot: Some("p".into()),
            date: Some(format!("2025-05-{day:02}")),
            before: None,
            inputs: Vec::new(),
            needs: Vec::new(),
            task: Task::Overlap {
                project,
                mountings: MountingsFrom::Project,
            },
        };
        item.named()
    }

    #[test]
    fn days_with_different_scanners_fail_only_the_drift_watch() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        let path = out.join("campaign.toml");
        fs::write(&path, "[campaign]\ndrives = \"{date}\"\ndrift = true\n").unwrap();
        let campaign = Campaign::read(&path).unwrap();
        let items = [item(1), item(2)];
        for (item, first) in items.iter().zip(["left", "front"]) {
            let mut overlap = overlap(0.0);
            overlap.first = first.into();
            fs::create_dir_all(item.folder(out)).unwrap();
            let text = json!({ "overlap": overlap }).to_string();
            fs::write(item.folder(out).join(item::RESULT), text).unwrap();
        }
        let outcome = conclude(&campaign, &items, &out.join("")).unwrap();
        assert!(outcome.result["drift"].is_null());
        assert_eq!(outcome.result["failed"], 1);
        let page = fs::read_to_string(out.join(PAGE)).unwrap();
        assert!(
            page.contains("drift watch") && page.contains("front"),
            "{page}"
        );
    }

    #[test]
    fn an_unreadable_result_is_a_failure_that_names_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        let path = out.join("campaign.toml");
        fs::write(&path, "[campaign]\ndrives = \"{date}\"\n").unwrap();
        let campaign = Campaign::read(&path).unwrap();
        let items = [item(1)];
        fs::create_dir_all(items[0].folder(out)).unwrap();
        for (part, text) in [("tiles", "[{}]"), ("overlap", "7")] {
            let result = items[0].folder(out).join(item::RESULT);
            fs::write(result, format!("{{\"{part}\": {text}}}")).unwrap();
            let outcome = conclude(&campaign, &items, out).unwrap();
            assert_eq!(outcome.result["failed"], 1);
            let summary = outcome.summary;
            assert!(
                summary.contains("result.json") && summary.contains(part),
                "{summary}"
            );
        }
    }

    #[test]
    fn a_knock_in_the_results_is_on_the_page_and_in_the_list() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        let path = out.join("campaign.toml");
        fs::write(&path, "[campaign]\ndrives = \"{date}\"\ndrift = true\n").unwrap();
        let campaign = Campaign::read(&path).unwrap();
        let items: Vec<Item> = (1..=9).map(item).collect();
        for (item, day) in items.iter().zip(1..) {
            let result = json!({ "overlap": overlap(if day < 7 { 0.0 } else { 2e-3 }) });
            fs::create_dir_all(item.folder(out)).unwrap();
            fs::write(item.folder(out).join(item::RESULT), result.to_string()).unwrap();
        }
        let outcome = conclude(&campaign, &items, &out.join("")).unwrap();
        let alarms = &outcome.result["drift"]["scanners"][0]["alarms"];
        assert_eq!(alarms.as_array().map(Vec::len), Some(1));
        assert_eq!(alarms[0]["date"], "2025-05-07");
        assert!(
            outcome.summary.contains("2025-05-07"),
            "{}",
            outcome.summary
        );
        let page = fs::read_to_string(out.join(PAGE)).unwrap();
        assert!(page.contains("Drift watch") && page.contains("between 2025-05-06 and 2025-05-07"));
        // Without a drive there is no section on quality.
        assert!(!page.contains("id=\"quality\""));
    }
}
