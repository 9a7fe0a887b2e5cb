//! From the files of a campaign to its items.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::item::{Failure, InputFile, Item, Kind, MountingsFrom, ProjectText, Task};
use super::listing::Listing;
use super::pattern::{Pattern, Place};
use super::settings::Campaign;
use super::template;
use crate::error::{Error, Location, Problem, Result};
use crate::pipeline;
use crate::project::Source;

/// The name of a plot where the pattern of the drives has none.
const ONLY_PLOT: &str = "field";

/// The items of a campaign before the content of their inputs is known.
#[derive(Debug, Clone)]
pub struct Plan {
    drafts: Vec<Draft>,
}

/// An item without the hashes of its inputs.
#[derive(Debug, Clone)]
struct Draft {
    kind: Kind,
    plot: Option<String>,
    date: Option<String>,
    before: Option<String>,
    inputs: Vec<String>,
    /// Places of the drafts whose results it reads, which come before it.
    needs: Vec<usize>,
    task: Task,
}

impl Draft {
    fn refused(mut self, error: &Error, root: &Path) -> Self {
        self.inputs.clear();
        self.task = Task::Refused(Failure::from(error).relative_to(root));
        self
    }
}

/// Paths that a pattern of the campaign may name, by plot and date.
struct Named<'a> {
    key: &'static str,
    pattern: &'a Pattern,
    found: Vec<(Place, String)>,
}

impl<'a> Named<'a> {
    fn new(key: &'static str, pattern: &'a Pattern, listing: &Listing) -> Self {
        let mut found = listing.matching(pattern);
        // One path need not be below the folder.
        if !pattern.is_open() {
            found = vec![(Place::default(), pattern.text())];
        }
        Self {
            key,
            pattern,
            found,
        }
    }

    fn of(&self, plot: &str, date: &str) -> Result<&(Place, String)> {
        let mut found = self
            .found
            .iter()
            .filter(|(place, _)| place.is_of(plot, date));
        let pattern = self.pattern.text();
        match (found.next(), found.next()) {
            (Some(first), None) => Ok(first),
            (None, _) => Err(Error::of(
                Problem::TooFew,
                format!("no file `{pattern}` for plot {plot} on {date}"),
                format!("add it, or change `campaign.{}`", self.key),
            )),
            (Some(first), Some(second)) => Err(Error::data(
                format!(
                    "{} and {} are both `{pattern}` for plot {plot} on {date}",
                    first.1, second.1
                ),
                format!("remove one, or make `campaign.{}` narrower", self.key),
            )),
        }
    }
}

impl Campaign {
    /// The small text files that planning reads: they must lie below the campaign's folder when [`Self::plan`] is
    /// called. Relative to it.
    ///
    /// # Errors
    /// No drive; a template that is not below the folder.
    pub fn texts(&self, listing: &Listing) -> Result<Vec<String>> {
        let mut texts = BTreeSet::new();
        for (_, path) in self.drives(listing)? {
            texts.extend(listing.has(&path).then_some(path));
        }
        if let Some(pattern) = &self.calibration_project {
            texts.extend(
                Named::new("calibration_project", pattern, listing)
                    .found
                    .into_iter()
                    .map(|(_, path)| path),
            );
        }
        if let Some(template) = &self.template {
            texts.insert(relative(template, self.folder()));
        }
        Ok(texts.into_iter().collect())
    }

    /// Plots, dates and paths of the drives, in that order.
    fn drives(&self, listing: &Listing) -> Result<Vec<(Place, String)>> {
        let mut drives = listing.matching(&self.drives);
        if drives.is_empty() {
            return Err(Error::format(
                &self.path,
                Location::Whole,
                format!("no file and no folder that is `{}`", self.drives.text()),
                "drives below the campaign's folder: see `campaign.drives`",
            ));
        }
        drives.sort();
        if let Some(twice) = drives.windows(2).find(|two| two[0].0 == two[1].0) {
            let [(_, first), (_, second)] = [&twice[0], &twice[1]];
            return Err(Error::format(
                &self.path,
                Location::Whole,
                format!("{first} and {second}, which are one plot on one date"),
                "one drive for each: make `campaign.drives` narrower",
            ));
        }
        Ok(drives)
    }

