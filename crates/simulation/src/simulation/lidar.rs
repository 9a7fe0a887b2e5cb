//! Revolutions of a spinning lidar on the robot.

use std::f64::consts::TAU;

use rand::RngExt;

use super::aiding::ticks;
use super::deformation::Mountings;
use super::drive::Drive;
use super::profiler::Ray;
use super::random::{Purpose, normal, stream};
use super::scenario::Scenario;
use super::scene::Scene;
use super::sensors::ScannerSettings;
use crate::geometry::Vec3;

/// The lidars on one drive; `scanner` is an index into the scenario's scanners.
#[derive(Debug, Clone)]
pub struct Lidar<'a> {
    scenario: &'a Scenario,
    scene: &'a Scene,
    drive: &'a Drive,
    drive_index: usize,
    mountings: Mountings,
    start_s: f64,
    count: usize,
}

impl<'a> Lidar<'a> {
    /// The lidars of a drive, which record as long as the profile scanners.
    pub fn new(
        scenario: &'a Scenario,
        scene: &'a Scene,
        drive: &'a Drive,
        drive_index: usize,
    ) -> Self {
        let span = drive.recording_s();
        Self {
            scenario,
            scene,
            drive,
            drive_index,
            mountings: Mountings::new(scenario, drive),
            start_s: span.0,
            count: ticks(span, scenario.lidar.rate_hz, 0.0).len(),
        }
    }

    /// Number of revolutions of each lidar.
    pub fn count(&self) -> usize {
        self.count
    }

    /// True time of a direction (`column`) of a revolution, seconds; its time stamp is later by the
    /// scanner's latency.
    pub fn time_s(&self, index: usize, column: usize) -> f64 {
        let settings = &self.scenario.lidar;
        let turns = index as f64 + column as f64 / settings.columns as f64;
        self.start_s + turns / settings.rate_hz
    }

    /// The rays of a direction, the lowest first, without noise and drop-outs.
    pub fn ideal(&self, scanner: usize, index: usize, column: usize) -> Vec<Option<Ray>> {
        let settings = &self.scenario.lidar;
        let time_s = self.time_s(index, column);
        let state = self.drive.at(time_s);
        let world_from_scanner =
            state.world_from_body * self.mountings.body_from_scanner(scanner, time_s, &state);
        let (sin, cos) = (TAU * column as f64 / settings.columns as f64).sin_cos();
        let fan = settings.fan_deg.to_radians();
        let [near, far] = settings.range_m;
        (0..settings.rings)
            .map(|ring| {
                let elevation = fan * ((ring as f64 + 0.5) / settings.rings as f64 - 0.5);
                let (up, level) = elevation.sin_cos();
                let ray = Vec3::new(level * cos, level * sin, up);
                let origin = world_from_scanner.translation_m;
                let direction = world_from_scanner.rotation * ray;
                let hit = self.scene.intersect(&origin, &direction, far, time_s)?;
                (hit.range_m >= near).then(|| Ray {
                    point_m: ray * hit.range_m,
                    cosine: -hit.normal.dot(&direction),
                    hit,
                })
            })
            .collect()
    }

    /// The points of a revolution as recorded, in order of time: time stamps (s) and positions in
    /// the scanner frame (m).
    pub fn revolution(&self, scanner: usize, index: usize) -> Vec<(f64, Vec3)> {
        let settings = &self.scenario.lidar;
        let &ScannerSettings {
            latency_s,
            range_offset_m,
            ..
        } = &self.scenario.scanners[scanner];
        let group = (self.drive_index * self.scenario.scanners.len() + scanner) as u64;
        let mut rng = stream(self.scenario.seed, Purpose::Lidar, group, index as u64);
        let mut points = Vec::new();
        for column in 0..settings.columns {
            let stamp_s = self.time_s(index, column) + latency_s;
            for ray in self.ideal(scanner, index, column) {
                // Drawn for every ray, so that the noise of a ray does not depend on others.
                let noise_m = normal(&mut rng) * settings.sigma_m;
                let is_lost = rng.random::<f64>() < settings.dropout;
                if let Some(ray) = ray.filter(|_| !is_lost) {
                    let stretch = 1.0 + (noise_m + range_offset_m) / ray.hit.range_m;
                    points.push((stamp_s, ray.point_m * stretch));
                }
            }
        }
        points
    }
}
