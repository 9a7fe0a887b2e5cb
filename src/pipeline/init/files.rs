//! What the files of a folder are, and what they can serve as.

use std::collections::HashSet;
use std::fmt;
use std::path::{Path, PathBuf};

use super::role::{Role, is_log};
use super::turning::Turning;
use crate::error::{Error, Location, Problem, Result};
use crate::format::{self, DescribedNoise, Format, Input, utc};
use crate::geometry::BodyFromScanner;

/// Depth of the subfolders that are searched.
const DEEPEST: usize = 4;
/// Largest number of files: a folder with more is not the folder of a drive.
pub const MOST_FILES: usize = 10_000;
const IMU: &str = "the samples of an IMU: [imu]";
const HEADING: &str = "headings: [heading]";
const GEOGRAPHIC: &str = "latitudes and longitudes of an antenna: [gnss], with frame.crs";
const GEOGRAPHIC_POSES: &str = "poses with latitudes and longitudes: [trajectory], with frame.crs";

/// The number of records, and their first and last time, seconds.
type Extent = (Option<u64>, Option<[f64; 2]>);

fn extent<T>(records: &[T], time_s: fn(&T) -> f64) -> Extent {
    let times_s = || records.iter().map(time_s);
    let span_s = times_s().reduce(f64::min).zip(times_s().reduce(f64::max));
    (Some(records.len() as u64), span_s.map(Into::into))
}

/// A file, and what it can serve as.
#[derive(Debug, Clone, PartialEq)]
pub struct FileUse {
    /// The file, relative to the folder.
    pub path: PathBuf,
    /// Its format; `None` if it is not recognised.
    pub format: Option<Format>,
    /// What it can serve as, or why it can serve as nothing.
    pub serves: String,
    /// Rows, samples, poses or points; `None` if they were not counted.
    pub count: Option<u64>,
    /// First and last time, seconds.
    pub span_s: Option<[f64; 2]>,
}

impl fmt::Display for FileUse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.path.display(), self.serves)?;
        if let Some(count) = self.count {
            write!(f, "; {count} rows")?;
        }
        match self.span_s {
            Some([first_s, last_s]) => match (utc(first_s), utc(last_s)) {
                (Some(first), Some(last)) => write!(f, ", {first} to {last} UTC"),
                _ => write!(f, ", {first_s:.1} s to {last_s:.1} s"),
            },
            None => Ok(()),
        }
    }
}

/// The files of a folder, sorted by purpose, with paths relative to the folder.
#[derive(Default)]
pub struct SortedFiles {
    pub imu: Vec<PathBuf>,
    pub prism: Vec<PathBuf>,
    pub gnss: Vec<PathBuf>,
    pub heading: Vec<PathBuf>,
    pub poses: Vec<PathBuf>,
    pub profiles: Vec<PathBuf>,
    /// LAS with the pose of one sensor at every point, which are profiles and poses, in time order, with their first and
    /// last time, seconds.
    pub posed: Vec<(PathBuf, [f64; 2])>,
    pub clouds: Vec<PathBuf>,
    pub mountings: Vec<(PathBuf, BodyFromScanner)>,
    /// The noise of the IMU logs beside these files.
    pub noise: Vec<(PathBuf, DescribedNoise)>,
    /// The rates at which the logs of IMUs turn.
    pub turnings: Vec<(PathBuf, Turning)>,
    /// Recordings of several sensors, with a description of their contents.
    pub recordings: Vec<(PathBuf, String)>,
    /// Polar observations, which need the position of their total station.
    pub polar: Vec<PathBuf>,
    /// Text and binary files of unknown formats, and tables that are not what their format says.
    pub unknown: Vec<PathBuf>,
    /// Reasons why files of a known format were not read.
    pub unread: Vec<String>,
    /// All files in order.
    pub uses: Vec<FileUse>,
}

/// Sorts the files below a folder.
///
/// # Errors
/// A folder that cannot be read, or with too many files.
pub fn sorted(folder: &Path) -> Result<SortedFiles> {
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
    // The list of a recording in several files stands for all of them, as does that of the times of records which have a
    // file each.
    let wholes: Vec<(PathBuf, Vec<PathBuf>)> = files
        .iter()
        .filter(|file| lists_others(file))
        .map(|list| (list.clone(), format::files_of(list).split_off(1)))
        .collect();
    let parts: HashSet<&PathBuf> = wholes.iter().flat_map(|(_, parts)| parts).collect();
    files.retain(|file| !parts.contains(file));
    let mut sorted = SortedFiles::default();
    for file in &files {
        sorted.add(folder, file);
    }
    for (list, parts) in &wholes {
        let path = list.strip_prefix(folder).unwrap_or(list);
        let count = parts.len();
        sorted.use_as(path, |serves| {
            format!("{serves}, with {count} files beside it")
        });
    }
    sorted.leave_out_other_sensors();
    Ok(sorted)
}

