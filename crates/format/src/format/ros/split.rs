//! Recordings of rosbag2 in a folder: one or more files, which `metadata.yaml` beside them lists in their order.

use std::path::{Path, PathBuf};

use crate::error::{Error, Location, Result};
use crate::format::file::{METADATA, file_of};
use crate::format::input::Input;
use crate::format::text::yaml;

/// The only key at the beginning of `metadata.yaml`.
pub(super) const START: &[u8] = b"rosbag2_bagfile_information:";
/// The keys of the names of the files, and of the kind of compression.
const FILES: &str = "rosbag2_bagfile_information.relative_file_paths";
const COMPRESSION: &str = "rosbag2_bagfile_information.compression_format";

/// The files of a recording in their order: those that its metadata list, or the file itself.
///
/// # Errors
/// Metadata that are damaged or list no file or a missing one, a compression that is not known.
pub(super) fn files(input: &Input) -> Result<Vec<Input>> {
    let (mut stream, _) = input.open()?;
    if !input.first_bytes(&mut stream)?.starts_with(START) {
        return Ok(vec![input.clone()]);
    }
    let list = &input.of_file(&file_of(input.path()));
    let listed = listed(list)?;
    let missing = listed.iter().find(|(path, _)| !path.is_file());
    if let Some((path, line)) = missing {
        let name = path.file_name().unwrap_or_default().display();
        return Err(Error::format(
            list.path(),
            Location::Line(*line),
            format!("{name}, which is not in this folder"),
            "all files of the recording; without one of them, name the others one by one",
        ));
    }
    let file = |(path, _): &(PathBuf, u64)| input.of_file(path);
    Ok(listed.iter().map(file).collect())
}

/// The files that the metadata at `path` list; none if it is another file.
pub(super) fn beside(path: &Path) -> Vec<PathBuf> {
    let input = Input::from(path);
    let is_metadata = || -> Result<bool> {
        let (mut stream, _) = input.open()?;
        Ok(input.first_bytes(&mut stream)?.starts_with(START))
    };
    let listed = is_metadata().and_then(|is_it| {
        if is_it {
            listed(&input)
        } else {
            Ok(Vec::new())
        }
    });
    let listed = listed.unwrap_or_default().into_iter();
    listed.map(|(path, _)| path).collect()
}

/// Remarks on a file that is one of several of a recording.
pub(super) fn remark_on_others(input: &Input) {
    let path = input.path();
    let metadata = path.with_file_name(METADATA);
    if !input.is_file() || !metadata.is_file() {
        return;
    }
    let all = beside(&metadata);
    if all.len() > 1 && all.iter().any(|other| other == path) {
        let folder = metadata.parent().unwrap_or(path).display();
        input.remark(format!(
            "this file is one of {} of a recording: to read them all, name the folder, {folder}",
            all.len()
        ));
    }
}

/// The files that metadata list, with the lines that name them. Recordings of one name are counted from 0, and some
/// programs list file 10 before file 2.
fn listed(input: &Input) -> Result<Vec<(PathBuf, u64)>> {
    let entries = yaml::values(input)?;
    let of = |keys: &'static str| entries.iter().filter(move |entry| entry.keys == keys);
    let is_known = |name: &str| matches!(name, "" | "zstd" | "null" | "~");
    if let Some(entry) = of(COMPRESSION).find(|entry| !is_known(&entry.text)) {
        return Err(Error::format(
            input.path(),
            Location::Line(entry.line),
            format!("the compression `{}`", entry.text),
            "none or zstd",
        ));
    }
    let mut files: Vec<(PathBuf, u64)> = of(FILES)
        .filter_map(|entry| {
            // Old versions put the name of the folder before that of the file.
            let name = Path::new(&entry.text).file_name()?;
            Some((as_found(input.path().with_file_name(name)), entry.line))
        })
        .collect();
    if files.is_empty() {
        return Err(Error::format(
            input.path(),
            Location::Whole,
            "metadata of rosbag2 without files",
            "relative_file_paths; ros2 bag reindex writes them anew",
        ));
    }
    let names: Option<Vec<(String, u64)>> = files.iter().map(|(path, _)| numbered(path)).collect();
    if names.is_some_and(|names| names.iter().all(|(name, _)| *name == names[0].0)) {
        files.sort_by_key(|(path, _)| numbered(path));
    }
    files.dedup_by(|a, b| a.0 == b.0);
    Ok(files)
}

/// The path at which a listed file is: recorders that compress files list them with or without `.zstd`.
fn as_found(path: PathBuf) -> PathBuf {
    let mut packed = path.clone().into_os_string();
    packed.push(".zstd");
    let others = [PathBuf::from(packed), path.with_extension("")];
    let mut found = others.into_iter().filter(|other| other.is_file());
    if path.is_file() {
        return path;
    }
    found.next().unwrap_or(path)
}

