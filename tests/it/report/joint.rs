//! The joint adjustment in the page and in `result.json`: the method of the values, and the tests of the adjustment.

use super::adjusted::solution;
use super::checker::{check_self_contained, check_well_formed};
use super::keep;
use super::synthetic::{Full, full, normal};
use boresight::calibration::{Calibration, Method, Variant};
use boresight::comparison::MountingKind;
use boresight::geometry::Vec3;
use boresight::joint::{
    AdjustedDrive, GroupTest, Joint, JointReport, PoseMove, PositionBlocks, PositionResiduals,
    ReferenceError, ReferenceSigma, Region, Rung,
};
use boresight::pipeline::{Findings, Rig, result};
use boresight::report::content::Content;
use boresight::report::render;
use boresight::results::FirstPlacement;
use boresight::trajectory::{EstimatedConstant, StopReason, Trajectory};
use nalgebra::DMatrix;
use serde_json::{Value, json};

fn group(name: &str, rows: usize, redundancy: f64, ratio: Option<f64>) -> GroupTest {
    GroupTest {
        name: name.into(),
        rows,
        chi_square: ratio.unwrap_or(0.0) * redundancy,
        redundancy,
        ratio,
    }
}

/// A drive with a prism; `east` is the root mean square of its residuals to the east over 30 s.
fn drive(full: &Full, east: f64) -> AdjustedDrive {
    let poses = &full.drives[0].poses;
    let blocks = |(block_s, rms): (f64, f64)| PositionBlocks {
        sensor: "prism".into(),
        block_s,
        blocks: (300.0 / block_s) as usize,
        rms: [rms, 0.9, 0.8],
    };
    let records = (0..2_100).map(|i| {
        let time_s = 1_000.0 + i as f64 / 7.0;
        (time_s, 5e-3 * Vec3::from_fn(|axis, _| normal(3 * i + axis)))
    });
    AdjustedDrive {
        points: Vec::new(),
        motion_left: 0.2,
        jumps: Vec::new(),
        name: "drive-1".into(),
        trajectory: Trajectory::new(poses.clone()).expect("poses in time order"),
        bending: Vec::new(),
        imu: "imu".into(),
        pose_errors: None,
        positions: [(2.0, 1.02), (10.0, 1.1), (30.0, east)].map(blocks).into(),
        residuals: vec![PositionResiduals {
            sensor: "prism".into(),
            records: records.collect(),
        }],
        moved: poses
            .iter()
            .enumerate()
            .map(|(i, pose)| PoseMove {
                time_s: pose.time_s,
                shift_m: Vec3::new(3e-3, 0.0, -4e-3) * (1e-3 * i as f64).sin().signum(),
                turn_rad: Vec3::repeat(1e-4),
            })
            .collect(),
    }
}

/// The result of an adjustment with these mountings, ratio of the IMU, and east residuals over 30 s.
fn joint_result(full: &Full, near: &Calibration, imu: f64, east: f64) -> Joint {
    Joint {
        prior_shares: Vec::new(),
        mountings: near.mountings.clone(),
        covariance: near.covariance.clone().expect("a covariance"),
        rung: Rung::Rigid,
        ladder: Vec::new(),
        compliance: Vec::new(),
        late_scores: vec![None, None],
        range_scores: vec![None, None],
        height_score: None,
        late_s: vec![Some((1.2e-3, 0.1e-3)), None],
        drives: vec![drive(full, east)],
        constants: vec![EstimatedConstant {
            name: "prism.time_offset".into(),
            unit: "s".into(),
            start: 0.0,
            value: -0.012_34,
            sigma: Some(0.000_21),
        }],
        reference: Some(ReferenceError {
            prior: ReferenceSigma::default(),
            shift_m: Vec3::new(5.1e-3, -0.2e-3, 0.0),
            shift_sigma_m: Vec3::new(0.12e-3, 0.13e-3, 2e-3),
            turn_rad: Vec3::new(1e-5, -2e-5, 3e-6),
            turn_sigma_rad: Vec3::repeat(2e-5),
        }),
        surface_m: 1.3e-4,
        regions: vec![Region {
            centre_m: Vec3::new(3.2, 1.4, 0.2),
            offset_m: 2.8e-3,
            surfels: 77,
        }],
        undetermined: Vec::new(),
        groups: vec![
            group("imu", 180_000, 90_000.0, Some(imu)),
            group("prism", 6_300, 5_900.0, Some(1.01)),
            group("heading", 1_500, 1_490.0, Some(0.98)),
            group("left", 52_000, 48_000.0, Some(1.0)),
            group("right", 51_000, 47_000.0, Some(1.0)),
            group("reference", 30_000, 11_000.0, Some(1.0)),
            group("assumed", 40, 0.5, None),
        ],
        stop: StopReason::Converged,
        iterations: 9,
        rows: 103_000,
        surfels: 12_345,
        planes: Vec::new(),
        unknowns: 85_432,
    }
}

