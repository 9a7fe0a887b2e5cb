//! The scales of a comparison, measured where they are not given.
//!
//! Lague, Brodu and Leroux (2013) choose them by the roughness of the surface and the number of
//! points: the neighbourhood of a normal is 20 to 25 times as wide as the surface is rough, which
//! makes the normal independent of the roughness, and a cylinder contains enough points, 20 or so,
//! for its mean and its level of detection. Here:
//!
//! - **Cylinder**: its radius is the one within which half of the reference, and half of the
//!   compared cloud, by area, have [`NEAREST`] points of that cloud. The larger of the two.
//! - **Normals**: the smallest radius, from twice that of the cylinder on in steps of √2, whose
//!   neighbourhoods are at least 25 times as wide as they are rough, in half of the reference. If no
//!   radius is, as in a canopy, the one that comes closest.
//! - **Depth**: half the length of the cylinder is five radii, as of this program's settings for
//!   scans of a field, or twice the distance to the other cloud that nine of ten places of a cloud
//!   keep, whichever is more. It is that along the normal, as the comparison measures it: places
//!   without a point of the other cloud in the cylinder have no counterpart there and are not
//!   counted. Of the two clouds, the one with the smaller distance counts.
//! - **Core points** are a diameter of the cylinder apart, so that neighbours share no points.
//!
//! Each is rounded up to two digits, so that the same numbers can be given again.

use serde::Serialize;

use super::places::{Around, NEAREST, Places};
use super::settings::{Aggregation, ComparisonSettings, Detection};
use crate::cloud::Stream;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::statistics::{median, quantile};

/// The smallest radius of a normal over that of the cylinder, as in [`ComparisonSettings::default`]:
/// the normal is that of a larger surface than the one it measures.
const NORMAL_OVER_RADIUS: f64 = 2.0;
/// Width of a neighbourhood over its roughness from which its normal can be trusted (Lague et al.:
/// 20 to 25).
const WIDTH_OVER_ROUGHNESS: f64 = 25.0;
/// Fewest points of a neighbourhood whose roughness counts.
const LEAST_POINTS: usize = 10;
/// Half the length of a cylinder over its radius, as in [`ComparisonSettings::default`].
const DEPTH_OVER_RADIUS: f64 = 5.0;
/// Half the length of a cylinder over the distance of the clouds.
const DEPTH_OVER_DISTANCE: f64 = 2.0;
/// The part of the places whose distance the cylinder must reach.
const REACHED: f64 = 0.9;
/// The part of the places that must be near the other cloud before their distances count: fewer are
/// chance.
const LEAST_NEAR: f64 = 0.1;
/// Points for each place, so that neighbourhoods of several sizes fit between places.
const POINTS_A_PLACE: u64 = 2000;
/// Fewest places that are asked for.
const FEWEST_PLACES: u64 = 64;
/// Most places.
const MOST_PLACES: u64 = 1024;
/// Steps of √2 from the largest neighbourhood that is measured to the smallest.
const STEPS: i32 = 16;

/// Scales of a comparison, metres; those that are `None` follow from the clouds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scales {
    /// See [`ComparisonSettings::core_spacing_m`].
    pub core_spacing_m: Option<f64>,
    /// See [`ComparisonSettings::normal_radii_m`].
    pub normal_radii_m: Option<Vec<f64>>,
    /// See [`ComparisonSettings::cylinder_radius_m`].
    pub cylinder_radius_m: Option<f64>,
    /// See [`ComparisonSettings::max_distance_m`].
    pub max_distance_m: Option<f64>,
}

/// What a comparison computes because it is not given.
#[derive(Debug, Clone, Copy)]
pub struct Computed {
    /// Core points, which need a spacing.
    pub core_points: bool,
    /// Normals, which need radii.
    pub normals: bool,
}

impl Scales {
    /// Whether one is not given that the comparison needs.
    pub fn lack(&self, computed: Computed) -> bool {
        self.cylinder_radius_m.is_none()
            || self.max_distance_m.is_none()
            || (computed.core_points && self.core_spacing_m.is_none())
            || (computed.normals && self.normal_radii_m.is_none())
    }
}

