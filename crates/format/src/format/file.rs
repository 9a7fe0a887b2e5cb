//! Names of files and of their parts, and decoders that may fail; shared by all readers.

use std::path::{Path, PathBuf};
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::error::{Error, Location, Result};

/// Approximate number of points that readers return at a time.
pub(crate) const CHUNK_POINTS: usize = 200_000;

/// The file in a folder of rosbag2 that lists the files of its recording.
pub(crate) const METADATA: &str = "metadata.yaml";

/// The file that stands for a path: of a recording of rosbag2 that is named by its folder, the one that lists its files.
fn listed_in(path: PathBuf) -> PathBuf {
    let list = path.join(METADATA);
    if list.is_file() { list } else { path }
}

/// A file, or a part of it, named after a `#`: `drive.mcap#/left/points` is a topic of a recording, whose folder may
/// be named instead of its files.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Part {
    pub(crate) file: PathBuf,
    pub(crate) name: Option<String>,
}

impl Part {
    /// Splits a path at the `#`. If a file with the full name exists, the `#` belongs to its name.
    pub(crate) fn of(path: &Path) -> Self {
        let text = path.to_string_lossy();
        let marks = || text.match_indices('#').map(|(at, _)| at);
        let is_there = |at: &usize| listed_in(text[..*at].into()).is_file();
        let at = marks().find(|at| !path.exists() && is_there(at));
        let file = listed_in(at.map_or_else(|| path.to_owned(), |at| text[..at].into()));
        let name = at.map(|at| text[at + 1..].to_owned());
        Self { file, name }
    }
}

/// The file of a path that may also name a part of the file, such as a topic of a recording.
pub fn file_of(path: &Path) -> PathBuf {
    Part::of(path).file
}

/// The error for a file of the right format without content.
pub(crate) fn nothing_in(path: &Path, what: &str) -> Error {
    Error::format(
        path,
        Location::Whole,
        format!("no {what}"),
        format!("at least one {what}"),
    )
}

/// The extension of `path` in lower case, without the dot.
pub(crate) fn extension(path: &Path) -> String {
    path.extension()
        .map(|e| e.to_string_lossy().to_lowercase())
        .unwrap_or_default()
}

/// Number of decoders running.
static GUARDED: AtomicUsize = AtomicUsize::new(0);

/// Keeps panic messages of third-party decoders off the terminal, on any thread, because these panics become
/// errors. Panics of this program are printed as usual.
fn silence_decoders() {
    static ONCE: Once = Once::new();
    const DECODERS: [&str; 9] = [
        "/las-",
        "/laz-",
        "/e57-",
        "/bzip2-",
        "/lz4_flex-",
        "/ruzstd-",
        "/parquet-",
        "/bytes-",
        "/yaml-rust2-",
    ];
    ONCE.call_once(|| {
        let print = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            let place = panic
                .location()
                .map_or("", |place| place.file())
                .replace('\\', "/");
            let is_decoder = DECODERS.iter().any(|name| place.contains(name));
            if !is_decoder || GUARDED.load(Ordering::SeqCst) == 0 {
                print(panic);
            }
        }));
    });
}

/// Runs a third-party decoder on a file that may be damaged: a panic becomes an error of the file.
pub(crate) fn guarded<T>(
    path: &Path,
    format: &str,
    decode: impl FnOnce() -> Result<T>,
) -> Result<T> {
    silence_decoders();
    GUARDED.fetch_add(1, Ordering::SeqCst);
    let decoded = std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode));
    GUARDED.fetch_sub(1, Ordering::SeqCst);
    decoded.unwrap_or_else(|_| {
        Err(Error::format(
            path,
            Location::Whole,
            "content that cannot be decoded",
            format!("an undamaged {format} file"),
        ))
    })
}

/// Names of two logs in a recording: of the system's clock, and of all events.
pub(crate) const CLOCK_LOG: &str = "clock.csv";
pub(crate) const EVENT_LOG: &str = "events.csv";

/// Whether a file is in the folder of a recording.
pub fn is_in_recording(path: &Path) -> bool {
    let is_there = |name| path.with_file_name(name).is_file();
    is_there(CLOCK_LOG) && is_there(EVENT_LOG)
}
