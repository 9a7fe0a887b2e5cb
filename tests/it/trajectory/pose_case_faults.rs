//! Faults on the simulated drive of five minutes at the sensors of the paper, each alone: the time
//! that a fault does not touch stays as good, and what was put in is named.

use super::faulty::{Faulty, Outcome, judge};
use super::pose_case::{self, IMU_HZ, pose_case};
use super::{Logs, Truth};
use boresight::trajectory::Estimate;

const JUMP_AT_S: f64 = 200.0;
const JUMP_S: f64 = 0.5;

/// The drive, its truth, and how good the poses are without a fault.
struct Case {
    clean: Logs,
    truth: Vec<Truth>,
    best: Estimate,
}

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

    /// What comes of the fault: as good as without it wherever it does not touch, and named.
    fn holds(&self, name: &str, fault: fn(&mut Faulty)) -> (Estimate, Outcome) {
        let mut faulty = Faulty::new(&self.clean, 7);
        fault(&mut faulty);
        let before_mm = judge(&faulty, &self.best, &|t| self.truth(t)).rmse_mm;
        let found = faulty.logs(&self.clean).estimate();
        let o = judge(&faulty, &found, &|t| self.truth(t));
        println!(
            "{name}: {before_mm:.3} mm without, {:.3} mm with; worst {:.2} sigma where touched; \
             {} injected, {} missed; {} good of {} rejected; stamps {:?}",
            o.rmse_mm,
            o.worst[0],
            o.injected,
            o.missed.len(),
            o.wrongly,
            o.good,
            o.stamps
        );
        assert!(found.solution.converged, "{name}: {}", found.solution);
        assert!(o.rmse_mm <= 1.2 * before_mm, "{name}: {o:?}");
        assert!(o.missed.is_empty(), "{name}: {o:?}");
        // The first stamp of a stream may be early unseen.
        assert!(o.stamps[0].abs_diff(o.stamps[1]) <= 1, "{name}: {o:?}");
        (found, o)
    }
}

/// The test rejects one good record in 10,000, and some around a fault.
fn few_good_records_are_rejected(o: &Outcome) {
    assert!(o.wrongly * 200 <= o.good, "{o:?}");
}

/// From 200 s on the stamps of the prism are half a second ahead.
fn clock_set_ahead(f: &mut Faulty) {
    f.prism_jump(JUMP_AT_S / f.span_s, JUMP_S);
}

#[test]
fn each_fault_of_the_five_minutes_is_survived_and_named() {
    let case = Case::read();
    // 2100 fixes and 1500 headings, one in ten spoilt: far from none.
    let (_, o) = case.holds("prism outliers", |f| f.prism_outliers_up_to(1.0));
    assert!(o.injected > 100, "{o:?}");
    few_good_records_are_rejected(&o);
    let (_, o) = case.holds("heading flips", Faulty::heading_flips);
    assert!(o.injected > 100, "{o:?}");
    few_good_records_are_rejected(&o);
    let (_, o) = case.holds("stamps", Faulty::stamps);
    assert!(o.stamps[1] > 100, "{o:?}");
    few_good_records_are_rejected(&o);

    // Few independent draws of three components in an outage: χ²₃ passes 4.0² once in 850.
    let (_, o) = case.holds("outage", |f| f.lock_lost_between(120.0, 150.0));
    assert!(o.worst[0] < 4.0, "{o:?}");
    few_good_records_are_rejected(&o);

    let (found, o) = case.holds("IMU gap", |f| f.imu_gap(80.0, 80.5));
    assert!(o.worst[0] < 4.0, "{o:?}");
    few_good_records_are_rejected(&o);
    let gaps = &found.solution.imu_gaps_s;
    assert!(
        matches!(gaps[..], [(from, to)] if (from - 80.0).abs() < 0.02 && (to - 80.5).abs() < 0.02),
        "{gaps:?}"
    );
}

#[test]
fn a_prism_clock_set_ahead_is_found_with_place_and_size() {
    let case = Case::read();
    assert!(case.best.solution.clock_jumps.is_empty());
    let (found, _) = case.holds("prism clock", clock_set_ahead);
    let jumps = &found.solution.clock_jumps;
    println!("{jumps:?}");
    let [jump] = &jumps[..] else {
        panic!("{jumps:?}");
    };
    assert_eq!(jump.sensor, "prism");
    assert!((jump.size_s - JUMP_S).abs() < 0.01, "{jump:?}");
    // Around the jump a fix on either side fits both clocks about as well: it moves 2 cm in one
    // interval of 1/7 s and the noise is 5 mm.
    assert!((jump.time_s - JUMP_AT_S - JUMP_S).abs() < 1.0, "{jump:?}");
}

#[test]
fn fixes_come_back_when_the_clock_is_right() {
    let case = Case::read();
    let (_, o) = case.holds("prism clock", clock_set_ahead);
    few_good_records_are_rejected(&o);
}
