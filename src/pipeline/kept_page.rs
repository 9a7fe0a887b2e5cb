//! The content of a run's page, kept beside it, so that the page can be made again without computing.
//!
//! The file names the program that wrote it, because only the same program can read its content, and ends with a hash
//! of all preceding bytes.

use std::path::Path;

use serde_json::json;
use twox_hash::xxhash3_128::Hasher;

use super::outcome::Outcome;
use super::page;
use super::program::PROGRAM;
use crate::calibration::{Calibration, Variant};
use crate::comparison::MountingKind;
use crate::error::{Error, Location, Result};
use crate::geometry::{BodyFromScanner, Vec3};
use crate::joint::JointReport;
use crate::output::write_whole;
use crate::progress::{Progress, StageSeconds};
use crate::project::Project;
use crate::report::content::{Comparison, Content, Fact, InputFile, Platform};
use crate::report::scene::Scene;
use crate::report::{self, Imprint, csv};
use crate::results::{Calibrations, Drive};
use crate::stored::{Stored, store_all, stored};
use crate::verdict::Verdict;

/// Name of the file.
pub const NAME: &str = "report.kept";
/// Name of the page that is made from it.
const PAGE: &str = "report.html";
/// First line of the file; the program follows on the second line.
const MAGIC: &str = "boresight report\n";
/// Length of the hash at the end.
const HASH: usize = 16;

/// The content of a page, owned.
struct Kept {
    /// Absolute path of the project file: some of its settings concern only the page.
    path: String,
    title: String,
    command: String,
    project: String,
    seed: Option<u64>,
    imprint: Imprint,
    logo: Option<String>,
    made_s: Option<f64>,
    inputs: Vec<Fact>,
    csv: Vec<String>,
    files: Vec<InputFile>,
    platform: Option<Platform>,
    calibrations: Option<KeptCalibrations>,
    comparison: Option<Comparison>,
    drives: Vec<Drive>,
    scenes: Vec<Option<Scene>>,
    background_m: Vec<Vec3>,
    stages: Vec<StageSeconds>,
    peak_memory_bytes: Option<u64>,
    warnings: Vec<String>,
    verdicts: Vec<Verdict>,
}

struct KeptCalibrations {
    mountings: Vec<(MountingKind, Vec<BodyFromScanner>)>,
    result: Calibration,
    joint: Option<JointReport>,
    variants: Vec<(Variant, Calibration)>,
    origin_m: Vec3,
}
stored!(struct KeptCalibrations { mountings, result, joint, variants, origin_m });

/// The content of a page of the project at `path`, as bytes.
pub fn bytes_of(content: &Content, path: &Path) -> Vec<u8> {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut bytes = header(PROGRAM).into_bytes();
    absolute.to_string_lossy().into_owned().store(&mut bytes);
    store(content, &mut bytes);
    Hasher::oneshot(&bytes).store(&mut bytes);
    bytes
}

fn header(program: &str) -> String {
    format!("{MAGIC}{program}\n")
}

