//! Random changes to the files of a project, like those of mistakes and accidents, tested with the real binary: each
//! run ends with a result, or with one error that names the file.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::common::{boresight, project_of_logs};
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The files of the project.
const FILES: [&str; 4] = ["project.toml", "imu.csv", "prism.csv", "left.csv"];
/// Commands that read all of these files, or all except the profiles.
const COMMANDS: [&[&str]; 3] = [&["trajectory"], &["calibrate"], &["georeference"]];
/// Longest duration of a run, with other tests running.
const LONGEST: Duration = Duration::from_secs(60);

/// Changes the numbers of a column.
fn change_column(text: &str, column: usize, change: impl Fn(f64) -> f64) -> String {
    let row = |line: &str| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if let Some(cell) = cells.get_mut(column)
            && let Ok(value) = cell.trim().parse()
        {
            *cell = format!("{}", change(value));
        }
        cells.join(",")
    };
    text.lines().map(row).collect::<Vec<_>>().join("\n")
}

/// A random change of numbers: other units, clocks or signs, or no number.
fn change(random: &mut impl Rng) -> Box<dyn Fn(f64) -> f64> {
    let factors = [1e3, 1e6, 1e9, 1e-3, 1e-6, 57.3, 1.0 / 57.3, 9.81, -1.0, 0.0];
    let offsets = [1e3, -1e3, 1.7e9, 3600.0, 18.0, 0.5, f64::NAN, f64::INFINITY];
    match random.random_range(0..3) {
        0 | 1 => {
            let by = *factors.choose(random).unwrap();
            Box::new(move |value| value * by)
        }
        _ => {
            let by = *offsets.choose(random).unwrap();
            Box::new(move |value| value + by)
        }
    }
}

/// Changes, removes or repeats a line of a text, or exchanges two.
fn change_lines(text: &str, random: &mut impl Rng) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let at = random.random_range(0..lines.len());
    let other = random.random_range(0..lines.len());
    match random.random_range(0..6) {
        0 => drop(lines.remove(at)),
        1 => lines.insert(other, lines[at].clone()),
        2 => lines.swap(at, other),
        3 => {
            let half = lines[at].len() / 2;
            lines[at].truncate(half);
        }
        4 => lines[at] = lines[at].replace(',', ";"),
        _ => lines[at] = lines[at].replace(['1', '2', '0'], "x"),
    }
    lines.join("\n")
}

/// Changes a number of a project.
fn change_project(text: &str, random: &mut impl Rng) -> String {
    let is_number = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    let mut numbers = Vec::new();
    let mut from = None;
    for (at, c) in text.char_indices() {
        match (is_number(c), from) {
            (true, None) => from = Some(at),
            (false, Some(start)) => {
                numbers.push(start..at);
                from = None;
            }
            _ => {}
        }
    }
    let range = numbers.choose(random).unwrap().clone();
    let value: f64 = text[range.clone()].parse().unwrap_or(1.0);
    let new = match random.random_range(0..8) {
        0 => "\"left\"".to_owned(),
        1 => "[]".to_owned(),
        2 => "true".to_owned(),
        3 => "-1".to_owned(),
        _ => format!("{:?}", change(random)(value)).replace("NaN", "nan"),
    };
    format!("{}{new}{}", &text[..range.start], &text[range.end..])
}

/// Changes, cuts off, inserts or removes bytes.
fn change_bytes(text: &str, random: &mut impl Rng) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    let at = random.random_range(0..bytes.len());
    match random.random_range(0..4) {
        0 => bytes.truncate(at),
        1 => bytes[at] = random.random(),
        2 => bytes.insert(at, random.random()),
        _ => drop(bytes.drain(at..(at + 40).min(bytes.len()))),
    }
    bytes
}

fn mutant(text: &str, name: &str, random: &mut impl Rng) -> Vec<u8> {
    match random.random_range(0..4) {
        0 => change_bytes(text, random),
        1 => change_lines(text, random).into_bytes(),
        _ if name.ends_with(".toml") => change_project(text, random).into_bytes(),
        _ => {
            let columns = text.lines().next().unwrap().split(',').count();
            // The times are changed about as often as all other columns together.
            let any = random.random_range(0..columns);
            let column = if random.random() { 0 } else { any };
            change_column(text, column, change(random)).into_bytes()
        }
    }
}

/// Runs a command on each mutant; returns how many were refused.
fn run_mutants(seeds: std::ops::Range<u64>) -> usize {
    let whole = project_of_logs();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut refused = 0;
    for seed in seeds {
        let random = &mut ChaCha8Rng::seed_from_u64(seed);
        for name in FILES {
            fs::copy(whole.path().join(name), path(name)).unwrap();
        }
        let name = *FILES.choose(random).unwrap();
        let text = fs::read_to_string(path(name)).unwrap();
        fs::write(path(name), mutant(&text, name, random)).unwrap();
        let command = *COMMANDS.choose(random).unwrap();
        let (project, out) = (path("project.toml"), path("out"));
        let files = [project.to_str().unwrap(), "--out", out.to_str().unwrap()];
        let begun = Instant::now();
        let run = boresight(&[command, &files].concat());
        let stderr = &run.err;
        let what = || {
            keep(
                &format!("seed {seed}, {command:?}, {name}: {stderr}"),
                folder.path(),
            )
        };
        assert!(begun.elapsed() < LONGEST, "{} took too long", what());
        assert!([0, 1].contains(&run.code), "exit {}: {}", run.code, what());
        let errors: Vec<&str> = stderr
            .lines()
            .filter(|l| l.starts_with("error: "))
            .collect();
        assert_eq!(errors.len(), usize::from(run.code == 1), "{}", what());
        if let Some(error) = errors.first() {
            refused += 1;
            let names = FILES.iter().any(|name| error.contains(name));
            assert!(names, "no file is named: {}", what());
        }
        let _ = fs::remove_dir_all(out);
    }
    refused
}

/// Copies the files of a failed mutant to a permanent folder, and appends its name to `what`.
fn keep(what: &str, folder: &Path) -> String {
    let copies = std::env::temp_dir().join("boresight-mutant");
    let _ = fs::create_dir_all(&copies);
    for name in FILES {
        let _ = fs::copy(folder.join(name), copies.join(name));
    }
    format!("{what} (files in {})", copies.display())
}

#[test]
fn mutants_end_with_a_result_or_an_error_that_names_a_file() {
    let refused = run_mutants(0..60);
    assert!((10..60).contains(&refused), "{refused} of 60 refused");
}

#[test]
#[ignore = "just acceptance"]
fn three_thousand_mutants_end_with_a_result_or_an_error_that_names_a_file() {
    let refused = run_mutants(0..3000);
    println!("{refused} of 3000 refused");
}