/// Settings of a comparison that may leave scales open.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpenSettings {
    /// The scales.
    pub scales: Scales,
    /// See [`ComparisonSettings::registration_error_m`].
    pub registration_error_m: f64,
    /// See [`ComparisonSettings::aggregation`].
    pub aggregation: Aggregation,
    /// See [`ComparisonSettings::detection`].
    pub detection: Detection,
    /// See [`ComparisonSettings::one_sided`].
    pub one_sided: bool,
    /// See [`ComparisonSettings::min_points`]; 1 if `None`.
    pub min_points: Option<u32>,
}

impl From<ComparisonSettings> for OpenSettings {
    /// With all scales given.
    fn from(settings: ComparisonSettings) -> Self {
        Self {
            scales: Scales {
                core_spacing_m: Some(settings.core_spacing_m),
                normal_radii_m: Some(settings.normal_radii_m),
                cylinder_radius_m: Some(settings.cylinder_radius_m),
                max_distance_m: Some(settings.max_distance_m),
            },
            registration_error_m: settings.registration_error_m,
            aggregation: settings.aggregation,
            detection: settings.detection,
            one_sided: settings.one_sided,
            min_points: Some(settings.min_points),
        }
    }
}

impl OpenSettings {
    /// The settings with these scales where none are given, or those of
    /// [`ComparisonSettings::default`]. A given radius of the cylinder decides the spacing and the
    /// depth that are not given.
    pub fn closed(&self, measured: Option<&MeasuredScales>) -> ComparisonSettings {
        let default = ComparisonSettings::default();
        let given = &self.scales;
        let radius_m = given
            .cylinder_radius_m
            .unwrap_or_else(|| measured.map_or(default.cylinder_radius_m, |m| m.cylinder_radius_m));
        let depth_m = |measured: &MeasuredScales| {
            let apart_m = measured.distance_m.unwrap_or(0.0);
            two_digits((DEPTH_OVER_RADIUS * radius_m).max(DEPTH_OVER_DISTANCE * apart_m))
        };
        ComparisonSettings {
            core_spacing_m: given.core_spacing_m.unwrap_or_else(|| {
                measured.map_or(default.core_spacing_m, |_| two_digits(2.0 * radius_m))
            }),
            normal_radii_m: given.normal_radii_m.clone().unwrap_or_else(|| {
                measured.map_or(default.normal_radii_m, |m| vec![m.normal_radius_m])
            }),
            cylinder_radius_m: radius_m,
            max_distance_m: given
                .max_distance_m
                .unwrap_or_else(|| measured.map_or(default.max_distance_m, depth_m)),
            registration_error_m: self.registration_error_m,
            aggregation: self.aggregation,
            detection: self.detection,
            one_sided: self.one_sided,
            min_points: self.min_points.unwrap_or(default.min_points),
        }
    }
}

/// What two clouds say about the scales of their comparison, metres.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MeasuredScales {
    /// Edge of the square of surface for each point of the reference.
    pub reference_spacing_m: f64,
    /// The same of the compared cloud.
    pub compared_spacing_m: f64,
    /// Radius of the cylinder.
    pub cylinder_radius_m: f64,
    /// Radius of the neighbourhood of a normal.
    pub normal_radius_m: f64,
    /// Standard deviation of the reference about its plane in such a neighbourhood; `None` if none
    /// is measured at this size.
    pub roughness_m: Option<f64>,
    /// Distance along the normal to the other cloud that nine of ten places of a cloud keep, the
    /// smaller of the two; `None` if too few have a counterpart.
    pub distance_m: Option<f64>,
}

/// A cloud whose spacing is to be measured.
pub struct StreamedCloud<'a> {
    /// Number of its points.
    pub count: u64,
    /// Its points, which are streamed three times.
    pub points: &'a mut Stream<'a>,
}

impl StreamedCloud<'_> {
    fn places(&mut self) -> Result<Places> {
        let most = (self.count / POINTS_A_PLACE).clamp(FEWEST_PLACES, MOST_PLACES);
        Places::of(self.points, most as usize)
    }
}

