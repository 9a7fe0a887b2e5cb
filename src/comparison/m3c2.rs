//! Signed distances between two clouds along local normals: M3C2 (Lague, Brodu, Leroux, *Accurate
//! 3D comparison of complex topography with terrestrial laser scanner*, ISPRS Journal 82, 2013).
//!
//! At every core point c:
//!
//! 1. The normal n is that of the reference's points within a radius of c. Of several radii the one
//!    with the largest planarity (λ₂ − λ₃) / λ₁ counts, of equals the first.
//! 2. A cylinder of radius R runs through c along n, to half its length L on both sides. It holds
//!    the points x of a cloud with |n·(x − c)| < L and |(x − c) − n n·(x − c)| ≤ R.
//! 3. With mean, standard deviation (divided by n − 1) and number n·(x − c), sᵢ, nᵢ of the points of
//!    cloud i in the cylinder, the distance is the mean of the compared cloud less that of the
//!    reference, and the level of detection at 95 %
//!
//!    LoD = 1.96 (√(s₁²/n₁ + s₂²/n₂) + registration error).
//!
//! Conventions are those of py4dgeo, so that numbers can be compared one by one; apart from points
//! exactly at a radius around a core point, which count here, and exactly on the borders between
//! the pieces it cuts its cylinders into, which it loses.

use rayon::prelude::*;

use crate::cloud::neighbours::Bounds;
use crate::cloud::{NeighbourIndex, StructureTensor, voxel};
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::project::ComparisonSettings;

/// Core points a thread works on at a time.
const CHUNK: usize = 256;

/// 97.5 % quantile of the normal distribution, as the literature rounds it.
const QUANTILE_95: f64 = 1.96;

/// What was found at one core point.
///
/// NaN stands for what too few points leave open: the distance needs one point of each cloud in
/// the cylinder, a spread two of its cloud, and the level of detection two of each. The normal needs
/// three points that are not on one line; without it all is NaN and the counts are 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoreDistance {
    /// The core point, metres.
    pub point: Vec3,
    /// Unit normal: the direction in which distances are positive.
    pub normal: Vec3,
    /// Radius of the neighbourhood the normal comes from, metres; NaN where it was given.
    pub normal_radius_m: f64,
    /// Mean of the compared cloud less mean of the reference, along the normal, metres.
    pub distance_m: f64,
    /// Level of detection at 95 %, metres: a smaller distance cannot be told from none.
    pub level_of_detection_m: f64,
    /// Standard deviation along the normal of the reference's points in the cylinder, metres.
    pub reference_spread_m: f64,
    /// Standard deviation along the normal of the compared points in the cylinder, metres.
    pub compared_spread_m: f64,
    /// Points of the reference in the cylinder.
    pub reference_count: u32,
    /// Compared points in the cylinder.
    pub compared_count: u32,
}

impl CoreDistance {
    /// Whether the distance exceeds the level of detection; `None` where either is unknown.
    pub fn significant(&self) -> Option<bool> {
        let known = self.distance_m.is_finite() && self.level_of_detection_m.is_finite();
        known.then(|| self.distance_m.abs() > self.level_of_detection_m)
    }
}

/// A comparison: one entry for each core point, in their order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct M3c2 {
    /// What was found at each core point.
    pub core: Vec<CoreDistance>,
}

impl M3c2 {
    /// The finite distances in the order of the core points, metres.
    pub fn distances_m(&self) -> impl Iterator<Item = f64> + '_ {
        self.core
            .iter()
            .map(|core| core.distance_m)
            .filter(|distance| distance.is_finite())
    }
}

/// Core points for comparing with `reference`: its points thinned to `core_spacing_m`.
pub fn core_points(reference: &[Vec3], settings: &ComparisonSettings) -> Vec<Vec3> {
    let kept = voxel::thin(reference, settings.core_spacing_m);
    kept.into_iter()
        .map(|index| reference[index as usize])
        .collect()
}