/// A covariance of both scanners: 0.15 mm and 0.004° of the body frame, which both share, and 0.01 mm and
/// 0.0002° of each scanner.
fn rigid(calibration: &Calibration) -> DMatrix<f64> {
    let (frame_m, frame_rad) = (1.5e-4, 0.004f64.to_radians());
    let (own_m, own_rad) = (1e-5, 0.0002f64.to_radians());
    let mut common = DMatrix::zeros(12, 6);
    let mut own = DMatrix::zeros(12, 12);
    for (i, mounting) in calibration.mountings.iter().enumerate() {
        let arm = mounting.body_from_scanner.translation_m.cross_matrix();
        for axis in 0..3 {
            common[(6 * i + axis, axis)] = frame_m;
            common[(6 * i + 3 + axis, 3 + axis)] = frame_rad;
            own[(6 * i + axis, 6 * i + axis)] = own_m * own_m;
            own[(6 * i + 3 + axis, 6 * i + 3 + axis)] = own_rad * own_rad;
            for turn in 0..3 {
                common[(6 * i + axis, 3 + turn)] = -frame_rad * arm[(axis, turn)];
            }
        }
    }
    &common * common.transpose() + own
}

/// A run whose joint adjustment was accepted.
fn accepted() -> Full {
    let mut full = full(500);
    let two_steps = full.result.clone();
    let mut near = full.variants[1].1.clone();
    near.mountings[0].fixed = [false; 6];
    near.covariance = Some(rigid(&near));
    let joint = joint_result(&full, &near, 1.02, 1.3);
    full.result = joint.calibration(&two_steps);
    assert_eq!(full.result.method, Method::Joint);
    full.mountings[1].1 = full.result.poses();
    let before = (MountingKind::TwoStep, two_steps.poses());
    full.mountings.insert(1, before);
    for drive in &mut full.drives {
        let pairs = drive.agreements.comparisons.chunks(3);
        let with_two_steps = pairs.flat_map(|pair| {
            let mut two_steps = pair[1].clone();
            two_steps.mounting = MountingKind::TwoStep;
            two_steps.statistics.rmse_m = 2.346e-3;
            [&pair[..1], &[two_steps], &pair[1..]].concat()
        });
        drive.agreements.comparisons = with_two_steps.collect();
    }
    full.drives[0].solution = Some(solution(2_100, 7.0, 1_500));
    full.variants.insert(0, (Variant::TwoStep, two_steps));
    full.joint = Some(JointReport {
        result: Some(joint),
        seconds: 6.1,
        ..JointReport::default()
    });
    full
}

const REASON: &str = "the IMU contradicts a rigid mounting: the squares of its residuals are 8.5 \
                      times what its noise explains (at most 1.21)";

/// A run whose joint adjustment was refused.
fn refused() -> Full {
    let mut full = full(500);
    let near = full.variants[1].1.clone();
    let joint = joint_result(&full, &near, 8.5, 3.4);
    full.joint = Some(JointReport {
        result: Some(joint),
        refused: vec![REASON.into()],
        seconds: 6.1,
        ..JointReport::default()
    });
    full
}

/// The first verdict of the page.
fn first_verdict(page: &str) -> &str {
    let list = page
        .split("<ul class=\"verdicts\">")
        .nth(1)
        .expect("verdicts");
    list.split("</li>").next().expect("a statement")
}

#[test]
fn an_accepted_adjustment_is_shown_beside_two_steps() {
    let page = render(&accepted().content());
    keep("report-joint.html", &page);
    check_well_formed(&page);
    check_self_contained(&page);
    let (_, method) = page
        .split_once("<li class=\"good\"><span class=\"sign\" role=\"img\" aria-label=\"good\">✓</span><span>These are the values of the joint adjustment")
        .expect("the method of the values");
    assert!(method.split("</li>").next().unwrap().contains("1.02"));
    for text in [
        "as in the paper</th>",
        "two steps</th>",
        "<th scope=\"col\" class=\"result\">joint adjustment</th>",
        "Scanner right relative to left",
        "times better than either scanner on the body",
        "Around east 1003.2 m, north 2001.4 m the scans lie 2.8 mm above the reference",
        "East and north are those of the clouds",
        "The reference is displaced against the poses by +5.1 mm east, -0.2 mm north",
        "mounting bends or slips",
        "Residuals of the positions in blocks of time",
        "± 0.005° (assumed)",
        "± 2.0 mm and a tilt by ± 0.005° (assumed",
        "left: latency beyond time_offset_s",
        "How far each pose of drive-1 moved",
        "before: trajectory alone",
        "85\u{202f}432 unknowns",
        "after two steps: 2.3 mm",
        "magnified to ±",
    ] {
        let plain = page.replace("&quot;", "\"");
        assert!(plain.contains(text), "{text}");
    }
    assert!(
        page.contains("<td>2.35</td>"),
        "two steps in the table of distances"
    );
    // Coordinates include the origin.
    assert!(!page.contains("east 3.2"));
    // Nothing is refused.
    assert!(!page.contains("refused</th>") && !page.contains("was refused"));
}

