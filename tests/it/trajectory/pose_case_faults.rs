//! Single faults on the simulated drive of five minutes: poses that a fault does not affect stay as
//! accurate, and the faults put in are named.

use super::faulty::{Faulty, Outcome, judge};
use super::pose_case::{self, IMU_HZ, pose_case};
use super::{Logs, Truth};
use boresight::trajectory::Estimate;
use std::sync::LazyLock;

const JUMP_AT_S: f64 = 200.0;
const JUMP_S: f64 = 0.5;

/// The drive, its truth, and its estimate without a fault.
struct Case {
    clean: Logs,
    truth: Vec<Truth>,
    best: Estimate,
}

/// Estimated only once.
static CASE: LazyLock<Case> = LazyLock::new(Case::read);

/// The case with the clock set ahead: two tests look at it.
static SET_AHEAD: LazyLock<(Estimate, Outcome)> =
    LazyLock::new(|| CASE.assert_survives("prism clock", clock_set_ahead));

impl Case {
    fn read() -> Self {
        let clean = pose_case();
        Self {
            best: clean.estimate(),
            truth: pose_case::truth(),
            clean,
        }
    }

    fn truth(&self, time_s: f64) -> Truth {
        self.truth[((time_s * IMU_HZ).round() as usize).min(self.truth.len() - 1)]
    }

    /// The fault is named, and poses that it does not affect are as accurate as without it.
    fn assert_survives(&self, name: &str, fault: fn(&mut Faulty)) -> (Estimate, Outcome) {
        let mut faulty = Faulty::new(&self.clean, 7);
        fault(&mut faulty);
        let before_mm = judge(&faulty, &self.best, &|t| self.truth(t)).rmse_mm;
        let estimate = faulty.logs(&self.clean).estimate();
        let o = judge(&faulty, &estimate, &|t| self.truth(t));
        println!(
            "{name}: {before_mm:.3} mm without, {:.3} mm with; worst {:.2} sigma where affected; \
             {} injected, {} missed; {} good of {} rejected; stamps {:?}",
            o.rmse_mm,
            o.worst[0],
            o.injected,
            o.missed.len(),
            o.wrongly,
            o.good,
            o.stamps
        );
        assert!(estimate.solution.converged, "{name}: {}", estimate.solution);
        assert!(o.rmse_mm <= 1.2 * before_mm, "{name}: {o:?}");
        assert!(o.missed.is_empty(), "{name}: {o:?}");
        // If the first stamp of a stream is early, nothing shows it.
        assert!(o.stamps[0].abs_diff(o.stamps[1]) <= 1, "{name}: {o:?}");
        (estimate, o)
    }
}

/// The outlier test rejects one good record in 10,000, and some next to a fault.
fn assert_few_good_records_rejected(o: &Outcome) {
    assert!(o.wrongly * 200 <= o.good, "{o:?}");
}

/// From 200 s on, the stamps of the prism are half a second ahead.
fn clock_set_ahead(f: &mut Faulty) {
    f.prism_jump(JUMP_AT_S / f.span_s, JUMP_S);
}

#[test]
fn each_fault_of_the_five_minutes_is_survived_and_named() {
    let case = &*CASE;
    // One in ten of 2100 fixes and 1500 headings is wrong.
    let (_, o) = case.assert_survives("prism outliers", |f| f.prism_outliers_up_to(1.0));
    assert!(o.injected > 100, "{o:?}");
    assert_few_good_records_rejected(&o);
    let (_, o) = case.assert_survives("heading flips", Faulty::heading_flips);
    assert!(o.injected > 100, "{o:?}");
    assert_few_good_records_rejected(&o);
    let (_, o) = case.assert_survives("stamps", Faulty::stamps);
    assert!(o.stamps[1] > 100, "{o:?}");
    assert_few_good_records_rejected(&o);

    // An outage has few independent errors of three components: χ²₃ exceeds 4.0² once in 850.
    let (_, o) = case.assert_survives("outage", |f| f.lock_lost_between(120.0, 150.0));
    assert!(o.worst[0] < 4.0, "{o:?}");
    assert_few_good_records_rejected(&o);

    let (estimate, o) = case.assert_survives("IMU gap", |f| f.imu_gap(80.0, 80.5));
    assert!(o.worst[0] < 4.0, "{o:?}");
    assert_few_good_records_rejected(&o);
    let gaps = &estimate.solution.imu_gaps_s;
    assert!(
        matches!(gaps[..], [(from, to)] if (from - 80.0).abs() < 0.02 && (to - 80.5).abs() < 0.02),
        "{gaps:?}"
    );
}

#[test]
fn a_prism_clock_set_ahead_is_reported_with_its_time_and_size() {
    assert!(CASE.best.solution.clock_jumps.is_empty());
    let (estimate, _) = &*SET_AHEAD;
    let jumps = &estimate.solution.clock_jumps;
    println!("{jumps:?}");
    let [jump] = &jumps[..] else {
        panic!("{jumps:?}");
    };
    assert_eq!(jump.sensor, "prism");
    assert!((jump.size_s - JUMP_S).abs() < 0.01, "{jump:?}");
    // Close to the jump, fixes fit both clocks about equally well: the prism moves 2 cm in an interval
    // of 1/7 s and the noise is 5 mm.
    assert!((jump.time_s - JUMP_AT_S - JUMP_S).abs() < 1.0, "{jump:?}");
}

#[test]
fn few_fixes_are_rejected_once_the_clock_is_corrected() {
    assert_few_good_records_rejected(&SET_AHEAD.1);
}
