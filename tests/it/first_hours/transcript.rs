//! First hours as a user sees them: text files with commands and all that they print.
//!
//! `$ boresight …` runs the binary; `$ edit FILE` replaces text of a file, as the lines below it with `-` and `+` say, at
//! the first place where it stands. Numbers differ from machine to machine: they are not compared, nor is the width of
//! columns.

use std::fs::{self, File};
use std::path::Path;
use std::process::Command;

use crate::common::rewrite;

/// Runs the commands of a transcript in a folder, and asserts that they print what it says.
pub fn replay(name: &str, folder: &Path) {
    let file = Path::new("tests/it/first_hours/transcripts").join(name);
    let expected = Path::new(env!("CARGO_MANIFEST_DIR")).join(&file);
    let expected = fs::read_to_string(expected).unwrap();
    let mut steps = expected.split("\n$ ");
    let mut found = steps.next().unwrap().to_owned();
    for step in steps {
        let (command, below) = step.split_once('\n').unwrap_or((step, ""));
        found += &format!("\n$ {command}\n");
        match command.split_once(' ') {
            Some(("edit", file)) => {
                edit(&folder.join(file), below);
                found += below;
            }
            Some(("boresight", arguments)) => found += &run(folder, arguments),
            _ => panic!("{}: what is `{command}`?", file.display()),
        }
    }
    if without_numbers(&found) != without_numbers(&expected) {
        let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        fs::write(&kept, &found).unwrap();
        panic!(
            "{found}\nThis is not {}. If it is meant, copy {} there.",
            file.display(),
            kept.display()
        );
    }
}

/// Replaces each text after `-` with the one after `+` below it.
fn edit(file: &Path, changes: &str) {
    let lines: Vec<&str> = changes.lines().filter(|line| !line.is_empty()).collect();
    for pair in lines.chunks(2) {
        let [old, new] = pair else {
            panic!("{changes}");
        };
        let (old, new) = (old.strip_prefix('-'), new.strip_prefix('+'));
        let (old, new) = (old.unwrap(), new.unwrap());
        rewrite(file, |text| {
            assert!(text.contains(old), "{old}: {text}");
            text.replacen(old, new, 1)
        });
    }
}

/// What a command prints, on both outputs in the order in which a terminal shows it.
fn run(folder: &Path, arguments: &str) -> String {
    let printed = tempfile::NamedTempFile::new().unwrap();
    let output = File::options().append(true).open(&printed).unwrap();
    let status = Command::new(env!("CARGO_BIN_EXE_boresight"))
        .current_dir(folder)
        .args(arguments.split(' '))
        .stdout(output.try_clone().unwrap())
        .stderr(output)
        .status()
        .unwrap();
    let text = fs::read_to_string(&printed).unwrap();
    let text = text.replace(folder.to_str().unwrap(), "~");
    if status.success() {
        return text;
    }
    format!("{text}[{status}]\n")
}

/// A text with `#` for every number, and one blank for several; without lines of progress.
fn without_numbers(text: &str) -> String {
    let line = |line: &str| {
        let mut shown = String::new();
        for word in line.split_whitespace() {
            shown.push(' ');
            for c in word.chars() {
                if !c.is_ascii_digit() {
                    shown.push(c);
                } else if !shown.ends_with('#') {
                    if shown.ends_with("#.") {
                        shown.truncate(shown.len() - 2);
                    }
                    if shown.ends_with(" -") || shown.ends_with(" −") {
                        shown.pop();
                    }
                    shown.push('#');
                }
            }
        }
        shown
    };
    let lines = text.lines().map(|text| line(text).replace("# min", "# s"));
    // Lines of progress appear only on slow machines.
    let is_progress = |line: &String| line.ends_with("so far") || line.contains(": # %");
    lines
        .filter(|line| !is_progress(line))
        .map(|line| line + "\n")
        .collect()
}
