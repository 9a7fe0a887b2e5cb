//! The drift watch on simulated days in a field; on one day the right scanner is knocked.

use crate::common::field_days::{FieldDay, Knock, date, scenario};
use boresight::drift::{Chart, ChartSettings, Overlap};
use boresight::error::Error;
use boresight::pipeline::Rig;

const DAYS: u64 = 5;
const KNOCKED: u64 = 4;

#[test]
fn a_day_in_the_field_gives_the_relative_mounting_within_its_sigmas() {
    let folder = tempfile::tempdir().unwrap();
    let day = FieldDay::new(scenario(40, 1, 1), None, folder.path()).unwrap();
    let overlap = day.overlap().unwrap();
    let right = &overlap.scanners[0];
    for (i, sigma) in right.sigma().iter().enumerate() {
        let (error, sigma) = (right.offset[i] - day.truth[i], sigma.unwrap());
        assert!(error.abs() < 4.0 * sigma, "{i}: {error} ± {sigma}");
    }
}

#[test]
#[ignore = "just acceptance"]
fn a_knock_is_detected_on_its_day_and_measured_within_its_sigmas() {
    let knock = Knock {
        shift_m: [0.0, 0.0, 0.002],
        turn_deg: [0.1, 0.0, 0.0],
    };
    let mut days = Vec::<(String, Overlap)>::new();
    let (mut truths, mut squares, mut count) = (Vec::new(), 0.0, 0.0);
    for day in 1..=DAYS {
        let folder = tempfile::tempdir().unwrap();
        let knock = (day >= KNOCKED).then_some(&knock);
        let field = FieldDay::new(scenario(40, day, 1), knock, folder.path()).unwrap();
        let overlap = field.overlap().unwrap();
        let right = &overlap.scanners[0];
        for (i, sigma) in right.sigma().iter().enumerate() {
            let sigma = sigma.unwrap();
            squares += ((right.offset[i] - field.truth[i]) / sigma).powi(2);
            count += 1.0;
        }
        truths.push(field.truth);
        // As JSON, which is how it passes from one process to another.
        let text = serde_json::to_string(&overlap).unwrap();
        days.push((date(day), serde_json::from_str(&text).unwrap()));
    }
    // Thirty ratios with a few tens of degrees of freedom each: 0.7 to 1.4 by chance.
    let ratio = f64::sqrt(squares / count);
    assert!((0.5..1.5).contains(&ratio), "{ratio}");

    let chart = Chart::new(&days, &[], &ChartSettings::default()).unwrap();
    let right = &chart.scanners[0];
    let alarms: Vec<&str> = right
        .alarms
        .iter()
        .map(|alarm| alarm.date.as_str())
        .collect();
    assert_eq!(alarms, ["2025-05-04"]);
    assert_eq!(right.alarms[0].last_within.as_deref(), Some("2025-05-03"));
    let off = right.off.as_ref().unwrap();
    assert_eq!(off.since, "2025-05-04");
    let (before, after) = (truths[0], truths[KNOCKED as usize]);
    for (i, (before, after)) in before.iter().zip(&after).enumerate() {
        let (offset, sigma) = (off.offset[i].unwrap(), off.sigma[i].unwrap());
        let truth = after - before;
        assert!(
            (offset - truth).abs() < 4.0 * sigma,
            "{i}: {offset} ± {sigma}, true {truth}"
        );
    }
    // The effect of the knock on points about 1.3 m below: 2 mm, and 0.1° times their lateral distance.
    let cost = &right.alarms[0].cost;
    assert!((1.5e-3..4.5e-3).contains(&cost.total_m), "{cost:?}");
    assert!(
        cost.normal_m < cost.total_m && cost.normal_sigma_m < 1e-4,
        "{cost:?}"
    );
}

#[test]
fn a_single_scanner_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut day = scenario(40, 1, 1);
    day.scanners.truncate(1);
    // Not with `FieldDay`, which needs the right scanner.
    let files = boresight::simulation::simulate(&day, folder.path(), &boresight::progress::Silent);
    let project = boresight::project::Project::read(&files.unwrap().drives[0].project).unwrap();
    let rig = Rig::new(&project);
    match boresight::pipeline::overlap(&project, &rig, &boresight::progress::Silent) {
        Err(Error::Data { problem, .. }) => assert!(problem.contains("compares two"), "{problem}"),
        other => panic!("{other:?}"),
    }
}
