//! Closed forms, and a slow reference with homogeneous matrices.

use nalgebra::{Matrix4, Vector4};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::geometry::so3::exp;
use crate::geometry::{Rotation, Vec3, WorldFromBody};

const BY_SECOND: Comparison = Comparison {
    alignment: Alignment::None,
    over: Over::Time(1.0),
    max_gap_s: None,
    time_offset_s: 0.0,
};

fn aligned(alignment: Alignment) -> Comparison {
    Comparison {
        alignment,
        ..BY_SECOND
    }
}

/// A winding drive of 20 s at 10 Hz, far from the origin.
fn drive() -> Vec<PoseRecord> {
    let pose = |i: u32| {
        let t = 0.1 * f64::from(i);
        let position = Vec3::new(2.0 * t, 5.0 * (0.3 * t).sin(), 0.5 * (0.7 * t).cos());
        let rotation = exp(&Vec3::new(0.1 * t.sin(), 0.05 * t.cos(), 0.2 * t));
        let origin = Vec3::new(362_000.0, 5_157_000.0, 100.0);
        PoseRecord::new(100.0 + t, WorldFromBody::new(rotation, origin + position))
    };
    (0..=200).map(pose).collect()
}

fn changed(
    poses: &[PoseRecord],
    change: impl Fn(usize, WorldFromBody) -> WorldFromBody,
) -> Vec<PoseRecord> {
    let each = poses.iter().enumerate();
    each.map(|(i, pose)| PoseRecord::new(pose.time_s, change(i, pose.world_from_body)))
        .collect()
}

#[test]
fn an_alignment_removes_what_it_can_and_nothing_else() {
    let reference = drive();
    let turned = |rotation: Rotation| {
        let motion: Transform<World, World> = Transform::new(rotation, Vec3::new(3.0, -4.0, 12.0));
        changed(&reference, |_, pose| motion * pose)
    };
    let yawed = turned(exp(&Vec3::new(0.0, 0.0, 0.4)));
    let tilted = turned(exp(&Vec3::new(0.3, -0.2, 0.4)));
    let errors = |estimate: &[PoseRecord], alignment| {
        let found = compare(estimate, &reference, &aligned(alignment)).unwrap();
        (found.translation_m.max, found.rotation_rad.max)
    };
    for (estimate, alignment) in [
        (&yawed, Alignment::Yaw),
        (&yawed, Alignment::Se3),
        (&yawed, Alignment::Origin),
        (&tilted, Alignment::Se3),
        (&tilted, Alignment::Origin),
    ] {
        let (metres, radians) = errors(estimate, alignment);
        assert!(
            metres < 1e-7 && radians < 1e-9,
            "{alignment:?}: {metres} {radians}"
        );
    }
    // A tilt remains, by its angle.
    let (_, radians) = errors(&tilted, Alignment::Yaw);
    assert!(radians > 0.3, "{radians}");
    // A pure shift of 13 m.
    let shifted = changed(&reference, |_, pose| {
        WorldFromBody::new(
            pose.rotation,
            pose.translation_m + Vec3::new(3.0, -4.0, 12.0),
        )
    });
    let found = compare(&shifted, &reference, &BY_SECOND).unwrap();
    assert!((found.translation_m.rmse - 13.0).abs() < 1e-9);
    assert!((found.translation_m.std, found.rotation_rad.max) <= (1e-4, 1e-9));
    assert!(found.relative.unwrap().translation_m.max < 1e-8);
}

#[test]
fn known_errors_have_known_statistics() {
    let reference = drive();
    // 6 mm up and 2 mm down in turn: of 201 poses, 101 and 100.
    let estimate = changed(&reference, |i, pose| {
        let up_m = if i % 2 == 0 { 0.006 } else { -0.002 };
        let rotation = pose.rotation * exp(&Vec3::new(0.0, 0.01, 0.0));
        WorldFromBody::new(rotation, pose.translation_m + Vec3::new(0.0, 0.0, up_m))
    });
    let found = compare(&estimate, &reference, &BY_SECOND).unwrap();
    let expected_mean = (101.0 * 0.006 + 100.0 * 0.002) / 201.0;
    let expected_rmse = ((101.0 * 36e-6 + 100.0 * 4e-6) / 201.0f64).sqrt();
    let t = found.translation_m;
    assert!(
        (t.mean - expected_mean).abs() < 1e-8 && (t.rmse - expected_rmse).abs() < 1e-8,
        "{t:?}"
    );
    assert!((t.median - 0.006).abs() < 1e-8 && (t.max - 0.006).abs() < 1e-8);
    assert!((t.min - 0.002).abs() < 1e-8, "{t:?}");
    assert!((found.rotation_rad.mean - 0.01).abs() < 1e-12);
    assert_eq!(found.poses.len(), 201);
}

