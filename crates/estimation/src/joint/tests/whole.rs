//! The whole adjustment: with any kind of scanner, fixed values stay, the same bytes for any number of threads.

use super::case::{Case, SURFEL_M, truth};
use crate::adjustment::StopReason;
use crate::calibration::{Mounting, change};
use crate::geometry::euler::{euler_deg_from_rotation, rotation_from_euler_deg};
use crate::geometry::{EulerConvention, Vec3};
use crate::joint::adjust::at_rung;
use crate::joint::{Joint, JointInput, Rung, adjust, consider_start, fixed, late};
use crate::progress::Silent;

fn adjusted(case: &Case) -> Joint {
    let joint = adjust(&case.input(), &case.settings, SURFEL_M, &Silent).expect("determined");
    // These mountings are rigid.
    assert!(joint.ladder.is_empty(), "{:#?}", joint.ladder);
    joint
}

/// Logs, and a reference without errors of its own.
pub fn on_exact_reference() -> Case {
    let mut case = Case {
        reference: Case::full().reference,
        ..Case::plain()
    };
    let reference = &mut case.settings.reference;
    (reference.shift_m, reference.tilt_rad) = (0.0, 0.0);
    case
}

/// Errors (δp, δφ) of a scanner with their standard deviations.
fn errors(joint: &Joint, truth: &[Mounting], scanner: usize) -> [(f64, f64); 6] {
    let (turn, shift) = joint.mountings[scanner]
        .body_from_scanner
        .perturbation_from(&truth[scanner].body_from_scanner);
    let all = [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z];
    std::array::from_fn(|i| {
        let place = 6 * scanner + i;
        (all[i], joint.covariance[(place, place)].sqrt())
    })
}

#[test]
fn a_profile_scanner_and_a_3d_scanner_are_found_together() {
    // In three seconds of data, a free lever arm would shift the mountings, and a free reference the world.
    let logs = on_exact_reference();
    for (name, case) in [("logs", logs), ("poses from a file", Case::from_file())] {
        let joint = adjusted(&case);
        println!("{name}: {} after {}", joint.stop, joint.iterations);
        assert_eq!(joint.stop, StopReason::Converged, "{name}");
        for scanner in 0..2 {
            for (i, (error, sigma)) in errors(&joint, &truth(), scanner).iter().enumerate() {
                println!("{name}, scanner {scanner}, {i}: {error:e} of {sigma:e}");
                assert!(error.abs() < 4.0 * sigma, "{name}, {scanner}, {i}");
            }
        }
        for (late_s, sigma_s) in joint.late_s.iter().flatten() {
            assert!(
                late_s.abs() < 4.0 * sigma_s,
                "{name}: {late_s} of {sigma_s}"
            );
        }
    }
}

#[test]
fn what_drives_determine_is_not_adjusted_again() {
    let case = on_exact_reference();
    let joint = adjusted(&case);
    let mut considered = joint.clone();
    let mut input = case.input();
    // The adjustment would fail without scans.
    input.drives.clear();
    consider_start(
        &mut input,
        &case.settings,
        SURFEL_M,
        &mut considered,
        &Silent,
    )
    .expect("nothing to do");
    assert_eq!(format!("{joint:?}"), format!("{considered:?}"));
}

#[test]
fn the_shift_of_a_reference_is_estimated() {
    let shift_m = Vec3::new(0.012, -0.008, 0.0);
    let mut case = Case::full();
    case.reference
        .iter_mut()
        .for_each(|point| *point += shift_m);
    case.settings.reference.shift_m = 0.01;
    case.settings.reference.tilt_rad = 0.0;
    let reference = adjusted(&case).reference.expect("a reference");
    for axis in 0..2 {
        let error_m = reference.shift_m[axis] - shift_m[axis];
        let sigma_m = reference.shift_sigma_m[axis];
        println!("axis {axis}: {error_m:e} of {sigma_m:e}");
        assert!(error_m.abs() < 4.0 * sigma_m && sigma_m < 0.005);
    }
    // Its height is held, with the standard deviation of the prior.
    assert!(reference.shift_m.z.abs() < 1e-6);
    assert!((reference.shift_sigma_m.z - 0.01).abs() < 1e-4);
}

