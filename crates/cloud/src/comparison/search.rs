//! Two indexed clouds, and the computation of distances at core points.

use std::sync::Arc;

use super::cells::{Cells, Lattice};
use super::checks::{Normals, check, check_core, empty};
use super::cylinder::{self, Cylinder, Heights};
use super::detection::{Sample, level_of_detection};
use super::groups::{Groups, box_around};
use super::moments::Offsets;
use super::normals;
use super::result::{CoreDistance, M3c2};
use super::settings::ComparisonSettings;
use super::window::Window;
use crate::cloud::NeighbourIndex;
use crate::error::{Error, Result};
use crate::geometry::{Vec3, is_finite};
use crate::progress::Progress;

/// Cylinders longer than this many radii to one side are searched in trees: blocks as large as
/// their length would contain too many other points.
const LONGEST_IN_CELLS: f64 = 8.0;

/// Two indexed clouds to compare.
#[derive(Debug, Clone)]
pub struct IndexedClouds {
    settings: ComparisonSettings,
    /// The reference, if normals are to be computed from it.
    for_normals: Option<Arc<Cells>>,
    for_cylinders: Cylinders,
}

/// Reference and compared cloud.
#[derive(Debug, Clone)]
enum Cylinders {
    Cells(Arc<Cells>, Cells),
    Trees(NeighbourIndex, NeighbourIndex),
}

impl IndexedClouds {
    /// Indexes two clouds (metres, in one frame) for a comparison with these settings and this kind
    /// of normals. Points that are not finite are ignored.
    ///
    /// # Errors
    /// [`Error::Data`] if a cloud has no finite point, a radius or distance is not positive and
    /// finite, the registration error is negative, `min_points` is 0, or a direction is zero or not
    /// finite.
    pub fn new(
        reference: &[Vec3],
        compared: &[Vec3],
        normals: Normals<'_>,
        settings: &ComparisonSettings,
    ) -> Result<Self> {
        for (cloud, name) in [(reference, "reference"), (compared, "compared")] {
            if !cloud.iter().any(is_finite) {
                return Err(empty(name));
            }
        }
        Self::of_pieces(reference, compared, normals, settings)
    }

    /// As [`Self::new`], for parts of two clouds, which may be empty: all points within [`reach_m`]
    /// of the core points to come.
    ///
    /// # Errors
    /// As [`Self::new`], except that clouds may have no points.
    pub fn of_pieces(
        reference: &[Vec3],
        compared: &[Vec3],
        normals: Normals<'_>,
        settings: &ComparisonSettings,
    ) -> Result<Self> {
        check(normals, settings)?;
        let ball = match normals {
            Normals::MostPlanar { .. } => settings.normal_radii_m.iter().copied().reduce(f64::max),
            _ => None,
        };
        let radius = settings.cylinder_radius_m;
        let reach = cylinder_reach_m(settings);
        let (for_normals, for_cylinders) = if reach > LONGEST_IN_CELLS * radius {
            let cells =
                || ball.map(|ball| Arc::new(Cells::new(reference, Lattice::reaching(ball))));
            let tree = |cloud: &[Vec3]| {
                let points: Vec<Vec3> = cloud.iter().copied().filter(is_finite).collect();
                NeighbourIndex::new(&points)
            };
            let (cells, trees) =
                rayon::join(cells, || rayon::join(|| tree(reference), || tree(compared)));
            (cells, Cylinders::Trees(trees.0, trees.1))
        } else {
            // One lattice, if it suits both searches.
            let both = ball.map_or(reach, |ball| ball.max(reach));
            let is_shared =
                both <= LONGEST_IN_CELLS * radius && ball.is_none_or(|ball| both <= 3.0 * ball);
            let lattice = Lattice::reaching(if is_shared { both } else { reach });
            let reference_cells = || {
                let cells = Arc::new(Cells::new(reference, lattice));
                let for_normals = ball.map(|ball| {
                    if is_shared {
                        Arc::clone(&cells)
                    } else {
                        Arc::new(Cells::new(reference, Lattice::reaching(ball)))
                    }
                });
                (cells, for_normals)
            };
            let ((reference, for_normals), compared) =
                rayon::join(reference_cells, || Cells::new(compared, lattice));
            (for_normals, Cylinders::Cells(reference, compared))
        };
        Ok(Self {
            settings: settings.clone(),
            for_normals,
            for_cylinders,
        })
    }