#[test]
fn drift_shows_in_relative_errors_by_time_and_by_distance() {
    // Straight east at 2 m/s; the estimate is 1 % too long and its heading drifts by 0.5 mrad/s.
    let pose = |i: u32, scale: f64, rate: f64| {
        let t = 0.1 * f64::from(i);
        let rotation = exp(&Vec3::new(0.0, 0.0, rate * t));
        PoseRecord::new(
            t,
            WorldFromBody::new(rotation, Vec3::new(2.0 * t * scale, 0.0, 0.0)),
        )
    };
    let reference: Vec<PoseRecord> = (0..400).map(|i| pose(i, 1.0, 0.0)).collect();
    let long: Vec<PoseRecord> = (0..400).map(|i| pose(i, 1.01, 0.0)).collect();
    let turning: Vec<PoseRecord> = (0..400).map(|i| pose(i, 1.0, 5e-4)).collect();
    for (over, apart, metres) in [
        (Over::Time(1.0), 1.0, 0.02),
        (Over::Time(5.0), 5.0, 0.1),
        (Over::Distance(10.0), 10.0, 0.1),
    ] {
        let comparison = Comparison { over, ..BY_SECOND };
        let found = compare(&long, &reference, &comparison)
            .unwrap()
            .relative
            .unwrap();
        assert!((found.apart - apart).abs() < 1e-6, "{found:?}");
        assert!(
            (found.translation_m.mean - metres).abs() < 1e-6,
            "{found:?}"
        );
        assert!(found.translation_m.std < 1e-5 && found.rotation_rad.max < 1e-9);
    }
    let found = compare(&turning, &reference, &BY_SECOND)
        .unwrap()
        .relative
        .unwrap();
    assert!((found.rotation_rad.max - 5e-4).abs() < 1e-9, "{found:?}");
    // 40 s are never 100 s apart.
    let comparison = Comparison {
        over: Over::Time(100.0),
        ..BY_SECOND
    };
    assert!(
        compare(&long, &reference, &comparison)
            .unwrap()
            .relative
            .is_none()
    );
    // On a straight line, a rotation in space is open; about the vertical it is not.
    let error = compare(&long, &reference, &aligned(Alignment::Se3)).unwrap_err();
    assert!(error.to_string().contains("on a line"), "{error}");
    assert!(compare(&long, &reference, &aligned(Alignment::Yaw)).is_ok());
}

/// A pose as a homogeneous matrix.
fn matrix(pose: &WorldFromBody) -> Matrix4<f64> {
    let mut matrix = pose.rotation.to_homogeneous();
    for (i, x) in pose.translation_m.iter().enumerate() {
        matrix[(i, 3)] = *x;
    }
    matrix
}

