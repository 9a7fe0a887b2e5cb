//! A mounting that is not rigid: the enclosure bends with tilt and acceleration, and creeps.

use std::f64::consts::PI;

use super::drive::{BodyState, Drive};
use super::random::{Correlated, Purpose, stream};
use super::scenario::Scenario;
use crate::geometry::{BodyFromScanner, Rotation, Vec3, so3};
use crate::statistics::{Series, rms};

/// True mountings of all scanners at any time of a drive.
#[derive(Debug, Clone)]
pub struct Mountings {
    at_rest: Vec<BodyFromScanner>,
    scenario: Scenario,
    body_from_frd: Rotation,
    span_s: (f64, f64),
    /// Roll and pitch after their play, degrees; `None` if they have none.
    tilts_deg: Option<Series<2>>,
    /// Random motion of each scanner: rotation (degrees) and shift (metres) in FRD axes.
    walks: Vec<Series<6>>,
}

/// Warming of the frame in the sun, kelvins.
pub const WARMING_K: f64 = 12.0;
/// Temperature of the frame before it warms up, °C.
const START_C: f64 = 18.0;

/// Time step of the quantities that depend on the past, seconds.
const STEP_S: f64 = 0.05;

impl Mountings {
    /// The mountings during a drive.
    pub fn new(scenario: &Scenario, drive: &Drive) -> Self {
        let (start_s, end_s) = drive.span_s;
        let count = if scenario.deformation.enabled {
            ((end_s - start_s) / STEP_S) as usize + 1
        } else {
            0
        };
        let times_s = || (0..count).map(|k| start_s + STEP_S * k as f64);
        let share = scenario.deformation.hysteresis;
        let tilts_deg = (share > 0.0).then(|| {
            let tilts = times_s().map(|t| drive.at(t).roll_pitch_rad.map(f64::to_degrees));
            Series::new(start_s, STEP_S, with_play(tilts.collect(), share))
        });
        let scanners = 0..scenario.scanners.len();
        Self {
            tilts_deg,
            walks: scanners
                .map(|scanner| {
                    Series::new(start_s, STEP_S, walk(scenario, drive, scanner, times_s()))
                })
                .collect(),
            at_rest: scenario.true_mountings(),
            scenario: scenario.clone(),
            body_from_frd: scenario.body_from_frd(),
            span_s: drive.moving_s,
        }
    }

    /// The mounting of one scanner at `time_s`, with the body in motion `state`.
    ///
    /// With deformation, the scanner turns about its own origin and shifts, linearly in roll,
    /// pitch, acceleration and time; the two scanners deform symmetrically.
    pub fn body_from_scanner(
        &self,
        scanner: usize,
        time_s: f64,
        state: &BodyState,
    ) -> BodyFromScanner {
        let rigid = self.at_rest[scanner];
        let settings = &self.scenario.deformation;
        if !settings.enabled {
            return rigid;
        }
        let side = self.scenario.scanners[scanner].translation_m[1].signum();
        let [roll, pitch] = match &self.tilts_deg {
            Some(tilts_deg) => tilts_deg.at(time_s),
            None => state.roll_pitch_rad.map(f64::to_degrees),
        };
        let walk = self.walks[scanner].at(time_s);
        let [walk_deg, walk_m] = [&walk[..3], &walk[3..]].map(Vec3::from_column_slice);
        let jump = if scanner == 0 && time_s > 0.5 * (self.span_s.0 + self.span_s.1) {
            Vec3::new(1.0, 0.0, -1.0) * (settings.jump_m / 2f64.sqrt())
        } else {
            Vec3::zeros()
        };
        let acceleration = self.body_from_frd.inverse()
            * (state.world_from_body.rotation.inverse() * state.acceleration_m_s2);
        let (start, end) = self.span_s;
        let age = ((time_s - start) / (end - start)).clamp(0.0, 1.0) - 0.5;
        let warmth = self.warmth(time_s);
        // Arms ahead of the axle bend with pitch, and sideways with roll.
        let turn_deg = Vec3::new(roll + 0.5 * side * pitch, pitch, 0.5 * side * roll)
            * settings.rotation_deg_per_deg
            + Vec3::new(side, 0.6, -0.4 * side) * (age * settings.drift_deg)
            + Vec3::new(0.5, side, 0.5 * side) * (warmth * settings.warming_deg)
            + walk_deg;
        let shift_m = Vec3::new(-0.5 * pitch, 0.5 * roll, pitch + side * roll)
            * settings.shift_m_per_deg
            + Vec3::new(acceleration.x, acceleration.y, 0.0) * settings.shift_m_per_m_s2
            + Vec3::new(0.3, 0.5 * side, 1.0) * (age * settings.drift_m)
            + Vec3::new(0.5 * side, side, 1.0) * (warmth * settings.warming_m)
            + walk_m
            + jump;
        let turn = self.body_from_frd * turn_deg.map(f64::to_radians);
        BodyFromScanner::new(
            so3::exp(&turn) * rigid.rotation,
            rigid.translation_m + self.body_from_frd * shift_m,
        )
    }