/// Whether a file lists others, which it needs: of a recording of rosbag2, or the times of the records of KITTI.
fn lists_others(file: &Path) -> bool {
    file.ends_with("metadata.yaml")
        || file.ends_with("timestamps.txt")
            && format::detect(file).is_ok_and(|format| format.id() == "kitti-oxts")
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
        let is_other = ["out", "out.finished", "truth"]
            .iter()
            .any(|name| path.ends_with(name));
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
    /// Whether no file has measurements along a drive.
    pub fn is_without_measurements(&self) -> bool {
        let logs = [&self.imu, &self.prism, &self.gnss, &self.heading];
        let other = [&self.poses, &self.profiles];
        let mut files = logs.into_iter().chain(other);
        files.all(Vec::is_empty) && self.posed.is_empty() && self.recordings.is_empty()
    }

    fn add(&mut self, folder: &Path, file: &Path) {
        let path = file.strip_prefix(folder).unwrap_or(file).to_owned();
        let input = &Input::from(file);
        let mut found = FileUse {
            path: path.clone(),
            format: None,
            serves: String::new(),
            count: None,
            span_s: None,
        };
        match format::detect(input) {
            Err(error) => {
                self.unknown.push(path);
                found.serves = nothing(&error, file);
            }
            Ok(format) => {
                found.format = Some(format);
                let role = Role::of(format);
                let inspection = match role {
                    Role::Cloud => None,
                    // Its measurements are read once, when it is sorted.
                    Role::Log if format.id() != "ros-bag" => None,
                    _ if format.id() == "project" => None,
                    _ => Some(format::inspect(input)),
                };
                if let Some(Ok(inspection)) = &inspection {
                    found.count = Some(inspection.count).filter(|count| *count > 0);
                    found.span_s = inspection.span_s;
                }
                found.serves = match (inspection, format.id()) {
                    (Some(Err(error)), _) => self.cannot_read(error, input.path()),
                    (_, "project") => "a project file, not data".to_owned(),
                    (_, "bonn-mounting") => match format::read_mounting(input) {
                        Ok(mounting) => {
                            self.mountings.push((path, mounting));
                            "the mounting of a scanner".to_owned()
                        }
                        Err(error) => self.cannot_read(error, input.path()),
                    },
                    (_, "euroc-sensor") => match format::read_imu_noise(input) {
                        Ok(noise) => {
                            self.noise.push((path, noise));
                            "the noise of the IMU log beside it: [imu]".to_owned()
                        }
                        Err(error) => self.cannot_read(error, input.path()),
                    },
                    (Some(Ok(inspection)), "ros-bag") => {
                        let topics = inspection.notes.join("; ");
                        self.recordings.push((path, topics.clone()));
                        format!("a recording, of which a project names topics: {topics}")
                    }
                    _ => self.sort(input, format, role, path, &mut found),
                };
            }
        }
        self.uses.push(found);
    }

    fn cannot_read(&mut self, error: Error, file: &Path) -> String {
        let why = nothing(&error, file);
        self.unread.push(error.to_string());
        why
    }

    /// Sorts a file with one kind of measurements; returns what it can serve as.
    fn sort(
        &mut self,
        input: &Input,
        format: Format,
        role: Role,
        path: PathBuf,
        found: &mut FileUse,
    ) -> String {
        let name = path.to_string_lossy().to_lowercase();
        let is_gnss = ["gnss", "gps", "rtk"]
            .iter()
            .any(|word| name.contains(word));
        if let Some(span_s) = posed_span_s(input, format) {
            self.posed.push((path, span_s));
            return "profiles and poses, [[scanner]] and [trajectory]: every point carries the sensor's pose".to_owned();
        }
        let (files, serves) = match role {
            Role::Cloud if is_log(input.path()) => (
                &mut self.unknown,
                "nothing yet: it begins with a time that increases from row to row, as a log does, and its header is \
                 not known; name the columns of positions time_s, east_m, north_m, up_m, and run `boresight init \
                 --force`. A cloud may be named in [reference]",
            ),
            Role::Cloud => (
                &mut self.clouds,
                "a cloud: [reference], or boresight compare",
            ),
            Role::Profiles => (&mut self.profiles, "the profiles of a [[scanner]]"),
            Role::Poses => (&mut self.poses, "poses: [trajectory]"),
            Role::Positions if is_gnss => (&mut self.gnss, "the positions of an antenna: [gnss]"),
            Role::Positions => {
                if ["polar-csv", "rts-csv"].contains(&format.id()) {
                    self.polar.push(path.clone());
                }
                (&mut self.prism, "the positions of a prism: [prism]")
            }
            Role::Log => return self.sort_log(input, format, found),
            Role::None => (
                &mut self.unknown,
                "nothing: no measurements that a project uses",
            ),
        };
        files.push(path);
        serves.to_owned()
    }

    /// Sorts a log that may hold several kinds of measurements: it serves as all that can be read of it. Its count and its
    /// span are those of the first kind.
    fn sort_log(&mut self, input: &Input, format: Format, found: &mut FileUse) -> String {
        let (mut serves, mut last_error) = (Vec::new(), None);
        let mut turning = None;
        let imu = || {
            format::read_imu(input).map(|samples| {
                turning = Some(Turning::of_imu(&samples));
                extent(&samples, |it| it.time_s)
            })
        };
        let poses =
            || format::read_geographic_poses(input).map(|poses| extent(&poses, |it| it.time_s));
        let heading = || format::read_heading(input).map(|fixes| extent(&fixes, |it| it.time_s));
        let geographic =
            || format::read_geographic(input).map(|fixes| extent(&fixes, |it| it.time_s));
        let path = found.path.clone();
        let mut offer = |read: Option<Result<Extent>>, to: &mut Vec<PathBuf>, what| match read {
            Some(Ok(extent)) => {
                if serves.is_empty() {
                    (found.count, found.span_s) = extent;
                }
                to.push(path.clone());
                serves.push(what);
            }
            Some(Err(error)) => last_error = Some(error),
            None => {}
        };
        offer(format.has_imu().then(imu), &mut self.imu, IMU);
        offer(
            format.has_heading().then(heading),
            &mut self.heading,
            HEADING,
        );
        let has = format.has_geographic();
        offer(has.then(geographic), &mut self.gnss, GEOGRAPHIC);
        let has = format.has_geographic_poses();
        offer(has.then(poses), &mut self.poses, GEOGRAPHIC_POSES);
        self.turnings
            .extend(turning.map(|turning| (path.clone(), turning)));
        match last_error.filter(|_| serves.is_empty()) {
            Some(error) => self.cannot_read(error, input.path()),
            None => serves.join("; "),
        }
    }

    /// Keeps those of the LAS files with the sensor's pose at every point that follow each other in time, as the strips
    /// of one sensor do, and likewise those of the files of poses.
    fn leave_out_other_sensors(&mut self) {
        self.posed.sort_by(|a, b| a.1[0].total_cmp(&b.1[0]));
        let posed = one_at_a_time(std::mem::take(&mut self.posed));
        let span_s = |path: &PathBuf| {
            let file = self.uses.iter().find(|file| file.path == *path);
            file.and_then(|file| file.span_s).unwrap_or([f64::NAN; 2])
        };
        let poses = self.poses.iter().map(|path| (path.clone(), span_s(path)));
        let poses = one_at_a_time(poses.collect());
        self.posed = posed.kept;
        self.poses = poses.kept.into_iter().map(|(path, _)| path).collect();
        for (path, first) in posed.others.into_iter().chain(poses.others) {
            let why = format!(
                "it has poses of another sensor at the same time as {}, and a project has those of one: make a project of it \
                 in a folder of its own",
                first.display()
            );
            self.unread.push(format!("{}: {why}", path.display()));
            self.use_as(&path, |_| why);
        }
    }

    /// Changes what a file serves as.
    pub(super) fn use_as(&mut self, path: &Path, serves: impl FnOnce(&str) -> String) {
        if let Some(file) = self.uses.iter_mut().find(|file| file.path == path) {
            file.serves = serves(&file.serves);
        }
    }
}

