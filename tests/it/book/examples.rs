//! The examples: projects, fields and scenarios are read, commands are run.

use std::fs;
use std::path::Path;
use std::process::Command;

use boresight::campaign::Campaign;
use boresight::project::Project;
use boresight::record::Field;
use boresight::simulation::Scenario;

use super::{Block, Page, chapters, root};

const PROGRAM: &str = env!("CARGO_BIN_EXE_boresight");

/// The parts that complete an example to a project.
const LOGS: &str =
    "[imu]\nfile = \"imu.csv\"\n[prism]\nfile = \"prism.csv\"\nlever_arm_m = [0, 0, 1]\n";
const HEADING: &str = "[heading]\nfile = \"heading.csv\"\n";
const SCANNER: &str = "[[scanner]]\nname = \"left\"\nprofiles = \"left.bin\"\ntranslation_m = [0, 0, 0]\nrotation_deg = [0, 0, 0]\n";

fn blocks(language: &str) -> Vec<Block> {
    let pages = chapters()
        .into_iter()
        .chain([Page::read(root().join("README.md"))]);
    let blocks = pages.flat_map(|page| page.blocks());
    blocks.filter(|block| block.language == language).collect()
}

/// Reads an example as project, field, campaign or scenario; returns whether it is a project.
fn read(block: &Block, folder: &Path) -> bool {
    let at = &block.at;
    let table: toml::Table = block
        .text
        .parse()
        .unwrap_or_else(|error| panic!("{at}: {error}"));
    let path = folder.join("example.toml");
    if table.contains_key("source") {
        fs::write(&path, &block.text).unwrap();
        Field::read(&path).unwrap_or_else(|error| panic!("{at}: {error}"));
        return false;
    }
    if table.contains_key("campaign") {
        fs::write(&path, &block.text).unwrap();
        Campaign::read(&path).unwrap_or_else(|error| panic!("{at}: {error}"));
        return false;
    }
    if table.contains_key("drives") {
        fs::write(&path, &block.text).unwrap();
        Scenario::load(path.to_str().unwrap()).unwrap_or_else(|error| panic!("{at}: {error}"));
        return false;
    }
    let has_poses = table
        .get("trajectory")
        .is_some_and(|trajectory| trajectory.get("file").is_some());
    let rest = if has_poses {
        SCANNER.to_owned()
    } else {
        format!("{LOGS}{HEADING}{SCANNER}")
    };
    let mut whole: toml::Table = rest.parse().unwrap();
    whole.extend(table);
    fs::write(&path, whole.to_string()).unwrap();
    Project::read(&path).unwrap_or_else(|error| panic!("{at}: {error}"));
    true
}

#[test]
fn every_toml_example_is_valid() {
    let folder = tempfile::tempdir().unwrap();
    let blocks = blocks("toml");
    let projects = blocks
        .iter()
        .filter(|block| read(block, folder.path()))
        .count();
    assert!(
        projects >= 8 && blocks.len() >= projects + 2,
        "{projects} projects of {}",
        blocks.len()
    );
}

/// The words of a shell command; the book has none with spaces in quotes.
fn words(line: &str) -> Vec<&str> {
    let line = line.split(" #").next().unwrap_or_default();
    line.split_whitespace().collect()
}

#[test]
fn every_command_is_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let run = |words: &[&str], more: &[&str]| {
        let output = Command::new(PROGRAM)
            .args(&words[1..])
            .args(more)
            .current_dir(folder.path())
            .output();
        output.unwrap()
    };
    let mut count = 0;
    for block in blocks("sh") {
        for line in block
            .text
            .lines()
            .filter(|line| line.starts_with("boresight "))
        {
            let words = words(line);
            let stderr = |output: &std::process::Output| {
                String::from_utf8_lossy(&output.stderr).into_owned()
            };
            let help = run(&words, &["--help"]);
            assert!(
                help.status.success(),
                "{}: {line}\n{}",
                block.at,
                stderr(&help)
            );
            // Without its files the command fails (1), but its usage is right (not 2).
            if !["demo", "simulate", "record"].contains(&words[1]) {
                let tried = run(&words, &[]);
                assert_eq!(
                    tried.status.code(),
                    Some(1),
                    "{}: {line}\n{}",
                    block.at,
                    stderr(&tried)
                );
            }
            count += 1;
        }
    }
    assert!(count >= 20, "{count} commands");
}

