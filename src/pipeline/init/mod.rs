//! Makes a project from the files of a folder.

mod drives;
mod files;
mod role;
mod turning;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::error::{Error, Problem, Result};
use crate::format::DescribedNoise;
use crate::geometry::EulerConvention;
use crate::geometry::euler::euler_deg_from_rotation;
use crate::sensor::STANDARD_GRAVITY_M_S2;
pub use files::FileUse;
use files::SortedFiles;

/// Files that an error lists.
const MOST_LISTED: usize = 20;

/// A project made from the files of a folder.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NewProject {
    /// The project file.
    pub text: String,
    /// Keys and tables that the user must fill in.
    pub missing: Vec<&'static str>,
    /// Reasons why files of a known format were not read.
    pub unread: Vec<String>,
    /// Each file of the folder, and what it can serve as.
    pub files: Vec<FileUse>,
    /// Whether the project gives a trajectory and no calibration, because no file is a recording of a scanner.
    pub is_trajectory_only: bool,
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
/// A folder that cannot be read, with too many files, with the files of several drives, or without a recording, a log or a
/// trajectory.
pub fn init(folder: &Path) -> Result<NewProject> {
    let mut sorted = files::sorted(folder)?;
    if sorted.is_without_measurements() {
        let uses = sorted.uses.iter().take(MOST_LISTED);
        let uses: String = uses.map(|file| format!("\n  {file}")).collect();
        return Err(Error::of(
            Problem::TooFew,
            format!(
                "none of the {} files in {} is a recording of a scanner, a log or a trajectory{uses}",
                sorted.uses.len(),
                folder.display()
            ),
            "see how each file is read: boresight inspect FILE…",
        ));
    }
    drives::check(folder, &sorted, scanner_name)?;
    let made = sorted.project();
    sorted.name_unused();
    Ok(NewProject {
        files: sorted.uses,
        ..made
    })
}

/// The files below a folder, and what each can serve as.
///
/// # Errors
/// A folder that cannot be read, or with too many files.
pub fn survey(folder: &Path) -> Result<Vec<FileUse>> {
    Ok(files::sorted(folder)?.uses)
}

