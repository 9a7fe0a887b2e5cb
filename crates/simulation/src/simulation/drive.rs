//! Motion of the robot: a route driven with changing speed over uneven ground.

use std::f64::consts::{PI, TAU};

use super::field::{DriveSettings, MotionSettings, Pass};
use super::route::{Piece, Waypoint, shortest};
use super::scenario::Scenario;
use super::scene::Scene;
use super::sensors::ScannerKind;
use super::spline::Spline;
use crate::geometry::{BodyAxes, Rotation, Vec3, WorldFromBody};

/// Time between control points of the motion, seconds.
const KNOT_S: f64 = 0.02;

/// Distance between control points of the route, metres.
const ROUTE_STEP_M: f64 = 0.15;

/// Reaction time of the speed control, seconds.
const SPEED_TIME_S: f64 = 0.4;

/// The motion of the body, four times continuously differentiable.
#[derive(Debug, Clone)]
pub struct Drive {
    axes: BodyAxes,
    /// East, north, up of the IMU (m), then roll, pitch, yaw (rad) of the axes forward, left, up.
    motion: Spline<6>,
    /// First and last time, seconds.
    pub span_s: (f64, f64),
    /// When the robot starts to move and when it has stopped, seconds.
    pub moving_s: (f64, f64),
    /// Length driven, metres.
    pub length_m: f64,
}

/// The motion of the body at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyState {
    /// Pose of the body.
    pub world_from_body: WorldFromBody,
    /// Velocity in the world, m/s.
    pub velocity_m_s: Vec3,
    /// Acceleration in the world, m/s².
    pub acceleration_m_s2: Vec3,
    /// Angular rate in body axes, rad/s.
    pub rate_rad_s: Vec3,
    /// Roll (left side up), pitch (nose down) of the body, radians.
    pub roll_pitch_rad: [f64; 2],
}

impl BodyState {
    /// The reading of an ideal accelerometer, m/s² in body axes: at rest it points upwards.
    pub fn specific_force_m_s2(&self, gravity_m_s2: f64) -> Vec3 {
        self.world_from_body.rotation.inverse()
            * (self.acceleration_m_s2 + Vec3::z() * gravity_m_s2)
    }
}

impl Drive {
    /// Time span in which the scanners record, seconds: from one second before the robot moves until it has
    /// stopped.
    pub fn recording_s(&self) -> (f64, f64) {
        (self.moving_s.0 - 1.0, self.moving_s.1)
    }

    /// The drive `index` of the scenario, starting at `start_s`.
    pub fn new(scenario: &Scenario, scene: &Scene, index: usize, start_s: f64) -> Self {
        let route = Route::new(scenario, &scenario.drives[index]);
        let motion = &scenario.motion;
        let mut wheels = Wheels::new(motion);
        let rest_s = motion.rest_s.max(1.0);
        let mut samples = Vec::new();
        let (mut distance, mut speed, mut rate) = (0.0, 0.0, 0.0);
        let mut yaw = route.yaw(0.0);
        let mut stopped_s = None;
        for k in 0.. {
            let t = f64::from(k) * KNOT_S;
            let remaining = route.length_m - distance;
            let wanted = if t < rest_s || remaining <= 0.0 {
                0.0
            } else {
                route.wanted_speed_m_s(distance, motion)
            };
            // Critically damped approach to the target speed: acceleration is continuous.
            rate += KNOT_S * ((wanted - speed) / SPEED_TIME_S - 2.0 * rate) / SPEED_TIME_S;
            speed += KNOT_S * rate;
            distance += KNOT_S * speed;
            let (x, y, heading) = route.place(distance);
            yaw += (heading - yaw + PI).rem_euclid(TAU) - PI;
            let [z, roll, pitch] = wheels.step(scene, x, y, yaw);
            // The tilt of the ground moves the IMU sideways.
            let up = Rotation::from_euler_angles(roll, pitch, yaw) * Vec3::z();
            let top = Vec3::new(x, y, z) + up * motion.imu_height_m;
            samples.push([top.x, top.y, top.z, roll, pitch, yaw]);
            let still = remaining <= 0.0 && speed.abs() < 1e-4 && rate.abs() < 1e-4;
            if still && t > *stopped_s.get_or_insert(t) + 3.0 {
                break;
            }
        }
        let end = start_s + (samples.len() - 1) as f64 * KNOT_S;
        Self {
            axes: scenario.body,
            motion: Spline::new(start_s, KNOT_S, &samples),
            span_s: (start_s, end),
            moving_s: (start_s + rest_s, start_s + stopped_s.unwrap_or(end)),
            length_m: distance,
        }
    }

