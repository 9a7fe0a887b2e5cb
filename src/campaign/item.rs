//! The items of a campaign: each depends on the content of its inputs, and its name contains a hash of this content.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use twox_hash::xxhash3_128::Hasher;

use crate::comparison::ComparisonSettings;
use crate::error::Error;
use crate::pipeline::Key;
use crate::project::Project;

/// The kind of an item.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Calibrates the scanners.
    Calibration,
    /// Places the points of a drive and compares them with the reference and with each other.
    Drive,
    /// Compares a plot with its previous date.
    Change,
    /// Compares the scanners with each other on the ground that both saw.
    Overlap,
}

impl Kind {
    /// The kind as it appears in names of items.
    pub fn name(self) -> &'static str {
        match self {
            Self::Calibration => "calibration",
            Self::Drive => "drive",
            Self::Change => "change",
            Self::Overlap => "overlap",
        }
    }
}

/// A file that an item reads.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputFile {
    /// Relative to the campaign's folder, or absolute if it is outside of it.
    pub path: String,
    /// The hash of its content; `None` if it could not be read.
    pub hash: Option<String>,
}

/// The text of a project, with the path of its actual or assumed file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProjectText {
    /// Relative to the campaign's folder, or absolute.
    pub path: String,
    /// The text.
    pub text: String,
}

impl ProjectText {
    /// The project, in a campaign's folder.
    ///
    /// # Errors
    /// As for [`Project::read`].
    pub fn project(&self, root: &Path) -> crate::Result<Project> {
        Project::parse(self.text.clone(), &root.join(&self.path))
    }
}

/// The source of the mountings of a drive.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MountingsFrom {
    /// Its project.
    Project,
    /// A `calibration.toml`, relative to the campaign's folder or absolute.
    File(String),
    /// The calibration item of this name.
    Item(String),
}

/// The work of an item with its settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Task {
    /// See [`Kind::Calibration`].
    Calibration {
        /// The project.
        project: ProjectText,
    },
    /// See [`Kind::Drive`].
    Drive {
        /// The project.
        project: ProjectText,
        /// Its mountings.
        mountings: MountingsFrom,
        /// The reference in place of the project's, relative to the campaign's folder or absolute.
        reference: Option<String>,
        /// Side of a tile, metres.
        tile_m: f64,
    },
    /// See [`Kind::Change`]: compares the two drives in [`Item::needs`], the earlier first.
    Change {
        /// The settings of the comparison.
        comparison: ComparisonSettings,
    },
    /// See [`Kind::Overlap`].
    Overlap {
        /// The project.
        project: ProjectText,
        /// Its mountings.
        mountings: MountingsFrom,
    },
    /// No work, because planning has shown that the item cannot be run.
    Refused(Failure),
}

/// The reason why an item failed.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// The problem, with names and numbers.
    pub problem: String,
    /// The remedy, if it is known.
    pub remedy: Option<String>,
}

impl Failure {
    /// The failure with paths relative to a campaign's folder.
    pub fn relative_to(self, root: &Path) -> Self {
        let folder = format!("{}/", root.display());
        Self {
            problem: self.problem.replace(&folder, ""),
            remedy: self.remedy.map(|remedy| remedy.replace(&folder, "")),
        }
    }
}

impl From<&Error> for Failure {
    fn from(error: &Error) -> Self {
        match error {
            Error::Data {
                problem, remedy, ..
            } => Self {
                problem: problem.clone(),
                remedy: Some(remedy.clone()).filter(|remedy| !remedy.is_empty()),
            },
            other => Self {
                problem: other.to_string(),
                remedy: None,
            },
        }
    }
}

