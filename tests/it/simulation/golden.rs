//! Digests of the demo's measurements, which options added for other scenarios must not change.

use boresight::simulation::{
    Drive, Profiler, Reference, Scene, simulate_heading, simulate_imu, simulate_prism,
};

use super::small;

/// Number of values, and their sum with weights that depend on their order.
fn digest(values: impl Iterator<Item = f64>) -> (usize, f64) {
    values.fold((0, 0.0), |(count, sum), value| {
        (count + 1, sum + (1.0 + (count % 89) as f64) * value)
    })
}

/// Sums rather than bytes: sines differ in the last digit between machines. One random number more
/// or less changes a sum by at least 1e-3.
#[test]
fn drives_of_the_demo_are_the_same_in_every_version() {
    let scenario = small();
    let scene = Scene::new(&scenario);
    let drive = Drive::new(&scenario, &scene, 1, 100.0);
    let imu = simulate_imu(&scenario, &drive, 1).samples;
    let prism = simulate_prism(&scenario, &drive, 1);
    let heading = simulate_heading(&scenario, &drive, 1);
    let profiler = Profiler::new(&scenario, &scene, &drive, 1);
    let profiles =
        (0..profiler.count()).flat_map(|k| [profiler.profile(0, k), profiler.profile(1, k)]);
    let reference = Reference::new(&scenario, &scene);
    let reference = (0..reference.strips()).flat_map(|k| reference.strip(k));
    let digests = [
        digest(imu.iter().flat_map(|s| {
            let (w, a) = (s.gyro_rad_s, s.accel_m_s2);
            [s.time_s, w.x, w.y, w.z, a.x, a.y, a.z]
        })),
        digest(prism.iter().flat_map(|fix| {
            let p = fix.position_m;
            [fix.time_s, p.x, p.y, p.z]
        })),
        digest(heading.iter().flat_map(|fix| [fix.time_s, fix.heading_rad])),
        digest(profiles.flat_map(|profile| {
            let points = profile.points.into_iter().flatten();
            let points = points.flat_map(|(x, z, intensity)| [x, z, f64::from(intensity)]);
            std::iter::once(profile.time_s)
                .chain(points)
                .collect::<Vec<_>>()
        })),
        digest(reference.flat_map(|p| [p.x, p.y, p.z])),
    ];
    let expected = [
        (188_664, 272_848_670.698_733),
        (7_544, 20_679_879.382_376),
        (2_694, 14_169_522.287_793),
        (179_303, 330_919_454.199_698),
        (86_532, 9_056_509.622_993),
    ];
    for (digest, expected) in digests.iter().zip(expected) {
        assert_eq!(digest.0, expected.0);
        assert!(
            (digest.1 - expected.1).abs() < 1e-4,
            "{digest:?}, not {expected:?}"
        );
    }
}