    /// Compares the clouds at the points `core` (metres, in their frame).
    ///
    /// The cylinder reaches `max_distance_m` to both sides, at least its radius. Core points
    /// outside the overlap get NaN, which is not an error; see [`super::Statistics::of`] if no core
    /// point has a distance. The caller begins, names and ends the stage, which advances by one for
    /// each core point. The result at a core point does not depend on the number of threads, on
    /// other core points, or on points of the clouds farther away than [`reach_m`], to the last
    /// bit.
    ///
    /// # Errors
    /// [`Error::Data`] if `core` is empty, the numbers of normals and core points differ, or
    /// normals are to be computed and the clouds were indexed without; [`Error::Cancelled`].
    pub fn distances(
        &self,
        core: &[Vec3],
        normals: Normals<'_>,
        progress: &dyn Progress,
    ) -> Result<M3c2> {
        check_core(core, normals)?;
        check(normals, &self.settings)?;
        let normals = match normals {
            Normals::MostPlanar { orientation } => {
                let Some(cells) = &self.for_normals else {
                    return Err(Error::data(
                        "the clouds are indexed for given normals, but no normals are given",
                        "index them for computed normals, or give normals",
                    ));
                };
                self.compute_normals(cells, core, &orientation, progress)
            }
            Normals::Fixed(direction) => vec![(normals::unit(&direction), f64::NAN); core.len()],
            Normals::Given(given) => given
                .iter()
                .map(|normal| (normals::unit(normal), f64::NAN))
                .collect(),
        };
        progress.check()?;
        let core = self.measure_distances(core, &normals, progress);
        progress.check()?;
        Ok(M3c2 { core })
    }

    /// Unit normals and their radii; NaN if there are none. Unusable if the work was cancelled.
    fn compute_normals(
        &self,
        cells: &Cells,
        core: &[Vec3],
        orientation: &Vec3,
        progress: &dyn Progress,
    ) -> Vec<(Vec3, f64)> {
        let radii = &self.settings.normal_radii_m;
        let widest = radii.iter().copied().fold(0.0, f64::max);
        let none = (Vec3::repeat(f64::NAN), f64::NAN);
        Groups::new(core, &cells.lattice).map(
            core.len(),
            none,
            |(window, offsets): &mut (Window, Offsets), block, indices| {
                if progress.is_cancelled() {
                    return vec![none; indices.len()];
                }
                let (low, high) = box_around(core, indices, widest);
                window.gather(cells, block, (&low, &high));
                progress.advance((indices.len() / 2) as u64);
                let mut last = None;
                let find = |&at: &u32| {
                    let point = &core[at as usize];
                    match last {
                        Some((same, normal_and_radius)) if same == *point => {
                            return normal_and_radius;
                        }
                        _ => {}
                    }
                    let normal_and_radius =
                        normals::most_planar(window, point, radii, orientation, offsets)
                            .unwrap_or(none);
                    last = Some((*point, normal_and_radius));
                    normal_and_radius
                };
                indices.iter().map(find).collect()
            },
        )
    }