    /// About how long the drive `index` of the scenario moves, seconds: without acceleration and braking.
    pub fn planned_s(scenario: &Scenario, index: usize) -> f64 {
        let route = Route::new(scenario, &scenario.drives[index]);
        let motion = &scenario.motion;
        let slow_m: f64 = route.slow_m.iter().map(|(from, to)| to - from).sum();
        slow_m / motion.scan_speed_m_s + (route.length_m - slow_m) / motion.transit_speed_m_s
    }

    /// The state at `time_s`; before and after the drive the robot is at rest.
    pub fn at(&self, time_s: f64) -> BodyState {
        let jet = self.motion.at(time_s);
        let [x, y, z, roll, pitch, yaw] = jet.value;
        let [vx, vy, vz, droll, dpitch, dyaw] = jet.first;
        let [ax, ay, az, ..] = jet.second;
        let (sr, cr) = roll.sin_cos();
        let (sp, cp) = pitch.sin_cos();
        // Rates of R = Rz(yaw) Ry(pitch) Rx(roll) in its own axes.
        let rate = Vec3::new(
            droll - dyaw * sp,
            dpitch * cr + dyaw * cp * sr,
            dyaw * cp * cr - dpitch * sr,
        );
        let level = match self.axes {
            BodyAxes::Flu => Rotation::identity(),
            BodyAxes::Frd => Rotation::from_axis_angle(&Vec3::x_axis(), PI),
        };
        let rotation = Rotation::from_euler_angles(roll, pitch, yaw) * level;
        BodyState {
            world_from_body: WorldFromBody::new(rotation, Vec3::new(x, y, z)),
            velocity_m_s: Vec3::new(vx, vy, vz),
            acceleration_m_s2: Vec3::new(ax, ay, az),
            rate_rad_s: level.inverse() * rate,
            roll_pitch_rad: [roll, pitch],
        }
    }
}

/// The curve that the point below the IMU follows, with the sections of low speed.
struct Route {
    curve: Spline<2>,
    length_m: f64,
    slow_m: Vec<(f64, f64)>,
}

impl Route {
    fn new(scenario: &Scenario, drive: &DriveSettings) -> Self {
        // The fans are this far ahead of the IMU, so a pass of the IMU is shifted back by this distance.
        let fans = scenario.scanners_of(ScannerKind::Profile);
        let forward = fans.iter().map(|&s| scenario.scanners[s].translation_m[0]);
        let ahead = forward.sum::<f64>() / fans.len().max(1) as f64;
        let mut pieces: Vec<Piece> = Vec::new();
        let mut at = None;
        let mut slow_m = Vec::new();
        let mut driven = 0.0;
        let mut start = Waypoint {
            x: 0.0,
            y: 0.0,
            yaw: 0.0,
        };
        let mut add = |pieces: &mut Vec<Piece>, piece: Piece| {
            driven += piece.length_m;
            pieces.push(piece);
            driven
        };
        for pass in &drive.passes {
            let (center, half) = centre_and_half(scenario, pass);
            let enter = center.along(0.0, -ahead - half);
            let mut from = 0.0;
            match at {
                None => start = enter.along(0.0, -0.5),
                Some(ref at) => {
                    for piece in shortest(at, &enter, scenario.motion.turn_radius_m) {
                        from = add(&mut pieces, piece);
                    }
                }
            }
            if at.is_none() {
                from = add(
                    &mut pieces,
                    Piece {
                        length_m: 0.5,
                        curvature: 0.0,
                    },
                );
            }
            let from = from.max(slow_m.last().map_or(0.0, |&(_, to): &(f64, f64)| to));
            let to = add(
                &mut pieces,
                Piece {
                    length_m: 2.0 * half,
                    curvature: 0.0,
                },
            );
            slow_m.push((from, to));
            at = Some(center.along(0.0, half - ahead));
        }
        let length_m = add(
            &mut pieces,
            Piece {
                length_m: 0.5,
                curvature: 0.0,
            },
        );
        // Distance for stopping.
        pieces.push(Piece {
            length_m: 0.5 + 4.0 * SPEED_TIME_S * scenario.motion.transit_speed_m_s,
            curvature: 0.0,
        });
        Self {
            curve: Self::smooth(start, &pieces),
            length_m,
            slow_m,
        }
    }