    /// All items. A drive whose project is wrong is an item that fails; the others do not mind.
    ///
    /// # Errors
    /// No drive; the template cannot be read.
    pub fn plan(&self, listing: &Listing) -> Result<Plan> {
        let drives = self.drives(listing)?;
        let template = self
            .template
            .as_deref()
            .map(Source::read)
            .transpose()?
            .map(Source::into_text);
        let mut plan = Plan { drafts: Vec::new() };
        let calibrated = self
            .calibration_project
            .as_ref()
            .map(|pattern| Named::new("calibration_project", pattern, listing));
        let places: BTreeMap<Place, usize> = calibrated
            .iter()
            .flat_map(|named| &named.found)
            .enumerate()
            .map(|(number, (place, path))| {
                plan.drafts.push(self.calibration(place, path));
                (place.clone(), number)
            })
            .collect();
        let files = self
            .calibration
            .as_ref()
            .map(|pattern| Named::new("calibration", pattern, listing));
        let references = self
            .reference
            .as_ref()
            .map(|pattern| Named::new("reference", pattern, listing));
        let mut before: Option<(String, usize)> = None;
        for (place, path) in drives {
            let plot = place.plot.unwrap_or_else(|| ONLY_PLOT.to_owned());
            let date = place.date.unwrap_or_default();
            let mut draft = Draft {
                kind: Kind::Drive,
                plot: Some(plot.clone()),
                date: Some(date.clone()),
                before: None,
                inputs: Vec::new(),
                needs: Vec::new(),
                task: Task::Refused(Failure {
                    problem: String::new(),
                    remedy: None,
                }),
            };
            let made = self
                .drive(&path, template.as_deref(), listing, &mut draft)
                .and_then(|project| {
                    let mut mountings = MountingsFrom::Project;
                    if let Some(named) = &files {
                        let file = named.of(&plot, &date)?.1.clone();
                        draft.inputs.push(file.clone());
                        mountings = MountingsFrom::File(file);
                    }
                    if let Some(named) = &calibrated {
                        draft.needs.push(places[&named.of(&plot, &date)?.0]);
                        // Its name is known once its inputs are.
                        mountings = MountingsFrom::Item(String::new());
                    }
                    let reference = references
                        .as_ref()
                        .map(|named| named.of(&plot, &date).map(|found| found.1.clone()));
                    let reference = reference.transpose()?;
                    draft.inputs.extend(reference.clone());
                    Ok(Task::Drive {
                        project,
                        mountings,
                        reference,
                        tile_m: self.tile_m,
                    })
                });
            let draft = match made {
                Ok(task) => Draft { task, ..draft },
                Err(error) => draft.refused(&error, self.folder()),
            };
            plan.drafts.push(draft);
            let number = plan.drafts.len() - 1;
            if let Some((_, earlier)) =
                before.filter(|(other, _)| self.compare_with_before && *other == plot)
            {
                let earlier_date = plan.drafts[earlier].date.clone();
                plan.drafts.push(Draft {
                    kind: Kind::Change,
                    plot: Some(plot.clone()),
                    date: Some(date),
                    before: earlier_date,
                    inputs: Vec::new(),
                    needs: vec![earlier, number],
                    task: Task::Change {
                        comparison: self.comparison.clone(),
                    },
                });
            }
            before = Some((plot, number));
        }
        Ok(plan)
    }

    /// A project that is calibrated.
    fn calibration(&self, place: &Place, path: &str) -> Draft {
        let mut draft = Draft {
            kind: Kind::Calibration,
            plot: place.plot.clone(),
            date: place.date.clone(),
            before: None,
            inputs: Vec::new(),
            needs: Vec::new(),
            task: Task::Refused(Failure {
                problem: String::new(),
                remedy: None,
            }),
        };
        let read = self.written(path).and_then(|project| {
            self.name_inputs(&project, &mut draft)?;
            Ok(project)
        });
        match read {
            Ok(project) => Draft {
                task: Task::Calibration { project },
                ..draft
            },
            Err(error) => draft.refused(&error, self.folder()),
        }
    }

