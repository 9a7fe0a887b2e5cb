//! `boresight inspect`, tested with the real binary.

use std::fs;
use std::path::Path;

use crate::common::{boresight, on_project, project_of_logs, rewrite_project};

#[test]
fn inspect_reports_every_value_with_its_unit_and_the_steps_of_a_run() {
    let folder = project_of_logs();
    let run = on_project(folder.path(), "inspect", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    for expected in [
        "body axes               FRD: x forward, y right, z down",
        "gravity                 9.81 m/s²",
        "gyro noise              0.15 °/√h = 4.363e-5 rad/s/√Hz",
        "lever arm in the body   0.1, 0.05, -0.55 m",
        "initial rotation        -145, 0, 90 ° (bonn, as in the project)",
        "voxel sizes             chosen from the points",
        "1. estimate the trajectory from IMU and prism",
        "2. calibrate left against its own passes; without a reference its height \
         is unobservable and is held",
        "cloud-left.laz",
    ] {
        assert!(run.out.contains(expected), "{expected}\n{}", run.out);
    }
    // Beside it, only how long its stages took.
    assert!(
        run.err.lines().all(|line| line.ends_with(" s")),
        "{}",
        run.err
    );
}

#[test]
fn inspect_reports_the_assumptions_of_the_joint_adjustment() {
    let folder = project_of_logs();
    let inspected = || {
        let run = on_project(folder.path(), "inspect", &[]);
        assert_eq!(run.code, 0, "{}", run.err);
        run.out
    };
    let assert_lines = |expected: &[&str]| {
        let out = inspected();
        for expected in expected {
            assert!(
                out.lines().any(|line| line == *expected),
                "{expected}\n{out}"
            );
        }
    };
    let joint = "  method                  joint: one adjustment of trajectory and mountings, after \
                 two steps";
    assert_lines(&[
        joint,
        "  size of surfels         ten times the spacing of points, half of that on rough ground",
        "  iterations              at most 100",
        "  lasting errors          none",
        "  3. adjust trajectory and mountings in one",
    ]);
    let reference = folder.path().join("tls.csv");
    fs::write(&reference, "east_m, north_m, up_m\n0, 0, 0\n").unwrap();
    rewrite_project(folder.path(), |text| {
        format!("{text}[reference]\nfile = \"tls.csv\"\n")
    });
    assert_lines(&[
        "  sigma of its shift      2 mm (assumed)",
        "  sigma of its tilt       0.005° (assumed)",
    ]);

    let other = folder.path().join("other.toml");
    fs::copy(folder.path().join("project.toml"), &other).unwrap();
    fs::copy(&other, folder.path().join("third.toml")).unwrap();
    rewrite_project(folder.path(), |text| {
        let prism = "[prism]\nsigma_correlated_m = [0.001, 0.001, 0.002]\ncorrelation_s = 40";
        text.replace("[prism]", prism).replace(
            "name = \"left\"",
            "name = \"left\"\nestimate = [\"time_offset\"]",
        ) + "sigma_m = 0.001\nsigma_surface_m = 0.0003\n[joint]\nsurfel_m = 0.08\n\
             [[drive]]\nname = \"second\"\nproject = \"other.toml\"\n\
             [[drive]]\nname = \"third\"\nproject = \"third.toml\"\n"
    });
    assert_lines(&[
        joint,
        "  lasting errors          1, 1, 2 mm (east, north, up) over 40 s (correlation time)",
        "  estimated               time offset, besides the mounting",
        "  sigma of its shift      1 mm",
        "  sigma of its tilt       0.005°",
        "  sigma of its surface    0.3 mm",
        "  size of surfels         80 mm",
        "drive second",
        "  project                 other.toml",
        "  3. adjust trajectory and mountings in one, together with second, third",
    ]);

    let poses = "time_s,east_m,north_m,up_m,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n";
    fs::write(folder.path().join("poses.csv"), poses).unwrap();
    rewrite_project(folder.path(), |_| {
        "[trajectory]\nfile = \"poses.csv\"\ncorrelation_s = 2.5\n\
         [reference]\nfile = \"tls.csv\"\n[calibration]\nmethod = \"two-step\"\n"
            .into()
    });
    assert_lines(&[
        "  errors last             2.5 s (correlation time)",
        "  method                  two steps: reweighted least squares on the estimated trajectory",
    ]);
    // Two steps make no assumption about the reference.
    let out = inspected();
    assert!(
        !out.contains("assumed") && !out.contains("surfels"),
        "{out}"
    );
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
fn inspect_reports_the_content_of_a_log() {
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
fn inspect_names_a_file_of_unknown_format() {
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
    let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    let log_report = &document["files"][0];
    let pasted = log_report["imu_toml"].as_str().unwrap();
    // 20,000 samples give a density to 1 %; the noisiest of three axes is above it by about as much.
    let expected = [
        ("gyro_noise_deg_sqrt_h", 4.4e-5f64.to_degrees() * 60.0),
        ("accel_noise_ug_sqrt_hz", 5.6e-4 / 9.80665e-6),
    ];
    for (key, truth) in expected {
        let value = log_report["figures"][key]["recommended"].as_f64().unwrap();
        assert!(
            (value / truth - 1.0).abs() < 0.04,
            "{key}: {value}, {truth}"
        );
    }
    // A few minutes do not determine a bias instability: it remains a comment with a bound.
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
        let value = log_report["figures"][key]["recommended"].as_f64().unwrap();
        // The figures have four digits.
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
            .contains("not at rest: at 15.000 s it turns at 5.7 °/s"),
        "{}",
        run.err
    );
}