/// Compares `compared` with `reference` at the points `core` (all metres, in one frame).
///
/// `normals`, one for each core point and of any norm above zero, take the place of those found from
/// the reference. Found normals are flipped to n·`orientation` ≥ 0; given ones stay. The
/// cylinder reaches `max_distance_m` to both sides, at least its radius. Core points
/// outside the overlap get NaN, which is no error; see [`super::Statistics::of`] for none at all.
/// The stage is the caller's to begin, name and end; it advances by one for each core point.
///
/// # Errors
/// [`Error::Data`] where a cloud or `core` is empty, a radius or distance is not positive and finite,
/// the registration error is negative, or there are not as many normals as core points.
pub fn m3c2(
    reference: &[Vec3],
    compared: &[Vec3],
    core: &[Vec3],
    normals: Option<&[Vec3]>,
    settings: &ComparisonSettings,
    orientation: &Vec3,
    progress: &dyn Progress,
) -> Result<M3c2> {
    check(reference, compared, core, normals, settings)?;
    let reference = NeighbourIndex::new(reference);
    let compared = NeighbourIndex::new(compared);
    // Core points near each other look at the same points, which are then in the cache.
    let order = NeighbourIndex::new(core);
    let order = order.spatial_order();

    let found: Vec<CoreDistance> = order
        .par_chunks(CHUNK)
        .flat_map_iter(|chunk| {
            let mut scratch = Scratch::default();
            let distances: Vec<CoreDistance> = chunk
                .iter()
                .map(|&at| {
                    let point = core[at as usize];
                    let (normal, normal_radius_m) = match normals {
                        Some(normals) => (normals[at as usize].normalize(), f64::NAN),
                        None => most_planar_normal(
                            &reference,
                            &point,
                            &settings.normal_radii_m,
                            orientation,
                            &mut scratch.near,
                        )
                        .unwrap_or((Vec3::repeat(f64::NAN), f64::NAN)),
                    };
                    let cylinder = Cylinder::new(point, normal, settings);
                    let before = cylinder.sample(&reference, &mut scratch.along);
                    let after = cylinder.sample(&compared, &mut scratch.along);
                    CoreDistance {
                        point,
                        normal,
                        normal_radius_m,
                        distance_m: after.mean - before.mean,
                        level_of_detection_m: QUANTILE_95
                            * ((before.variance_of_mean() + after.variance_of_mean()).sqrt()
                                + settings.registration_error_m),
                        reference_spread_m: before.variance.sqrt(),
                        compared_spread_m: after.variance.sqrt(),
                        reference_count: before.count,
                        compared_count: after.count,
                    }
                })
                .collect();
            progress.advance(chunk.len() as u64);
            distances
        })
        .collect();

    let mut in_order = found.clone();
    for (&at, distance) in order.iter().zip(found) {
        in_order[at as usize] = distance;
    }
    Ok(M3c2 { core: in_order })
}

fn check(
    reference: &[Vec3],
    compared: &[Vec3],
    core: &[Vec3],
    normals: Option<&[Vec3]>,
    settings: &ComparisonSettings,
) -> Result<()> {
    let clouds = [
        ("reference", reference),
        ("compared", compared),
        ("core point", core),
    ];
    for (name, cloud) in clouds {
        if cloud.is_empty() {
            return Err(Error::data(
                format!("the {name} cloud of the comparison holds no points"),
                "check the file, and the filters and time spans that were applied to it",
            ));
        }
    }
    if let Some(normals) = normals
        && normals.len() != core.len()
    {
        return Err(Error::data(
            format!(
                "{} normals were given for {} core points",
                normals.len(),
                core.len()
            ),
            "give one normal for each core point, or none",
        ));
    }
    let mut lengths = vec![
        ("cylinder_radius_m", settings.cylinder_radius_m),
        ("max_distance_m", settings.max_distance_m),
    ];
    lengths.extend(
        settings
            .normal_radii_m
            .iter()
            .map(|&radius| ("normal_radii_m", radius)),
    );
    let bad_length = lengths
        .iter()
        .find(|(_, length)| !(*length > 0.0 && length.is_finite()));
    if let Some((name, length)) = bad_length {
        return Err(Error::data(
            format!("{name} of the comparison is {length} m"),
            "give a length above zero",
        ));
    }
    let registration = settings.registration_error_m;
    if !(registration >= 0.0 && registration.is_finite()) {
        return Err(Error::data(
            format!("registration_error_m of the comparison is {registration} m"),
            "give zero or a length above zero",
        ));
    }
    if normals.is_none() && settings.normal_radii_m.is_empty() {
        return Err(Error::data(
            "the comparison has neither radii for normals nor normals",
            "give normal_radii_m at least one radius",
        ));
    }
    Ok(())
}

