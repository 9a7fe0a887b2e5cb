//! Tests of the library and its command line, one module per subject: `cargo test --release --test it truck` runs
//! those of one subject. Tests that depend on time or on the machine are in `tests/clock`.

#![allow(clippy::unwrap_used)] // helpers fail as tests do

#[path = "../common/mod.rs"]
mod common;

mod accidents;
mod architecture;
mod book;
mod calibration;
mod calibration_file;
mod campaign;
mod cancel;
mod cli;
mod convert;
mod drift;
mod evaluate;
mod faults;
mod features;
mod field_cases;
mod first_hours;
mod formats;
mod geocom;
mod gocator;
mod init;
mod inputs;
mod inspect;
mod joint;
mod kernels;
mod m3c2;
mod m3c2_defaults;
mod m3c2_files;
mod m3c2_options;
mod mischief;
mod mistakes;
mod mutants;
mod pages;
mod placement;
mod printing;
mod protected;
mod random;
mod replace;
mod report;
mod resume;
mod run;
mod simulation;
mod thin;
mod trajectory;
mod truck;
mod verdicts;
