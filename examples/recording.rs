//! Makes a recording of a simulated drive, as its sensors would have sent it, for `boresight replay`:
//! `cargo run --release --features examples --example recording -- out/data/drive-1/project.toml out/recording`
#![allow(clippy::unwrap_used, clippy::print_stderr)] // an example

#[path = "../tests/clock/live/twin.rs"]
#[allow(dead_code)] // the tests use all of it
mod twin;

use std::path::PathBuf;

fn main() {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [project, folder] = arguments.as_slice() else {
        eprintln!(
            "recording PROJECT FOLDER: expected a project of `boresight simulate`, and a new folder"
        );
        std::process::exit(2);
    };
    twin::record(project, folder);
}
