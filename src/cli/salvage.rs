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
    pub fn execute(&self) -> Result<Outcome> {
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
        let (mut documents, mut lines) = (Vec::new(), Vec::new());
        for (file, name) in self.files.iter().zip(&names) {
            let salvaged = format::salvage(file, &staging.path(name))?;
            let what = match salvaged.dropped_rows {
                0 => "records".to_owned(),
                rows => format!("rows, {rows} left out"),
            };
            lines.push(match salvaged.first_byte {
                None => format!("{}: undamaged, {} kept", file.display(), salvaged.kept),
                Some(byte) => format!(
                    "{}: kept {} {what}; {} bytes left out in {} places, the first at byte {byte}",
                    file.display(),
                    salvaged.kept,
                    salvaged.dropped_bytes,
                    salvaged.places
                ),
            });
            let salvaged = serde_json::to_value(salvaged).map_err(unprintable)?;
            documents.push(json!({ "file": file.display().to_string(), "salvaged": salvaged }));
        }
        staging.commit()?;
        Ok(Outcome {
            result: json!({ "files": documents }),
            summary: lines.join("\n"),
            files: names.iter().map(|name| self.out.join(name)).collect(),
            ..Outcome::default()
        })
    }
}
