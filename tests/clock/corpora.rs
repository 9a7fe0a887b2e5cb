//! Every input of the fuzz corpora, read as the fuzz targets read it: no panic, no reader that takes more than a
//! second, no error without the name of its file. The corpora contain the input of each fault that fuzzing found.

#[path = "../../fuzz/src/readers.rs"]
mod readers;

use std::path::{Path, PathBuf};

use readers::{Scratch, TARGETS, read_all};

fn corpora() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus")
}

/// The inputs of a target by name.
fn inputs(target: &str) -> Vec<PathBuf> {
    let folder = corpora().join(target);
    let files = std::fs::read_dir(&folder).expect("a corpus for every target");
    let mut files: Vec<PathBuf> = files.map(|file| file.expect("a file").path()).collect();
    files.sort();
    files
}

/// Reads the corpus of a target.
fn replay(name: &str) {
    let target = readers::target(name).expect("a known target");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scratch = Scratch::new(folder.path()).expect("files beside the inputs");
    let files = inputs(name);
    assert!(files.len() > 1, "no corpus for {name}");
    for file in files {
        let bytes = std::fs::read(&file).expect("an input");
        // Shown if the reader panics.
        println!("{}", file.display());
        read_all(target, &scratch, &bytes, &mut |call| call());
    }
}

macro_rules! replays {
    ($($name:ident)*) => {
        /// The targets with a test.
        const TESTED: &[&str] = &[$(stringify!($name)),*];
        $(
            #[test]
            fn $name() {
                replay(stringify!($name));
            }
        )*
    };
}

replays!(las e57 ply pcd npy parquet text bonn sbg ros sbet any);

#[test]
fn every_corpus_is_replayed_and_small() {
    for target in &TARGETS {
        assert!(TESTED.contains(&target.name), "{}", target.name);
    }
    let folders = std::fs::read_dir(corpora()).expect("the corpora");
    let mut total = 0;
    for folder in folders {
        let folder = folder.expect("a corpus").file_name();
        let name = folder.to_str().expect("a target");
        // Project files have a separate fuzz target.
        assert!(TESTED.contains(&name) || name == "project", "{name}");
        for file in inputs(name) {
            let size = file.metadata().expect("an input").len();
            assert!(size <= 30_000, "{} has {size} bytes", file.display());
            total += size;
        }
    }
    assert!(total <= 1_000_000, "corpora of {total} bytes");
}
