//! The inputs that a project may name, and how they are reported, tested with the binary.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use crate::common::tables::numbers;
use crate::common::{
    boresight, change_project, on_project, project_of_logs, refused, replace_logs,
};
use boresight::geometry::Projection;

const PRISM: &str = "[prism]\nfile = \"prism.csv\"\nlever_arm_m = [0.10, 0.05, -0.55]\n";
const STATION: [f64; 3] = [-7.0, 12.0, 1.5];

/// Writes the coordinates of `prism.csv` as polar observations from [`STATION`], with horizontal zero at
/// azimuth 30°, zenith angles, and rows without a range on lines 50 and 100.
fn write_polar(folder: &Path) {
    let mut polar = "time_s,slope_distance_m,horizontal_deg,vertical_deg,status\n".to_owned();
    for cells in numbers(&folder.join("prism.csv")) {
        let [east, north, up] = [1, 2, 3].map(|i| cells[i] - STATION[i - 1]);
        let distance = (east * east + north * north + up * up).sqrt();
        let horizontal = (east.atan2(north).to_degrees() - 30.0).rem_euclid(360.0);
        let zenith = (up / distance).acos().to_degrees();
        let lines = polar.lines().count() + 1;
        if [50, 100].contains(&lines) {
            let _ = writeln!(polar, "{},0,0,0,2", cells[0] - 0.01);
        }
        let _ = writeln!(polar, "{},{distance},{horizontal},{zenith},0", cells[0]);
    }
    fs::write(folder.join("polar.csv"), polar).unwrap();
}

fn poses(folder: &Path) -> Vec<Vec<f64>> {
    numbers(&folder.join("out/trajectory.csv"))
}

/// Writes the prism positions of the project, moved far from the origin, as a table and as NMEA sentences.
fn write_antenna(folder: &Path) {
    let crs = Projection::new("EPSG:25832").unwrap();
    let mut table = "time_s,east_m,north_m,up_m\n".to_owned();
    let mut log = String::new();
    let sentence = |text: &str| {
        let sum = text.bytes().fold(0, |sum, byte| sum ^ byte);
        format!("${text}*{sum:02X}\r\n")
    };
    for cells in numbers(&folder.join("prism.csv")) {
        let (time_s, [east, north, up]) =
            (cells[0], [cells[1] + 364e3, cells[2] + 5621e3, cells[3]]);
        let _ = writeln!(table, "{time_s},{east},{north},{up}");
        let (latitude, longitude) = crs.unproject(east, north).unwrap();
        let angle = |radians: f64, width: usize| {
            let degrees = radians.to_degrees();
            let minutes = (degrees - degrees.floor()) * 60.0;
            format!("{:0width$.0}{minutes:012.9}", degrees.floor())
        };
        let clock = format!("1200{time_s:05.2}");
        log += &sentence(&format!(
            "GNGGA,{clock},{},N,{},E,4,17,0.7,{up:.4},M,0.0,M,1.0,0001",
            angle(latitude, 2),
            angle(longitude, 3)
        ));
        log += &sentence(&format!("GNZDA,{clock},23,11,2026,00,00"));
    }
    fs::write(folder.join("antenna.csv"), table).unwrap();
    fs::write(folder.join("antenna.nmea"), log).unwrap();
}

/// Unix time of the noon at which the log of the antenna begins, seconds.
const NOON_S: f64 = 1_795_435_200.0;

