//! The section of the trajectory: it shows the computed numbers and the faults, in bounded size; and the
//! same numbers are in `result.json`.

use super::adjusted::{START_S, solution};
use super::checker::{check_self_contained, check_well_formed};
use super::{keep, synthetic};
use boresight::diagnostics::worst;
use boresight::geometry::{Rotation, Vec3, WorldFromBody};
use boresight::pipeline::result;
use boresight::report::content::Content;
use boresight::report::render;
use boresight::results::Drive;
use boresight::sensor::{ImuBias, PoseRecord, PoseSigma};
use boresight::trajectory::Solution;
use serde_json::json;

/// Poses with biases, and sigmas of 4 mm east and 3 mm north, ten times larger from 1100 s to 1120 s.
fn poses(count: usize, rate_hz: f64) -> Vec<PoseRecord> {
    (0..count)
        .map(|i| {
            let time_s = START_S + i as f64 / rate_hz;
            let factor = if (1_100.0..1_120.0).contains(&time_s) {
                10.0
            } else {
                1.0
            };
            PoseRecord {
                time_s,
                world_from_body: WorldFromBody::new(
                    Rotation::identity(),
                    Vec3::x() * (0.1 * i as f64 / rate_hz),
                ),
                velocity_m_s: None,
                bias: Some(ImuBias {
                    gyro_rad_s: Vec3::new(1e-3, 0.0, -1e-3)
                        + Vec3::repeat(1e-6) * (0.02 * time_s).sin(),
                    accel_m_s2: Vec3::new(0.03, 0.01, -0.02),
                }),
                sigma: Some(PoseSigma {
                    position_m: Vec3::new(0.004, 0.003, 0.0) * factor,
                    rotation_rad: Vec3::new(0.01, 0.02, 0.1).map(f64::to_radians) * factor,
                }),
            }
        })
        .collect()
}

fn page(solution: Solution, poses: Vec<PoseRecord>) -> String {
    let drive = Drive {
        name: "drive-1".into(),
        poses,
        solution: Some(solution),
        ..Drive::default()
    };
    render(&Content {
        title: "Trajectory of drive-1".into(),
        drives: vec![drive].into(),
        ..Content::default()
    })
}

/// The cells of the row that starts with `name`, without markup, of the table after `heading`.
fn row(page: &str, heading: &str, name: &str) -> Vec<String> {
    let table = page.split(heading).nth(1).expect("the table");
    let start = format!("<th scope=\"row\">{name}</th>");
    let row = table.split(&start).nth(1).expect("the row");
    let row = row.split("</tr>").next().expect("its end");
    row.replace("<br/>", " ")
        .split("</td>")
        .map(|cell| {
            let pieces = cell.split('<').map(|p| p.rsplit('>').next().unwrap_or(""));
            pieces.collect::<String>().trim().to_owned()
        })
        .filter(|cell| !cell.is_empty())
        .collect()
}

