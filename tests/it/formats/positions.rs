//! Logs of positions in every form, and their errors.

use std::path::{Path, PathBuf};

use boresight::format::*;
use boresight::geometry::{Mat3, Vec3};
use boresight::sensor::*;

use crate::common::external_data;
use crate::common::samples::*;

fn log(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("log.csv");
    std::fs::write(&path, text).unwrap();
    path
}

fn station() -> TotalStation {
    TotalStation {
        station_m: Vec3::new(1000.0, 2000.0, 300.0),
        orientation_rad: 0.0,
        vertical: VerticalAngle::Zenith,
        reflector_constant_m: 0.0,
        sigma_distance_m: 0.001,
        sigma_distance_ppm: 0.0,
        sigma_angle_rad: 1e-5,
        sigma_prism_m: 0.0,
    }
}

/// The error of reading `text` as `observations`.
fn refusal(text: &str, observations: &Observations) -> String {
    let folder = tempfile::tempdir().unwrap();
    let error = read_positions(&log(folder.path(), text), observations).unwrap_err();
    error.to_string()
}

#[test]
fn sigmas_and_covariances_are_read_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    let skew = Mat3::new(4e-6, 1e-6, -2e-7, 1e-6, 9e-6, 3e-7, -2e-7, 3e-7, 1.7e-5);
    let square = |v: Vec3| Mat3::from_diagonal(&v.component_mul(&v));
    for (covariance, columns) in [
        (square(Vec3::repeat(0.0123)), "up_m,sigma_m\n"),
        (
            square(Vec3::new(0.011, 0.012, 0.0345)),
            "up_m,sigma_east_m,sigma_north_m,sigma_up_m\n",
        ),
        (
            skew,
            "up_m,cov_ee_m2,cov_nn_m2,cov_uu_m2,cov_en_m2,cov_eu_m2,cov_nu_m2\n",
        ),
    ] {
        // Some fixes have no covariance, and the times are neither sorted nor unique.
        let times = [3.0, 1.0, 1.0, 2.0];
        let fixes: Vec<_> = (0..4)
            .map(|i| PositionFix {
                time_s: times[i],
                position_m: vector(i, 0) * 1e6,
                covariance_m2: (i != 1).then_some(covariance),
            })
            .collect();
        write_positions(&path, &fixes).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(columns), "{text}");
        let read = read_positions(&path, &Observations::AsFound).unwrap();
        assert_eq!(read.fixes, fixes);
        assert_eq!(read.rejected, []);
    }
}

#[test]
fn pitch_is_read_back_with_the_heading() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    let fixes: Vec<_> = (0..20)
        .map(|i| HeadingFix {
            pitch_rad: (i % 2 == 0).then_some(0.01 * i as f64),
            pitch_sigma_rad: (i % 4 == 0).then_some(0.02),
            // Times run backwards and repeat: the reader accepts that.
            ..HeadingFix::new(f64::from(20 - i / 2), 0.3, None)
        })
        .collect();
    write_heading(&path, &fixes).unwrap();
    let read = read_heading(&path).unwrap();
    for (a, b) in read.iter().zip(&fixes) {
        assert_eq!((a.time_s, a.sigma_rad), (b.time_s, b.sigma_rad));
        assert_eq!(a.pitch_rad.is_some(), b.pitch_rad.is_some());
        let difference =
            |a: Option<f64>, b: Option<f64>| (a.unwrap_or(0.0) - b.unwrap_or(0.0)).abs();
        // Radians to degrees and back: two roundings.
        assert!(difference(a.pitch_rad, b.pitch_rad) < 1e-16);
        assert!(difference(a.pitch_sigma_rad, b.pitch_sigma_rad) < 1e-17);
    }
    for (row, expected) in [
        (
            "1,2,95,",
            "line 2: found pitch_deg = 95, expected -90 to 90",
        ),
        ("1,2,5,0", "line 2: found sigma_pitch_deg = 0"),
        ("1,2,,1", "line 2: found sigma_pitch_deg without pitch_deg"),
    ] {
        let text = format!("time_s,heading_deg,pitch_deg,sigma_pitch_deg\n{row}\n");
        let error = read_heading(&log(folder.path(), &text))
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn imu_rows_keep_the_order_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let header =
        "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\n";
    let rows = "3,0,0,0,0,0,9\n1,0,0,0,0,0,9\n1,0,0,0,0,0,9\n";
    let read = read_imu(&log(folder.path(), &format!("{header}{rows}"))).unwrap();
    let times: Vec<f64> = read.iter().map(|sample| sample.time_s).collect();
    assert_eq!(times, [3.0, 1.0, 1.0]);
}