#[test]
fn a_fixed_value_that_the_drive_contradicts_is_named() {
    let mut case = on_exact_reference();
    case.mountings[0].fixed[0] = true;
    let check = |case: &Case| {
        let at_lowest = |input: &JointInput<'_>| {
            let (settings, rung) = (&case.settings, Rung::Rigid);
            at_rung(input, settings, SURFEL_M, rung, false, &mut None, &Silent)
        };
        fixed::check(&case.input(), at_lowest)
    };
    check(&case).expect("the true value");
    case.mountings[0].body_from_scanner.translation_m.x += 0.03;
    let text = check(&case).expect_err("a wrong value").to_string();
    let name = &case.mountings[0].name;
    assert!(
        text.contains(&format!("tx of `{name}` is off by +")),
        "{text}"
    );
}

#[test]
fn where_a_late_scanner_contradicts_a_rung_only_its_latency_is_estimated() {
    let mut case = Case {
        reference: Case::full().reference,
        ..Case::plain()
    };
    let explained = |case: &Case| {
        let at_lowest = |input: &JointInput<'_>| {
            let (settings, rung) = (&case.settings, Rung::Rigid);
            at_rung(input, settings, SURFEL_M, rung, true, &mut None, &Silent)
        };
        late::explained(&case.input(), at_lowest).unwrap()
    };
    assert!(explained(&case).is_none());
    let latency_s = 8e-3;
    let profiles = &mut case.samples[0].profiles;
    profiles
        .iter_mut()
        .for_each(|profile| profile.time_s += latency_s);
    let joint = explained(&case).expect("the right latency");
    let (late_s, sigma_s) = joint.late_s[0].expect("estimated");
    println!("{late_s:e} ± {sigma_s:e}");
    assert!((late_s - latency_s).abs() < 4.0 * sigma_s && late_s.abs() > 5.0 * sigma_s);
    assert_eq!(joint.late_s[1], None);
    let joint = adjusted(&case);
    assert_eq!((joint.rung, joint.late_s[0].is_some()), (Rung::Rigid, true));
    case.estimate_latency = vec![true, true];
    assert!(explained(&case).is_none());
}

#[test]
fn the_score_of_a_latency_is_the_same_as_its_estimate() {
    // Poses from a file would follow a latency, and their errors would be learned with it. The standard deviation of a
    // score says nothing about mountings that might move.
    let mut case = Case {
        reference: Case::full().reference,
        ..Case::plain()
    };
    case.settings.mounting.most = Rung::Rigid;
    // Stamps that are 0.2 ms late: a tenth of a millimetre, so that few rows gain or lose trust.
    let profiles = &mut case.samples[0].profiles;
    profiles
        .iter_mut()
        .for_each(|profile| profile.time_s += 2e-4);
    let score = adjusted(&case).late_scores[0].expect("held");
    case.estimate_latency[0] = true;
    let joint = adjusted(&case);
    assert!(joint.late_scores[0].is_none());
    let (late_s, sigma_s) = joint.late_s[0].expect("estimated");
    println!("{score:?}, estimated {late_s:e} ± {sigma_s:e}");
    assert!((score.sigma / sigma_s - 1.0).abs() < 0.05);
    // The trust in rows differs a little between the two.
    assert!((score.value - late_s).abs() < 0.5 * sigma_s);
    assert!((late_s - 2e-4).abs() < 4.0 * sigma_s);
}

