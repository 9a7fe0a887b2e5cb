//! Measurements of the total station and the heading antennas.

use rand::RngExt;

use super::drive::Drive;
use super::random::{Correlated, Purpose, normal, normal3, stream};
use super::scenario::Scenario;
use crate::geometry::{Vec3, heading};
use crate::sensor::{HeadingFix, PositionFix};

/// Facets of a round prism: its error repeats this often per turn.
const FACETS: f64 = 6.0;

/// Measured positions of the prism, each with its own time stamp.
pub fn simulate_prism(scenario: &Scenario, drive: &Drive, drive_index: usize) -> Vec<PositionFix> {
    let settings = &scenario.prism;
    let stream_of = |purpose| stream(scenario.seed, purpose, drive_index as u64, 0);
    let mut rng = stream_of(Purpose::Prism);
    let mut outliers = stream_of(Purpose::PrismOutlier);
    let mut correlated = Correlated::<3>::new(
        stream_of(Purpose::PrismCorrelated),
        settings.sigma_correlated_m,
        settings.correlation_s,
    );
    let lever_arm = scenario.lever_arm_m();
    let up = scenario.body.up();
    ticks(drive.span_s, settings.rate_hz, 0.0137)
        .filter_map(|time_s| {
            let measured_s = time_s - settings.latency_s;
            let body = drive.at(measured_s).world_from_body;
            let prism = body.translation_m + body.rotation * lever_arm;
            let sight = prism - Vec3::from(settings.station_m);
            // Direction in which the line of sight enters the prism, about its axis.
            let sight_in_body = body.rotation.inverse() * sight;
            let level = up.cross(&Vec3::x());
            let angle = FACETS * sight_in_body.dot(&level).atan2(sight_in_body.x);
            let along = sight.normalize();
            let across = Vec3::z().cross(&along);
            let bias = (along * angle.cos() + across * angle.sin()) * settings.incidence_bias_m;
            // Drawn for every position, so that its noise does not depend on whether others are lost.
            let noise = normal3(&mut rng) * settings.sigma_m + Vec3::from(correlated.at(time_s));
            let is_outlier = outliers.random::<f64>() < settings.outlier_share;
            let displacement = normal3(&mut outliers).normalize() * settings.outlier_m;
            let mut position_m = prism + bias + noise;
            if is_outlier {
                position_m += displacement;
            }
            let elapsed_s = measured_s - drive.span_s.0;
            let is_within = |&[from, to]: &[f64; 2]| (from..=to).contains(&elapsed_s);
            let is_lost = settings.lost_s.iter().any(is_within);
            if is_within(&settings.displaced_s) {
                position_m += Vec3::from(settings.displaced_m);
            }
            let stamp_s = time_s + 1e-6 * settings.clock_ppm * elapsed_s;
            (!is_lost).then(|| PositionFix::with_sigma(stamp_s, position_m, None))
        })
        .collect()
}

/// Measured headings of the antennas, clockwise from north, in (−π, π].
pub fn simulate_heading(scenario: &Scenario, drive: &Drive, drive_index: usize) -> Vec<HeadingFix> {
    let settings = &scenario.heading;
    let stream_of = |purpose| stream(scenario.seed, purpose, drive_index as u64, 0);
    let mut rng = stream_of(Purpose::Heading);
    let mut correlated = Correlated::<1>::new(
        stream_of(Purpose::HeadingCorrelated),
        settings.sigma_correlated_deg,
        settings.correlation_s,
    );
    ticks(drive.span_s, settings.rate_hz, 0.0061)
        .map(|time_s| {
            let body = drive.at(time_s - settings.latency_s).world_from_body;
            let truth = heading::heading_rad(&body.rotation);
            let [slow] = correlated.at(time_s);
            let error = normal(&mut rng) * settings.sigma_deg - settings.mounting_offset_deg + slow;
            HeadingFix::new(time_s, heading::wrap(truth + error.to_radians()), None)
        })
        .collect()
}

/// Times at this rate within the span, the first one `phase_s` after its start.
pub(super) fn ticks(
    (start, end): (f64, f64),
    rate_hz: f64,
    phase_s: f64,
) -> impl ExactSizeIterator<Item = f64> {
    let count = ((end - start - phase_s) * rate_hz).floor().max(0.0) as usize;
    (0..count).map(move |k| start + phase_s + k as f64 / rate_hz)
}

#[cfg(test)]
mod tests {
    use super::super::scene::Scene;
    use super::*;
    use crate::statistics::rms;

    #[test]
    fn errors_have_the_expected_size_and_latency_delays_the_time_stamps() {
        let mut scenario = Scenario::demo();
        let drive = Drive::new(&scenario, &Scene::new(&scenario), 1, 10.0);
        let errors = |scenario: &Scenario, latency: f64| {
            rms(simulate_prism(scenario, &drive, 1)
                .into_iter()
                .flat_map(|fix| {
                    let body = drive.at(fix.time_s - latency).world_from_body;
                    let d = fix.position_m
                        - body.translation_m
                        - body.rotation * scenario.lever_arm_m();
                    [d.x, d.y, d.z]
                }))
        };
        // Some 5000 values scatter by 1 %.
        assert!((errors(&scenario, 0.0) / 0.005 - 1.0).abs() < 0.04);
        let headings = simulate_heading(&scenario, &drive, 1);
        let heading_rms = rms(headings.iter().map(|fix| {
            let truth = heading::heading_rad(&drive.at(fix.time_s).world_from_body.rotation);
            heading::wrap(fix.heading_rad - truth).to_degrees()
        }));
        assert!((heading_rms / 0.7 - 1.0).abs() < 0.1, "{heading_rms}");

        scenario.prism.sigma_m = 0.0;
        scenario.prism.latency_s = 0.08;
        assert!(errors(&scenario, 0.0) > 0.003 && errors(&scenario, 0.08) < 1e-12);
        scenario.prism.latency_s = 0.0;
        scenario.prism.incidence_bias_m = 0.003;
        // A vector of 3 mm spreads over three coordinates.
        let biased = errors(&scenario, 0.0);
        assert!(
            (biased / (0.003 / 3f64.sqrt()) - 1.0).abs() < 0.01,
            "{biased}"
        );
    }
}