    /// Samples the pieces at equal distances and uses the samples as control points.
    fn smooth(start: Waypoint, pieces: &[Piece]) -> Spline<2> {
        let mut points = Vec::new();
        let (mut at, mut next) = (start, 0.0);
        for piece in pieces {
            while next <= piece.length_m {
                let p = at.along(piece.curvature, next);
                points.push([p.x, p.y]);
                next += ROUTE_STEP_M;
            }
            next -= piece.length_m;
            at = at.along(piece.curvature, piece.length_m);
        }
        // A straight lead-in, so that the end of the spline does not bend the start.
        let lead = (1..=4).rev().map(|k| {
            let p = start.along(0.0, -f64::from(k) * ROUTE_STEP_M);
            [p.x, p.y]
        });
        let all: Vec<[f64; 2]> = lead.chain(points).collect();
        Spline::new(-4.0 * ROUTE_STEP_M, ROUTE_STEP_M, &all)
    }

    fn place(&self, distance_m: f64) -> (f64, f64, f64) {
        let jet = self.curve.at(distance_m);
        (jet.value[0], jet.value[1], jet.first[1].atan2(jet.first[0]))
    }

    fn yaw(&self, distance_m: f64) -> f64 {
        self.place(distance_m).2
    }

    fn wanted_speed_m_s(&self, distance_m: f64, motion: &MotionSettings) -> f64 {
        // Braking begins as early as the speed control requires.
        let braking = 3.0 * SPEED_TIME_S * motion.transit_speed_m_s;
        let slow = self
            .slow_m
            .iter()
            .any(|&(from, to)| (from - braking..to).contains(&distance_m));
        if slow {
            motion.scan_speed_m_s
        } else {
            motion.transit_speed_m_s
        }
    }
}

/// The waypoint in the middle of a pass, and half the pass's length, metres.
fn centre_and_half(scenario: &Scenario, pass: &Pass) -> (Waypoint, f64) {
    match *pass {
        Pass::Board { board, heading_deg } => {
            let board = &scenario.boards[board];
            // Half the board's extent along the pass in plan view, with a margin.
            let (sin, cos) = (heading_deg - board.azimuth_deg).to_radians().sin_cos();
            let slope = board.tilt_deg.to_radians().cos();
            let [level, sloping] = board.size_m;
            let half = 0.5 * (level * sin.abs() + sloping * slope * cos.abs()) + 0.08;
            let center = Waypoint::heading(board.center_m[0], board.center_m[1], heading_deg);
            (center, half)
        }
        Pass::Line { from_m, to_m } => {
            let (dx, dy) = (to_m[0] - from_m[0], to_m[1] - from_m[1]);
            let center = Waypoint {
                x: from_m[0] + 0.5 * dx,
                y: from_m[1] + 0.5 * dy,
                yaw: dy.atan2(dx),
            };
            (center, 0.5 * dx.hypot(dy))
        }
    }
}

/// Four wheels on the ground under a sprung body.
struct Wheels {
    half_base: f64,
    half_track: f64,
    shortest_m: f64,
    omega: f64,
    damping: f64,
    state: Option<[[f64; 2]; 3]>,
}

impl Wheels {
    fn new(motion: &MotionSettings) -> Self {
        Self {
            half_base: 0.5 * motion.wheelbase_track_m[0],
            half_track: 0.5 * motion.wheelbase_track_m[1],
            shortest_m: motion.wheel_wavelength_m,
            omega: TAU * motion.suspension_hz,
            damping: motion.suspension_damping,
            state: None,
        }
    }

