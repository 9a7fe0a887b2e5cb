//! The online smoother: against the batch, against truth, and on logs as they come.

use super::pose_case::pose_case;
use super::rover::rover_drive;
use super::{Logs, common, numbers, quaternion, rms, vec3};
use boresight::progress::Silent;
use boresight::trajectory::{Estimate, Online, OnlineOptions, Thresholds, Trajectory, Update};
use std::time::Instant;

/// Gives all records to the smoother in the order of their times, `late_s` after them.
fn replay_late(
    logs: &Logs,
    options: OnlineOptions,
    late_s: [f64; 3],
    mut each: impl FnMut(&[Update], f64),
) -> Online {
    let mut online = Online::new(&logs.settings, options).expect("settings");
    let (mut imu, mut prism, mut heading) = (0, 0, 0);
    loop {
        let due = [
            logs.imu.get(imu).map(|s| s.time_s),
            logs.heading.get(heading).map(|h| h.time_s),
            logs.prism.get(prism).map(|p| p.time_s),
        ];
        let due: Vec<f64> = due
            .iter()
            .zip(late_s)
            .map(|(t, late)| t.map_or(f64::INFINITY, |t| t + late))
            .collect();
        let next = (0..3)
            .min_by(|&a, &b| due[a].total_cmp(&due[b]))
            .expect("three");
        if due[next].is_infinite() {
            return online;
        }
        let begun = Instant::now();
        let updates = match next {
            0 => online.imu(logs.imu[imu]).expect("a sample"),
            1 => {
                online.heading(logs.heading[heading]).expect("a heading");
                Vec::new()
            }
            _ => online.position(0, logs.prism[prism]).expect("a fix"),
        };
        let took_s = begun.elapsed().as_secs_f64();
        match next {
            0 => imu += 1,
            1 => heading += 1,
            _ => prism += 1,
        }
        each(&updates, took_s);
    }
}

fn replay(logs: &Logs, options: OnlineOptions) -> (Online, Vec<Update>) {
    let mut all = Vec::new();
    let online = replay_late(logs, options, [0.0; 3], |updates, _| {
        all.extend_from_slice(updates);
    });
    (online, all)
}

/// Largest differences of position (m) and attitude (rad) of poses at the same times.
fn difference(a: &Trajectory, b: &Trajectory) -> (f64, f64) {
    let mut largest = (0.0f64, 0.0f64);
    for (a, b) in a.nodes().iter().zip(b.nodes()) {
        assert!(
            (a.time_s - b.time_s).abs() < 1e-6,
            "{} {}",
            a.time_s,
            b.time_s
        );
        let (pa, pb) = (a.world_from_body, b.world_from_body);
        let apart_m = (pa.translation.vector - pb.translation.vector).norm();
        largest.0 = largest.0.max(apart_m);
        largest.1 = largest.1.max(pa.rotation.angle_to(&pb.rotation));
    }
    largest
}

fn finished_is_batch(logs: &Logs) {
    let (online, updates) = replay(logs, OnlineOptions::default());
    let rejected: usize = updates.iter().map(|u| u.rejected.len()).sum();
    let batch = logs.estimate();
    let Estimate {
        trajectory,
        solution,
        ..
    } = online.finish(&Silent).expect("the whole trajectory");
    assert!(solution.converged);
    assert_eq!(trajectory.nodes().len(), batch.trajectory.nodes().len());
    let (position_m, rotation_rad) = difference(&trajectory, &batch.trajectory);
    println!(
        "finished against batch: {position_m:.1e} m, {rotation_rad:.1e} rad, {} iterations (batch \
         {}), {} updates, {rejected} refused on the way",
        solution.iterations,
        batch.solution.iterations,
        updates.len()
    );
    assert!(position_m < 1e-6, "{position_m}");
    assert!(rotation_rad < 1e-6, "{rotation_rad}");
    assert_eq!(solution.rejections, batch.solution.rejections);
}

#[test]
fn a_finished_rover_drive_is_that_of_the_batch() {
    for seed in 0..3 {
        finished_is_batch(&rover_drive(seed).0);
    }
}

#[test]
fn a_finished_drive_of_five_minutes_is_that_of_the_batch() {
    if let Some(folder) = common::shared_data("pose_case") {
        finished_is_batch(&pose_case(&folder));
    }
}