    /// The project of a drive: its own, from the template, or made from the files of its folder.
    fn drive(
        &self,
        path: &str,
        template: Option<&str>,
        listing: &Listing,
        draft: &mut Draft,
    ) -> Result<ProjectText> {
        let folder = self.folder().join(path);
        let project = match (listing.has(path), template, &self.template) {
            (true, _, _) => self.written(path)?,
            (false, Some(text), Some(file)) => ProjectText {
                path: format!(
                    "{path}/{}",
                    file.file_name().unwrap_or_default().to_string_lossy()
                ),
                text: template::filled(text, file, path, listing)?,
            },
            _ => {
                let made = pipeline::init(&folder)?;
                if !made.missing.is_empty() {
                    return Err(Error::of(
                        Problem::TooFew,
                        format!("the files of {path} do not say {}", made.missing.join(", ")),
                        "name a project as a template in `campaign.project`",
                    ));
                }
                ProjectText {
                    path: format!("{path}/project.toml"),
                    text: made.text,
                }
            }
        };
        self.name_inputs(&project, draft)?;
        Ok(project)
    }

    fn written(&self, path: &str) -> Result<ProjectText> {
        let text = Source::read(&self.folder().join(path))?.into_text();
        Ok(ProjectText {
            path: path.to_owned(),
            text,
        })
    }

    /// Adds the files of the project to the inputs.
    fn name_inputs(&self, project: &ProjectText, draft: &mut Draft) -> Result<()> {
        let mut project = project.project(self.folder())?;
        if draft.kind == Kind::Drive && self.reference.is_some() {
            project.reference = None;
        }
        let files = project.files().into_iter();
        draft
            .inputs
            .extend(files.map(|file| relative(&file, self.folder())));
        Ok(())
    }
}

impl Plan {
    /// Every file that an item reads, relative to the campaign's folder, or absolute where it is not below it.
    pub fn files(&self) -> Vec<String> {
        let files: BTreeSet<&String> = self.drafts.iter().flat_map(|draft| &draft.inputs).collect();
        files.into_iter().cloned().collect()
    }

    /// The items, each behind those that it needs; `hashes` are the contents of the files.
    pub fn items(&self, hashes: &BTreeMap<String, String>) -> Vec<Item> {
        let mut items: Vec<Item> = Vec::new();
        for draft in &self.drafts {
            let needs: Vec<String> = draft
                .needs
                .iter()
                .map(|at| items[*at].name.clone())
                .collect();
            let mut task = draft.task.clone();
            if let (
                Task::Drive {
                    mountings: MountingsFrom::Item(name),
                    ..
                },
                Some(calibration),
            ) = (&mut task, needs.first())
            {
                name.clone_from(calibration);
            }
            let input = |path: &String| InputFile {
                path: path.clone(),
                hash: hashes.get(path).cloned(),
            };
            let item = Item {
                name: String::new(),
                kind: draft.kind,
                plot: draft.plot.clone(),
                date: draft.date.clone(),
                before: draft.before.clone(),
                inputs: draft.inputs.iter().map(input).collect(),
                needs,
                task,
            };
            items.push(item.named());
        }
        items
    }
}

/// A path as seen from a campaign's folder.
fn relative(path: &Path, root: &Path) -> String {
    let mut clean = std::path::PathBuf::new();
    for part in path.components() {
        match part {
            std::path::Component::ParentDir => {
                clean.pop();
            }
            std::path::Component::CurDir => {}
            other => clean.push(other),
        }
    }
    let shown = clean.strip_prefix(root).unwrap_or(&clean);
    shown
        .to_string_lossy()
        .replace(std::path::MAIN_SEPARATOR, "/")
}
