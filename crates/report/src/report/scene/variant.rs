//! A way in which the points are placed, with the remaining distances.

use rayon::prelude::*;

use super::Variant;
use super::distances::Distances;
use super::input::{Input, View};
use super::quantised::{Bytes, Track};
use super::select::Chosen;
use crate::cloud::{NeighbourIndex, Neighbourhood};
use crate::comparison::{Against, Agreement};
use crate::geometry::Vec3;
use crate::number::nice_above;
use crate::progress::Silent;
use crate::statistics::quantile;

/// Quantile of the absolute distances that the largest byte stands for.
const REACHED: f64 = 0.995;
/// Points of a neighbourhood whose omnivariance is shown.
const NEIGHBOURS: usize = 16;

/// The view of a drive with the poses number `set`.
pub fn variant(
    view: &View,
    set: usize,
    selected: &[Vec<Chosen>],
    input: &Input,
    step_m: f64,
) -> Variant {
    let moves = !view.bending.is_empty();
    let moving = selected.iter().enumerate().filter(|_| moves);
    let moving = moving.map(|(scanner, profiles)| {
        let mut track = Track::default();
        for (profile, _) in profiles {
            let mounting = view.mounting(scanner, profile.time_s);
            track.push(&mounting, &Vec3::zeros(), step_m);
        }
        track
    });
    let known: Vec<Vec<[f64; 2]>> = selected
        .par_iter()
        .enumerate()
        .map(|(scanner, profiles)| distances(view, set, scanner, profiles, input))
        .collect();
    let limit = |which: usize| {
        let all = known.iter().flatten().map(|values| values[which].abs());
        let mut sizes: Vec<f64> = all.filter(|size| size.is_finite()).collect();
        sizes.sort_by(f64::total_cmp);
        nice_above(quantile(&sizes, REACHED).max(1e-4))
    };
    let (most, most_detected) = (limit(0), limit(1));
    let bytes = |which: usize, ends: (f64, f64)| -> Vec<Bytes> {
        let one = |values: &Vec<[f64; 2]>| Bytes::of(ends, values.iter().map(|v| v[which]));
        known.iter().map(one).collect()
    };
    let omnivariances = graded(&omnivariances(view, set, selected));
    let sigma_at = |time_s: f64| {
        let sigma = view.trajectory.sigma_at(time_s);
        sigma.map_or(f64::NAN, |sigma| sigma.position_m.norm())
    };
    let pose_sigmas = selected.par_iter().map(|profiles| {
        let each = profiles.iter().flat_map(|(profile, points)| {
            std::iter::repeat_n(sigma_at(profile.time_s), points.len())
        });
        each.collect()
    });
    let pose_sigmas: Vec<Vec<f64>> = pose_sigmas.collect();
    Variant {
        kind: view.kind,
        poses: set,
        mountings: view.mountings.to_vec(),
        moving: moving.collect(),
        distances: bytes(0, (-most, most)),
        detections: bytes(1, (0.0, most_detected)),
        omnivariances,
        pose_sigmas: graded(&pose_sigmas),
    }
}

/// Non-negative values as bytes, from 0 to a value that almost none exceeds.
fn graded(fans: &[Vec<f64>]) -> Vec<Bytes> {
    let mut sizes: Vec<f64> = fans.iter().flatten().copied().collect();
    sizes.retain(|size| size.is_finite());
    sizes.sort_by(f64::total_cmp);
    let most = if sizes.is_empty() {
        1.0
    } else {
        nice_above(quantile(&sizes, REACHED).max(1e-6))
    };
    let one = |fan: &Vec<f64>| Bytes::of((0.0, most), fan.iter().copied());
    fans.iter().map(one).collect()
}

/// The omnivariance of the points around each point of each scanner, mm²: the quantity that a calibration minimises.
fn omnivariances(view: &View, set: usize, selected: &[Vec<Chosen>]) -> Vec<Vec<f64>> {
    let mut places = Vec::new();
    for (scanner, profiles) in selected.iter().enumerate() {
        for (profile, points) in profiles {
            let pose = profile.poses[set] * view.mounting(scanner, profile.time_s);
            places.extend(points.iter().map(|point| pose.map(&point.position_m)));
        }
    }
    let index = NeighbourIndex::new(&places);
    let neighbourhood = Neighbourhood::Nearest(NEIGHBOURS);
    let omnivariances =
        index.surroundings_of_all(&index, neighbourhood, &Silent, |_, surroundings| {
            1e6 * surroundings.tensor.omnivariance()
        });
    // Silent progress cannot be cancelled, so there is always a result.
    let mut omnivariances = omnivariances.unwrap_or_default().into_iter();
    let counts = selected
        .iter()
        .map(|profiles| profiles.iter().map(|(_, points)| points.len()).sum());
    counts
        .map(|count: usize| omnivariances.by_ref().take(count).collect())
        .collect()
}

/// Distance and level of detection at each point of a scanner, metres; NaN where they are unknown.
fn distances(
    view: &View,
    set: usize,
    scanner: usize,
    profiles: &[Chosen],
    input: &Input,
) -> Vec<[f64; 2]> {
    let name = input.scans[scanner].name;
    let wanted = |agreement: &&Agreement| {
        agreement.scanner == name
            && match &agreement.against {
                Against::Reference => true,
                Against::Scanner(_) => input.reference.is_empty(),
            }
    };
    let Some(agreement) = input.agreements.under(view.kind).find(wanted) else {
        let points = profiles.iter().map(|(_, points)| points.len());
        return vec![[f64::NAN; 2]; points.sum()];
    };
    let settings = input.settings;
    let (reach_m, most_m) = (settings.core_spacing_m, settings.max_distance_m);
    let distances = Distances::new(&agreement.distances, reach_m, most_m);
    let each = profiles.par_iter().flat_map_iter(|(profile, points)| {
        let pose = profile.poses[set] * view.mounting(scanner, profile.time_s);
        let at = points
            .iter()
            .map(|point| distances.at(&pose.map(&point.position_m)));
        at.collect::<Vec<_>>()
    });
    each.collect()
}