    /// Height (m), roll and pitch (rad) of the body one knot later.
    fn step(&mut self, scene: &Scene, x: f64, y: f64, yaw: f64) -> [f64; 3] {
        let (s, c) = yaw.sin_cos();
        let ground = |forward: f64, left: f64| {
            scene.soil.carrying_height_m(
                x + c * forward - s * left,
                y + s * forward + c * left,
                self.shortest_m,
            )
        };
        let (b, t) = (self.half_base, self.half_track);
        let [fl, fr, rl, rr] = [ground(b, t), ground(b, -t), ground(-b, t), ground(-b, -t)];
        let target = [
            0.25 * (fl + fr + rl + rr),
            (0.25 * (fl + rl - fr - rr) / t).atan(),
            (0.25 * (rl + rr - fl - fr) / b).atan(),
        ];
        let (omega, damping) = (self.omega, self.damping);
        let state = self.state.get_or_insert(target.map(|value| [value, 0.0]));
        for ([value, rate], target) in state.iter_mut().zip(target) {
            *rate += KNOT_S * omega * (omega * (target - *value) - 2.0 * damping * *rate);
            *value += KNOT_S * *rate;
        }
        state.map(|[value, _]| value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{heading, so3};

    #[test]
    fn derivatives_meet_finite_differences() {
        for axes in [BodyAxes::Frd, BodyAxes::Flu] {
            let scenario = Scenario {
                body: axes,
                ..Scenario::demo()
            };
            let drive = Drive::new(&scenario, &Scene::new(&scenario), 1, 50.0);
            // Steps of 1e-4 s leave a truncation error below 1e-6 at these jerks.
            let h = 1e-4;
            for t in [52.0, 60.013, 75.5, 101.2345] {
                let (a, b, c) = (drive.at(t - h), drive.at(t), drive.at(t + h));
                let x = |s: &BodyState| s.world_from_body.translation_m;
                let velocity = (x(&c) - x(&a)) / (2.0 * h);
                let acceleration = (c.velocity_m_s - a.velocity_m_s) / (2.0 * h);
                let turn = a.world_from_body.rotation.inverse() * c.world_from_body.rotation;
                let rate = so3::log(&turn) / (2.0 * h);
                assert!((velocity - b.velocity_m_s).norm() < 1e-6);
                assert!((acceleration - b.acceleration_m_s2).norm() < 1e-5);
                assert!((rate - b.rate_rad_s).norm() < 1e-6);
            }
        }
    }

    #[test]
    fn the_robot_starts_at_rest_and_upright() {
        for axes in [BodyAxes::Frd, BodyAxes::Flu] {
            let scenario = Scenario {
                body: axes,
                ..Scenario::demo()
            };
            let drive = Drive::new(&scenario, &Scene::new(&scenario), 0, 0.0);
            let state = drive.at(2.0);
            assert!(state.velocity_m_s.norm() < 1e-12 && state.rate_rad_s.norm() < 1e-12);
            let force = state.specific_force_m_s2(9.81);
            assert!((force.norm() - 9.81).abs() < 1e-12);
            // Within the tilt of the ground, a few degrees.
            assert!(force.normalize().dot(&axes.up()) > 0.998);
            let expected = 90f64.to_radians();
            let heading = heading::heading_rad(&state.world_from_body.rotation);
            assert!((heading - expected).abs() < 0.01);
        }
    }

    #[test]
    fn speeds_and_tilts_are_those_of_a_field_robot() {
        let scenario = Scenario::demo();
        let scene = Scene::new(&scenario);
        for index in 0..scenario.drives.len() {
            let drive = Drive::new(&scenario, &scene, index, 0.0);
            let (_, end) = drive.span_s;
            assert!((150.0..400.0).contains(&end), "drive {index} takes {end} s");
            let mut worst = [0.0f64; 3];
            for k in 0..(end * 20.0) as usize {
                let state = drive.at(k as f64 * 0.05);
                worst[0] = worst[0].max(state.velocity_m_s.norm());
                worst[1] = worst[1].max(state.roll_pitch_rad[0].abs().to_degrees());
                worst[2] = worst[2].max(state.roll_pitch_rad[1].abs().to_degrees());
            }
            println!(
                "drive {index}: {end:.1} s, {:.1} m, {worst:?}",
                drive.length_m
            );
            assert!(
                worst[0] < 0.6 && worst[1] < 3.0 && worst[2] < 3.0,
                "{worst:?}"
            );
            assert!(worst[1] > 0.3 && worst[2] > 0.3, "{worst:?}");
        }
    }
}