#[test]
fn polar_rows_become_positions_and_rows_without_a_range_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let path = log(
        folder.path(),
        "time_s,slope_distance_m,horizontal_deg,vertical_deg,status\n\
         1,10,90,90,0\n2,0,0,0,3\n# lost\n3,20,0,60,0\n2.5,-1,0,0,\n",
    );
    let read = read_positions(&path, &Observations::Polar(station())).unwrap();
    let near = |fix: &PositionFix, x, y, z| (fix.position_m - Vec3::new(x, y, z)).norm() < 1e-9;
    assert!(near(&read.fixes[0], 1010.0, 2000.0, 300.0));
    assert!(near(
        &read.fixes[1],
        1000.0,
        2000.0 + 20.0 * 0.75_f64.sqrt(),
        310.0
    ));
    // Along the line of sight the sigma of the distance, across it 1e-5 rad times 10 m.
    let covariance = read.fixes[0].covariance_m2.unwrap();
    let expected = Mat3::from_diagonal(&Vec3::new(1e-6, 1e-8, 1e-8));
    assert!((covariance - expected).abs().max() < 1e-20, "{covariance}");
    let rejected: Vec<String> = read
        .rejected
        .iter()
        .map(|row| {
            row.to_string()
                .replace(&*folder.path().to_string_lossy(), "")
        })
        .collect();
    assert_eq!(
        rejected,
        [
            "/log.csv, line 3, 2 s: zero range (status 3)",
            "/log.csv, line 6, 2.5 s: a range of -1 m"
        ]
    );
}

#[test]
fn contradictory_or_incomplete_logs_are_refused_with_the_reason() {
    let coordinates = "time_s,east_m,north_m,up_m\n1,2,3,4\n";
    let polar = "time_s,slope_distance_m,horizontal_deg,vertical_deg\n1,10,90,90\n";
    let both = "time_s,east_m,north_m,up_m,slope_distance_m,horizontal_deg,vertical_deg\n\
                1,2,3,4,10,90,90\n";
    let instrument = Observations::Polar(station());
    let elevation = Observations::Polar(TotalStation {
        vertical: VerticalAngle::Elevation,
        ..station()
    });
    let as_found = Observations::AsFound;
    let sigmas = |columns: &str, values: &str| {
        format!("time_s,east_m,north_m,up_m,{columns}\n1,2,3,4,{values}\n")
    };
    let covariances = "cov_ee_m2,cov_nn_m2,cov_uu_m2,cov_en_m2,cov_eu_m2,cov_nu_m2";
    let geographic = "time_s,latitude_deg,longitude_deg,height_m\n1,50,7,60\n";
    for (text, observations, expected) in [
        (
            polar,
            &as_found,
            "found polar observations only, expected the instrument's pose",
        ),
        (
            coordinates,
            &instrument,
            "found coordinates, expected polar observations",
        ),
        (
            both,
            &as_found,
            "expected a choice in the project: observations = \"cartesian\"",
        ),
        (
            geographic,
            &as_found,
            "found the geographic column latitude_deg, expected projected",
        ),
        (
            &polar.replace(",90\n", ",-3\n"),
            &instrument,
            "line 2: found a vertical angle of -3 degrees, expected 0 to 360 from the zenith; for angles from the horizon set vertical_angle = \"elevation\"",
        ),
        (
            &polar.replace(",90\n", ",91\n"),
            &elevation,
            "set vertical_angle = \"zenith\"",
        ),
        (
            &polar.replace(",10,", ",0,"),
            &instrument,
            "found 1 rows, none with a range",
        ),
        (
            &sigmas("sigma_east_m,sigma_north_m", "1,1"),
            &as_found,
            "2 of sigma_east_m",
        ),
        (
            &sigmas("sigma_m,sigma_east_m,sigma_north_m,sigma_up_m", "1,1,1,1"),
            &as_found,
            "found 1 of sigma_m, 3 of",
        ),
        (
            &sigmas("sigma_east_m,sigma_north_m,sigma_up_m", "1,1,-1"),
            &as_found,
            "line 2: found sigma_up_m = -1",
        ),
        (
            &sigmas(covariances, "1,1,1,2,0,0"),
            &as_found,
            "line 2: found the covariance 1, 1, 1, 2, 0, 0 m2, expected a positive definite",
        ),
        (
            &sigmas("sigma_me", "5"),
            &as_found,
            "`sigma_me` looks like `sigma_m`",
        ),
    ] {
        let message = refusal(text, observations);
        assert!(
            message.contains(expected),
            "{message}\n  should contain: {expected}"
        );
    }
    // If the project chooses, both forms are read.
    let folder = tempfile::tempdir().unwrap();
    let path = log(folder.path(), both);
    let read = read_positions(&path, &Observations::Cartesian).unwrap();
    assert_eq!(read.fixes[0].position_m, Vec3::new(2.0, 3.0, 4.0));
    let read = read_positions(&path, &instrument).unwrap();
    assert!((read.fixes[0].position_m.x - 1010.0).abs() < 1e-9);
}

