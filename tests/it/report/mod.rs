//! The report page: complete, well formed, self-contained, of bounded size, and deterministic.

mod adjusted;
mod checker;
mod joint;
mod synthetic;
mod trajectory;

use boresight::comparison::{Agreements, DistanceMap};
use boresight::geometry::Vec3;
use boresight::report::content::Content;
use boresight::report::render;
use boresight::sensor::PoseSigma;
use checker::{check_self_contained, check_well_formed};
use synthetic::full;

/// Writes the page to the target folder, so that a person can look at it.
fn keep(name: &str, page: &str) {
    std::fs::write(
        std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name),
        page,
    )
    .expect("the target folder takes a file");
}

#[test]
fn a_full_page_is_complete_and_below_5_megabytes() {
    // Three maps with two panels of 50 000 core points: 300 000 in total, the last panels drawn twice.
    let page = render(&full(50_000).content());
    keep("report-full.html", &page);
    assert!(check_well_formed(&page) > 1000);
    check_self_contained(&page);
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
    for text in [
        "Calibration of drive-1",
        "Scanner left and the reference scan: RMSE 1.3 mm",
        "Scanner left",
        "Scanner right",
        "unobservable",
        "fixed by user",
        "−143.7690",
        "left against right",
        "Figure 5",
        "left<br/>tx",
        "49\u{202f}484",
        "Peak memory: 1.15\u{202f}GiB",
        "12 profiles lie outside",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert_eq!(
        page.matches("<image").count(),
        28 + 1 + 3 + 2,
        "three maps per pair and drive, and the ground; the map of the first screen; levels of detection, over the reference"
    );
}

#[test]
fn equal_contents_give_equal_bytes() {
    assert_eq!(
        render(&full(3_000).content()),
        render(&full(3_000).content())
    );
}

#[test]
fn sections_without_data_are_left_out() {
    let page = render(&Content {
        title: "Nothing yet".into(),
        ..Content::default()
    });
    keep("report-minimal.html", &page);
    check_well_formed(&page);
    check_self_contained(&page);
    assert!(!page.contains("<section") && !page.contains("<svg") && !page.contains("<table"));
    assert!(page.contains("<h1>Nothing yet</h1>"));
}

#[test]
fn one_scanner_without_truth_or_reference_gives_a_page() {
    let mut full = full(100);
    full.mountings.truncate(2);
    full.mountings.iter_mut().for_each(|(_, m)| m.truncate(1));
    full.result.mountings.truncate(1);
    full.result.constancy = None;
    full.variants.clear();
    full.drives
        .iter_mut()
        .for_each(|drive| drive.agreements = Agreements::default());
    let page = render(&full.content());
    check_well_formed(&page);
    check_self_contained(&page);
    for text in [
        "truth",
        "largest error",
        "M3C2",
        "Is the mounting constant?",
    ] {
        assert!(!page.contains(text), "{text}");
    }
    assert!(page.contains("Scanner left") && !page.contains("Scanner right"));
}

#[test]
fn large_coordinates_have_short_tick_labels() {
    let mut full = full(100);
    full.background_m.clear();
    for pose in full.drives.iter_mut().flat_map(|d| &mut d.poses) {
        pose.world_from_body.translation_m += Vec3::new(364_512.0, 5_621_033.0, 0.0);
    }
    let page = render(&full.content());
    check_well_formed(&page);
    assert!(page.contains("east − 364\u{202f}500 m (m)"));
    assert!(page.contains("north − 5\u{202f}621\u{202f}000 m (m)"));
}

#[test]
fn numbers_that_are_not_finite_never_reach_the_page() {
    let bad = f64::NAN;
    let mut full = full(200);
    let result = &mut full.result;
    if let Some(covariance) = &mut result.covariance {
        covariance.row_mut(0).fill(bad);
        covariance.view_mut((3, 3), (3, 3)).fill(bad);
    }
    result.scales[0].costs = vec![bad, 0.0, -1.0, f64::INFINITY];
    result.scales[1].costs.clear();
    result.scales[1].seconds = bad;
    result.scales[2].voxel_m = bad;
    let constancy = result.constancy.as_mut().unwrap();
    constancy.blocks[0][3].expected_sigma_m = bad;
    constancy.blocks[0][4].time_s = f64::INFINITY;
    full.variants[0].1.mountings[0]
        .body_from_scanner
        .translation_m
        .x = f64::INFINITY;
    let [first, second, ..] = &mut full.drives[..] else {
        panic!("three drives");
    };
    let statistics = &mut first.agreements.comparisons[0].statistics;
    statistics.mean_m = bad;
    statistics.std_m = f64::INFINITY;
    statistics.rmse_m = f64::NEG_INFINITY;
    statistics.median_m = bad;
    for agreement in &mut first.agreements.comparisons[6..] {
        agreement.distances = DistanceMap::default();
    }
    for (i, pose) in first.poses.iter_mut().enumerate().step_by(5) {
        pose.world_from_body.translation_m.x = if i % 2 == 0 { bad } else { f64::INFINITY };
        pose.sigma = None;
    }
    for pose in &mut second.poses {
        pose.sigma = Some(PoseSigma {
            position_m: Vec3::repeat(bad),
            rotation_rad: Vec3::repeat(f64::INFINITY),
        });
    }
    full.background_m[0] = Vec3::new(bad, 1.0, bad);
    full.stages[0].seconds = bad;
    let page = render(&full.content());
    check_well_formed(&page);
    check_self_contained(&page);
}

#[test]
fn text_of_the_user_is_escaped() {
    let evil = "<script>alert(\"x\")</script> & 'more' \u{1}";
    let mut full = full(50);
    full.title = evil.into();
    full.command = evil.into();
    full.inputs[0].label = evil.into();
    full.inputs[0].value = evil.into();
    full.stages[0].name = evil.into();
    full.warnings[0] = evil.into();
    let calibrations = full.variants.iter_mut().map(|(_, calibration)| calibration);
    for calibration in calibrations.chain([&mut full.result]) {
        calibration.mountings[0].name = evil.into();
        calibration
            .observability
            .unobservable
            .iter_mut()
            .for_each(|free| free.description = evil.into());
    }
    for drive in &mut full.drives {
        drive.name = evil.into();
        for agreement in &mut drive.agreements.comparisons {
            agreement.scanner = evil.into();
        }
    }
    let page = render(&full.content());
    assert!(!page.contains("<script"));
    assert!(page.contains("&lt;script&gt;alert(&quot;x&quot;)"));
    assert!(!page.contains('\u{1}'));
    check_well_formed(&page);
}