#[test]
fn the_right_scanner_has_smaller_sigmas_relative_to_the_left_than_to_the_body() {
    let full = accepted();
    let on_body = full.result.sigmas(0, full.result.mountings[0].convention);
    let relative = full.result.relative().remove(0);
    assert_eq!((&*relative.name, &*relative.first), ("right", "left"));
    for (on_body, relative) in on_body.iter().zip(relative.sigma) {
        assert!(relative.unwrap() < 0.2 * on_body.unwrap());
    }
}

#[test]
fn a_refusal_is_the_first_verdict_with_its_reason() {
    let page = render(&refused().content());
    keep("report-refused.html", &page);
    check_well_formed(&page);
    check_self_contained(&page);
    let first = first_verdict(&page);
    assert!(first.contains("class=\"attention\""), "{first}");
    assert!(
        first.contains("These are the values of two steps"),
        "{first}"
    );
    assert!(first.contains(REASON), "{first}");
    assert!(page.contains("joint adjustment, refused</th>"));
    assert!(
        page.contains("<td class=\"out\">8.50</td>"),
        "the IMU is marked"
    );
    assert!(
        page.contains("<td class=\"out\">3.40</td>"),
        "so are the blocks"
    );
    assert!(page.contains("these figures show what it would have done"));
}

#[test]
fn clouds_that_agree_worse_than_after_two_steps_need_attention() {
    let mut full = accepted();
    for drive in &mut full.drives {
        for agreement in &mut drive.agreements.comparisons {
            if agreement.mounting == MountingKind::Final {
                agreement.statistics.rmse_m = 3.9e-3;
            }
        }
    }
    let page = render(&full.content());
    let attention = page.split("<li class=\"attention\">").skip(1);
    let attention: Vec<&str> = attention
        .map(|rest| rest.split("</li>").next().unwrap())
        .collect();
    for text in [
        "after two steps: 2.3 mm), NMAD",
        "worse than after two steps",
        "On drive-2, which was not used in the calibration",
    ] {
        assert!(attention.iter().any(|item| item.contains(text)), "{text}");
    }
}

#[test]
fn an_error_of_many_standard_deviations_needs_attention() {
    let mut full = accepted();
    // Two of twelve errors beyond 1.96 σ may be chance, but not if they are this large.
    for mounting in &mut full.result.mountings {
        mounting.body_from_scanner.translation_m.z += 4e-3;
    }
    let page = render(&full.content());
    // It is the reason of the headline, and then the first verdict of the list.
    let statement = page
        .rsplit("The largest errors against the simulated truth")
        .nth(1)
        .unwrap();
    let item = statement.rsplit("<li class=\"").next().unwrap();
    assert!(item.starts_with("fault"), "{item}");
}

#[test]
fn numbers_that_are_not_finite_never_reach_the_page() {
    let mut full = accepted();
    let joint = full.joint.as_mut().and_then(|j| j.result.as_mut()).unwrap();
    let bad = f64::NAN;
    joint.groups[0].ratio = Some(bad);
    joint.groups[1].chi_square = f64::INFINITY;
    joint.drives[0].positions[2].rms = [bad; 3];
    joint.drives[0].moved[3].shift_m = Vec3::repeat(bad);
    joint.drives[0].residuals[0].records[5].1 = Vec3::repeat(f64::INFINITY);
    joint.late_s[0] = Some((bad, bad));
    full.result.covariance = Some(DMatrix::from_element(12, 12, bad));
    let page = render(&full.content());
    check_well_formed(&page);
    check_self_contained(&page);
}