#[test]
fn the_score_of_a_range_is_the_error_of_the_zero_point() {
    let mut case = Case {
        reference: Case::full().reference,
        ..Case::plain()
    };
    let before = adjusted(&case);
    let long_m = 1.5e-3;
    for point in &mut case.samples[1].points {
        point.position_m += point.position_m.normalize() * long_m;
    }
    let after = adjusted(&case);
    let [clean, long] = [&before, &after].map(|joint| joint.range_scores[1].expect("held"));
    println!("{clean:?}, then {long:?}");
    let others = [&before, &after].map(|joint| joint.range_scores[0].expect("held").added);
    assert!(clean.added.sigmas() < 4.0 && others.iter().all(|other| other.sigmas() < 4.0));
    // The noise is the same, but rows that fit worse are trusted less.
    let change_m = long.added.value - clean.added.value;
    assert!((change_m + long_m).abs() < 0.2 * long_m && long.added.sigmas() > 5.0);
    // To add that would bring the mountings back.
    let moved = change(&before.mountings, &after.mountings);
    let sigmas = after.covariance.diagonal().map(f64::sqrt);
    let moved_sigmas = moved.component_div(&sigmas).amax();
    println!("moved by {moved_sigmas} sigma");
    assert!((long.moved_sigmas / moved_sigmas - 1.0).abs() < 0.3);
}

#[test]
fn a_fixed_scanner_keeps_its_mounting_to_the_last_bit() {
    let mut case = Case::full();
    case.mountings[1] = Mounting {
        fixed: [true; 6],
        ..truth()[1].clone()
    };
    let held = case.mountings[1].body_from_scanner;
    let joint = adjusted(&case);
    assert_eq!(joint.mountings[1].body_from_scanner, held);
    assert_eq!(joint.mountings[1], case.mountings[1]);
    for (error, sigma) in errors(&joint, &truth(), 0) {
        assert!(error.abs() < 4.0 * sigma, "{error} of {sigma}");
    }
    for (error, sigma) in errors(&joint, &truth(), 1) {
        assert!(error == 0.0 && sigma < 1e-7, "{error} of {sigma}");
    }
}

#[test]
fn a_fixed_angle_stays_while_the_others_are_estimated() {
    for convention in [EulerConvention::Zyx, EulerConvention::Bonn] {
        for angle in 0..3 {
            let mut case = Case::full();
            // The start has the true angle, and is off by 0.5° in the two others.
            let rotation = truth()[0].body_from_scanner.rotation;
            let mut angles_deg = euler_deg_from_rotation(convention, &rotation);
            let held_deg = angles_deg[angle];
            angles_deg[(angle + 1) % 3] += 0.5;
            angles_deg[(angle + 2) % 3] -= 0.5;
            let start = &mut case.mountings[0];
            start.convention = convention;
            start.fixed[3 + angle] = true;
            start.body_from_scanner.rotation = rotation_from_euler_deg(convention, angles_deg);
            let joint = adjusted(&case);
            let rotation = joint.mountings[0].body_from_scanner.rotation;
            let after_deg = euler_deg_from_rotation(convention, &rotation);
            // Rounding of the conversions, once in each iteration.
            let moved_deg = (after_deg[angle] - held_deg).abs();
            assert!(moved_deg < 1e-11, "{convention:?} {angle}: {moved_deg}");
            for (i, (error, sigma)) in errors(&joint, &truth(), 0).iter().enumerate() {
                // In addition to the standard deviation, the sigma that holds the angle.
                assert!(
                    error.abs() < 4.0 * sigma + 1e-7,
                    "{convention:?} {angle}, {i}: {error} of {sigma}"
                );
            }
            println!(
                "{convention:?} {angle}: {} after {}",
                joint.stop, joint.iterations
            );
            assert_eq!(joint.stop, StopReason::Converged, "{convention:?} {angle}");
        }
    }
}

#[test]
fn one_thread_and_two_give_the_same_bytes() {
    let case = Case::full();
    let [one, two] = [1, 2].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let joint = pool.expect("threads").install(|| adjusted(&case));
        // Shortest decimals that read back as the same number: equal text is equal bits.
        format!("{joint:?}")
    });
    assert!(one == two, "the results differ");
}