/// Every node linearised anew at every update, through the whole drive: the incremental
/// elimination itself must come to the solution of the batch.
#[test]
fn linearised_anew_at_every_update_the_chain_is_that_of_the_batch() {
    let (mut logs, _) = rover_drive(1);
    logs.settings.zero_velocity = false;
    let options = OnlineOptions {
        relinearise: Thresholds::ZERO,
        wildfire: Thresholds::ZERO,
        reach: usize::MAX / 2,
        ..OnlineOptions::default()
    };
    let (mut online, updates) = replay(&logs, options);
    assert!(online.rejections().is_empty(), "{:?}", online.rejections());
    // The last pose stands at the last fix, the others at samples.
    let mut poses = online.full().expect("a trajectory").nodes().to_vec();
    poses.pop();
    let found = Trajectory::new(poses).expect("a trajectory");
    // The batch of what the smoother has seen: to the last node.
    let newest_s = updates.last().expect("updates").pose.time_s;
    logs.prism.retain(|fix| fix.time_s <= newest_s);
    logs.heading.retain(|fix| fix.time_s <= newest_s);
    let batch = logs.estimate();
    let (position_m, rotation_rad) = difference(&found, &batch.trajectory);
    println!("chain against batch: {position_m:.1e} m, {rotation_rad:.1e} rad");
    assert!(position_m < 1e-6, "{position_m}");
    assert!(rotation_rad < 1e-6, "{rotation_rad}");
    let sigma_ratio = found
        .nodes()
        .iter()
        .zip(batch.trajectory.nodes())
        .map(|(a, b)| {
            let (a, b) = (a.sigma.expect("sigma"), b.sigma.expect("sigma"));
            let position = a.position_m.component_div(&b.position_m).add_scalar(-1.0);
            let rotation = a.rotation_rad.component_div(&b.rotation_rad);
            position.amax().max(rotation.add_scalar(-1.0).amax())
        })
        .fold(0.0, f64::max);
    println!("sigmas differ by {sigma_ratio:.1e} of themselves");
    assert!(sigma_ratio < 1e-3, "{sigma_ratio}");
}

/// The newest pose at every update against truth; the figures are those of gtsam's iSAM2 on the
/// same logs.
#[test]
fn newest_poses_are_as_good_as_those_of_isam2() {
    let Some(folder) = common::shared_data("pose_case") else {
        return;
    };
    let logs = pose_case(&folder);
    let mut times: Vec<f64> = Vec::new();
    let mut updates: Vec<Update> = Vec::new();
    replay_late(&logs, OnlineOptions::default(), [0.0; 3], |new, took_s| {
        if !new.is_empty() {
            times.push(took_s * 1e3);
        }
        updates.extend_from_slice(new);
    });
    let truth = numbers(&folder.join("truth.csv"));
    let (mut position, mut tilt, mut yaw, mut inside) = (vec![], vec![], vec![], [0usize; 6]);
    for update in &updates {
        let at = truth.partition_point(|t| t[0] < update.pose.time_s - 1e-6);
        let t = &truth[at];
        assert!((t[0] - update.pose.time_s).abs() < 1e-6);
        let pose = update.pose.world_from_body;
        let dp = pose.translation.vector - vec3(t, 1);
        let dr = (pose.rotation * quaternion(t, 4).inverse()).scaled_axis();
        let sigma = update.pose.sigma.expect("standard deviations");
        for axis in 0..3 {
            inside[axis] += usize::from(dp[axis].abs() < 1.96 * sigma.position_m[axis]);
            inside[3 + axis] += usize::from(dr[axis].abs() < 1.96 * sigma.rotation_rad[axis]);
        }
        position.push(dp.norm());
        tilt.push(dr.xy().norm());
        yaw.push(dr.z);
    }
    let position_mm = rms(position.iter().copied()) * 1e3;
    let tilt_deg = rms(tilt.iter().copied()).to_degrees();
    let yaw_deg = rms(yaw.iter().copied()).to_degrees();
    let relinearised: usize = updates.iter().map(|u| u.relinearised).sum();
    let eliminated: usize = updates.iter().map(|u| u.eliminated).sum();
    let rejected: usize = updates.iter().map(|u| u.rejected.len()).sum();
    println!(
        "{} updates from {:.2} s: position {position_mm:.3} mm, tilt {tilt_deg:.4}°, yaw \
         {yaw_deg:.4}°; {relinearised} nodes relinearised, {eliminated} fronts, {rejected} refused",
        updates.len(),
        updates[0].pose.time_s,
    );
    println!(
        "inside {:.3?}",
        inside.map(|n| n as f64 / updates.len() as f64)
    );
    times.remove(0);
    let mut worst: Vec<(f64, usize)> = times
        .iter()
        .copied()
        .zip(updates[1..].iter().map(|u| u.eliminated))
        .collect();
    worst.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("{:?}", &worst[..8]);
    times.sort_by(f64::total_cmp);
    let at = |q: f64| times[((times.len() - 1) as f64 * q).ceil() as usize];
    println!(
        "update: median {:.3} ms, 99.9 % {:.3} ms, largest {:.3} ms",
        at(0.5),
        at(0.999),
        at(1.0)
    );
    assert!(position_mm <= 4.3, "{position_mm}");
    assert!(yaw_deg <= 0.081, "{yaw_deg}");
    assert!(tilt_deg <= 0.11, "{tilt_deg}");
    // It starts within seconds, and misses no fix after.
    assert!(updates[0].pose.time_s < 5.0);
    assert!(updates.len() as f64 > 0.99 * (300.0 - 5.0) / 0.14);
}
