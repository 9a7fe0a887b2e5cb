//! Drives that are drawn at random, far from the demo.

use std::path::Path;

use crate::common::random_drive::{Ended, with_fault, without_fault};
use crate::common::random_series::Series;
use crate::common::ranks::{LEVEL, probability};
use boresight::simulation::Extent;

/// A share of drives that may have a false alarm.
const ALARMS: f64 = 0.02;

/// Seeds of tiny drives whose runs take seconds: all is determined, and the mountings end where they start along three
/// directions.
const TINY: [u64; 2] = [4, 10];

/// Coordinates of points that lie in their 95 % intervals, at least: those of one drive depend on each other.
const WITHIN_95: f64 = 0.85;

#[test]
fn tiny_drives_are_right_or_say_that_they_are_not() {
    assert_right_or_said(&TINY);
}

#[test]
#[ignore = "just acceptance"]
fn a_tiny_drive_without_boards_is_right_or_says_that_it_is_not() {
    assert_right_or_said(&[1]);
}

/// From the result of two steps the joint adjustment is refused, or there is none; from the initial values it holds.
#[test]
#[ignore = "just acceptance"]
fn tiny_drives_that_two_steps_lead_astray_are_adjusted_from_the_initial_values() {
    assert_right_or_said(&[2, 13, 15]);
}

/// The first drives with a step of positions, gyros with a wrong scale, a late scanner, ranges that are too long, and a clock
/// of positions that runs fast.
#[test]
#[ignore = "just acceptance"]
fn faults_of_tiny_drives_are_named() {
    for seed in [1, 2, 4, 5, 6] {
        let folder = tempfile::tempdir().unwrap();
        let ended = Ended::of_seed(seed, &with_fault(Extent::TINY), folder.path()).unwrap();
        println!("{seed}: {}\n    {}", ended.drawn, ended.line());
        assert_eq!(ended.is_named, Some(true), "{seed}: {}", ended.line());
        assert!(ended.false_alarms.is_empty(), "{seed}: {}", ended.line());
    }
}

fn assert_right_or_said(seeds: &[u64]) {
    for &seed in seeds {
        let folder = tempfile::tempdir().unwrap();
        let ended = Ended::of_seed(seed, &without_fault(Extent::TINY), folder.path()).unwrap();
        println!("{seed}: {}\n    {}", ended.drawn, ended.line());
        assert!(!ended.is_quietly_wrong(), "{seed}: {}", ended.line());
        assert!(ended.false_alarms.is_empty(), "{seed}: {}", ended.line());
        let points = ended.points.as_ref().expect("a joint adjustment");
        assert!(points.within_95 > WITHIN_95, "{seed}: {}", ended.line());
    }
}

#[test]
#[ignore = "hours: simulation-based calibration over 200 drives, which continues where it was interrupted"]
fn random_drives_agree_with_the_stated_distributions() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("out/random");
    let series = Series::run(1..201, &without_fault(Extent::FULL), &folder).unwrap();
    println!("{}", series.summary());
    assert_eq!(series.count(Ended::is_quietly_wrong), 0);
    let alarms = series.count(|ended| !ended.false_alarms.is_empty());
    assert!(
        alarms as f64 <= ALARMS * series.0.len() as f64,
        "{alarms} false alarms"
    );
    for of in series.ranks() {
        assert!(probability(&of.ranks) > LEVEL, "ranks of {}", of.quantity);
    }
}