/// Text on one line, to compare texts with different line breaks.
fn on_one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Runs the commands of the tutorial that only inspect, on a small drive: they print the output that the page shows.
#[cfg(unix)]
#[test]
fn the_commands_of_the_tutorial_print_the_output_that_it_shows() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("small.toml");
    let pass = |board: u8| format!("[[drives.passes]]\nboard = {board}\nheading_deg = 90.0\n");
    let keys = "[profiles]\nrate_hz = 5.0\nwidth = 40\n[reference]\nboard_spacing_m = 0.05\nsoil_spacing_m = 0.05\n";
    fs::write(
        &scenario,
        format!("{keys}[[drives]]\n{}{}", pass(0), pass(1)),
    )
    .unwrap();
    let data = folder.path().join("out/data");
    let made = Command::new(PROGRAM)
        .args(["--quiet", "simulate", "--scenario"])
        .arg(&scenario)
        .arg("--out")
        .arg(&data)
        .status();
    assert!(made.unwrap().success());
    let path = format!(
        "{}:{}",
        Path::new(PROGRAM).parent().unwrap().display(),
        std::env::var("PATH").unwrap()
    );
    let blocks = Page::read(root().join("docs/tutorial.md")).blocks();
    let mut printed = 0;
    for (index, block) in blocks.iter().enumerate() {
        let only_inspects = |line: &str| {
            ["boresight inspect", "sed "]
                .iter()
                .any(|word| line.starts_with(word))
        };
        if block.language != "sh" || !block.text.lines().all(only_inspects) {
            continue;
        }
        let output = Command::new("sh")
            .arg("-c")
            .arg(&block.text)
            .env("PATH", &path)
            .current_dir(folder.path())
            .output()
            .unwrap();
        let output = String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr);
        let here = format!("{}/", folder.path().canonicalize().unwrap().display());
        let output = on_one_line(
            &output
                .replace(&here, "")
                .replace(&format!("{}/", folder.path().display()), ""),
        );
        // If the page shows the output, it follows the command at once.
        let next = blocks.get(index + 1);
        let next = next.filter(|next| next.language == "text" && next.lines.0 <= block.lines.1 + 2);
        for part in next.into_iter().flat_map(|next| next.text.split("\n\n")) {
            assert!(
                output.contains(&on_one_line(part)),
                "{}: `{part}` is not in\n{output}",
                block.at
            );
            printed += 1;
        }
    }
    assert_eq!(printed, 3);
}

/// Runs `init` on a folder without a project, as in "Your own robot".
#[test]
fn init_writes_the_tables_of_the_project_in_the_book() {
    let folder = tempfile::tempdir().unwrap();
    let drive = folder.path().join("drive");
    fs::create_dir(&drive).unwrap();
    for (name, text) in [
        (
            "imu.csv",
            "time_ms,gyro_x_deg_s,gyro_y_deg_s,gyro_z_deg_s,accel_x_g,accel_y_g,accel_z_g\n0,0,0,0,0,0,-1\n10,0,0,0,0,0,-1\n",
        ),
        (
            "prism.csv",
            "time_s,east_m,north_m,up_m\n0,0,0,0\n0.1,0,0,0\n",
        ),
        ("heading.csv", "time_s,heading_deg\n0,0\n0.1,0\n"),
        ("left.csv", "time_s,x_m,z_m\n0,0,-1\n0,0.1,-1\n"),
        ("tls.xyz", "0 0 0\n1 0 0\n0 1 0\n"),
    ] {
        fs::write(drive.join(name), text).unwrap();
    }
    let made = Command::new(PROGRAM)
        .args(["init", "drive"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(
        made.status.success(),
        "{}",
        String::from_utf8_lossy(&made.stderr)
    );
    let text = fs::read_to_string(drive.join("project.toml")).unwrap();
    let book = Page::read(root().join("docs/your-robot.md"));
    let project = book
        .blocks()
        .into_iter()
        .find(|block| block.text.contains("[frame]"))
        .unwrap();
    for line in project.text.lines().filter(|line| line.starts_with('[')) {
        assert!(text.contains(line), "init does not write {line}:\n{text}");
    }
}