#[test]
fn latitudes_and_longitudes_are_projected_into_the_world() {
    let folder = project_of_logs();
    let folder = folder.path();
    write_antenna(folder);
    let gnss = |file: &str, offset_s: f64, crs: &str| {
        format!(
            "[frame]\norigin_m = [364e3, 5621e3, 0]\n{crs}[imu]\nfile = \"imu.csv\"\n[gnss]\n\
             file = \"{file}\"\ntime_offset_s = {offset_s}\nlever_arm_m = [0.10, 0.05, -0.55]\n"
        )
    };
    replace_logs(folder, &gnss("antenna.csv", 0.0, ""));
    let run = on_project(folder, "trajectory", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let expected = poses(folder);

    replace_logs(folder, &gnss("antenna.nmea", -NOON_S, ""));
    let error = refused(folder, &["trajectory", "./project.toml"]).err;
    assert!(
        error.contains("antenna.nmea") && error.contains("crs"),
        "{error}"
    );

    replace_logs(
        folder,
        &gnss("antenna.nmea", -NOON_S, "crs = \"EPSG:25832\"\n"),
    );
    let run = on_project(folder, "trajectory", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    for (pose, expected) in poses(folder).iter().zip(&expected) {
        // Heights have four decimals; Unix times are exact to 0.2 µs.
        for column in 0..4 {
            assert!((pose[column] - expected[column]).abs() < 1e-4, "{pose:?}");
        }
    }
}

#[test]
fn polar_observations_give_the_same_trajectory_as_coordinates() {
    let folder = project_of_logs();
    let folder = folder.path();
    // The observations are nearly exact, so that the noise is the prism's 5 mm in both cases.
    change_project(
        folder,
        PRISM,
        &PRISM.replace("lever", "loss = \"none\"\nlever"),
    );
    let run = on_project(folder, "trajectory", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let cartesian = poses(folder);

    write_polar(folder);
    let instrument = format!(
        "polar.csv\"\nsigma_m = 0.005\nsigma_distance_m = 1e-9\nsigma_distance_ppm = 0\n\
         sigma_angle_arcsec = 1e-6\nstation_m = {STATION:?}\nstation_orientation_deg = 30\n"
    );
    change_project(folder, "prism.csv\"\n", &instrument);
    let run = on_project(folder, "trajectory", &["--json", "-v"]);
    assert_eq!(run.code, 0, "{}", run.err);
    let polar = poses(folder);
    assert_eq!(polar.len(), cartesian.len());
    for (a, b) in polar.iter().zip(&cartesian) {
        // Coordinates are rounded to 0.1 mm in both logs; the difference is rounding of the last bits and
        // the point at which the solver stops.
        let off = (1..4).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max);
        assert!(off < 1e-6, "{off} at {}", a[0]);
    }
    for expected in [
        "polar.csv, line 50, ",
        "zero range (status 2)",
        "2 of 152 rows of `prism` contain no measurement",
    ] {
        assert!(run.err.contains(expected), "{expected}\n{}", run.err);
    }
    let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    let rows = document["rejected_rows"].as_array().unwrap();
    let lines: Vec<_> = rows
        .iter()
        .map(|row| row["line"].as_u64().unwrap())
        .collect();
    assert_eq!(lines, [50, 100]);
    assert_eq!(rows[0]["reason"], "zero range (status 2)");
}

#[test]
fn a_polar_log_without_an_instrument_is_an_error() {
    let folder = project_of_logs();
    write_polar(folder.path());
    change_project(folder.path(), "prism.csv", "polar.csv");
    let run = on_project(folder.path(), "trajectory", &[]);
    assert_eq!(run.code, 1);
    assert!(
        run.err
            .contains("polar.csv: found polar observations only, expected the instrument's pose"),
        "{}",
        run.err
    );
}

#[test]
fn inspect_reports_all_settings_of_the_sensors_with_units() {
    let folder = project_of_logs();
    let folder = folder.path();
    write_polar(folder);
    let tables = "[[prism]]\nname = \"a\"\nfile = \"polar.csv\"\nlever_arm_m = [0, 0, 1]\n\
                  station_m = [1, 2, 3]\nstation_orientation_deg = 45\nsigma_angle_arcsec = 2\n\
                  [[prism]]\nname = \"b\"\nfile = \"other.csv\"\nlever_arm_m = [0, 0, 1]\n\
                  [gnss]\nfile = \"prism.csv\"\nlever_arm_m = [0, 0, 1]\nloss = \"cauchy\"\n\
                  [trajectory]\nnodes = \"imu\"\nestimate = [\"a.incidence_bias\", \"imu.noise_scale\"]\n\
                  max_sigma_position_m = 0.02\nmax_sigma_rotation_deg = 0.5\n";
    change_project(folder, PRISM, tables);
    let run = on_project(folder, "inspect", &[]);
    assert_eq!(run.code, 1);
    assert!(
        run.err.contains("line 13: found prism[1].file = "),
        "{}",
        run.err
    );
    fs::copy(folder.join("prism.csv"), folder.join("other.csv")).unwrap();
    let run = on_project(folder, "inspect", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    for expected in [
        "prism a\n",
        "station                 1, 2, 3 m",
        "horizontal zero         45° clockwise from grid north",
        "vertical angles         from the zenith",
        "sigma of distances      1 mm + 1 ppm",
        "sigma of angles         2″",
        "sigma of tracking       0 mm",
        "prism b\n",
        "sigma                   5 mm if the log has none",
        "gnss\n",
        "sigma                   20, 20, 40 mm (east, north, up) if",
        "logarithmic for large residuals (Cauchy)",
        "nodes                   at every IMU sample",
        "estimated constants     a.incidence_bias, imu.noise_scale",
        "largest position sigma  20 mm; points beyond are left out",
        "largest rotation sigma  0.5°; points",
        "1. estimate the trajectory from IMU, a, b and gnss",
    ] {
        assert!(run.out.contains(expected), "{expected}\n{}", run.out);
    }
    let polar = folder.join("polar.csv");
    let run = boresight(&["inspect", polar.to_str().unwrap()]);
    for expected in [
        "total station log",
        "2 rows without a range",
        "slope_distance",
    ] {
        assert!(run.out.contains(expected), "{expected}\n{}", run.out);
    }
}

#[test]
fn an_unknown_constant_is_named_with_the_known_ones() {
    let folder = project_of_logs();
    let estimate =
        format!("{PRISM}[trajectory]\nestimate = [\"prism.latency\", \"prism.timeoffset\"]\n");
    change_project(folder.path(), PRISM, &estimate);
    let run = on_project(folder.path(), "trajectory", &[]);
    assert_eq!(run.code, 1);
    assert!(
        run.err
            .contains("line 8: found the unknown constant `prism.latency`"),
        "{}",
        run.err
    );
    assert!(
        run.err
            .contains("constants: prism.time_offset, prism.time_drift, prism.lever_arm, "),
        "{}",
        run.err
    );
}

/// Replaces the logs by poses at 10 Hz, with position sigmas of 1 mm, and of 50 mm from 5 s to 8 s.
fn with_poses(folder: &Path, sigmas: bool, tables: &str) {
    let mut text = "time_s,east_m,north_m,up_m,qx,qy,qz,qw".to_owned();
    if sigmas {
        text += ",sigma_east_m,sigma_north_m,sigma_up_m,sigma_rotation_east_rad,\
                 sigma_rotation_north_rad,sigma_rotation_up_rad";
    }
    let half = 0.5_f64.sqrt();
    for i in 0..300 {
        let time = f64::from(i) / 10.0;
        let _ = write!(text, "\n{time},0,{},2,{half},{half},0,0", 0.5 * time);
        if sigmas {
            let sigma = if (50..=80).contains(&i) { 0.05 } else { 0.001 };
            let _ = write!(text, ",0.001,0.001,{sigma},0.0001,0.0001,0.001");
        }
    }
    fs::write(folder.join("poses.csv"), text + "\n").unwrap();
    let poses = format!("[trajectory]\nfile = \"poses.csv\"\n{tables}\n");
    replace_logs(folder, &poses);
}

/// The number of points in the scanner's cloud.
fn placed(folder: &Path) -> u64 {
    let cloud = folder.join("out/cloud-left.laz");
    let run = boresight(&["inspect", cloud.to_str().unwrap(), "--json"]);
    let document: serde_json::Value = serde_json::from_str(&run.out).unwrap();
    document["files"][0]["count"].as_u64().unwrap()
}

#[test]
fn points_with_poses_beyond_the_limits_of_sigma_are_left_out() {
    let folder = project_of_logs();
    let folder = folder.path();
    with_poses(folder, true, "");
    let run = on_project(folder, "georeference", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    // 250 profiles from 1.0 s on, ten per second, with 41 points.
    assert_eq!(placed(folder), 250 * 41);
    assert!(!run.err.contains("left out"), "{}", run.err);

    // Profiles are at the times of the nodes: the interval from 4.9 s ends at the bad node at 5 s, and the
    // one from 8.0 s starts at one, so that 4.9 s to 8.0 s are left out: 32 profiles.
    with_poses(folder, true, "max_sigma_position_m = 0.01");
    let run = on_project(folder, "georeference", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert_eq!(placed(folder), (250 - 32) * 41);
    let expected = "12.8 % of the points of scanner `left` were left out: 1312 points from 4.900 s \
                    to 8.000 s, whose poses have standard deviations above 0.01 m (max_sigma_position_m)";
    assert!(run.err.contains(expected), "{}", run.err);
    for command in ["calibrate", "run"] {
        let run = on_project(folder, command, &[]);
        assert!(run.err.contains(expected), "{command}: {}", run.err);
    }
    let result = fs::read_to_string(folder.join("out/result.json")).unwrap();
    assert!(result.contains(expected), "{result}");

    with_poses(folder, true, "max_sigma_rotation_deg = 0.01");
    let run = on_project(folder, "georeference", &[]);
    assert_eq!(run.code, 1);
    assert!(
        run.err
            .contains("no point of scanner `left` can be placed: 10250 points from 1.000 s")
            && run.err.contains("max_sigma_rotation_deg"),
        "{}",
        run.err
    );
}

#[test]
fn a_limit_of_pose_sigmas_needs_poses_with_sigmas() {
    let folder = project_of_logs();
    let folder = folder.path();
    with_poses(folder, false, "max_sigma_position_m = 0.01");
    let run = on_project(folder, "georeference", &[]);
    assert_eq!(run.code, 1);
    assert!(
        run.err.contains("comes without standard deviations"),
        "{}",
        run.err
    );
    let both = "max_sigma_position_m = 0.01\nsigma_position_m = 0.001\nsigma_rotation_deg = 0.01";
    with_poses(folder, false, both);
    let run = on_project(folder, "georeference", &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert_eq!(placed(folder), 250 * 41);
}