/// As a run keeps its stages and the content of its page.
#[test]
fn results_come_back_from_bytes_exactly() {
    let mut full = accepted();
    full.result.covariance = Some(DMatrix::from_element(12, 12, f64::NAN));
    let content = full.content();
    let bytes = postcard::to_allocvec(&content).unwrap();
    let back: Content = postcard::from_bytes(&bytes).unwrap();
    assert_eq!(postcard::to_allocvec(&back).unwrap(), bytes);
    // `Debug` prints every field, and numbers exactly.
    assert_eq!(format!("{back:?}"), format!("{content:?}"));
    assert_eq!(render(&back), render(&content));
}

fn document(full: Full) -> Value {
    result::document(&Findings {
        rig: Rig::default(),
        calibrations: full.calibrations(),
        drives: full.drives,
        scenes: Vec::new(),
        background_m: full.background_m,
        made_s: 0.0,
        files: Vec::new(),
        stages: full.stages,
        placement: FirstPlacement::default(),
        warnings: full.warnings,
        verdicts: Vec::new(),
        kept_stages: None,
    })
}

#[test]
fn the_document_contains_the_joint_adjustment() {
    let document = document(accepted());
    let calibration = &document["calibration"];
    assert_eq!(calibration["method"], "joint");
    assert_eq!(document["two_steps"]["calibration"]["method"], "two-step");
    let joint = &calibration["joint"];
    for (key, value) in [
        ("iterations", json!(9)),
        ("converged", json!(true)),
        ("rows", json!(103_000)),
        ("surfels", json!(12_345)),
        ("unknowns", json!(85_432)),
        ("seconds", json!(6.1)),
        ("decided", json!("rigid")),
        ("refused", json!(null)),
        ("contradicted", json!(null)),
        ("held_out", json!(null)),
    ] {
        assert_eq!(joint[key], value, "{key}");
    }
    assert_eq!(joint["chi_square"]["imu"]["ratio"], 1.02);
    assert_eq!(joint["chi_square"]["prism"]["redundancy"], 5_900.0);
    assert_eq!(joint["chi_square"]["assumed"]["ratio"], json!(null));
    assert_eq!(joint["position_blocks"][2]["drive"], "drive-1");
    assert_eq!(joint["position_blocks"][2]["rms"], json!([1.3, 0.9, 0.8]));
    let region = &joint["regions"][0];
    assert_eq!(region["centre_m"], json!([1_003.2, 2_001.4, 0.2]));
    assert_eq!(joint["reference"]["assumed"], true);
    assert_eq!(joint["reference"]["sigma_m"], 2e-3);
    assert_eq!(joint["reference"]["shift_m"], json!([5.1e-3, -0.2e-3, 0.0]));
    assert_eq!(
        joint["scanner_latency_s"],
        json!({"left": {"value": 1.2e-3, "sigma": 0.1e-3}})
    );
    assert_eq!(joint["constants"][0]["name"], "prism.time_offset");
    let moved = &joint["drives"][0]["moved_rms"]["shift_m"][2];
    assert!((moved.as_f64().unwrap() - 4e-3).abs() < 1e-5, "{moved}");

    let right = &calibration["relative"]["right"];
    assert_eq!(right["first"], "left");
    assert_eq!(right["quaternion_xyzw"].as_array().map(Vec::len), Some(4));
    assert!(right["sigma"]["translation_m"][0].as_f64().unwrap() < 5e-5);
    assert!(right["sigma"]["rotation_deg"][2].as_f64().unwrap() < 0.001);
    let names = calibration["parameters"].as_array().unwrap();
    let correlation = calibration["correlation"].as_array().unwrap();
    assert_eq!((names.len(), correlation.len()), (12, 12));
    assert_eq!(correlation[4][4], 1.0);
    assert!(calibration["covariance"][0][6].as_f64().unwrap() > 0.0);
}

#[test]
fn the_document_gives_the_reason_of_a_refusal() {
    let refusal = document(refused());
    assert_eq!(refusal["calibration"]["method"], "two-step");
    let joint = &refusal["calibration"]["joint"];
    assert_eq!(joint["refused"], REASON);
    assert_eq!(joint["reason"], REASON);
    assert!(joint["scanners"]["right"]["body_from_scanner"].is_object());

    let mut not_made = full(50);
    not_made.joint = Some(JointReport {
        result: None,
        refused: vec!["only 12 patches of the surface are known".into()],
        seconds: 0.2,
        ..JointReport::default()
    });
    let page = render(&not_made.content());
    assert!(first_verdict(&page).contains("only 12 patches of the surface"));
    let refusal = document(not_made);
    let joint = &refusal["calibration"]["joint"];
    assert_eq!(joint["decided"], json!(null));
    assert_eq!(joint["refused"], "only 12 patches of the surface are known");
}