/// Buffers that are used again from core point to core point.
#[derive(Default)]
struct Scratch {
    near: Vec<(f64, Vec3)>,
    along: Vec<f64>,
}

/// The normal of the most planar neighbourhood, and its radius. `None` where none of them has three
/// points that span a plane.
fn most_planar_normal(
    cloud: &NeighbourIndex,
    point: &Vec3,
    radii: &[f64],
    orientation: &Vec3,
    near: &mut Vec<(f64, Vec3)>,
) -> Option<(Vec3, f64)> {
    let widest = radii.iter().copied().fold(0.0, f64::max);
    near.clear();
    cloud.visit(
        |bounds| bounds.squared_distance(point) <= widest * widest,
        |_, neighbour| {
            let squared = (neighbour - point).norm_squared();
            if squared <= widest * widest {
                near.push((squared, *neighbour));
            }
        },
    );
    let mut best: Option<(f64, Vec3, f64)> = None;
    for &radius in radii {
        let inside = near
            .iter()
            .filter(|(squared, _)| *squared <= radius * radius);
        let tensor = StructureTensor::from_points(inside.map(|(_, neighbour)| neighbour));
        if tensor.count < 3 {
            continue;
        }
        let eigen = tensor.eigen();
        let planarity = eigen.planarity();
        if planarity > best.map_or(0.0, |(most, _, _)| most) {
            best = Some((planarity, eigen.vectors.column(2).into_owned(), radius));
        }
    }
    best.map(|(_, normal, radius)| {
        (
            if normal.dot(orientation) < 0.0 {
                -normal
            } else {
                normal
            },
            radius,
        )
    })
}

/// Open at its ends, closed at its side.
struct Cylinder {
    centre: Vec3,
    axis: Vec3,
    radius_m: f64,
    half_length_m: f64,
}

/// Mean and variance along the axis of the points in a cylinder.
struct Sample {
    count: u32,
    mean: f64,
    variance: f64,
}

impl Sample {
    fn variance_of_mean(&self) -> f64 {
        self.variance / f64::from(self.count)
    }
}

impl Cylinder {
    fn new(centre: Vec3, axis: Vec3, settings: &ComparisonSettings) -> Self {
        Self {
            centre,
            axis,
            radius_m: settings.cylinder_radius_m,
            half_length_m: settings.max_distance_m.max(settings.cylinder_radius_m),
        }
    }

    /// Whether the box may hold points of the cylinder: false only where surely none is inside,
    /// with room for the rounding of the test itself.
    fn may_meet(&self, bounds: &Bounds) -> bool {
        const ROOM: f64 = 1.0 + 1e-12;
        let middle = ((bounds.low - self.centre) + (bounds.high - self.centre)) / 2.0;
        let half = (bounds.high - bounds.low) / 2.0;
        let rounding = 1e-12 * (middle.norm() + half.norm());
        let along = middle.dot(&self.axis);
        let half_along = half.dot(&self.axis.abs());
        if along.abs() > (half_along + self.half_length_m) * ROOM + rounding {
            return false;
        }
        let across = (middle - self.axis * along).norm();
        across <= (half.norm() + self.radius_m) * ROOM + rounding
    }

    fn sample(&self, cloud: &NeighbourIndex, along: &mut Vec<f64>) -> Sample {
        along.clear();
        cloud.visit(
            |bounds| self.may_meet(bounds),
            |_, point| {
                let offset = point - self.centre;
                let height = offset.dot(&self.axis);
                let across = offset - self.axis * height;
                let inside = height.abs() < self.half_length_m
                    && across.norm_squared() <= self.radius_m * self.radius_m;
                if inside {
                    along.push(height);
                }
            },
        );
        // 0/0 is the NaN that the mean of no points and the variance of one point should be.
        let n = along.len() as f64;
        let mean = along.iter().sum::<f64>() / n;
        let squares = along
            .iter()
            .map(|height| (height - mean).powi(2))
            .sum::<f64>();
        Sample {
            count: along.len() as u32,
            mean,
            variance: if along.is_empty() {
                f64::NAN
            } else {
                squares / (n - 1.0)
            },
        }
    }
}