impl MeasuredScales {
    /// Measures two clouds, in one frame. Points that are not finite are ignored. `None` if a cloud
    /// has no other.
    ///
    /// # Errors
    /// Those of the streams.
    pub fn of(
        mut reference: StreamedCloud<'_>,
        mut compared: StreamedCloud<'_>,
    ) -> Result<Option<Self>> {
        let places = reference.places()?;
        let radii_m = radii_up_to(places.cell_m);
        let around = places.look(reference.points, &radii_m)?;
        let others = compared.places()?;
        let others_radii_m = radii_up_to(others.cell_m);
        let around_others = others.look(compared.points, &others_radii_m)?;
        let (Some(reference_m), Some(compared_m)) = (
            radius_m(&around, places.cell_m),
            radius_m(&around_others, others.cell_m),
        ) else {
            return Ok(None);
        };
        let cylinder_radius_m = two_digits(reference_m.max(compared_m));
        let least_m = NORMAL_OVER_RADIUS * cylinder_radius_m;
        let normal = normal_radius(&around, &radii_m, least_m);
        let normal_radius_m = normal.map_or(least_m, |(radius_m, _)| radius_m);
        let axes = normals(&around, &radii_m, normal_radius_m);
        let across_m = places.along(compared.points, &axes, cylinder_radius_m)?;
        let axes = normals(&around_others, &others_radii_m, normal_radius_m);
        let back_m = others.along(reference.points, &axes, cylinder_radius_m)?;
        let apart_m = [across_m, back_m].map(|apart_m| distance_m(&apart_m));
        Ok(Some(Self {
            reference_spacing_m: spacing_m(reference_m),
            compared_spacing_m: spacing_m(compared_m),
            cylinder_radius_m,
            normal_radius_m: two_digits(normal_radius_m),
            roughness_m: normal.map(|(_, roughness_m)| roughness_m),
            distance_m: apart_m.into_iter().flatten().reduce(f64::min),
        }))
    }
}

/// Edge of the square of surface for each point, if [`NEAREST`] points lie in a disc of this radius.
fn spacing_m(radius_m: f64) -> f64 {
    radius_m * (std::f64::consts::PI / NEAREST as f64).sqrt()
}

/// The radius within which half of the places have [`NEAREST`] points, at most `reach_m`.
fn radius_m(around: &[Around], reach_m: f64) -> Option<f64> {
    median(
        around
            .iter()
            .map(|place| place.radius_m().unwrap_or(reach_m)),
    )
}

/// Radii in steps of √2 up to this one, ascending.
fn radii_up_to(largest_m: f64) -> Vec<f64> {
    let steps = (0..=STEPS).rev();
    steps
        .map(|step| largest_m * 0.5f64.powf(f64::from(step) / 2.0))
        .collect()
}

/// The radius for normals, at least `least_m`, and the roughness there; `None` if no neighbourhood
/// that large was measured.
fn normal_radius(around: &[Around], radii_m: &[f64], least_m: f64) -> Option<(f64, f64)> {
    let roughness_m: Vec<Vec<f64>> = around
        .iter()
        .map(|place| place.roughness_m(LEAST_POINTS))
        .collect();
    let at = |(i, &radius_m): (usize, &f64)| {
        let known = roughness_m.iter().map(|place| place[i]);
        let middle_m = median(known.filter(|roughness| roughness.is_finite()))?;
        Some((radius_m, middle_m))
    };
    let large_enough = |radius_m: &f64| *radius_m >= least_m;
    let measured = radii_m.iter().enumerate().filter_map(at);
    let candidates: Vec<(f64, f64)> = measured
        .filter(|(radius, _)| large_enough(radius))
        .collect();
    // Without roughness, the ratio is infinite.
    let width_over_roughness = |(radius_m, roughness_m): &(f64, f64)| 2.0 * radius_m / roughness_m;
    let trusted = |candidate: &&(f64, f64)| width_over_roughness(candidate) >= WIDTH_OVER_ROUGHNESS;
    let first = candidates.iter().find(trusted);
    let closest = || {
        let by_ratio = |a: &&(f64, f64), b: &&(f64, f64)| {
            width_over_roughness(a).total_cmp(&width_over_roughness(b))
        };
        candidates.iter().max_by(by_ratio)
    };
    first.or_else(closest).copied()
}

