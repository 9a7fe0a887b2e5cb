//! The command line through the real binary.

mod common;

use std::fs;
use std::path::Path;

use common::{boresight, change_project, on_project, project_of_logs, rewrite_project};

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
fn wrong_use_exits_2_and_says_what_is_known() {
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
fn errors_are_one_json_document_where_json_is_asked_for() {
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
fn inspect_tells_every_value_with_its_unit_and_what_will_be_done() {
    let folder = project_of_logs();
    let run = on_project(folder.path(), "inspect", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    for expected in [
        "body axes               FRD: x forward, y right, z down",
        "gravity                 9.81 m/s²",
        "gyro noise              0.15 °/√h = 4.363e-5 rad/s/√Hz",
        "lever arm in the body   0.1, 0.05, -0.55 m",
        "rotation to start       -145, 0, 90 ° (bonn, the project's)",
        "voxel sizes             50, 40, 30, 20, 10, 5 mm",
        "1. estimate the trajectory from IMU and prism",
        "2. calibrate left on 6 scales against its own passes; without a reference its height \
         cannot be found and is held",
        "cloud-left.laz",
    ] {
        assert!(run.out.contains(expected), "{expected}\n{}", run.out);
    }
    assert_eq!(run.err, "");
}

#[test]
fn inspect_as_json_gives_the_resolved_project() {
    let folder = project_of_logs();
    let run = on_project(folder.path(), "inspect", &["--json"]);
    let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    let project = &document["files"][0]["project"];
    assert_eq!(project["prism"]["sigma_m"], 0.005);
    assert_eq!(project["calibration"]["neighbours"], 50);
    let profiles = project["scanner"][0]["profiles"].as_str().unwrap();
    assert_eq!(Path::new(profiles), folder.path().join("left.csv"));
}

#[test]
fn inspect_tells_what_a_log_holds() {
    let folder = project_of_logs();
    let imu = folder.path().join("imu.csv");
    let prism = folder.path().join("prism.csv");
    let run = boresight(&["inspect", imu.to_str().unwrap(), prism.to_str().unwrap()]);
    assert_eq!(run.code, 0, "{}", run.err);
    // 1500 rows at 50 Hz and 150 at 5 Hz.
    for expected in [
        "imu.csv",
        "1500",
        "50.000 Hz",
        "prism.csv",
        "150\n",
        "5.000 Hz",
    ] {
        assert!(run.out.contains(expected), "{expected}\n{}", run.out);
    }
    let run = boresight(&["inspect", imu.to_str().unwrap(), "--json"]);
    let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    assert_eq!(document["files"][0]["count"], 1500);
}

#[test]
fn inspect_names_a_file_that_nothing_reads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notes.txt");
    fs::write(&path, "dear diary,\nit rained\n").unwrap();
    for path in [path, folder.path().join("missing.csv")] {
        let run = boresight(&["inspect", path.to_str().unwrap()]);
        assert_eq!(run.code, 1, "{}", run.out);
        assert!(run.err.contains(path.to_str().unwrap()), "{}", run.err);
    }
}

/// An IMU log at rest: 100 Hz, white noise of 4.4e-5 rad/s/√Hz and 5.6e-4 m/s²/√Hz on every axis.
fn static_log(path: &Path, seconds: usize) {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, Normal};
    use std::fmt::Write;

    let mut random = ChaCha8Rng::seed_from_u64(3);
    let gyro = Normal::new(1e-3, 4.4e-4).expect("a positive sigma");
    let accel = Normal::new(0.0, 5.6e-3).expect("a positive sigma");
    let mut log =
        "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\n"
            .to_owned();
    for k in 0..seconds * 100 {
        let w: [f64; 3] = std::array::from_fn(|_| gyro.sample(&mut random));
        let a: [f64; 3] = std::array::from_fn(|_| accel.sample(&mut random));
        let time = k as f64 / 100.0;
        let up = a[2] + 9.81;
        let _ = writeln!(
            log,
            "{time:.2},{},{},{},{},{},{up}",
            w[0], w[1], w[2], a[0], a[1]
        );
    }
    fs::write(path, log).expect("a folder to write to");
}

#[test]
fn noise_figures_of_a_static_log_can_be_pasted_into_a_project() {
    let folder = project_of_logs();
    let log = folder.path().join("static.csv");
    static_log(&log, 200);
    let run = boresight(&["inspect", "--allan", log.to_str().unwrap(), "--json"]);
    assert_eq!(run.code, 0, "{}", run.err);
    let found: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    let found = &found["files"][0];
    let pasted = found["imu_toml"].as_str().unwrap();
    // 20,000 samples give a density to 1 %, the noisiest of three axes lies above by as much.
    let expected = [
        ("gyro_noise_deg_sqrt_h", 4.4e-5f64.to_degrees() * 60.0),
        ("accel_noise_ug_sqrt_hz", 5.6e-4 / 9.80665e-6),
    ];
    for (key, truth) in expected {
        let value = found["figures"][key]["recommended"].as_f64().unwrap();
        assert!(
            (value / truth - 1.0).abs() < 0.04,
            "{key}: {value}, {truth}"
        );
    }
    // Minutes cannot show a bias instability: it stays a comment with a bound.
    let bound = "# gyro_bias_instability_deg_h: not determined by this log, at most ";
    assert!(pasted.contains(bound), "{pasted}");

    let with_file = pasted.replace("[imu]\n", "[imu]\nfile = \"imu.csv\"\n");
    rewrite_project(folder.path(), |text| {
        text.replace("[imu]\nfile = \"imu.csv\"\n", &with_file)
    });
    let run = on_project(folder.path(), "inspect", &["--json"]);
    assert_eq!(run.code, 0, "{}{}", run.out, run.err);
    let project: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    for (key, _) in expected {
        let resolved = project["files"][0]["project"]["imu"][key].as_f64().unwrap();
        let value = found["figures"][key]["recommended"].as_f64().unwrap();
        // Four digits are pasted.
        assert!(
            (resolved / value - 1.0).abs() < 5e-4,
            "{key}: {resolved}, {value}"
        );
    }

    let run = boresight(&["inspect", "--allan", log.to_str().unwrap()]);
    for part in [
        "gyro_noise_deg_sqrt_h",
        "at most",
        "Allan deviation",
        "\n[imu]\n",
    ] {
        assert!(run.out.contains(part), "{part}: {}", run.out);
    }
}

#[test]
fn noise_figures_need_an_imu_log_at_rest() {
    let folder = project_of_logs();
    let prism = folder.path().join("prism.csv");
    let run = boresight(&["inspect", "--allan", prism.to_str().unwrap()]);
    assert_eq!(run.code, 1);
    assert!(run.err.contains("an IMU log at rest"), "{}", run.err);
    let log = folder.path().join("static.csv");
    static_log(&log, 20);
    let text = fs::read_to_string(&log).unwrap();
    let late = text.lines().enumerate().map(|(row, line)| {
        // From 15 s on the IMU turns by 0.1 rad/s about z.
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if row > 1500 {
            cells[3] = (cells[3].parse::<f64>().unwrap() + 0.1).to_string();
        }
        cells.join(",") + "\n"
    });
    fs::write(&log, late.collect::<String>()).unwrap();
    let run = boresight(&["inspect", "--allan", log.to_str().unwrap()]);
    assert_eq!(run.code, 1);
    assert!(
        run.err
            .contains("not at rest: at 15.000 s it turns by 5.7 °/s"),
        "{}",
        run.err
    );
}
