//! `boresight salvage`

use std::collections::BTreeSet;
use std::path::PathBuf;

use serde_json::json;

use super::context::Force;
use super::print::unprintable;
use crate::error::{Error, Result};
use crate::format;
use crate::output::Staging;
use crate::pipeline::Outcome;

/// Copy damaged recordings (`.bin`, ROS bags, MCAP) and text tables without incomplete or unreadable records
#[derive(Debug, clap::Args)]
pub(super) struct Salvage {
    /// The damaged files
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Folder for the copies, which keep their names
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    force: Force,
}

impl Salvage {
    /// Copies each file, or names the error in reading it if there are several; the flag says whether all could be
    /// copied.
    pub fn execute(&self) -> Result<(Outcome, bool)> {
        let name = |file: &PathBuf| match file.file_name() {
            Some(name) => Ok(name.to_string_lossy().into_owned()),
            None => Err(Error::data(
                format!("{} has no name", file.display()),
                "give the path of a file",
            )),
        };
        let names = self.files.iter().map(name).collect::<Result<Vec<_>>>()?;
        let mut seen = BTreeSet::new();
        if let Some(twice) = names.iter().find(|name| !seen.insert(name.to_lowercase())) {
            return Err(Error::data(
                format!("two files are called {twice}, and their copies would have the same name"),
                "salvage them into different folders",
            ));
        }
        self.force.check(&self.out, &self.files, &names)?;
        let staging = Staging::new(&self.out, &self.files, &names)?;
        let (mut documents, mut lines, mut copied) = (Vec::new(), Vec::new(), Vec::new());
        for (file, name) in self.files.iter().zip(&names) {
            let copy = staging.path(name);
            let salvaged = match format::salvage(file, &copy) {
                Ok(salvaged) => salvaged,
                Err(error) if self.files.len() == 1 || matches!(error, Error::Cancelled) => {
                    return Err(error);
                }
                Err(error) => {
                    // A copy without content must not appear; it may not have been begun.
                    let _ = std::fs::remove_file(&copy);
                    documents.push(
                        json!({ "file": file.display().to_string(), "error": error.to_string() }),
                    );
                    lines.push(format!("{}: nothing kept: {error}", file.display()));
                    continue;
                }
            };
            copied.push(self.out.join(name));
            let what = match salvaged.dropped_rows {
                0 => "records".to_owned(),
                rows => format!("rows, {rows} left out"),
            };
            lines.push(match salvaged.first_byte {
                None => format!("{}: undamaged, {} kept", file.display(), salvaged.kept),
                Some(byte) => format!(
                    "{}: kept {} {what}; {} bytes left out in {} place{}, the first at byte {byte}",
                    file.display(),
                    salvaged.kept,
                    salvaged.dropped_bytes,
                    salvaged.places,
                    if salvaged.places == 1 { "" } else { "s" }
                ),
            });
            let salvaged = serde_json::to_value(salvaged).map_err(unprintable)?;
            documents.push(json!({ "file": file.display().to_string(), "salvaged": salvaged }));
        }
        staging.commit()?;
        let have_all = copied.len() == self.files.len();
        let outcome = Outcome {
            result: json!({ "files": documents }),
            summary: lines.join("\n"),
            files: copied,
            ..Outcome::default()
        };
        Ok((outcome, have_all))
    }
}
