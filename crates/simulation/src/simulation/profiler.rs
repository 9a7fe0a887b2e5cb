//! Profiles of a triangulating scanner on the robot.

use rand::RngExt;

use super::aiding::ticks;
use super::deformation::Mountings;
use super::drive::Drive;
use super::random::{Purpose, normal, stream};
use super::scenario::Scenario;
use super::scene::{Hit, Scene, Surface};
use super::sensors::ScannerKind;
use crate::geometry::Vec3;

/// One profile: for each ray x, z in the scanner frame (m) and the intensity, or `None`.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Time stamp, seconds.
    pub time_s: f64,
    /// The rays from one side of the fan to the other.
    pub points: Vec<Option<(f64, f64, u8)>>,
}

/// A ray without noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// The point in the scanner frame, metres.
    pub point_m: Vec3,
    /// The surface point that it hits.
    pub hit: Hit,
    /// Cosine of the angle between the ray and the surface's normal.
    pub cosine: f64,
}

/// The profile scanners on one drive; `scanner` is an index into the scenario's scanners.
#[derive(Debug, Clone)]
pub struct Profiler<'a> {
    scenario: &'a Scenario,
    scene: &'a Scene,
    drive: &'a Drive,
    drive_index: usize,
    mountings: Mountings,
    /// Indices of the scanners that record profiles.
    scanners: Vec<usize>,
    rays: Vec<Vec3>,
    start_s: f64,
    count: usize,
}

impl<'a> Profiler<'a> {
    /// The profile scanners of a drive.
    pub fn new(
        scenario: &'a Scenario,
        scene: &'a Scene,
        drive: &'a Drive,
        drive_index: usize,
    ) -> Self {
        let settings = &scenario.profiles;
        let fan = settings.fan_deg.to_radians();
        let rays = (0..settings.width)
            .map(|k| {
                let angle = fan * ((k as f64 + 0.5) / settings.width as f64 - 0.5);
                Vec3::new(angle.sin(), 0.0, -angle.cos())
            })
            .collect();
        let span = drive.recording_s();
        Self {
            scenario,
            scene,
            drive,
            drive_index,
            mountings: Mountings::new(scenario, drive),
            scanners: scenario.scanners_of(ScannerKind::Profile),
            rays,
            start_s: span.0,
            count: ticks(span, settings.rate_hz, 0.0).len(),
        }
    }

    /// Number of profiles of each profile scanner.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Number of profile scanners before this one; lidars do not count.
    fn place(&self, scanner: usize) -> usize {
        self.scanners.partition_point(|&other| other < scanner)
    }

    /// True time of a profile, seconds; its time stamp is later by the scanner's latency. The scanners
    /// fire in turn, so that none sees another's laser line.
    pub fn time_s(&self, scanner: usize, index: usize) -> f64 {
        let turn = self.place(scanner) as f64 / self.scanners.len() as f64;
        self.start_s + (index as f64 + turn) / self.scenario.profiles.rate_hz
    }

    /// The rays of a profile, without noise and drop-outs.
    pub fn ideal(&self, scanner: usize, index: usize) -> Vec<Option<Ray>> {
        let time_s = self.time_s(scanner, index);
        let state = self.drive.at(time_s);
        let world_from_scanner =
            state.world_from_body * self.mountings.body_from_scanner(scanner, time_s, &state);
        let origin = world_from_scanner.translation_m;
        let rotation = world_from_scanner.rotation.to_rotation_matrix();
        let [near, far] = self.scenario.profiles.range_m;
        self.rays
            .iter()
            .map(|ray| {
                let direction = rotation * ray;
                let reach = far / -ray.z;
                let hit = self.scene.intersect(&origin, &direction, reach, time_s)?;
                (hit.range_m * -ray.z >= near).then(|| Ray {
                    point_m: ray * hit.range_m,
                    cosine: -hit.normal.dot(&direction),
                    hit,
                })
            })
            .collect()
    }

    /// The range beyond an edge beside ray `k`, whose light mixes with that of the ray: of a neighbour whose range differs
    /// by more than `edge_m`, and so much that a surface through both points would be seen beyond the grazing angle. Where
    /// rays are far apart, ranges also differ on ground without an edge.
    fn across_edge(&self, ideal: &[Option<Ray>], k: usize) -> Option<f64> {
        let settings = &self.scenario.profiles;
        let (here, direction) = (ideal[k].as_ref()?, &self.rays[k]);
        let is_beyond_grazing = |other: &Ray| {
            let between = other.point_m - here.point_m;
            let along_m = between.dot(direction);
            let across_m = (between - direction * along_m).norm();
            along_m.abs() > settings.grazing_deg.to_radians().tan() * across_m
        };
        let beside = [k.wrapping_sub(1), k + 1].into_iter();
        let mut beside = beside.filter_map(|n| ideal.get(n)?.as_ref());
        let across = beside.find(|other| {
            let differ_m = (other.hit.range_m - here.hit.range_m).abs();
            differ_m > settings.edge_m && is_beyond_grazing(other)
        });
        across.map(|other| other.hit.range_m)
    }