/// A name such as `drive_10.mcap` as `drive_` and its number; `None` if it ends otherwise.
fn numbered(path: &Path) -> Option<(String, u64)> {
    let name = path.file_name()?.to_str()?.trim_end_matches(".zstd");
    let (stem, _) = name.rsplit_once('.')?;
    let before = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = stem.get(before.len()..)?.parse().ok()?;
    Some((before.to_owned(), number))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Read;
    use std::path::{Path, PathBuf};

    use super::super::read_imu;
    use super::super::tests::sample;
    use crate::format::compressed::ZSTANDARD;
    use crate::format::input::Input;

    /// A copy of the sample in two files, with other metadata.
    fn copy(edit: impl Fn(String) -> String) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metadata.yaml");
        for name in ["drive_0.db3.zstd", "drive_1.db3.zstd"] {
            fs::copy(sample("split").join(name), folder.path().join(name)).unwrap();
        }
        let text = fs::read_to_string(sample("split").join("metadata.yaml")).unwrap();
        fs::write(&path, edit(text)).unwrap();
        (folder, path)
    }

    fn times_s(path: &Path) -> Vec<f64> {
        let samples = read_imu(&Input::from(path), None).unwrap();
        samples.iter().map(|sample| sample.time_s).collect()
    }

    #[test]
    fn files_are_read_in_their_order_however_they_are_listed() {
        let whole = times_s(&sample("zstd.mcap"));
        let listed = "  - drive_0.db3.zstd\n  - drive_1.db3.zstd\n";
        for other in [
            "  - drive_1.db3.zstd\n  - drive_0.db3.zstd\n",
            "  - drive_0.db3\n  - drive_1.db3\n",
            "  - bag/drive_0.db3.zstd\n  - bag/drive_1.db3.zstd\n",
        ] {
            let (folder, path) = copy(|text| text.replace(listed, other));
            assert_eq!(times_s(&path), whole, "{other}");
            assert_eq!(times_s(folder.path()), whole, "{other}");
        }
        assert_eq!(super::beside(&sample("split/metadata.yaml")).len(), 2);
        assert_eq!(super::beside(&sample("zstd.mcap")).len(), 0);
        let copy = sample("split").join("none");
        let error = crate::format::salvage(sample("split").as_path(), &copy).unwrap_err();
        let error = error.to_string();
        assert!(error.contains("the list of the files"), "{error}");
    }

    #[test]
    fn one_file_of_several_is_named_as_such() {
        let input = Input::from(&sample("split/drive_1.db3.zstd"));
        assert_eq!(read_imu(&input, None).unwrap().len(), 6);
        let remarks = input.remarks().join("\n");
        assert!(
            remarks.contains("one of 2 of a recording: to read them all, name the folder"),
            "{remarks}"
        );
    }

    #[test]
    fn metadata_that_cannot_be_followed_are_refused() {
        let refused = |edit: &dyn Fn(String) -> String, expected: [&str; 2]| {
            let (_folder, path) = copy(edit);
            let error = read_imu(&Input::from(&path), None).unwrap_err().to_string();
            for part in expected {
                assert!(error.contains(part), "{error}");
            }
        };
        refused(
            &|text| text.replace("  - drive_1", "  - drive_2"),
            ["line 17", "drive_2.db3.zstd, which is not in this folder"],
        );
        refused(
            &|text| text.replace("format: zstd", "format: lz4"),
            ["line 2", "the compression `lz4`"],
        );
        refused(
            &|text| text.replace("relative_file_paths", "paths"),
            ["without files", "ros2 bag reindex"],
        );
        refused(&|text| text + "]", ["metadata.yaml, line", "YAML"]);
    }

    #[test]
    fn a_damaged_message_is_left_out() {
        let packed = fs::read(sample("messages.db3.zst")).unwrap();
        let mut bytes = Vec::new();
        ruzstd::decoding::StreamingDecoder::new(packed.as_slice())
            .unwrap()
            .read_to_end(&mut bytes)
            .unwrap();
        let is_frame = |at: &usize| bytes[*at..].starts_with(ZSTANDARD);
        let frames: Vec<usize> = (0..bytes.len()).filter(is_frame).collect();
        assert_eq!(frames.len(), 100);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.db3");
        let mut left_out = 0;
        for frame in frames {
            let mut damaged = bytes.clone();
            damaged[frame + 5..frame + 25].fill(0xff);
            fs::write(&path, damaged).unwrap();
            let input = Input::from(&path);
            let kept = read_imu(&input, None).unwrap().len();
            let remarks = input.remarks().join("\n");
            left_out += 12 - kept;
            assert_eq!(
                kept == 11,
                remarks.contains("1 of 12 messages of /imu left out")
                    && remarks.contains("compression that cannot be unpacked"),
                "{remarks}"
            );
        }
        assert_eq!(left_out, 12);
    }
}
