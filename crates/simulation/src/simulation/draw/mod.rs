//! Scenarios drawn at random: what users may bring, far from the demo.

mod draws;
mod extent;
mod faults;
mod ground;
mod rays;
mod robot;
mod sensors;

pub use extent::Extent;
pub use faults::Fault;

use draws::Draws;

use super::random::{Purpose, stream};
use super::scenario::Scenario;

/// The parts of a scenario. Each has random numbers of its own, so that a change of one leaves the others.
#[derive(Debug, Clone, Copy)]
enum Part {
    Robot,
    Scanners,
    Ground,
    Route,
    Imu,
    Positions,
    Heading,
    Reference,
    Frame,
    Fault,
}

impl Scenario {
    /// A scenario with one drive whose ground, robot, sensors, route and faults of the frame are drawn with this seed.
    /// What the project states about the noise is what it was drawn from.
    pub fn random(seed: u64, extent: &Extent) -> Self {
        let draws = |part| part_draws(seed, part);
        let mut scenario = Self {
            name: format!("random-{seed}"),
            seed,
            ..Self::default()
        };
        scenario.project.voxel_sizes_m = Vec::new();
        let standoff_m = robot::body(&mut draws(Part::Robot), extent, &mut scenario);
        robot::scanners(&mut draws(Part::Scanners), standoff_m, &mut scenario);
        ground::ground(&mut draws(Part::Ground), standoff_m, &mut scenario);
        ground::route(&mut draws(Part::Route), extent, &mut scenario);
        sensors::imu(&mut draws(Part::Imu), &mut scenario);
        sensors::positions(&mut draws(Part::Positions), &mut scenario);
        sensors::heading(&mut draws(Part::Heading), &mut scenario);
        sensors::reference(&mut draws(Part::Reference), &mut scenario);
        robot::frame(&mut draws(Part::Frame), &mut scenario);
        rays::limit(extent, &mut scenario);
        scenario
    }

    /// [`Scenario::random`] with a fault that its project does not state, and the fault.
    pub fn random_faulty(seed: u64, extent: &Extent) -> (Self, Fault) {
        let mut scenario = Self::random(seed, extent);
        let fault = faults::fault(&mut part_draws(seed, Part::Fault), &mut scenario);
        (scenario, fault)
    }
}

/// The random numbers of a part of the scenario with this seed.
fn part_draws(seed: u64, part: Part) -> Draws {
    Draws::new(stream(seed, Purpose::Scenario, part as u64, 0))
}

#[cfg(test)]
mod tests {
    use super::super::sensors::ScannerKind;
    use super::*;

    const SEEDS: u64 = 300;

    #[test]
    fn every_drawn_scenario_can_be_simulated() {
        for seed in 0..SEEDS {
            for extent in [Extent::FULL, Extent::TINY] {
                let scenario = Scenario::random(seed, &extent);
                scenario
                    .check()
                    .unwrap_or_else(|error| panic!("seed {seed}: {error}"));
                let text = toml::to_string(&scenario).unwrap();
                assert_eq!(toml::from_str::<Scenario>(&text).unwrap(), scenario);
            }
        }
    }

    #[test]
    fn every_fault_is_drawn_and_can_be_simulated() {
        let mut drawn = Vec::new();
        for seed in 0..SEEDS {
            let (scenario, fault) = Scenario::random_faulty(seed, &Extent::TINY);
            scenario
                .check()
                .unwrap_or_else(|error| panic!("seed {seed}, {fault:?}: {error}"));
            assert_ne!(scenario, Scenario::random(seed, &Extent::TINY), "{fault:?}");
            drawn.push(fault);
        }
        assert!(Fault::ALL.iter().all(|fault| drawn.contains(fault)));
    }

    #[test]
    fn the_draws_cover_what_users_bring() {
        let all: Vec<Scenario> = (0..SEEDS)
            .map(|seed| Scenario::random(seed, &Extent::FULL))
            .collect();
        let share = |what: fn(&Scenario) -> bool| {
            all.iter().filter(|scenario| what(scenario)).count() as f64 / SEEDS as f64
        };
        type Kind = (&'static str, fn(&Scenario) -> bool);
        let kinds: [Kind; 14] = [
            ("no boards", |s| s.boards.is_empty()),
            ("plants", |s| s.plants.count_per_m2 > 0.0),
            ("clods", |s| s.soil.clod_height_m > 0.0),
            ("one scanner", |s| s.scanners.len() == 1),
            ("lidar", |s| !s.scanners_of(ScannerKind::Lidar).is_empty()),
            ("no heading", |s| !s.heading.enabled),
            ("no reference", |s| !s.reference.enabled),
            ("gaps", |s| !s.prism.lost_s.is_empty()),
            ("lasting errors", |s| s.prism.sigma_correlated_m > 0.0),
            ("frame not rigid", |s| s.deformation.enabled),
            ("vibration", |s| s.imu.vibration_m_s2 > 0.0),
            ("late positions", |s| s.prism.latency_s > 0.0),
            ("turns on the spot", |s| s.motion.turn_radius_m < 0.2),
            ("fast", |s| s.motion.scan_speed_m_s > 1.0),
        ];
        for (name, what) in kinds {
            let share = share(what);
            assert!((0.05..0.95).contains(&share), "{name}: {share}");
        }
    }
}
