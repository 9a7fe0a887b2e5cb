//! Plans the items of a campaign from its files.

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

/// The name of the plot if the pattern of the drives has none.
const ONLY_PLOT: &str = "field";

/// The items of a campaign before the contents of their inputs are known.
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
    /// Indices of the drafts whose results it reads, which come before it.
    needs: Vec<usize>,
    task: Task,
}

impl Draft {
    fn new(kind: Kind, plot: Option<String>, date: Option<String>) -> Self {
        Self {
            kind,
            plot,
            date,
            before: None,
            inputs: Vec::new(),
            needs: Vec::new(),
            task: Task::Refused(Failure::default()),
        }
    }

    /// The draft with its task, or with the reason why it has none.
    fn with_task(mut self, task: Result<Task>, root: &Path) -> Self {
        self.task = task.unwrap_or_else(|error| {
            self.inputs.clear();
            self.needs.clear();
            Task::Refused(Failure::from(&error).relative_to(root))
        });
        self
    }
}

/// The paths that match a pattern of the campaign, with their plots and dates.
struct Named<'a> {
    key: &'static str,
    pattern: &'a Pattern,
    files: Vec<(Place, String)>,
}

impl<'a> Named<'a> {
    fn new(key: &'static str, pattern: &'a Option<Pattern>, listing: &Listing) -> Option<Self> {
        let pattern = pattern.as_ref()?;
        // A pattern for a single path may name a file outside of the folder.
        let files = if pattern.is_open() {
            listing.matching(pattern)
        } else {
            vec![(Place::default(), pattern.text())]
        };
        Some(Self {
            key,
            pattern,
            files,
        })
    }

    fn file(&self, plot: &str, date: &str) -> Result<&(Place, String)> {
        let mut matches = self
            .files
            .iter()
            .filter(|(place, _)| place.is_of(plot, date));
        let pattern = self.pattern.text();
        match (matches.next(), matches.next()) {
            (Some(first), None) => Ok(first),
            (None, _) => Err(Error::of(
                Problem::TooFew,
                format!("no file `{pattern}` for plot {plot} on {date}"),
                format!("add it, or change `campaign.{}`", self.key),
            )),
            (Some(first), Some(second)) => Err(Error::data(
                format!(
                    "{} and {} both match `{pattern}` for plot {plot} on {date}",
                    first.1, second.1
                ),
                format!("remove one, or make `campaign.{}` narrower", self.key),
            )),
        }
    }
}

impl Campaign {
    /// The small text files that planning reads, relative to the campaign's folder: they must exist there when
    /// [`Self::plan`] is called.
    ///
    /// # Errors
    /// No drive; a template that is not below the folder.
    pub fn texts(&self, listing: &Listing) -> Result<Vec<String>> {
        let mut texts = BTreeSet::new();
        for (_, path) in self.drives(listing)? {
            texts.extend(listing.has(&path).then_some(path));
        }
        let calibrated = Named::new("calibration_project", &self.calibration_project, listing);
        let calibrated = calibrated.into_iter().flat_map(|named| named.files);
        texts.extend(calibrated.map(|(_, path)| path));
        if let Some(template) = &self.template {
            texts.insert(relative(template, self.folder()));
        }
        if let Some(outside) = texts.iter().find(|text| Path::new(text).is_absolute()) {
            return Err(Error::format(
                &self.path,
                Location::Whole,
                format!("{outside}, which is not below the campaign's folder"),
                "only files below the folder of the campaign, because it is read from a URL",
            ));
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
                format!(
                    "no file and no folder that matches `{}`",
                    self.drives.text()
                ),
                "drives below the campaign's folder: see `campaign.drives`",
            ));
        }
        drives.sort();
        if let Some(twice) = drives.windows(2).find(|two| two[0].0 == two[1].0) {
            let [(_, first), (_, second)] = [&twice[0], &twice[1]];
            return Err(Error::format(
                &self.path,
                Location::Whole,
                format!("{first} and {second}, which are the same plot on the same date"),
                "one drive per plot and date: make `campaign.drives` narrower",
            ));
        }
        Ok(drives)
    }

    /// All items. A drive with an invalid project becomes an item that fails and does not affect the others.
    ///
    /// # Errors
    /// No drive; the template cannot be read.
    pub fn plan(&self, listing: &Listing) -> Result<Plan> {
        let drives = self.drives(listing)?;
        let mut planner = Planner {
            campaign: self,
            listing,
            template: self.template.as_deref().map(text_of).transpose()?,
            calibrated: Named::new("calibration_project", &self.calibration_project, listing),
            files: Named::new("calibration", &self.calibration, listing),
            references: Named::new("reference", &self.reference, listing),
            drafts: Vec::new(),
        };
        planner.calibrations();
        let mut before: Option<(String, usize)> = None;
        for (place, path) in drives {
            let plot = place.plot.unwrap_or_else(|| ONLY_PLOT.to_owned());
            let date = place.date.unwrap_or_default();
            let number = planner.drafts.len();
            planner.drive(&plot, &date, &path);
            let earlier = before.filter(|(other, _)| self.compare_with_before && *other == plot);
            if let Some((_, earlier)) = earlier {
                planner.change(earlier, number);
            }
            before = Some((plot, number));
        }
        Ok(Plan {
            drafts: planner.drafts,
        })
    }
}