impl SortedFiles {
    fn project(&self) -> NewProject {
        let mut made = NewProject {
            text: "# Keys that the files do not give are commented out: fill in their values.\n\
                   [frame]\nbody = \"FRD\"                  # x forward, y right, z down; or \"FLU\"\n"
                .to_owned(),
            unread: self.unread.clone(),
            ..NewProject::default()
        };
        let has_scanner = self.has_scanner();
        let poses = self.trajectory_files();
        let is_from_logs = self.is_from_logs();
        let positions = self.gnss.first();
        let mut places = poses
            .iter()
            .filter(|_| !is_from_logs)
            .chain(positions.filter(|_| is_from_logs));
        if places.any(|path| self.is_geographic(path)) {
            made.misses("crs");
            made.text += "# crs =                           # projected system of the world, such as \"EPSG:25832\"\n";
        }
        if is_from_logs {
            self.logs(&mut made);
            let what = "poses that could be used instead of these logs";
            list_as_comment(&mut made.text, what, &poses);
        } else {
            let files = list_of(&poses);
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
            let name = free_name(&plain, &names);
            self.scanner(&mut made, profiles, &plain, &name);
            names.push(name);
        }
        self.posed_scanner(&mut made, &mut names);
        if !has_scanner {
            made.is_trajectory_only = self.recordings.is_empty();
            if !made.is_trajectory_only {
                made.misses("[[scanner]]");
            }
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
        for error in &made.unread.clone() {
            made.text += &format!("# not read: {}\n", error.replace('\n', " "));
        }
        made
    }

    /// Whether there is a recording of a scanner.
    fn has_scanner(&self) -> bool {
        !(self.profiles.is_empty() && self.posed.is_empty())
    }

    /// Whether the trajectory is estimated from logs rather than taken from poses.
    fn is_from_logs(&self) -> bool {
        let has_positions = !(self.prism.is_empty() && self.gnss.is_empty());
        let has_poses = !(self.poses.is_empty() && self.posed.is_empty());
        !has_poses || !self.has_scanner() && has_positions && !self.imu.is_empty()
    }

    /// Says of the logs, or of the poses, that the project has the other in their place.
    fn name_unused(&mut self) {
        let logs = [&self.imu, &self.prism, &self.gnss, &self.heading];
        let (unused, instead) = if self.is_from_logs() {
            (self.poses.clone(), "logs")
        } else {
            let logs = logs.into_iter().flatten();
            (
                logs.filter(|path| !self.poses.contains(path))
                    .cloned()
                    .collect(),
                "poses",
            )
        };
        for path in unused {
            self.use_as(&path, |serves| {
                format!("{serves}, named in a comment: the project has {instead} in its place")
            });
        }
    }

    /// Whether the places in a file are latitudes and longitudes.
    fn is_geographic(&self, path: &Path) -> bool {
        let file = self.uses.iter().find(|file| file.path == path);
        let format = file.and_then(|file| file.format);
        format.is_some_and(|format| format.has_geographic() || format.has_geographic_poses())
    }

    /// The files of poses: those of the sensor in LAS, if there are any, since the points belong to these.
    fn trajectory_files(&self) -> Vec<PathBuf> {
        if self.posed.is_empty() {
            return self.poses.clone();
        }
        self.posed.iter().map(|(path, _)| path.clone()).collect()
    }

    /// The scanner of LAS with the sensor's pose at every point.
    fn posed_scanner(&self, made: &mut NewProject, names: &mut Vec<String>) {
        let Some((first, _)) = self.posed.first() else {
            return;
        };
        let name = free_name(&scanner_name(first), names);
        let _ = write!(
            made.text,
            "\n[[scanner]]\nname = {}\nprofiles = {}\n\
             # the poses of the file are those of the scanner itself\n\
             translation_m = [0.0, 0.0, 0.0]\nrotation_deg = [0.0, 0.0, 0.0]\n",
            quoted(&name),
            list_of(&self.trajectory_files())
        );
        names.push(name);
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
                made.text += &format!("\n[{name}]\nfile = {}\n", quoted_path(first));
                let described = self
                    .noise
                    .iter()
                    .find(|(path, _)| name == "imu" && path.parent() == first.parent());
                match described {
                    Some((path, noise)) => made.text += &noise_keys(path, noise),
                    None => made.text += keys,
                }
                list_as_comment(&mut made.text, "others of this kind", further);
                if keys == arm {
                    made.misses("lever_arm_m");
                }
                if self.polar.contains(first) {
                    made.misses("station_m");
                    made.text += "# station_m =                     # of the total station's axes: [east, north, up]\n\
                                  # station_orientation_deg = 0.0   # grid bearing of its zero direction\n";
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

/// A name for a scanner that no other has.
fn free_name(plain: &str, names: &[String]) -> String {
    let numbered = (2..).map(|number| format!("{plain}-{number}"));
    let mut free = std::iter::once(plain.to_owned()).chain(numbered);
    free.find(|name| !names.contains(name)).unwrap_or_default()
}

/// The noise of an IMU, in the keys of the project.
fn noise_keys(path: &Path, noise: &DescribedNoise) -> String {
    let deg_sqrt_h = 60.0 * 1f64.to_degrees();
    let ug = 1e6 / STANDARD_GRAVITY_M_S2;
    let keys = [
        ("gyro_noise_deg_sqrt_h", noise.gyro_density, deg_sqrt_h),
        ("accel_noise_ug_sqrt_hz", noise.accel_density, ug),
        ("gyro_bias_walk_rad_s_sqrt_s", noise.gyro_bias_walk, 1.0),
        ("accel_bias_walk_m_s2_sqrt_s", noise.accel_bias_walk, 1.0),
    ];
    let mut text = format!(
        "# the noise of {}, which is without that of vibrations\n",
        path.display()
    );
    for (key, value, unit) in keys {
        // Rounded to six digits.
        let value = value.and_then(|value| format!("{:.5e}", value * unit).parse::<f64>().ok());
        if let Some(value) = value {
            let _ = writeln!(text, "{key} = {value:?}");
        }
    }
    text
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
    use super::files::MOST_FILES;
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