#[test]
fn numbers_in_the_tables_are_those_of_the_solution() {
    let solution = solution(2_100, 7.0, 1_500);
    let (used, rejected) = (solution.sensors[0].count, solution.sensors[0].rejected);
    assert_eq!(rejected, solution.rejections.len() - 1);
    let page = page(solution, poses(30_000, 100.0));
    keep("report-trajectory.html", &page);
    check_well_formed(&page);
    check_self_contained(&page);
    let sensors = |name: &str| row(&page, "<h3>Residuals by sensor</h3>", name);
    let (used, rejected) = (used.to_string(), rejected.to_string());
    let expected = [
        &used,
        &rejected,
        "3",
        "4.56\u{202f}mm",
        "0.97",
        "4321",
        "0.98",
        "4250 4140 to 4505",
        "as expected",
    ];
    assert_eq!(sensors("prism"), expected);
    assert_eq!(sensors("heading")[3], "0.0123°");
    assert_eq!(
        sensors("heading")[6..],
        [
            "3.24",
            "3240 914 to 1090",
            "1.80 times larger than expected"
        ]
    );
    assert_eq!(sensors("gyro")[0], "30\u{202f}000");
    assert_eq!(sensors("gyro")[3], "0.0500\u{202f}°/s");
    assert_eq!(sensors("gyro")[8], "1.25 times smaller than expected");
    assert_eq!(sensors("bias walk")[8], "not checked");
    assert!(!page.contains("<th scope=\"row\">pitch</th>"));

    let constants = |name: &str| row(&page, "<h3>Constants", name);
    assert_eq!(
        constants("prism.lever_arm.x"),
        ["0.10342± 0.00083", "0.1", "m"]
    );
    assert_eq!(constants("prism.time_offset"), ["−12.34± 0.21", "0", "ms"]);
    assert_eq!(
        constants("heading.mounting_offset"),
        ["–", "0", "not determined by this drive", "°"]
    );

    let counts = |name: &str| row(&page, "<h3>Rejected measurements</h3>", name);
    assert_eq!(counts("prism"), ["outlier", &rejected]);
    assert_eq!(counts("IMU"), ["time out of order", "1"]);
    let all = page.split("All ").nth(1).expect("the list of all");
    assert_eq!(
        row(all, "rejected measurements</summary>", "IMU"),
        ["4711", "1047.110", "time out of order", "–"]
    );
    // 0.3 m with a sigma of 5 mm; divided by √0.81 for the test.
    assert_eq!(
        row(
            &page,
            "worst measurements (largest test value 66.7, prism record 8)",
            "prism"
        ),
        [
            "8",
            "1001.000",
            "east",
            "+300\u{202f}mm",
            "+60.0",
            "+66.7",
            "rejected"
        ]
    );
}

#[test]
fn faults_are_shown() {
    let page = page(solution(2_100, 7.0, 1_500), poses(30_000, 100.0));
    for text in [
        "The adjustment of the trajectory converged after 6 iterations over 12\u{202f}345 nodes.",
        "residuals of heading are 1.80 times larger than expected",
        "The IMU has no samples from 1060.0 s to 1060.8 s.",
        "The clock of prism jumps by 512 ms at 1234.5 s: corrected.",
        // √(4² + 3²) mm, and ten times that.
        "exceeds 3 times its median of 5.00 mm from 1100.0 s to 1120.0 s: up to 50.0 mm",
        "held at the project&#39;s value: heading.mounting_offset",
        "(median and largest): 3D position 5.00\u{202f}mm and 50.0\u{202f}mm",
        "one gap",
        "x, mean +206\u{202f}°/h",
    ] {
        assert!(page.contains(text), "{text}");
    }
    // The three components of the prism show the time without prism and the IMU gap, the heading shows
    // the IMU gap, and both charts of sigmas show the outage.
    assert_eq!(page.matches("<rect class=\"silent\"").count(), 4);
    assert_eq!(page.matches("<rect class=\"gap\"").count(), 3 + 2);
    // Only the first component of the outliers exceeds the scale.
    assert_eq!(page.matches("<path class=\"beyond\"").count(), 1);
    // In two components with outliers, and on the time line.
    assert_eq!(page.matches("<path class=\"cross\"").count(), 2 + 1);
}

#[test]
fn hours_of_records_do_not_make_the_page_larger() {
    let short = page(solution(2_100, 7.0, 1_500), poses(3_000, 10.0));
    let long = page(solution(250_000, 70.0, 180_000), poses(3_000, 1.0));
    assert!(
        long.len() < 700_000,
        "{} bytes after {}",
        long.len(),
        short.len()
    );
    check_well_formed(&long);
}