/// One item.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Item {
    /// `<kind>_<plot>_<date>_<16 digits>`: the digits are a hash of everything on which the results depend.
    pub name: String,
    /// The kind of its work.
    pub kind: Kind,
    /// The plot; `None` for a calibration.
    pub plot: Option<String>,
    /// The date, YYYY-MM-DD; `None` for a calibration of all dates.
    pub date: Option<String>,
    /// The earlier date of a change.
    pub before: Option<String>,
    /// The files that it reads.
    pub inputs: Vec<InputFile>,
    /// Names of the items whose results it reads.
    pub needs: Vec<String>,
    /// The work with its settings.
    pub task: Task,
}

impl Item {
    /// The item with its name.
    pub fn named(mut self) -> Self {
        let hashes: Vec<_> = self.inputs.iter().map(|input| &input.hash).collect();
        let key = Key::default().with(&self.task).with(&self.needs);
        let key = key.with(&hashes).to_string();
        let mut name = self.kind.name().to_owned();
        for part in [&self.plot, &self.date].into_iter().flatten() {
            name = name + "_" + part;
        }
        self.name = name + "_" + &key[..16];
        self
    }

    /// The folder of its results.
    pub fn folder(&self, out: &Path) -> PathBuf {
        folder_of(out, &self.name)
    }

    /// Whether it is finished.
    pub fn is_finished(&self, out: &Path) -> bool {
        self.folder(out).join(RESULT).is_file()
    }
}

impl Display for Item {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let words = [
            Some(self.kind.name()),
            self.plot.as_deref(),
            self.date.as_deref(),
        ];
        let words: Vec<&str> = words.into_iter().flatten().collect();
        write!(f, "{}", words.join(" "))
    }
}

/// The file that is written last to the folder of an item.
pub const RESULT: &str = "result.json";
/// A file beside [`RESULT`] with time and memory, which are all that differs between runs.
pub const WORK: &str = "work.json";

/// The folder of the results of the item of this name.
pub fn folder_of(out: &Path, name: &str) -> PathBuf {
    out.join("items").join(name)
}

/// The file with the reason why the item of this name failed.
pub fn failure_of(out: &Path, name: &str) -> PathBuf {
    out.join("failed").join(format!("{name}.json"))
}

/// A hash of content that is passed in pieces: 32 hexadecimal digits.
#[derive(Clone)]
pub struct ContentHash(Hasher);

impl Default for ContentHash {
    fn default() -> Self {
        Self(Hasher::new())
    }
}

impl ContentHash {
    /// Adds the next piece.
    pub fn update(&mut self, bytes: &[u8]) {
        self.0.write(bytes);
    }

    /// The digits.
    pub fn digits(&self) -> String {
        format!("{:032x}", self.0.finish_128())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(hash: &str, tile_m: f64) -> Item {
        let project = ProjectText {
            path: "a/project.toml".into(),
            text: "x".into(),
        };
        let item = Item {
            name: String::new(),
            kind: Kind::Drive,
            plot: Some("p".into()),
            date: Some("2025-05-01".into()),
            before: None,
            inputs: vec![InputFile {
                path: "a".into(),
                hash: Some(hash.into()),
            }],
            needs: Vec::new(),
            task: Task::Drive {
                project,
                mountings: MountingsFrom::Project,
                reference: None,
                tile_m,
            },
        };
        item.named()
    }

    #[test]
    fn names_follow_from_content_and_settings() {
        let first = item("1", 20.0);
        assert!(first.name.starts_with("drive_p_2025-05-01_"));
        assert_eq!(first, item("1", 20.0));
        assert_ne!(first.name, item("2", 20.0).name);
        assert_ne!(first.name, item("1", 10.0).name);
        let text = serde_json::to_string(&first).unwrap();
        assert_eq!(serde_json::from_str::<Item>(&text).unwrap(), first);
    }

    #[test]
    fn content_in_pieces_has_the_hash_of_the_whole() {
        let mut hash = ContentHash::default();
        hash.update(b"abc");
        hash.update(b"def");
        assert_eq!(
            hash.digits(),
            format!("{:032x}", Hasher::oneshot(b"abcdef"))
        );
    }
}
