//! Names the sources that the program is built from: results kept on disk are found again by programs that compute
//! the same, and by no others.

use std::path::{Path, PathBuf};

/// All that decides what the program computes; in a released package only the first two are there, and its version
/// stands for the crates.
const SOURCES: [&str; 4] = ["src", "Cargo.toml", "Cargo.lock", "crates"];

fn main() {
    let mut files = Vec::new();
    for source in SOURCES {
        println!("cargo::rerun-if-changed={source}");
        collect(Path::new(source), &mut files);
    }
    files.sort();
    let mut hash = Fnv::new();
    for file in &files {
        hash.write(file.to_string_lossy().as_bytes());
        hash.write(&std::fs::read(file).expect("a source can be read"));
    }
    println!("cargo::rustc-env=BORESIGHT_SOURCES={:032x}", hash.0);
}

/// The files below a folder, or the file.
fn collect(path: &Path, files: &mut Vec<PathBuf>) {
    if path.is_file() {
        files.push(path.to_owned());
    } else if let Ok(entries) = std::fs::read_dir(path) {
        for entry in entries.flatten() {
            collect(&entry.path(), files);
        }
    }
}

/// FNV-1a with 128 bits, as a build script needs no library for it.
struct Fnv(u128);

impl Fnv {
    fn new() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }

    fn write(&mut self, bytes: &[u8]) {
        const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;
        for &byte in bytes {
            self.0 = (self.0 ^ u128::from(byte)).wrapping_mul(PRIME);
        }
    }
}
