//! How many rays the scanners of a drawn drive send.

use super::super::drive::Drive;
use super::super::scenario::Scenario;
use super::super::sensors::ScannerKind;
use super::extent::Extent;
use super::robot::slowest_profiles_hz;

/// Rays of a profile, at least: fewer tell nothing.
const NARROWEST: usize = 60;

/// Profiles per second, at least.
const SLOWEST_HZ: f64 = 20.0;

/// Rays of a turn of a lidar for each ring, at least: it looks all around.
const FEWEST_COLUMNS: usize = 90;

/// Turns of a lidar per second, at least.
const SLOWEST_TURNS_HZ: f64 = 5.0;

/// Narrows profiles and then lowers their rate, so that a drive does not have too many rays, and the same for a lidar, of
/// which rings are then left out.
pub(super) fn limit(extent: &Extent, scenario: &mut Scenario) {
    let duration_s = Drive::planned_s(scenario, 0);
    let slowest_hz = slowest_profiles_hz(scenario).max(SLOWEST_HZ);
    let fans = scenario.scanners_of(ScannerKind::Profile).len().max(1) as f64;
    let profiles = &mut scenario.profiles;
    let most_hz = extent.most_rays / (duration_s * fans);
    profiles.width = narrowed(profiles.width, NARROWEST, most_hz / profiles.rate_hz);
    profiles.rate_hz = slowed(
        profiles.rate_hz,
        slowest_hz,
        most_hz / profiles.width as f64,
    );
    let lidar = &mut scenario.lidar;
    let most_hz = extent.most_rays / (duration_s * lidar.rings as f64);
    lidar.columns = narrowed(lidar.columns, FEWEST_COLUMNS, most_hz / lidar.rate_hz);
    lidar.rate_hz = slowed(
        lidar.rate_hz,
        SLOWEST_TURNS_HZ,
        most_hz / lidar.columns as f64,
    );
    let rays = duration_s * lidar.rate_hz * lidar.columns as f64;
    lidar.rings = narrowed(lidar.rings, 1, extent.most_rays / rays);
}

/// At most so many rays, but at least the fewest.
fn narrowed(rays: usize, fewest: usize, most: f64) -> usize {
    rays.min((most as usize).max(fewest))
}

/// At most this rate, but at least the slowest.
fn slowed(rate_hz: f64, slowest_hz: f64, most_hz: f64) -> f64 {
    rate_hz.min(most_hz.max(slowest_hz))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drives_have_at_most_as_many_rays_unless_fewer_tell_nothing() {
        for seed in 0..100 {
            let scenario = Scenario::random(seed, &Extent::TINY);
            let duration_s = Drive::planned_s(&scenario, 0);
            let most = 1.001 * Extent::TINY.most_rays;
            let fans = scenario.scanners_of(ScannerKind::Profile).len() as f64;
            let profiles = &scenario.profiles;
            let rays = duration_s * fans * profiles.rate_hz * profiles.width as f64;
            let slowest_hz = slowest_profiles_hz(&scenario).max(SLOWEST_HZ);
            let is_least = profiles.width == NARROWEST && profiles.rate_hz <= slowest_hz;
            assert!(is_least || rays <= most, "{seed}: {rays}");
            let lidar = &scenario.lidar;
            let in_turn = (lidar.rings * lidar.columns) as f64;
            let rays = duration_s * lidar.rate_hz * in_turn;
            assert!(lidar.rings == 1 || rays <= most, "{seed}: {rays}");
        }
    }
}