/// Makes the page in the folder of a run again from the content that the run kept, without computing.
///
/// # Errors
/// The folder has no such file, or another program wrote it; the file is damaged; the page cannot be written.
pub fn report(folder: &Path, progress: &dyn Progress) -> Result<Outcome> {
    let kept = read(folder)?;
    let mut content = kept.content();
    let path = Path::new(&kept.path);
    if path.is_file() {
        let set = Project::read(path);
        match set.and_then(|project| page::settings_of(&project, &mut content)) {
            Ok(()) => {}
            Err(error) => progress.warn(&format!(
                "the settings of the page are those of the run, as the project cannot be read: {error}"
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

/// Reads the content that a run kept in a folder.
fn read(folder: &Path) -> Result<Kept> {
    let path = folder.join(NAME);
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Err(Error::data(
                format!(
                    "{}: there is no {NAME}, which a run keeps for its page",
                    folder.display()
                ),
                "name the folder with the results of `boresight run` or `boresight demo`; older runs kept nothing: \
                 run them again",
            ));
        }
        Err(error) => return Err(Error::io(&path, error)),
    };
    parse(&path, &bytes, PROGRAM)
}

fn parse(path: &Path, bytes: &[u8], program: &str) -> Result<Kept> {
    let wrong = |at, found: &str, expected: &str| Err(Error::format(path, at, found, expected));
    if !bytes.starts_with(MAGIC.as_bytes()) {
        let expected = format!("`{}`, as a run writes it", MAGIC.trim_end());
        return wrong(Location::Line(1), "another file", &expected);
    }
    let content = bytes.split_last_chunk::<HASH>().filter(|(before, hash)| {
        before.len() >= MAGIC.len() && Hasher::oneshot(before) == u128::from_le_bytes(**hash)
    });
    let Some((before, _)) = content else {
        let expected = "the file as the run wrote it; run again";
        return wrong(
            Location::Byte(bytes.len() as u64),
            "a file that is cut off or changed",
            expected,
        );
    };
    let Some(mut left) = before.strip_prefix(header(program).as_bytes()) else {
        let other = before[MAGIC.len()..].split(|byte| *byte == b'\n').next();
        let found = format!(
            "a page kept by another program (boresight {})",
            String::from_utf8_lossy(other.unwrap_or_default())
        );
        let expected = format!(
            "one kept by this program (boresight {program}): use that program, or run again with this one"
        );
        return wrong(Location::Line(2), &found, &expected);
    };
    let kept = restore(&mut left);
    match kept.filter(|_| left.is_empty()) {
        Some(kept) => Ok(kept),
        None => wrong(
            Location::Whole,
            "content that is no page",
            "what this program writes; run again",
        ),
    }
}

/// Appends the content to `bytes`. [`restore`] reads it in the same order.
fn store(content: &Content, bytes: &mut Vec<u8>) {
    // All fields are named, so that a new field cannot be forgotten.
    let Content {
        title,
        command,
        project,
        seed,
        imprint,
        logo,
        made_s,
        inputs,
        csv,
        files,
        platform,
        calibrations,
        comparison,
        drives,
        scenes,
        background_m,
        stages,
        peak_memory_bytes,
        warnings,
        verdicts,
    } = content;
    for text in [title, command, project] {
        text.store(bytes);
    }
    seed.store(bytes);
    // The page contains the logo itself, so the path of its file is not needed.
    for text in [&imprint.title, &imprint.author, &imprint.organisation, logo] {
        text.store(bytes);
    }
    made_s.store(bytes);
    inputs.store(bytes);
    let names: Vec<String> = csv.iter().map(|name| (*name).to_owned()).collect();
    names.store(bytes);
    store_all(files, bytes);
    platform.store(bytes);
    calibrations.is_some().store(bytes);
    if let Some(calibrations) = calibrations {
        let Calibrations {
            mountings,
            result,
            joint,
            variants,
            origin_m,
        } = *calibrations;
        store_all(mountings, bytes);
        result.store(bytes);
        joint.is_some().store(bytes);
        if let Some(joint) = joint {
            joint.store(bytes);
        }
        store_all(variants, bytes);
        origin_m.store(bytes);
    }
    comparison.store(bytes);
    store_all(drives, bytes);
    store_all(scenes, bytes);
    store_all(background_m, bytes);
    stages.len().store(bytes);
    for StageSeconds { name, seconds } in *stages {
        name.store(bytes);
        seconds.store(bytes);
    }
    peak_memory_bytes.store(bytes);
    store_all(warnings, bytes);
    verdicts.store(bytes);
}

/// Reads the output of [`bytes_of`] after the header; `None` if it is not valid.
fn restore(bytes: &mut &[u8]) -> Option<Kept> {
    Some(Kept {
        path: Stored::restore(bytes)?,
        title: Stored::restore(bytes)?,
        command: Stored::restore(bytes)?,
        project: Stored::restore(bytes)?,
        seed: Stored::restore(bytes)?,
        imprint: Imprint {
            title: Stored::restore(bytes)?,
            author: Stored::restore(bytes)?,
            organisation: Stored::restore(bytes)?,
            logo: None,
        },
        logo: Stored::restore(bytes)?,
        made_s: Stored::restore(bytes)?,
        inputs: Stored::restore(bytes)?,
        csv: Stored::restore(bytes)?,
        files: Stored::restore(bytes)?,
        platform: Stored::restore(bytes)?,
        calibrations: Stored::restore(bytes)?,
        comparison: Stored::restore(bytes)?,
        drives: Stored::restore(bytes)?,
        scenes: Stored::restore(bytes)?,
        background_m: Stored::restore(bytes)?,
        stages: {
            let stages: Vec<(String, f64)> = Stored::restore(bytes)?;
            let named = stages.into_iter();
            let named = named.map(|(name, seconds)| StageSeconds { name, seconds });
            named.collect()
        },
        peak_memory_bytes: Stored::restore(bytes)?,
        warnings: Stored::restore(bytes)?,
        verdicts: Stored::restore(bytes)?,
    })
}

impl Kept {
    fn content(&self) -> Content<'_> {
        let calibrations = self.calibrations.as_ref().map(|kept| Calibrations {
            mountings: &kept.mountings,
            result: &kept.result,
            joint: kept.joint.as_ref(),
            variants: &kept.variants,
            origin_m: kept.origin_m,
        });
        let csv = csv::FILES.iter();
        let csv = csv.filter(|file| self.csv.iter().any(|name| name == file.name));
        Content {
            title: self.title.clone(),
            command: self.command.clone(),
            project: self.project.clone(),
            seed: self.seed,
            imprint: self.imprint.clone(),
            logo: self.logo.clone(),
            made_s: self.made_s,
            inputs: self.inputs.clone(),
            csv: csv.map(|file| file.name).collect(),
            files: &self.files,
            platform: self.platform.clone(),
            calibrations,
            comparison: self.comparison.clone(),
            drives: &self.drives,
            scenes: &self.scenes,
            background_m: &self.background_m,
            stages: &self.stages,
            peak_memory_bytes: self.peak_memory_bytes,
            warnings: &self.warnings,
            verdicts: self.verdicts.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_this_page_is_named() {
        let content = Content {
            title: "A drive".into(),
            seed: Some(7),
            ..Content::default()
        };
        let path = Path::new("out/report.kept");
        let program = PROGRAM;
        let bytes = bytes_of(&content, Path::new("project.toml"));
        let kept = parse(path, &bytes, program).unwrap();
        assert_eq!(report::render(&kept.content()), report::render(&content));
        assert!(Path::new(&kept.path).is_absolute());

        let refused = |bytes: &[u8], program: &str| {
            let error = parse(path, bytes, program).err().unwrap().to_string();
            assert!(error.starts_with("out/report.kept"), "{error}");
            error
        };
        for length in 0..bytes.len() {
            let error = refused(&bytes[..length], program);
            let at_all = length >= MAGIC.len();
            assert_eq!(error.contains("cut off"), at_all, "{length} bytes: {error}");
        }
        for place in 0..bytes.len() {
            let mut bytes = bytes.clone();
            bytes[place] ^= 1;
            refused(&bytes, program);
        }
        let error = refused(&bytes, "another");
        assert!(error.contains("another program"), "{error}");
        assert!(error.contains(env!("CARGO_PKG_VERSION")), "{error}");
    }
}