fn text_of(path: &Path) -> Result<String> {
    Source::read(path).map(Source::into_text)
}

/// The state of a plan while it is made.
struct Planner<'a> {
    campaign: &'a Campaign,
    listing: &'a Listing,
    template: Option<String>,
    calibrated: Option<Named<'a>>,
    files: Option<Named<'a>>,
    references: Option<Named<'a>>,
    drafts: Vec<Draft>,
}

impl Planner<'_> {
    /// Adds the projects that are calibrated: the first drafts, in the order of their paths.
    fn calibrations(&mut self) {
        let projects = self.calibrated.iter().flat_map(|named| &named.files);
        let drafts = projects.map(|(place, path)| {
            let mut draft = Draft::new(Kind::Calibration, place.plot.clone(), place.date.clone());
            let task = self.written(path).and_then(|project| {
                let files = self.files_of(&project, true)?;
                draft.inputs.extend(files);
                Ok(Task::Calibration { project })
            });
            draft.with_task(task, self.campaign.folder())
        });
        self.drafts = drafts.collect();
    }

    /// Adds a drive, and the overlap of its scanners.
    fn drive(&mut self, plot: &str, date: &str, path: &str) {
        let root = self.campaign.folder();
        let draft = |kind| Draft::new(kind, Some(plot.to_owned()), Some(date.to_owned()));
        let (mut drive, mut overlap) = (draft(Kind::Drive), draft(Kind::Overlap));
        let made = self.project(path).and_then(|project| {
            let reference = self.references.as_ref();
            let reference = reference.map(|named| named.file(plot, date)).transpose()?;
            let reference = reference.map(|(_, path)| path.clone());
            let mountings = self.mountings(plot, date, &mut overlap)?;
            drive.needs.clone_from(&overlap.needs);
            drive.inputs.clone_from(&overlap.inputs);
            drive
                .inputs
                .extend(self.files_of(&project, reference.is_none())?);
            drive.inputs.extend(reference.clone());
            overlap.inputs.extend(self.files_of(&project, false)?);
            let tile_m = self.campaign.tile_m;
            let watched = Task::Overlap {
                project: project.clone(),
                mountings: mountings.clone(),
            };
            let placed = Task::Drive {
                project,
                mountings,
                reference,
                tile_m,
            };
            Ok((placed, watched))
        });
        match made {
            Ok((placed, watched)) => {
                self.drafts.push(drive.with_task(Ok(placed), root));
                if self.campaign.drift {
                    self.drafts.push(overlap.with_task(Ok(watched), root));
                }
            }
            // The overlap is left out, so that the error is reported only once.
            Err(error) => self.drafts.push(drive.with_task(Err(error), root)),
        }
    }

    /// Adds the change between two drafts of drives.
    fn change(&mut self, earlier: usize, later: usize) {
        let (plot, date) = (&self.drafts[later].plot, &self.drafts[later].date);
        let mut draft = Draft::new(Kind::Change, plot.clone(), date.clone());
        draft.before.clone_from(&self.drafts[earlier].date);
        draft.needs = vec![earlier, later];
        draft.task = Task::Change {
            comparison: self.campaign.comparison.clone(),
        };
        self.drafts.push(draft);
    }

    /// The source of the mountings of a drive, which is added to the inputs or needs of `draft`.
    fn mountings(&self, plot: &str, date: &str, draft: &mut Draft) -> Result<MountingsFrom> {
        if let Some(named) = &self.calibrated {
            let (place, _) = named.file(plot, date)?;
            let number = named.files.iter().position(|(other, _)| other == place);
            draft.needs.extend(number);
            // The name of the calibration is known only when its inputs are.
            return Ok(MountingsFrom::Item(String::new()));
        }
        let Some(named) = &self.files else {
            return Ok(MountingsFrom::Project);
        };
        let (_, file) = named.file(plot, date)?;
        draft.inputs.push(file.clone());
        Ok(MountingsFrom::File(file.clone()))
    }

    /// The project of a drive: its project file, the template, or a project made from the files of its folder.
    fn project(&self, path: &str) -> Result<ProjectText> {
        if self.listing.has(path) {
            return self.written(path);
        }
        if let (Some(text), Some(file)) = (&self.template, &self.campaign.template) {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            return Ok(ProjectText {
                path: format!("{path}/{name}"),
                text: template::filled(text, file, path, self.listing)?,
            });
        }
        let made = pipeline::init(&self.campaign.folder().join(path))?;
        if !made.missing.is_empty() {
            let problem = format!(
                "the files of {path} do not give {}",
                made.missing.join(", ")
            );
            let unread = made.unread.iter().map(|why| format!("; not read: {why}"));
            return Err(Error::of(
                Problem::TooFew,
                problem + &unread.collect::<String>(),
                "name a project as a template in `campaign.project`",
            ));
        }
        Ok(ProjectText {
            path: format!("{path}/project.toml"),
            text: made.text,
        })
    }

    fn written(&self, path: &str) -> Result<ProjectText> {
        Ok(ProjectText {
            path: path.to_owned(),
            text: text_of(&self.campaign.folder().join(path))?,
        })
    }

    /// The files that a project names, with its reference or without.
    fn files_of(&self, project: &ProjectText, with_reference: bool) -> Result<Vec<String>> {
        let root = self.campaign.folder();
        let mut project = project.project(root)?;
        if !with_reference {
            project = project.with_reference(None);
        }
        let files = project.files().into_iter();
        Ok(files.map(|file| relative(&file, root)).collect())
    }
}

impl Plan {
    /// All files that an item reads, relative to the campaign's folder, or absolute if they are outside of it.
    pub fn files(&self) -> Vec<String> {
        let files: BTreeSet<&String> = self.drafts.iter().flat_map(|draft| &draft.inputs).collect();
        files.into_iter().cloned().collect()
    }

    /// The items, each after those that it needs; `hashes` are those of the contents of the files.
    pub fn items(&self, hashes: &BTreeMap<String, String>) -> Vec<Item> {
        let mut items: Vec<Item> = Vec::new();
        for draft in &self.drafts {
            let needs: Vec<String> = draft
                .needs
                .iter()
                .map(|at| items[*at].name.clone())
                .collect();
            let mut task = draft.task.clone();
            if let Task::Drive { mountings, .. } | Task::Overlap { mountings, .. } = &mut task
                && let (MountingsFrom::Item(name), Some(calibration)) = (mountings, needs.first())
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

/// A path relative to a campaign's folder.
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