#[test]
fn a_real_total_station_log_gives_the_same_positions_as_polar_and_as_cartesian() {
    let Some(path) = external_data("total_station/tps_20210119155250.csv") else {
        return;
    };
    let instrument = TotalStation {
        station_m: Vec3::zeros(),
        vertical: VerticalAngle::Elevation,
        ..station()
    };
    let polar = read_positions(&path, &Observations::Polar(instrument)).unwrap();
    let cartesian = read_positions(&path, &Observations::Cartesian).unwrap();
    assert_eq!(polar.rejected, cartesian.rejected);
    assert_eq!(polar.fixes.len(), 1513);
    assert_eq!(cartesian.fixes.len(), 1513);
    let lines: Vec<u64> = polar.rejected.iter().map(|row| row.line).collect();
    assert_eq!(lines, (1515..=1523).collect::<Vec<_>>());
    assert_eq!(polar.rejected[0].time_s, 57361.3873);
    assert!(
        polar
            .rejected
            .iter()
            .all(|row| row.reason == "zero range (status 2)")
    );
    let mut squares = 0.0;
    let mut largest = 0.0_f64;
    for (a, b) in polar.fixes.iter().zip(&cartesian.fixes) {
        assert_eq!(a.time_s, b.time_s);
        let off = a.position_m - b.position_m;
        // Half the last digit of distance, coordinates (1e-6 m) and each angle (1e-6°): the rounding in
        // the file.
        let range = a.position_m.norm();
        let rounding = 0.5e-6 + 0.5e-6 + range * 0.5e-6_f64.to_radians() * 2.0_f64.sqrt();
        assert!(off.abs().max() <= rounding, "{off} at {range} m");
        squares += off.norm_squared();
        largest = largest.max(off.abs().max());
    }
    let rms = (squares / 1513.0).sqrt();
    println!("polar against Cartesian: rms {rms:.2e} m, largest coordinate {largest:.2e} m");
    assert!(rms < 1e-6, "{rms}");
    // Without a choice, and with the wrong kind of vertical angle, the log is refused.
    let error = read_positions(&path, &Observations::AsFound).unwrap_err();
    assert!(
        error.to_string().contains("observations = \"cartesian\""),
        "{error}"
    );
    let zenith = Observations::Polar(station());
    let error = read_positions(&path, &zenith).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("line 2: found a vertical angle of -1.628805"),
        "{error}"
    );

    let report = inspect(&path).unwrap();
    assert_eq!((report.format.id(), report.count), ("tps-csv", 1522));
    let text = report.to_string();
    for expected in [
        "9 rows without a range",
        "observations = \"cartesian\" or",
        "13.916170 to",
    ] {
        assert!(text.contains(expected), "{text}");
    }
}
