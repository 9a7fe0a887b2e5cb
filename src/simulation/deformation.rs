//! A mounting that is not rigid: the enclosure bends with tilt and acceleration, and creeps.

use super::drive::{BodyState, Drive};
use super::scenario::Scenario;
use crate::geometry::{BodyFromScanner, Rotation, Vec3, so3};

/// True mountings of all scanners at any time of a drive.
#[derive(Debug, Clone)]
pub struct Mountings {
    at_rest: Vec<BodyFromScanner>,
    scenario: Scenario,
    body_from_frd: Rotation,
    span_s: (f64, f64),
}

impl Mountings {
    /// The mountings during a drive.
    pub fn new(scenario: &Scenario, drive: &Drive) -> Self {
        Self {
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
        let [roll, pitch] = state.roll_pitch_rad.map(f64::to_degrees);
        let acceleration = self.body_from_frd.inverse()
            * (state.world_from_body.rotation.inverse() * state.acceleration_m_s2);
        let (start, end) = self.span_s;
        let age = ((time_s - start) / (end - start)).clamp(0.0, 1.0) - 0.5;
        // Arms ahead of the axle bend with pitch, and sideways with roll.
        let turn_deg = Vec3::new(roll + 0.5 * side * pitch, pitch, 0.5 * side * roll)
            * settings.rotation_deg_per_deg
            + Vec3::new(side, 0.6, -0.4 * side) * (age * settings.drift_deg);
        let shift_m = Vec3::new(-0.5 * pitch, 0.5 * roll, pitch + side * roll)
            * settings.shift_m_per_deg
            + Vec3::new(acceleration.x, acceleration.y, 0.0) * settings.shift_m_per_m_s2
            + Vec3::new(0.3, 0.5 * side, 1.0) * (age * settings.drift_m);
        let turn = self.body_from_frd * turn_deg.map(f64::to_radians);
        BodyFromScanner::new(
            so3::exp(&turn) * rigid.rotation,
            rigid.translation_m + self.body_from_frd * shift_m,
        )
    }
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