    /// The result at every core point; unusable if the work was cancelled.
    fn measure_distances(
        &self,
        core: &[Vec3],
        normals: &[(Vec3, f64)],
        progress: &dyn Progress,
    ) -> Vec<CoreDistance> {
        let settings = &self.settings;
        let reach = cylinder_reach_m(settings);
        let lattice = match &self.for_cylinders {
            Cylinders::Cells(reference, _) => reference.lattice,
            Cylinders::Trees(..) => Lattice::reaching(reach),
        };
        let groups = Groups::new(core, &lattice);
        let nothing = CoreDistance::unknown();
        let mut distances = groups.map(
            core.len(),
            nothing,
            |scratch: &mut Scratch, block, indices| {
                if progress.is_cancelled() {
                    return vec![nothing; indices.len()];
                }
                let [reference, compared] = &mut scratch.windows;
                if let Cylinders::Cells(before, after) = &self.for_cylinders {
                    let (low, high) = box_around(core, indices, reach);
                    reference.gather(before, block, (&low, &high));
                    compared.gather(after, block, (&low, &high));
                }
                let (heights, sorted) = (&mut scratch.heights, &mut scratch.sorted);
                let mut sample = |heights: &Heights| {
                    let (heights, weights) = heights.weighted();
                    Sample::new(heights, weights, settings.aggregation, sorted)
                };
                let mut last = None;
                let distance = |&at: &u32| {
                    let (normal, normal_radius_m) = normals[at as usize];
                    // Core points at one place have the same distance.
                    match last {
                        Some((same, distance)) if same == (core[at as usize], normal) => {
                            return distance;
                        }
                        _ => {}
                    }
                    let cylinder = Cylinder::new(core[at as usize], normal, settings);
                    let samples = if normal.x.is_nan() {
                        [Sample::NONE; 2]
                    } else {
                        match &self.for_cylinders {
                            Cylinders::Cells(..) => [&*reference, &*compared].map(|window| {
                                cylinder.heights_in_window(window, heights);
                                sample(heights)
                            }),
                            Cylinders::Trees(before, after) => [before, after].map(|tree| {
                                cylinder.heights_in_tree(tree, heights);
                                sample(heights)
                            }),
                        }
                    };
                    let distance = core_distance(&samples, normal, normal_radius_m, settings);
                    last = Some(((core[at as usize], normal), distance));
                    distance
                };
                let distances: Vec<CoreDistance> = indices.iter().map(distance).collect();
                // Computing normals was the first half of the work.
                let half = match self.for_normals {
                    Some(_) => indices.len() / 2,
                    None => 0,
                };
                progress.advance((indices.len() - half) as u64);
                distances
            },
        );
        for (distance, point) in distances.iter_mut().zip(core) {
            distance.point = *point;
        }
        distances
    }
}

/// Combines the summaries of reference and compared cloud.
fn core_distance(
    [reference, compared]: &[Sample; 2],
    normal: Vec3,
    normal_radius_m: f64,
    settings: &ComparisonSettings,
) -> CoreDistance {
    let enough = reference.count.min(compared.count) >= settings.min_points;
    CoreDistance {
        normal,
        normal_radius_m,
        distance_m: if enough {
            compared.middle - reference.middle
        } else {
            f64::NAN
        },
        level_of_detection_m: level_of_detection(reference, compared, settings),
        reference_spread_m: reference.variance.sqrt(),
        compared_spread_m: compared.variance.sqrt(),
        reference_count: reference.count,
        compared_count: compared.count,
        ..CoreDistance::unknown()
    }
}

/// Buffers reused from group to group.
#[derive(Default)]
struct Scratch {
    windows: [Window; 2],
    heights: Heights,
    sorted: Vec<f64>,
}

/// Distance from a core point to the farthest point of its cylinder, metres.
fn cylinder_reach_m(settings: &ComparisonSettings) -> f64 {
    settings
        .cylinder_radius_m
        .hypot(cylinder::half_length_m(settings))
}

/// Points of the clouds farther from a core point than this do not change its result, to the last
/// bit, metres: a part of a cloud must contain all points up to this distance from its core points.
///
/// It reaches beyond balls and cylinders, because the order of sums depends on all points in the
/// cells that meet them.
pub fn reach_m(settings: &ComparisonSettings) -> f64 {
    let balls = settings.normal_radii_m.iter().copied();
    2.0 * balls.fold(cylinder_reach_m(settings), f64::max)
}