/// Normals of the neighbourhoods with the largest radius up to `radius_m`.
fn normals(around: &[Around], radii_m: &[f64], radius_m: f64) -> Vec<Option<Vec3>> {
    let within = radii_m.partition_point(|known_m| *known_m <= radius_m);
    let largest = within.saturating_sub(1);
    around.iter().map(|place| place.normal(largest)).collect()
}

/// The distance that [`REACHED`] of the places with a counterpart keep; `None` if fewer than
/// [`LEAST_NEAR`] have one.
fn distance_m(apart_m: &[Option<f64>]) -> Option<f64> {
    let mut near_m: Vec<f64> = apart_m.iter().flatten().copied().collect();
    near_m.sort_unstable_by(f64::total_cmp);
    let enough = near_m.len() as f64 >= LEAST_NEAR * apart_m.len() as f64;
    (enough && !near_m.is_empty()).then(|| quantile(&near_m, REACHED))
}

/// Rounded up to two significant digits.
fn two_digits(length_m: f64) -> f64 {
    let digits = 1 - length_m.log10().floor() as i32;
    // Dividing by a whole power of ten gives the number that its digits read as.
    let rounded = if digits >= 0 {
        let unit = 10f64.powi(digits);
        (length_m * unit - 1e-9).ceil() / unit
    } else {
        let unit = 10f64.powi(-digits);
        (length_m / unit - 1e-9).ceil() * unit
    };
    if rounded > 0.0 && rounded.is_finite() {
        rounded
    } else {
        length_m
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// A square of 200 points on each side, this far apart, with uniform noise up to `noise_m`.
    fn square(spacing_m: f64, up_m: f64, noise_m: f64) -> Vec<Vec3> {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let point = |i: usize| {
            let noise = rng.random_range(-1.0..1.0) * noise_m;
            let [x, y] = [i % 200, i / 200].map(|n| n as f64 * spacing_m);
            Vec3::new(362_000.0 + x, 5_157_000.0 + y, up_m + noise)
        };
        (0..40_000).map(point).collect()
    }

    fn measure(reference: &[Vec3], compared: &[Vec3], chunk: usize) -> MeasuredScales {
        let stream = |cloud: &'_ [Vec3]| {
            let cloud = cloud.to_vec();
            move |each: &mut dyn FnMut(&[Vec3]) -> Result<()>| {
                cloud.chunks(chunk).try_for_each(each)
            }
        };
        let [mut a, mut b] = [stream(reference), stream(compared)];
        let clouds = [(reference.len(), &mut a), (compared.len(), &mut b)];
        let [reference, compared] = clouds.map(|(count, points)| StreamedCloud {
            count: count as u64,
            points,
        });
        MeasuredScales::of(reference, compared).unwrap().unwrap()
    }

    #[test]
    fn scales_follow_the_spacing_of_the_points() {
        for spacing_m in [0.002, 0.05, 1.0] {
            let noise_m = 0.1 * spacing_m;
            let reference = square(spacing_m, 0.0, noise_m);
            let compared = square(2.0 * spacing_m, 0.5 * spacing_m, noise_m);
            let found = measure(&reference, &compared, 1000);
            // On a lattice, many points have the same distance.
            let near = |found: f64, known: f64| (found / known - 1.0).abs() < 0.15;
            assert!(near(found.reference_spacing_m, spacing_m), "{found:?}");
            assert!(near(found.compared_spacing_m, 2.0 * spacing_m), "{found:?}");
            // A disc with 20 points of the sparser cloud.
            let radius_m = 2.0 * spacing_m * (20.0 / std::f64::consts::PI).sqrt();
            assert!(near(found.cylinder_radius_m, radius_m), "{found:?}");
            let settings = OpenSettings::default().closed(Some(&found));
            assert_eq!(settings.cylinder_radius_m, found.cylinder_radius_m);
            assert_eq!(settings.normal_radii_m, [found.normal_radius_m]);
            assert!(
                near(settings.core_spacing_m, 2.0 * radius_m),
                "{settings:?}"
            );
            assert!(
                near(settings.max_distance_m, 5.0 * radius_m),
                "{settings:?}"
            );
            // It does not matter how the points arrive.
            assert_eq!(measure(&reference, &compared, 777), found);
        }
    }

    #[test]
    fn a_rougher_surface_has_wider_neighbourhoods() {
        let [smooth, rough] = [0.0002, 0.02].map(|noise_m| {
            let cloud = square(0.01, 0.0, noise_m);
            measure(&cloud, &cloud, 1000)
        });
        // A uniform distribution over ± 20 mm has a standard deviation of 20 mm / √3.
        let roughness_m = 0.02 / 3f64.sqrt();
        assert!(
            (rough.roughness_m.unwrap() / roughness_m - 1.0).abs() < 0.1,
            "{rough:?}"
        );
        let width_m = 2.0 * rough.normal_radius_m;
        assert!(
            (25.0 * roughness_m * 0.9..40.0 * roughness_m).contains(&width_m),
            "{rough:?}"
        );
        assert!(
            smooth.normal_radius_m < 3.0 * smooth.cylinder_radius_m,
            "{smooth:?}"
        );
    }

    #[test]
    fn cylinders_reach_clouds_that_lie_apart() {
        let reference = square(0.01, 0.0, 0.001);
        let found = measure(&reference, &square(0.01, 0.2, 0.001), 1000);
        assert!((found.distance_m.unwrap() - 0.2).abs() < 0.01, "{found:?}");
        let settings = OpenSettings::default().closed(Some(&found));
        assert!(
            (0.39..0.43).contains(&settings.max_distance_m),
            "{settings:?}"
        );
        let elsewhere: Vec<Vec3> = reference.iter().map(|p| p * 3.0).collect();
        assert_eq!(measure(&reference, &elsewhere, 1000).distance_m, None);
    }

    #[test]
    fn a_reference_that_extends_beyond_the_cloud_does_not_lengthen_cylinders() {
        let reference = square(0.01, 0.0, 0.001);
        let is_covered = |p: &Vec3| p.x < 362_000.0 + 1.4;
        let covered: Vec<Vec3> = reference.iter().copied().filter(is_covered).collect();
        let found = measure(&reference, &covered, 1000);
        assert!(found.distance_m.unwrap() < 0.02, "{found:?}");
    }

    #[test]
    fn clouds_that_each_extend_beyond_the_other_do_not_lengthen_cylinders() {
        let all = square(0.01, 0.0, 0.001);
        let part = |low: f64, high: f64| -> Vec<Vec3> {
            let is_in = |p: &&Vec3| (low..high).contains(&(p.x - 362_000.0));
            all.iter().filter(is_in).copied().collect()
        };
        let found = measure(&part(0.0, 1.4), &part(0.6, 2.0), 1000);
        assert!(found.distance_m.unwrap() < 0.02, "{found:?}");
    }

    #[test]
    fn given_scales_hold_and_decide_those_that_depend_on_them() {
        let cloud = square(0.01, 0.0, 0.001);
        let found = measure(&cloud, &cloud, 1000);
        let given = OpenSettings {
            scales: Scales {
                cylinder_radius_m: Some(0.3),
                normal_radii_m: Some(vec![0.7, 0.8]),
                ..Scales::default()
            },
            min_points: Some(4),
            ..OpenSettings::default()
        };
        let settings = given.closed(Some(&found));
        let expected = ComparisonSettings {
            core_spacing_m: 0.6,
            normal_radii_m: vec![0.7, 0.8],
            cylinder_radius_m: 0.3,
            max_distance_m: 1.5,
            min_points: 4,
            ..ComparisonSettings::default()
        };
        assert_eq!(settings, expected);
        assert_eq!(
            OpenSettings::from(expected.clone()).closed(Some(&found)),
            expected
        );
        assert_eq!(
            OpenSettings::default().closed(None),
            ComparisonSettings::default()
        );
    }

    #[test]
    fn lengths_are_rounded_up_to_two_digits() {
        let cases = [
            (0.02523, 0.026),
            (0.02, 0.02),
            (1.0001, 1.1),
            (123.0, 130.0),
            (0.6 + 1e-16, 0.6),
            (99.5, 100.0),
        ];
        for (given, known) in cases {
            assert_eq!(two_digits(given), known);
        }
    }
}