#[test]
fn the_document_has_the_numbers_of_the_page() {
    let solution = solution(2_100, 7.0, 1_500);
    let poses = poses(30_000, 100.0);
    let document = result::trajectory(&solution, &poses);
    let list = document["worst"].as_array().expect("a list");
    assert_eq!(list.len(), 20);
    assert_eq!(list[0]["sensor"], "prism");
    assert_eq!(list[0]["record"], 8);
    assert_eq!(list[0]["time_s"], 1_001.0);
    assert_eq!(list[0]["component"], "east");
    assert_eq!(list[0]["residual"], 0.3);
    assert_eq!(list[0]["rejected"], true);
    assert_eq!(list[0]["test"], json!(worst(&solution, 1)[0].test));
    let rejected = solution.sensors[0].rejected;
    assert_eq!(
        document["rejection_counts"],
        json!([
            {"sensor": "imu", "reason": "time_order", "count": 1},
            {"sensor": "prism", "reason": "outlier", "count": rejected},
        ])
    );
    assert_eq!(
        document["rejections"].as_array().map(Vec::len),
        Some(rejected + 1)
    );
    let determined = |i: usize| document["constants"][i]["determined"].as_bool();
    assert_eq!(
        [0, 1, 2].map(determined),
        [Some(true), Some(true), Some(false)]
    );
    let passed = |i: usize| document["sensors"][i]["chi_square_passed"].clone();
    assert_eq!(passed(0), json!(true));
    assert_eq!(passed(1), json!(false));
    assert_eq!(passed(3), json!(null));
    let sigma = &document["pose_sigma"];
    let close = |value: &serde_json::Value, expected: f64| {
        // Rounding of a few operations.
        assert!((value.as_f64().expect("a number") - expected).abs() < 1e-12);
    };
    close(&sigma["position_m"]["median"], 0.005);
    close(&sigma["position_m"]["max"], 0.05);
    close(&sigma["tilt_deg"]["median"], 0.02);
    close(&sigma["heading_deg"]["max"], 1.0);
    assert_eq!(sigma["outages"].as_array().map(Vec::len), Some(1));
    close(&sigma["outages"][0]["from_s"], 1_100.0);
    close(&sigma["outages"][0]["to_s"], 1_119.99);
}

#[test]
fn names_of_the_user_are_escaped_and_numbers_may_be_missing() {
    let evil = "<script>alert(1)</script> & 'more'";
    let mut solution = solution(300, 7.0, 100);
    solution.sensors[0].name = evil.into();
    solution.sensors[0].rms_raw = f64::NAN;
    solution.sensors[0].variance_component = Some(f64::NAN);
    solution.sensors[1].chi_square = f64::INFINITY;
    solution.constants[0].name = evil.into();
    solution.constants[0].sigma = Some(f64::NAN);
    solution.constants[1].value = f64::INFINITY;
    solution.rejections[0].sensor = evil.into();
    solution.rejections[0].time_s = f64::NAN;
    solution.residuals[0][3].values[0] = f64::NAN;
    solution.residuals[0][4].tests = vec![f64::NAN; 3];
    solution.residuals[0][5].time_s = f64::INFINITY;
    solution.residuals[1]
        .iter_mut()
        .for_each(|r| r.values[0] = f64::NAN);
    let mut drive = poses(500, 10.0);
    drive[7].bias = None;
    drive[8].bias = Some(ImuBias {
        gyro_rad_s: Vec3::repeat(f64::NAN),
        accel_m_s2: Vec3::repeat(f64::INFINITY),
    });
    let page = page(solution, drive);
    check_well_formed(&page);
    check_self_contained(&page);
    assert!(!page.contains("<script"));
    assert!(page.contains("&lt;script&gt;alert(1)"));
}

#[test]
fn other_drives_are_folded_below_the_first() {
    let mut full = synthetic::full(50);
    for drive in &mut full.drives {
        drive.solution = Some(solution(700, 7.0, 500));
    }
    let page = render(&full.content());
    check_well_formed(&page);
    check_self_contained(&page);
    let (shown, folded) = page
        .split_once("Residuals by sensor on the other drives")
        .expect("the other drives");
    assert_eq!(
        shown.matches("<table class=\"numbers sensors\">").count(),
        1
    );
    assert_eq!(
        folded.matches("<table class=\"numbers sensors\">").count(),
        2
    );
}