    /// How far the frame has warmed up, 0 to 1. It warms quickly at first, and cools a little while a cloud covers
    /// the sun in the third quarter of the drive.
    fn warmth(&self, time_s: f64) -> f64 {
        let (start, end) = self.span_s;
        let age = ((time_s - start) / (end - start)).clamp(0.0, 1.0);
        let cloud = (PI * (4.0 * age - 2.0).clamp(0.0, 1.0)).sin();
        1.0 - (-4.0 * age).exp() - 0.3 * cloud
    }

    /// Reading of a thermometer on the frame, °C.
    pub fn temperature_c(&self, time_s: f64) -> f64 {
        START_C + WARMING_K * self.warmth(time_s)
    }
}

/// Tilts (degrees) that follow the given ones with a play: half its width is this share of their amplitude.
fn with_play(mut tilts_deg: Vec<[f64; 2]>, share: f64) -> Vec<[f64; 2]> {
    for axis in 0..2 {
        let amplitude = 2f64.sqrt() * rms(tilts_deg.iter().map(|tilt| tilt[axis]));
        let half = share * amplitude;
        let mut follower = tilts_deg.first().map_or(0.0, |tilt| tilt[axis]);
        for tilt in &mut tilts_deg {
            follower = follower.clamp(tilt[axis] - half, tilt[axis] + half);
            tilt[axis] = follower;
        }
    }
    tilts_deg
}

/// Random motion of a scanner at these times: rotation (degrees) and shift (metres) in FRD axes.
fn walk(
    scenario: &Scenario,
    drive: &Drive,
    scanner: usize,
    times_s: impl Iterator<Item = f64>,
) -> Vec<[f64; 6]> {
    let settings = &scenario.deformation;
    let group = if settings.walk_together { 0 } else { scanner };
    let rng = stream(
        scenario.seed,
        Purpose::Mounting,
        group as u64,
        drive.span_s.0 as u64,
    );
    let mut process = Correlated::<6>::new(rng, 1.0, settings.walk_correlation_s);
    let values = times_s.map(|time_s| {
        let value = process.at(time_s);
        std::array::from_fn(|i| {
            value[i]
                * if i < 3 {
                    settings.walk_deg
                } else {
                    settings.walk_m
                }
        })
    });
    values.collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, SVector};

    use super::super::profiler::Profiler;
    use super::super::scene::Scene;
    use super::*;

    #[test]
    fn the_best_rigid_mounting_leaves_about_eight_millimetres() {
        let mut scenario = Scenario::demo();
        scenario.deformation.enabled = true;
        let scene = Scene::new(&scenario);
        let drive = Drive::new(&scenario, &scene, 0, 0.0);
        let mountings = Mountings::new(&scenario, &drive);
        let profiler = Profiler::new(&scenario, &scene, &drive, 0);
        for scanner in 0..2 {
            let nominal = scenario.true_mountings()[scanner];
            // Normal equations of the distances along surface normals for the six parameters.
            let mut normal = SMatrix::<f64, 6, 6>::zeros();
            let mut right = SVector::<f64, 6>::zeros();
            let (mut squares, mut count, mut worst) = (0.0, 0.0, [0.0f64; 2]);
            for index in (0..profiler.count()).step_by(13) {
                let time_s = profiler.time_s(scanner, index);
                let state = drive.at(time_s);
                let true_pose =
                    state.world_from_body * mountings.body_from_scanner(scanner, time_s, &state);
                let change =
                    nominal.inverse() * mountings.body_from_scanner(scanner, time_s, &state);
                worst[0] = worst[0].max(change.translation_m.norm());
                worst[1] = worst[1].max(change.rotation.angle().to_degrees());
                for ray in profiler.ideal(scanner, index).iter().flatten().step_by(7) {
                    let (x, hit) = (&ray.point_m, &ray.hit);
                    let p = (state.world_from_body * nominal).map(x);
                    let distance = hit.normal.dot(&(p - true_pose.map(x)));
                    let n = state.world_from_body.rotation.inverse() * hit.normal;
                    let arm = (nominal.rotation * x).cross(&n);
                    let row = SVector::<f64, 6>::new(n.x, n.y, n.z, arm.x, arm.y, arm.z);
                    normal += row * row.transpose();
                    right += row * distance;
                    squares += distance * distance;
                    count += 1.0;
                }
            }
            let fit = normal
                .cholesky()
                .expect("all parameters are seen")
                .solve(&right);
            let rmse = ((squares - fit.dot(&right)) / count).sqrt();
            println!("scanner {scanner}: rigid fit leaves {rmse} m of {worst:?} (m, deg)");
            assert!((0.006..0.010).contains(&rmse), "{rmse}");
        }
    }
}