    /// The profile as recorded.
    pub fn profile(&self, scanner: usize, index: usize) -> Profile {
        let settings = &self.scenario.profiles;
        let group = (self.drive_index * self.scanners.len() + self.place(scanner)) as u64;
        let mut rng = stream(self.scenario.seed, Purpose::Profile, group, index as u64);
        let ideal = self.ideal(scanner, index);
        let [near, far] = settings.range_m;
        let [lost, flying] = settings.edge_lost_flying;
        let least_cosine = settings.grazing_deg.to_radians().cos();
        let range_offset_m = self.scenario.scanners[scanner].range_offset_m;
        let step_m = settings.step_m;
        let round = |x: f64| {
            if step_m > 0.0 {
                (x / step_m).round() * step_m
            } else {
                x
            }
        };
        let points = ideal
            .iter()
            .enumerate()
            .map(|(k, ray)| {
                // Drawn for every ray, so that the noise of a ray does not depend on others.
                let noise = normal(&mut rng);
                let [chance, mix] = [rng.random::<f64>(), rng.random::<f64>()];
                let Ray { hit, cosine, .. } = ray.as_ref()?;
                let (direction, range) = (&self.rays[k], hit.range_m);
                if *cosine < least_cosine || chance < settings.dropout {
                    return None;
                }
                let mut measured = range;
                if let Some(other) = self.across_edge(&ideal, k) {
                    if chance < lost {
                        return None;
                    } else if chance < lost + flying {
                        measured += mix * (other - range);
                    }
                }
                let depth = measured * -direction.z;
                let share = ((depth - near) / (far - near)).clamp(0.0, 1.0);
                let sigma =
                    settings.sigma_m[0] + share * (settings.sigma_m[1] - settings.sigma_m[0]);
                measured += noise * sigma / -direction.z + range_offset_m;
                let albedo = match hit.surface {
                    Surface::Soil => 110.0,
                    Surface::Board(_) => 220.0,
                    Surface::Plant => 160.0,
                };
                Some((
                    round(direction.x * measured),
                    round(direction.z * measured),
                    (albedo * cosine) as u8,
                ))
            })
            .collect();
        Profile {
            time_s: self.time_s(scanner, index) + self.scenario.scanners[scanner].latency_s,
            points,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_lost_where_light_grazes_at_edges_and_at_random() {
        let scenario = Scenario::demo();
        let scene = Scene::new(&scenario);
        let drive = Drive::new(&scenario, &scene, 1, 0.0);
        let profiler = Profiler::new(&scenario, &scene, &drive, 1);
        let settings = &scenario.profiles;
        let [
            mut plain,
            mut lost,
            mut edges,
            mut lost_edges,
            mut flying,
            mut grazing,
        ] = [0.0; 6];
        for index in (0..profiler.count()).step_by(20) {
            for scanner in 0..2 {
                let ideal = profiler.ideal(scanner, index);
                let profile = profiler.profile(scanner, index);
                assert_eq!(profile.points.len(), settings.width);
                for (k, (ray, point)) in ideal.iter().zip(&profile.points).enumerate() {
                    let Some(ray) = ray else {
                        assert_eq!(*point, None);
                        continue;
                    };
                    let depth = -ray.point_m.z;
                    assert!((0.35..=1.85).contains(&depth));
                    if ray.cosine < settings.grazing_deg.to_radians().cos() {
                        grazing += 1.0;
                        assert_eq!(*point, None);
                        continue;
                    }
                    let is_edge = profiler.across_edge(&ideal, k).is_some();
                    let error = point.map(|(x, z, _)| x.hypot(z) - ray.hit.range_m);
                    if is_edge {
                        edges += 1.0;
                        lost_edges += f64::from(u8::from(error.is_none()));
                        flying += f64::from(u8::from(error.is_some_and(|e| e.abs() > 0.003)));
                    } else {
                        plain += 1.0;
                        lost += f64::from(u8::from(error.is_none()));
                        // Six standard deviations of a ray at the side of the fan.
                        assert!(error.is_none_or(|e| e.abs() < 0.0022), "{error:?}");
                    }
                }
            }
        }
        println!(
            "{plain} plain, {lost} lost, {edges} at edges, {lost_edges} lost, {flying} flying, {grazing} grazing"
        );
        // Binomial counts within four standard deviations.
        let within = |count: f64, total: f64, share: f64| {
            (count - total * share).abs() < 4.0 * (total * share * (1.0 - share)).sqrt()
        };
        assert!(grazing > 100.0 && edges > 100.0);
        assert!(within(lost, plain, settings.dropout));
        assert!(within(lost_edges, edges, settings.edge_lost_flying[0]));
        // Few of the flying points stay within 3 mm of the surface.
        assert!(flying > 0.05 * edges && flying < 0.15 * edges);
    }

    /// Rays 2° apart differ by more than `edge_m` in range where they meet ground at 60° or more.
    #[test]
    fn ground_has_no_edges_however_far_apart_rays_are() {
        let mut scenario = Scenario::plain();
        scenario.plants.count_per_m2 = 0.0;
        scenario.profiles.width = 30;
        let scene = Scene::new(&scenario);
        let drive = Drive::new(&scenario, &scene, 0, 0.0);
        let profiler = Profiler::new(&scenario, &scene, &drive, 0);
        let (mut differ, mut edges) = (0, 0);
        for index in (0..profiler.count()).step_by(50) {
            let ideal = profiler.ideal(0, index);
            for (k, pair) in ideal.windows(2).enumerate() {
                let [Some(a), Some(b)] = pair else { continue };
                let apart_m = (a.hit.range_m - b.hit.range_m).abs();
                differ += usize::from(apart_m > scenario.profiles.edge_m);
                edges += usize::from(profiler.across_edge(&ideal, k).is_some());
            }
        }
        assert!(differ > 50 && edges == 0, "{differ} differ, {edges} edges");
    }
}