#[test]
fn noisy_trajectories_agree_with_the_slow_reference() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let reference = drive();
    let mut noise = |size: f64| Vec3::from_fn(|_, _| rng.random_range(-size..size));
    let noises: Vec<[Vec3; 2]> = reference
        .iter()
        .map(|_| [noise(0.05), noise(0.02)])
        .collect();
    let estimate = changed(&reference, |i, pose| {
        let [shift, turn] = noises[i];
        let motion: Transform<World, World> =
            Transform::new(exp(&Vec3::new(0.2, 0.1, -0.7)), Vec3::new(5.0, 6.0, 7.0));
        motion * WorldFromBody::new(pose.rotation * exp(&turn), pose.translation_m + shift)
    });
    let found = compare(&estimate, &reference, &aligned(Alignment::Se3)).unwrap();
    let cost = |motion: &Matrix4<f64>| -> f64 {
        let pairs = estimate.iter().zip(&reference);
        let squares = pairs.map(|(estimate, reference)| {
            let q = estimate.world_from_body.translation_m;
            let p = reference.world_from_body.translation_m;
            let mapped = motion * Vector4::new(q.x, q.y, q.z, 1.0);
            (mapped.xyz() - p).norm_squared()
        });
        squares.sum()
    };
    let best = matrix(&WorldFromBody::new(
        found.alignment.rotation,
        found.alignment.translation_m,
    ));
    let n = estimate.len() as f64;
    assert!((found.translation_m.rmse - (cost(&best) / n).sqrt()).abs() < 1e-9);
    // No small motion about the middle of the drive is better.
    let middle = found
        .poses
        .iter()
        .map(|pose| pose.reference_m)
        .sum::<Vec3>()
        / n;
    for axis in 0..6 {
        for sign in [-1.0, 1.0] {
            let step = |first: usize, size: f64| {
                Vec3::from_fn(|i, _| if first + i == axis { sign * size } else { 0.0 })
            };
            let turn = exp(&step(0, 1e-4));
            let shift = step(3, 1e-3);
            let moved = WorldFromBody::new(turn, middle - turn * middle + shift);
            assert!(
                cost(&(matrix(&moved) * best)) > cost(&best),
                "{axis} {sign}"
            );
        }
    }
    // Relative errors with matrices, for all pairs 10 poses apart.
    let squares: Vec<[f64; 2]> = (0..estimate.len() - 10)
        .map(|i| {
            let step = |poses: &[PoseRecord]| {
                let from = matrix(&poses[i].world_from_body);
                from.try_inverse().unwrap() * matrix(&poses[i + 10].world_from_body)
            };
            let error = step(&reference).try_inverse().unwrap() * step(&estimate);
            let trace = error[(0, 0)] + error[(1, 1)] + error[(2, 2)];
            let angle = (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos();
            [error.fixed_view::<3, 1>(0, 3).norm_squared(), angle * angle]
        })
        .collect();
    let rms = |k: usize| (squares.iter().map(|s| s[k]).sum::<f64>() / squares.len() as f64).sqrt();
    let relative = found.relative.unwrap();
    assert_eq!(relative.count, squares.len());
    assert!(
        (relative.translation_m.rmse - rms(0)).abs() < 1e-6,
        "{relative:?}"
    );
    assert!(
        (relative.rotation_rad.rmse - rms(1)).abs() < 1e-6,
        "{relative:?}"
    );
}

#[test]
fn poses_are_compared_at_common_times_only() {
    let reference = drive();
    // Every third pose, 0.03 s later on a clock that is 5 s behind, with a gap in the reference.
    let estimate: Vec<PoseRecord> = reference.iter().step_by(3).copied().collect();
    let late: Vec<PoseRecord> = estimate
        .iter()
        .map(|pose| PoseRecord::new(pose.time_s - 5.0, pose.world_from_body))
        .collect();
    let gappy: Vec<PoseRecord> = reference
        .iter()
        .filter(|pose| !(105.01..=107.01).contains(&pose.time_s))
        .copied()
        .collect();
    let error = compare(&late[..5], &reference[100..], &BY_SECOND).unwrap_err();
    assert!(error.to_string().contains("no common time"), "{error}");
    let comparison = Comparison {
        time_offset_s: 5.0,
        ..BY_SECOND
    };
    let found = compare(&late, &gappy, &comparison).unwrap();
    let association = &found.association;
    assert!(association.interpolates_reference);
    assert!((association.max_gap_s - 0.25).abs() < 1e-9);
    // 67 poses, of which 105.1, 105.4, … 107.0 s have no reference.
    assert_eq!((association.pairs.len(), association.in_gaps), (60, 7));
    assert!(found.translation_m.max < 1e-6, "{:?}", found.translation_m);
    // The sparser trajectory is kept where it is, whichever it is; turning evenly, straight between poses.
    let swapped = compare(&reference, &estimate, &BY_SECOND).unwrap();
    assert!(!swapped.association.interpolates_reference);
    assert_eq!(swapped.poses.len(), estimate.len());
    let shifted: Vec<PoseRecord> = estimate
        .iter()
        .map(|pose| PoseRecord::new(pose.time_s + 0.05, pose.world_from_body))
        .collect();
    let between = compare(&shifted, &reference, &BY_SECOND).unwrap();
    let [first, next] = [0, 1].map(|i| reference[i].world_from_body);
    let middle = 0.5 * (first.translation_m + next.translation_m);
    assert!((between.poses[0].reference_m - middle).norm() < 1e-6);
}
