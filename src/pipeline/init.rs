//! Makes a project from the files of a folder.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Problem, Result};
use crate::format::{self, Format, Input};
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::{BodyFromScanner, EulerConvention};

/// Depth of the subfolders that are searched.
const DEEPEST: usize = 4;
/// Largest number of files: a folder with more is not the folder of a drive.
const MOST_FILES: usize = 10_000;

/// The files of a folder, sorted by purpose, with paths relative to the folder.
#[derive(Debug, Default)]
struct SortedFiles {
    imu: Vec<PathBuf>,
    prism: Vec<PathBuf>,
    gnss: Vec<PathBuf>,
    heading: Vec<PathBuf>,
    poses: Vec<PathBuf>,
    profiles: Vec<PathBuf>,
    clouds: Vec<PathBuf>,
    mountings: Vec<(PathBuf, BodyFromScanner)>,
    /// Recordings of several sensors, with a description of their contents.
    recordings: Vec<(PathBuf, String)>,
    /// Text and binary files of unknown formats.
    unknown: Vec<PathBuf>,
    /// Reasons why files of a known format were not read.
    unread: Vec<String>,
}

/// A project made from the files of a folder.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NewProject {
    /// The project file.
    pub text: String,
    /// Keys and tables that the user must fill in.
    pub missing: Vec<&'static str>,
    /// Reasons why files of a known format were not read.
    pub unread: Vec<String>,
}

impl NewProject {
    fn misses(&mut self, key: &'static str) {
        if !self.missing.contains(&key) {
            self.missing.push(key);
        }
    }
}

/// Makes a commented project file for the logs, recordings and clouds below `folder`, with relative paths. A value that
/// the files do not contain is left as a comment for the user to fill in: a run then names the missing values.
///
/// # Errors
/// A folder that cannot be read, with too many files, or without a recording of a scanner.
pub fn init(folder: &Path) -> Result<NewProject> {
    if !folder.is_dir() {
        let expected = "a folder with the files of a drive";
        return Err(if folder.exists() {
            Error::format(folder, Location::Whole, "a file", expected)
        } else {
            Error::format(folder, Location::Whole, "no such folder", expected)
        });
    }
    let mut files = Vec::new();
    list(folder, DEEPEST, &mut files)?;
    files.sort();
    let mut sorted = SortedFiles::default();
    for file in &files {
        sorted.add(folder, file);
    }
    if sorted.profiles.is_empty() && sorted.recordings.is_empty() {
        return Err(Error::of(
            Problem::TooFew,
            format!(
                "none of the {} files in {} is a recording of a scanner",
                files.len(),
                folder.display()
            ),
            "see how each file is read: boresight inspect FILE…",
        ));
    }
    Ok(sorted.project())
}

