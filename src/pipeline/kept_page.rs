//! The content of a run's page, kept beside the page, so that it can be made again without computing.

use std::path::Path;

use serde_json::json;

use super::kept;
use super::outcome::Outcome;
use super::page;
use crate::error::{Error, Result};
use crate::output::write_whole;
use crate::progress::Progress;
use crate::project::Project;
use crate::report;
use crate::report::content::Content;

/// Name of the file.
pub const NAME: &str = "report.kept";
/// Name of the page that is made from this file.
const PAGE: &str = "report.html";

/// The bytes that keep the content of a page and the absolute path of its project, some of whose settings concern only
/// the page.
///
/// # Errors
/// As for [`kept::bytes_of`].
pub fn bytes_of(content: &Content, project: &Path) -> Result<Vec<u8>> {
    let absolute = std::path::absolute(project).unwrap_or_else(|_| project.to_owned());
    kept::bytes_of(&(absolute.to_string_lossy(), content))
}

/// Makes the page in the folder of a run again from the content that the run kept, without computing.
///
/// # Errors
/// The folder has no such file, or another program wrote it; the file is damaged; the page cannot be written.
pub fn report(folder: &Path, progress: &dyn Progress) -> Result<Outcome> {
    let (path, mut content) = read(folder)?;
    let path = Path::new(&path);
    if path.is_file() {
        let project = Project::read(path);
        match project.and_then(|project| page::settings_of(&project, &mut content)) {
            Ok(()) => {}
            Err(error) => progress.warn(&format!(
                "the page has the settings of the run, because the project cannot be read: {error}"
            )),
        }
    }
    let page = folder.join(PAGE);
    write_whole(&page, report::render(&content).as_bytes())?;
    Ok(Outcome {
        result: json!({ "report": page, "verdicts": content.verdicts }),
        summary: format!("report: {}", page.display()),
        files: Vec::new(),
        verdicts: Some(content.verdicts),
    })
}

/// The path of the project and the content that a run kept in a folder.
fn read(folder: &Path) -> Result<(String, Content<'static>)> {
    let path = folder.join(NAME);
    if !path.exists() {
        return Err(Error::data(
            format!(
                "{}: there is no {NAME}, in which a run keeps the content of its page",
                folder.display()
            ),
            "name the folder with the results of `boresight run` or `boresight demo`; if an older program ran there, \
             run again",
        ));
    }
    kept::read(&path)
}
