//! The page: complete, well formed, self-contained, of bounded size, and deterministic.

mod adjusted;
mod checker;
mod synthetic;
mod trajectory;

use boresight::geometry::{Mat3, Vec3};
use boresight::report::content::*;
use boresight::report::render;
use boresight::sensor::PoseSigma;
use checker::{check_self_contained, check_well_formed};
use synthetic::full;

/// Leaves the page where a person can look at it.
fn keep(name: &str, page: &str) {
    std::fs::write(
        std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name),
        page,
    )
    .expect("the target folder takes a file");
}

#[test]
fn a_full_page_is_whole_and_small() {
    // Three maps of two panels of 50 000 core points: 300 000 in all, the last panels drawn twice.
    let content = full(50_000);
    let page = render(&content);
    keep("report-full.html", &page);
    assert!(check_well_formed(&page) > 1000);
    check_self_contained(&page);
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
    for text in [
        "Calibration of drive-1",
        "points agree with the reference scan to 1.3 mm",
        "Scanner left",
        "Scanner right",
        "not observable",
        "fixed by user",
        "−143.7690",
        "left against right",
        "Figure 5",
        "left<br/>tx",
        "74\u{202f}312",
        "Peak memory: 1.15\u{202f}GiB",
        "12 profiles lie outside",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert_eq!(
        page.matches("<image").count(),
        10,
        "three maps a pair and the ground"
    );
}

#[test]
fn equal_contents_give_equal_bytes() {
    assert_eq!(render(&full(3_000)), render(&full(3_000)));
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
fn one_scanner_without_truth_or_reference_makes_a_page() {
    let mut content = full(100);
    content.mountings.truncate(1);
    content.mountings[0].truth = None;
    content.distances.clear();
    content.maps.clear();
    content.residuals = None;
    for run in &mut content.methods {
        for scale in &mut run.scales {
            scale.max_translation_error_m = None;
            scale.max_rotation_error_rad = None;
        }
    }
    let page = render(&content);
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
fn large_coordinates_keep_short_ticks() {
    let mut content = full(100);
    let figure = content.trajectory.as_mut().unwrap();
    figure.background_m.clear();
    figure.outlines.clear();
    for pose in figure.drives.iter_mut().flat_map(|d| &mut d.poses) {
        pose.world_from_body.translation_m += Vec3::new(364_512.0, 5_621_033.0, 0.0);
    }
    let page = render(&content);
    check_well_formed(&page);
    assert!(page.contains("east − 364\u{202f}500 m (m)"));
    assert!(page.contains("north − 5\u{202f}621\u{202f}000 m (m)"));
}

#[test]
fn what_is_not_finite_never_reaches_the_page() {
    let bad = f64::NAN;
    let mut content = full(200);
    for table in &mut content.mountings {
        table.estimates[2].translation_sigma_m[0] = Some(bad);
        table.estimates[2].rotation_covariance_rad2 = Some(Mat3::repeat(bad));
        table.estimates[1].body_from_scanner.translation_m.x = f64::INFINITY;
    }
    content.distances[0].statistics = DistanceStatistics {
        mean_m: bad,
        std_m: f64::INFINITY,
        rmse_m: f64::NEG_INFINITY,
        median_m: bad,
        n: 0,
    };
    let figure = content.trajectory.as_mut().unwrap();
    for (i, pose) in figure.drives[0].poses.iter_mut().enumerate().step_by(5) {
        pose.world_from_body.translation_m.x = if i % 2 == 0 { bad } else { f64::INFINITY };
        pose.sigma = None;
    }
    for pose in &mut figure.drives[1].poses {
        pose.sigma = Some(PoseSigma {
            position_m: Vec3::repeat(bad),
            rotation_rad: Vec3::repeat(f64::INFINITY),
        });
    }
    figure.background_m[0] = [bad, 1.0, bad];
    figure.outlines[0].corners_m[0] = [bad, bad];
    for point in &mut content.maps[0].panels[0].points {
        point.distance_m = bad;
    }
    content.maps[1].panels[1].points[5].position_m = [bad, f64::INFINITY];
    content.maps[2]
        .panels
        .iter_mut()
        .for_each(|p| p.points.clear());
    content.maps[1].colour_limit_m = Some(bad);
    content.methods[0].scales[0].cost = vec![bad, 0.0, -1.0, f64::INFINITY];
    content.methods[0].scales[1].cost.clear();
    content.methods[0].scales[1].seconds = bad;
    content.methods[0].scales[2].voxel_m = bad;
    content.stages[0].seconds = bad;
    let series = &mut content.residuals.as_mut().unwrap().series[0];
    series.blocks[3].expected_sigma_m = bad;
    series.blocks[4].time_s = f64::INFINITY;
    let page = render(&content);
    check_well_formed(&page);
    check_self_contained(&page);
}

#[test]
fn text_from_outside_stays_text() {
    let evil = "<script>alert(\"x\")</script> & 'more' \u{1}";
    let mut content = full(50);
    content.title = evil.into();
    content.version = evil.into();
    content.date = evil.into();
    content.command = evil.into();
    content.project = evil.into();
    content.summary[0].text = evil.into();
    content.inputs[0].label = evil.into();
    content.inputs[0].value = evil.into();
    content.mountings[0].scanner = evil.into();
    content.mountings[0].estimates[0].label = evil.into();
    content.distances[0].pair = evil.into();
    content.distances[0].drive = evil.into();
    content.maps[0].pair = evil.into();
    content.maps[0].drive = evil.into();
    content.methods[0].method = evil.into();
    content.methods[0].ending = evil.into();
    content.correlation.as_mut().unwrap().labels[0] = evil.into();
    content.observability[0].text = evil.into();
    let residuals = content.residuals.as_mut().unwrap();
    residuals.verdict.text = evil.into();
    residuals.series[0].label = evil.into();
    content.stages[0].name = evil.into();
    content.warnings[0] = evil.into();
    let figure = content.trajectory.as_mut().unwrap();
    figure.drives[0].name = evil.into();
    figure.outlines[0].label = evil.into();
    let page = render(&content);
    assert!(!page.contains("<script"));
    assert!(page.contains("&lt;script&gt;alert(&quot;x&quot;)"));
    assert!(!page.contains('\u{1}'));
    check_well_formed(&page);
}
