//! Tells the tests what is at hand, so that those that need more are listed as ignored, and the program which
//! sources it is made of, so that it knows the stages that it finished itself.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};

fn main() {
    println!("cargo::rustc-check-cfg=cfg(has_data, has_avx512)");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-env=BORESIGHT_SOURCES={:016x}", sources());
    println!("cargo::rerun-if-env-changed=BORESIGHT_DATA");
    if std::env::var_os("BORESIGHT_DATA").is_some_and(|folder| !folder.is_empty()) {
        println!("cargo::rustc-cfg=has_data");
    }
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
    {
        println!("cargo::rustc-cfg=has_avx512");
    }
}

/// A hash of everything that the program is made of.
fn sources() -> u64 {
    let mut files = vec![PathBuf::from("Cargo.toml"), PathBuf::from("Cargo.lock")];
    list(Path::new("src"), &mut files);
    files.sort();
    let mut hasher = DefaultHasher::new();
    for file in &files {
        println!("cargo::rerun-if-changed={}", file.display());
        // A library is built without the lock file of its own.
        (file, std::fs::read(file).ok()).hash(&mut hasher);
    }
    hasher.finish()
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) {
    println!("cargo::rerun-if-changed={}", folder.display());
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for path in entries.map(|entry| entry.path()) {
        if path.is_dir() {
            list(&path, files);
        } else {
            files.push(path);
        }
    }
}
