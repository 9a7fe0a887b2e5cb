//! The command line, tested with the real binary.

use std::fs;

use crate::common::{boresight, change_project, names, on_project, project_of_logs};

/// Commands that write results.
const WRITING: [&str; 9] = [
    "demo",
    "simulate",
    "trajectory",
    "calibrate",
    "georeference",
    "compare",
    "thin",
    "features",
    "run",
];

#[test]
fn help_names_every_command_and_the_exit_codes() {
    let run = boresight(&["--help"]);
    assert_eq!(run.code, 0);
    for name in WRITING.iter().chain(&["inspect"]) {
        assert!(
            run.out.contains(&format!("\n  {name} ")),
            "{name}: {}",
            run.out
        );
    }
    assert!(
        run.out
            .contains("Exit codes: 0 done, 1 failed, 2 wrong use"),
        "{}",
        run.out
    );
    for flag in ["--json", "--threads", "--seed", "--quiet", "--verbose"] {
        assert!(run.out.contains(flag), "{flag}: {}", run.out);
    }
}

#[test]
fn every_command_that_writes_takes_a_folder() {
    for name in WRITING {
        let run = boresight(&[name, "--help"]);
        assert_eq!(run.code, 0, "{name}: {}", run.err);
        assert!(run.out.contains("--out <DIR>"), "{name}: {}", run.out);
    }
}

#[test]
fn the_version_is_that_of_the_package() {
    let run = boresight(&["--version"]);
    assert_eq!(run.code, 0);
    assert_eq!(
        run.out,
        format!("boresight {}\n", env!("CARGO_PKG_VERSION"))
    );
}

#[test]
fn wrong_use_exits_with_2_and_names_the_mistake() {
    let cases: [(&[&str], &str); 8] = [
        (&[], "Usage: boresight"),
        (&["calibrat"], "'calibrate'"),
        (&["run"], "<PROJECT>"),
        (&["run", "p.toml", "--jsn"], "'--json'"),
        (
            &["run", "p.toml", "--threads", "0"],
            "0 is not in 1..=65535",
        ),
        (&["simulate"], "--out <DIR>"),
        (
            &["inspect", "p.toml", "--quiet", "-v"],
            "cannot be used with",
        ),
        (
            &["compare", "a", "b", "--cylinder-radius-m", "-1"],
            "--cylinder-radius-m",
        ),
    ];
    for (arguments, expected) in cases {
        let run = boresight(arguments);
        assert_eq!(run.code, 2, "{arguments:?}: {}", run.err);
        assert!(run.err.contains(expected), "{arguments:?}: {}", run.err);
        assert_eq!(run.out, "", "{arguments:?}");
    }
}

#[test]
fn a_mistyped_key_is_named_with_file_line_and_the_nearest_key() {
    let folder = project_of_logs();
    change_project(folder.path(), "lever_arm_m", "leverarm_m");
    for command in ["inspect", "trajectory", "calibrate", "georeference", "run"] {
        let run = on_project(folder.path(), command, &[]);
        assert_eq!(run.code, 1);
        assert_eq!(run.out, "");
        assert_eq!(run.err.matches("error: ").count(), 1, "{}", run.err);
        assert!(
            run.err.contains(
                "project.toml, line 6: found the unknown key `leverarm_m`, expected `lever_arm_m`"
            ),
            "{}",
            run.err
        );
    }
}

#[test]
fn with_json_an_error_is_one_json_document() {
    let folder = project_of_logs();
    change_project(folder.path(), "lever_arm_m", "leverarm_m");
    let run = on_project(folder.path(), "run", &["--json"]);
    assert_eq!(run.code, 1);
    let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    assert_eq!(document["error"]["line"], 6);
    assert_eq!(document["error"]["found"], "the unknown key `leverarm_m`");
    assert!(
        document["error"]["file"]
            .as_str()
            .unwrap()
            .ends_with("project.toml")
    );
}

#[test]
fn a_missing_project_file_is_named() {
    let run = boresight(&["run", "nowhere/project.toml"]);
    assert_eq!(run.code, 1);
    assert!(
        run.err.starts_with("error: nowhere/project.toml: "),
        "{}",
        run.err
    );
}

#[test]
fn a_missing_log_is_named_with_its_key_and_line_and_nothing_is_written() {
    let folder = project_of_logs();
    fs::remove_file(folder.path().join("prism.csv")).unwrap();
    for command in ["inspect", "trajectory", "calibrate", "georeference", "run"] {
        let run = on_project(folder.path(), command, &[]);
        assert_eq!(run.code, 1);
        assert!(
            run.err
                .contains("project.toml, line 5: found prism.file = "),
            "{}",
            run.err
        );
        assert!(run.err.contains("prism.csv"), "{}", run.err);
    }
    assert!(!folder.path().join("out").exists());
}

#[test]
fn completions_and_manual_pages_name_every_command() {
    let help = boresight(&["--help"]).out;
    let commands = help.split("\nCommands:\n").nth(1).unwrap();
    let commands = commands.split("\n\n").next().unwrap();
    let commands: Vec<&str> = commands
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .map(|line| line.split_whitespace().next().unwrap())
        .filter(|name| *name != "help")
        .collect();
    assert!(
        commands.len() > 15 && commands.contains(&"run"),
        "{commands:?}"
    );
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let run = boresight(&["completions", shell]);
        assert_eq!(run.code, 0, "{}", run.err);
        for name in &commands {
            assert!(run.out.contains(name), "{shell}: {name}");
        }
        assert!(run.out.contains("watch"), "{shell}");
    }
    let wrong = boresight(&["completions", "dos"]);
    assert_eq!(wrong.code, 2);
    assert!(wrong.err.contains("bash"), "{}", wrong.err);

    let folder = tempfile::tempdir().unwrap();
    let man = folder.path().join("man1");
    let run = boresight(&["man", man.to_str().unwrap()]);
    assert_eq!(run.code, 0, "{}", run.err);
    let first = fs::read_to_string(man.join("boresight.1")).unwrap();
    let mut expected = vec!["boresight.1".to_owned()];
    for name in &commands {
        assert!(
            first.contains(&format!("boresight\\-{name}(1)")),
            "{name}: {first}"
        );
        let page = fs::read_to_string(man.join(format!("boresight-{name}.1"))).unwrap();
        assert!(page.contains(".TH"), "{name}");
        expected.push(format!("boresight-{name}.1"));
    }
    expected.sort();
    assert_eq!(names(&man), expected);
}