/// Files that follow each other in time, and the others, each with the one whose times it shares.
struct OneAtATime {
    kept: Vec<(PathBuf, [f64; 2])>,
    others: Vec<(PathBuf, PathBuf)>,
}

/// Sorts files with their first and last times; of those that overlap, the first one in the list is kept. Files that meet
/// at one time follow each other.
fn one_at_a_time(files: Vec<(PathBuf, [f64; 2])>) -> OneAtATime {
    let mut sorted = OneAtATime {
        kept: Vec::new(),
        others: Vec::new(),
    };
    for (path, [first_s, last_s]) in files {
        let overlaps =
            |(_, span_s): &&(PathBuf, [f64; 2])| first_s < span_s[1] && last_s > span_s[0];
        match sorted.kept.iter().find(overlaps) {
            Some((kept, _)) => sorted.others.push((path, kept.clone())),
            None => sorted.kept.push((path, [first_s, last_s])),
        }
    }
    sorted
}

/// The first and the last time of a LAS file whose points carry the sensor's pose.
fn posed_span_s(input: &Input, format: Format) -> Option<[f64; 2]> {
    if !format.is_las() {
        return None;
    }
    let poses = format::read_trajectory(input).ok()?;
    Some([poses.first()?.time_s, poses.last()?.time_s])
}

/// What a file with this error serves as: the error in one line, without the path before which it stands.
fn nothing(error: &Error, file: &Path) -> String {
    let text = error.to_string().replace('\n', " ");
    let path = file.display().to_string();
    let rest = text
        .strip_prefix(&path)
        .map(|rest| rest.trim_start_matches([',', ':', ' ']));
    format!("nothing: {}", rest.unwrap_or(&text))
}
