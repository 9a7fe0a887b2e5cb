//! Two clouds, ready to be searched around core points, and the search.

use std::sync::Arc;

use super::cells::{Cells, Lattice};
use super::cylinder::{self, Cylinder, Heights};
use super::detection::{Sample, level_of_detection};
use super::groups::{Groups, box_around};
use super::m3c2::{CoreDistance, M3c2, Normals, check, check_core, empty};
use super::moments::Offsets;
use super::normals;
use super::window::Window;
use crate::cloud::NeighbourIndex;
use crate::comparison::ComparisonSettings;
use crate::error::{Error, Result};
use crate::geometry::{Vec3, is_finite};
use crate::progress::Progress;

/// Cylinders longer than this many radii to one side are searched for in trees: blocks as large as
/// they are long would hold too much beside them.
const LONGEST_IN_CELLS: f64 = 8.0;

/// Two clouds to compare, ready to be searched.
#[derive(Debug, Clone)]
pub struct IndexedClouds {
    settings: ComparisonSettings,
    /// The reference, where normals are to be found from it.
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
    /// Indexes two clouds (metres, in one frame) for comparing them with these settings, with normals
    /// of this kind. Points that are not finite count as missing.
    ///
    /// # Errors
    /// [`Error::Data`] where a cloud has no finite point, a radius or distance is not positive and
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

    /// As [`Self::new`], of pieces of two clouds, which may hold no points: all those within
    /// [`reach_m`] of the core points to come.
    ///
    /// # Errors
    /// As there, but for clouds without points.
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
            // One lattice where it suits both searches.
            let both = ball.map_or(reach, |ball| ball.max(reach));
            let is_shared =
                both <= LONGEST_IN_CELLS * radius && ball.is_none_or(|ball| both <= 3.0 * ball);
            let lattice = Lattice::reaching(if is_shared { both } else { reach });
            let reference_cells = || {
                let cells = Arc::new(Cells::new(reference, lattice));
                let for_normals = ball.map(|ball| match is_shared {
                    true => Arc::clone(&cells),
                    false => Arc::new(Cells::new(reference, Lattice::reaching(ball))),
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
    /// The cylinder reaches `max_distance_m` to both sides, at least its radius. Core points outside
    /// the overlap get NaN, which is no error; see [`super::Statistics::of`] for none at all. The
    /// stage is the caller's to begin, name and end; it advances by one for each core point. What is
    /// found at a core point depends neither on the number of threads nor on other core points nor
    /// on points of the clouds farther away than [`reach_m`], to the last bit.
    ///
    /// # Errors
    /// [`Error::Data`] where `core` is empty, there are not as many normals as core points, or
    /// normals are to be found and the clouds were indexed without.
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
                        "the clouds are indexed for given normals and none are given",
                        "index them for normals that are found",
                    ));
                };
                self.find_normals(cells, core, &orientation, progress)
            }
            Normals::Fixed(direction) => vec![(normals::unit(&direction), f64::NAN); core.len()],
            Normals::Given(given) => given
                .iter()
                .map(|normal| (normals::unit(normal), f64::NAN))
                .collect(),
        };
        // Finding normals is the first half of the work.
        let done = |count: usize| {
            let half = if self.for_normals.is_some() {
                count / 2
            } else {
                0
            };
            progress.advance((count - half) as u64);
        };
        Ok(M3c2 {
            core: self.measure(core, &normals, done),
        })
    }

    /// Unit normals and the radii they come from; NaN where there are none.
    fn find_normals(
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
                let (low, high) = box_around(core, indices, widest);
                window.gather(cells, block, (&low, &high));
                progress.advance((indices.len() / 2) as u64);
                let mut last = None;
                let find = |&at: &u32| {
                    let point = &core[at as usize];
                    match last {
                        Some((same, found)) if same == *point => return found,
                        _ => {}
                    }
                    let found = normals::most_planar(window, point, radii, orientation, offsets)
                        .unwrap_or(none);
                    last = Some((*point, found));
                    found
                };
                indices.iter().map(find).collect()
            },
        )
    }

    fn measure(
        &self,
        core: &[Vec3],
        normals: &[(Vec3, f64)],
        done: impl Fn(usize) + Sync,
    ) -> Vec<CoreDistance> {
        let settings = &self.settings;
        let reach = cylinder_reach_m(settings);
        let lattice = match &self.for_cylinders {
            Cylinders::Cells(reference, _) => reference.lattice,
            Cylinders::Trees(..) => Lattice::reaching(reach),
        };
        let groups = Groups::new(core, &lattice);
        let nothing = CoreDistance::unknown();
        let mut found = groups.map(
            core.len(),
            nothing,
            |scratch: &mut Scratch, block, indices| {
                let [reference, compared] = &mut scratch.windows;
                if let Cylinders::Cells(before, after) = &self.for_cylinders {
                    let (low, high) = box_around(core, indices, reach);
                    reference.gather(before, block, (&low, &high));
                    compared.gather(after, block, (&low, &high));
                }
                let (heights, sorted) = (&mut scratch.heights, &mut scratch.sorted);
                let mut sample = |heights: &Heights| {
                    let (heights, weights) = heights.weighted();
                    Sample::of(heights, weights, settings.aggregation, sorted)
                };
                let mut last = None;
                let distance = |&at: &u32| {
                    let (normal, normal_radius_m) = normals[at as usize];
                    // Core points at one place have the same distance.
                    match last {
                        Some((same, found)) if same == (core[at as usize], normal) => return found,
                        _ => {}
                    }
                    let cylinder = Cylinder::new(core[at as usize], normal, settings);
                    let found = if normal.x.is_nan() {
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
                    let found = summed_up(&found, normal, normal_radius_m, settings);
                    last = Some(((core[at as usize], normal), found));
                    found
                };
                let distances: Vec<CoreDistance> = indices.iter().map(distance).collect();
                done(indices.len());
                distances
            },
        );
        for (found, point) in found.iter_mut().zip(core) {
            found.point = *point;
        }
        found
    }
}

/// What the samples of reference and compared cloud say.
fn summed_up(
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

/// Buffers that are used again from group to group.
#[derive(Default)]
struct Scratch {
    windows: [Window; 2],
    heights: Heights,
    sorted: Vec<f64>,
}

/// Distance from a core point to the farthest place of its cylinder, metres.
fn cylinder_reach_m(settings: &ComparisonSettings) -> f64 {
    settings
        .cylinder_radius_m
        .hypot(cylinder::half_length_m(settings))
}

/// Points of the clouds farther from a core point than this do not change what is found there, to
/// the last bit, metres: what a piece of a cloud must hold around its core points.
///
/// It reaches beyond balls and cylinders: the order of sums hangs on all points in the cells that
/// meet them.
pub fn reach_m(settings: &ComparisonSettings) -> f64 {
    let balls = settings.normal_radii_m.iter().copied();
    2.0 * balls.fold(cylinder_reach_m(settings), f64::max)
}