fn list(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<()> {
    let error = |e| Error::io(folder, e);
    for entry in std::fs::read_dir(folder).map_err(error)? {
        let entry = entry.map_err(error)?;
        let path = entry.path();
        if entry.file_name().to_string_lossy().starts_with('.') {
            continue;
        }
        // Results of runs and the truth of simulated drives are not inputs.
        let is_other = ["out", "truth"].iter().any(|name| path.ends_with(name));
        if path.is_dir() && depth > 0 && !is_other {
            list(&path, depth - 1, files)?;
        } else if path.is_file() {
            if files.len() == MOST_FILES {
                return Err(Error::of(
                    Problem::TooMany,
                    format!("more than {MOST_FILES} files up to {}", folder.display()),
                    "name the folder of one drive",
                ));
            }
            files.push(path);
        }
    }
    Ok(())
}

impl SortedFiles {
    fn add(&mut self, folder: &Path, file: &Path) {
        let path = file.strip_prefix(folder).unwrap_or(file).to_owned();
        let input = &Input::from(file);
        let Ok(format) = format::detect(input) else {
            self.unknown.push(path);
            return;
        };
        if format.id() == "project" {
            return;
        }
        if format.id() == "bonn-mounting" {
            match format::read_mounting(input) {
                Ok(mounting) => self.mountings.push((path, mounting)),
                Err(error) => self.unread.push(error.to_string()),
            }
            return;
        }
        if format.id() == "ros-bag" {
            match format::inspect(input) {
                Ok(inspection) => self.recordings.push((path, inspection.notes.join("; "))),
                Err(error) => self.unread.push(error.to_string()),
            }
            return;
        }
        let name = path.to_string_lossy().to_lowercase();
        let is_gnss = ["gnss", "gps", "rtk"]
            .iter()
            .any(|word| name.contains(word));
        match Role::of(format) {
            Role::Cloud => self.clouds.push(path),
            Role::Profiles => self.profiles.push(path),
            Role::Poses => self.poses.push(path),
            Role::Positions if is_gnss => self.gnss.push(path),
            Role::Positions => self.prism.push(path),
            Role::Geographic => self.gnss.push(path),
            Role::Logs => {
                let heading = format
                    .has_heading()
                    .then(|| format::read_heading(input).map(drop));
                let imu = format.has_imu().then(|| format::read_imu(input).map(drop));
                if let Some(Ok(())) = &heading {
                    self.heading.push(path.clone());
                }
                if let Some(Ok(())) = &imu {
                    self.imu.push(path);
                }
                // A format that can hold both may hold only one of them.
                let both = heading.into_iter().chain(imu);
                let (read, errors): (Vec<_>, Vec<_>) = both.partition(Result::is_ok);
                if read.is_empty() {
                    let why = errors.into_iter().filter_map(Result::err).next_back();
                    self.unread.extend(why.map(|error| error.to_string()));
                }
            }
            Role::None => self.unknown.push(path),
        }
    }

    fn project(&self) -> NewProject {
        let mut made = NewProject {
            text: "# Keys that the files do not give are commented out: fill in their values.\n\
                   [frame]\nbody = \"FRD\"                  # x forward, y right, z down; or \"FLU\"\n"
                .to_owned(),
            missing: Vec::new(),
            unread: self.unread.clone(),
        };
        if self.poses.is_empty() {
            self.logs(&mut made);
        } else {
            let files = list_of(&self.poses);
            made.text += &format!(
                "\n[trajectory]\nfile = {files}\n\
                 # If the file gives no standard deviations, the joint adjustment needs these:\n\
                 # sigma_position_m = 0.01\n# sigma_rotation_deg = 0.05\n"
            );
            let positions = self.prism.iter().chain(&self.gnss);
            let logs = self.imu.iter().chain(positions).chain(&self.heading);
            let what = "logs from which the trajectory could be estimated instead";
            list_as_comment(&mut made.text, what, logs);
        }
        let mut names: Vec<String> = Vec::new();
        for profiles in &self.profiles {
            let plain = scanner_name(profiles);
            let numbered = (2..).map(|number| format!("{plain}-{number}"));
            let mut free = std::iter::once(plain.clone()).chain(numbered);
            let name = free.find(|name| !names.contains(name)).unwrap_or_default();
            self.scanner(&mut made, profiles, &plain, &name);
            names.push(name);
        }
        if self.profiles.is_empty() {
            made.misses("[[scanner]]");
        }
        for (path, topics) in &self.recordings {
            made.text += &format!(
                "\n# {} contains {topics}.\n# Append the topic to the file name: file = {}\n",
                path.display(),
                quoted(&format!("{}#/topic", path.display()))
            );
        }
        if let Some((first, further)) = self.clouds.split_first() {
            made.text += &format!("\n[reference]\nfile = {}\n", quoted_path(first));
            list_as_comment(&mut made.text, "other clouds", further);
        }
        list_as_comment(&mut made.text, "files of unknown formats", &self.unknown);
        for error in &self.unread {
            made.text += &format!("# not read: {}\n", error.replace('\n', " "));
        }
        made
    }

    fn logs(&self, made: &mut NewProject) {
        let arm =
            "# lever_arm_m =                   # from the IMU, in the body frame: [x, y, z]\n";
        let noise = "# the noise of its datasheet: gyro_noise_deg_sqrt_h = …\n";
        let offset =
            "# mounting_offset_deg = 0.0       # of the antenna baseline from the body's x axis\n";
        for (name, files, keys) in [
            ("imu", &self.imu, noise),
            ("prism", &self.prism, arm),
            ("gnss", &self.gnss, arm),
            ("heading", &self.heading, offset),
        ] {
            if let Some((first, further)) = files.split_first() {
                made.text += &format!("\n[{name}]\nfile = {}\n{keys}", quoted_path(first));
                list_as_comment(&mut made.text, "others of this kind", further);
                if keys == arm {
                    made.misses("lever_arm_m");
                }
            }
        }
        if self.imu.is_empty() {
            made.misses("[imu], or [trajectory] with poses");
        }
        if self.prism.is_empty() && self.gnss.is_empty() {
            made.misses("[prism] or [gnss], or [trajectory] with poses");
        }
    }

    fn scanner(&self, made: &mut NewProject, profiles: &Path, plain: &str, name: &str) {
        let _ = write!(
            made.text,
            "\n[[scanner]]\nname = {}\nprofiles = {}\n",
            quoted(name),
            quoted_path(profiles)
        );
        let mut mountings = self.mountings.iter();
        match mountings.find(|(path, _)| scanner_name(path) == plain) {
            Some((path, mounting)) => {
                let t = mounting.translation_m;
                let angles = euler_deg_from_rotation(EulerConvention::Bonn, &mounting.rotation);
                let list = |values: [f64; 3]| {
                    let [x, y, z] = values.map(|x| (x * 1e6).round() / 1e6);
                    format!("[{x:?}, {y:?}, {z:?}]")
                };
                let _ = writeln!(
                    made.text,
                    "# from {}\ntranslation_m = {}\nrotation_deg = {}\nrotation_convention = \"bonn\"",
                    path.display(),
                    list([t.x, t.y, t.z]),
                    list(angles)
                );
            }
            None => {
                made.misses("translation_m");
                made.misses("rotation_deg");
                made.text += "# translation_m =                 # of the scanner in the body frame, by tape: \
                              [x, y, z]\n\
                              # rotation_deg =                  # [α, β, γ], to some degrees\n\
                              # rotation_convention = \"zyx\"     # or \"bonn\"\n";
            }
        }
    }
}

/// The purpose of files of a format.
enum Role {
    Cloud,
    Profiles,
    Poses,
    Positions,
    Geographic,
    Logs,
    None,
}

impl Role {
    fn of(format: Format) -> Self {
        match format {
            _ if format.has_imu() || format.has_heading() => Self::Logs,
            _ if format.has_positions() => Self::Positions,
            _ if format.has_geographic() => Self::Geographic,
            _ if format.has_cloud() => Self::Cloud,
            _ if format.has_profiles() => Self::Profiles,
            _ if format.has_poses() => Self::Poses,
            _ => Self::None,
        }
    }
}

/// `left` or `right` by the last letter of the file, as the Bonn group names its files, otherwise the file's name.
fn scanner_name(profiles: &Path) -> String {
    let stem = profiles.file_stem().unwrap_or_default().to_string_lossy();
    let mut letters = stem.chars().rev();
    let (last, before) = (letters.next(), letters.next());
    let stands_alone = before.is_none_or(|c| !c.is_alphabetic());
    match last {
        Some('l' | 'L') if stands_alone => "left".into(),
        Some('r' | 'R') if stands_alone => "right".into(),
        _ => {
            let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
            stem.chars().map(plain).collect()
        }
    }
}

/// Lists files as a comment.
fn list_as_comment<'a>(
    text: &mut String,
    what: &str,
    files: impl IntoIterator<Item = &'a PathBuf>,
) {
    let names: Vec<String> = files
        .into_iter()
        .map(|path| path.display().to_string())
        .collect();
    if !names.is_empty() {
        *text += &format!("# {what}: {}\n", names.join(", "));
    }
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

fn quoted_path(path: &Path) -> String {
    quoted(&path.to_string_lossy())
}

/// One file, or a list of them.
fn list_of(files: &[PathBuf]) -> String {
    match files {
        [one] => quoted_path(one),
        all => {
            let names: Vec<String> = all.iter().map(|path| quoted_path(path)).collect();
            format!("[{}]", names.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_cannot_be_read_are_listed_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let write =
            |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        write("left.csv", "time_s,x_m,z_m\n0,0.1,1.0\n0,0.2,1.0\n");
        let imu = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\n";
        write(
            "imu.csv",
            &format!("{imu}0,0,0,0,0,0,-9.81\n1,0,zero,0,0,0,-9.81\n"),
        );
        let made = init(folder.path()).unwrap();
        assert!(made.missing.contains(&"[imu], or [trajectory] with poses"));
        let [why] = made.unread.as_slice() else {
            panic!("{:?}", made.unread);
        };
        assert!(
            why.contains("imu.csv, line 3") && why.contains("zero"),
            "{why}"
        );
        assert!(
            made.text.contains(&format!("# not read: {why}")),
            "{}",
            made.text
        );
    }

    #[test]
    fn a_folder_with_too_many_files_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        for number in 0..=MOST_FILES {
            std::fs::write(folder.path().join(number.to_string()), "").unwrap();
        }
        let error = init(folder.path()).unwrap_err().to_string();
        assert!(error.contains("more than 10000 files"), "{error}");
    }
}
