//! How clouds are indexed for a comparison, and the search of their points around core points.

use super::cells::{Cells, Lattice};
use super::checks::{Normals, check};
use super::cylinder::{self, Cylinder, Heights};
use super::detection::Sample;
use super::groups::{Groups, box_around};
use super::moments::Offsets;
use super::normals::{self, Normal, Orientation};
use super::settings::ComparisonSettings;
use super::window::Window;
use crate::cloud::NeighbourIndex;
use crate::error::Result;
use crate::geometry::{Vec3, is_finite};
use crate::progress::Progress;

/// Cylinders longer than this many radii to one side are searched in trees: blocks as large as
/// their length would contain too many other points.
const LONGEST_IN_CELLS: f64 = 8.0;

/// A lattice for cylinders of up to this many radii of normals also serves to find the neighbours of these: 27 times the
/// points of a cell are looked at, in one pass over memory instead of two.
const ONE_LATTICE: f64 = 3.0;

/// How the clouds of a comparison are indexed.
#[derive(Debug, Clone)]
pub(super) struct Search {
    pub(super) settings: ComparisonSettings,
    /// The lattice for normals, if they are to be computed.
    for_normals: Option<Lattice>,
    /// The lattice for cylinders; `None` if they are searched in trees.
    for_cylinders: Option<Lattice>,
}

impl Search {
    /// For a comparison with these settings and this kind of normals.
    ///
    /// # Errors
    /// See [`check`].
    pub(super) fn new(normals: Normals<'_>, settings: &ComparisonSettings) -> Result<Self> {
        check(normals, settings)?;
        let radii = settings.normal_radii_m.iter().copied();
        let widest = radii.reduce(f64::max);
        let ball = widest.filter(|_| normals.are_computed());
        let reach = cylinder_reach_m(settings);
        let longest = LONGEST_IN_CELLS * settings.cylinder_radius_m;
        let (mut for_normals, mut for_cylinders) = (ball, (reach <= longest).then_some(reach));
        // One lattice, if it suits both searches.
        if let (Some(ball), Some(reach)) = (ball, for_cylinders) {
            let both = ball.max(reach);
            if both <= longest && both <= ONE_LATTICE * ball {
                (for_normals, for_cylinders) = (Some(both), Some(both));
            }
        }
        Ok(Self {
            settings: settings.clone(),
            for_normals: for_normals.map(Lattice::reaching),
            for_cylinders: for_cylinders.map(Lattice::reaching),
        })
    }

    /// Indexes a cloud for cylinders.
    pub(super) fn index(&self, cloud: &[Vec3]) -> Indexed {
        if let Some(lattice) = self.for_cylinders {
            return Indexed::Cells(Cells::new(cloud, lattice));
        }
        let points: Vec<Vec3> = cloud.iter().copied().filter(is_finite).collect();
        Indexed::Tree(NeighbourIndex::new(&points))
    }

    /// Sorts the reference into cells for normals; `None` if none are to be computed, or if the cells
    /// for cylinders serve for both.
    pub(super) fn cells_for_normals(&self, reference: &[Vec3]) -> Option<Cells> {
        let is_separate = |lattice: &Lattice| Some(*lattice) != self.for_cylinders;
        let lattice = self.for_normals.filter(is_separate)?;
        Some(Cells::new(reference, lattice))
    }

    /// Whether the reference's cells for cylinders serve for normals too.
    pub(super) fn is_shared(&self) -> bool {
        self.for_normals.is_some() && self.for_normals == self.for_cylinders
    }

    /// The lattice whose blocks group the core points of cylinders; points that it does not cover
    /// have no results.
    pub(super) fn lattice(&self) -> Lattice {
        let reach = || Lattice::reaching(cylinder_reach_m(&self.settings));
        self.for_cylinders.unwrap_or_else(reach)
    }

    /// The normals at core points, computed from the reference's cells. Unusable if the work was
    /// cancelled.
    pub(super) fn normals(
        &self,
        cells: &Cells,
        core: &[Vec3],
        orientation: &Orientation,
        pass: Pass<'_>,
    ) -> Vec<Normal> {
        let radii = &self.settings.normal_radii_m;
        let widest = radii.iter().copied().fold(0.0, f64::max);
        Groups::new(core, &cells.lattice).map(
            core.len(),
            Normal::NONE,
            |(window, offsets): &mut (Window, Offsets), block, indices| {
                if pass.progress.is_cancelled() {
                    return vec![Normal::NONE; indices.len()];
                }
                let (low, high) = box_around(core, indices, widest);
                window.gather(cells, block, (&low, &high));
                let mut last = None;
                let find = |&at: &u32| {
                    let point = &core[at as usize];
                    match last {
                        Some((same, normal)) if same == *point => return normal,
                        _ => {}
                    }
                    let normal = normals::most_planar(window, point, radii, orientation, offsets)
                        .unwrap_or(Normal::NONE);
                    last = Some((*point, normal));
                    normal
                };
                let normals = indices.iter().map(find).collect();
                pass.advance(indices.len());
                normals
            },
        )
    }

    /// The points of a cloud in the cylinder of each core point; none if it has no normal. Unusable if the work was cancelled.
    pub(super) fn samples(
        &self,
        cloud: &Indexed,
        core: &[Vec3],
        normals: &[Normal],
        pass: Pass<'_>,
    ) -> Vec<Sample> {
        let settings = &self.settings;
        let reach = cylinder_reach_m(settings);
        Groups::new(core, &self.lattice()).map(
            core.len(),
            Sample::NONE,
            |scratch: &mut Scratch, block, indices| {
                if pass.progress.is_cancelled() {
                    return vec![Sample::NONE; indices.len()];
                }
                let Scratch {
                    window,
                    heights,
                    sorted,
                } = scratch;
                if let Indexed::Cells(cells) = cloud {
                    let (low, high) = box_around(core, indices, reach);
                    window.gather(cells, block, (&low, &high));
                }
                let mut last = None;
                let find = |&at: &u32| {
                    let (point, axis) = (core[at as usize], normals[at as usize].direction);
                    if axis.x.is_nan() {
                        return Sample::NONE;
                    }
                    // Core points at one place have the same points.
                    match last {
                        Some((same, sample)) if same == (point, axis) => return sample,
                        _ => {}
                    }
                    let cylinder = Cylinder::new(point, axis, settings);
                    match cloud {
                        Indexed::Cells(_) => cylinder.heights_in_window(window, heights),
                        Indexed::Tree(tree) => cylinder.heights_in_tree(tree, heights),
                    }
                    let (inside, weights) = heights.weighted();
                    let sample = Sample::new(inside, weights, settings.aggregation, sorted);
                    last = Some(((point, axis), sample));
                    sample
                };
                let samples = indices.iter().map(find).collect();
                pass.advance(indices.len());
                samples
            },
        )
    }
}

/// A cloud indexed for cylinders.
#[derive(Debug, Clone)]
pub(super) enum Indexed {
    Cells(Cells),
    Tree(NeighbourIndex),
}

/// Buffers reused from group to group.
#[derive(Default)]
struct Scratch {
    window: Window,
    heights: Heights,
    sorted: Vec<f64>,
}

/// One of several passes over all core points in a stage with one work unit for each core point.
#[derive(Clone, Copy)]
pub(super) struct Pass<'a> {
    pub(super) progress: &'a dyn Progress,
    /// Number of this pass, from 0.
    pub(super) number: u64,
    /// Number of passes in the stage.
    pub(super) passes: u64,
}

impl<'a> Pass<'a> {
    pub(super) fn first(progress: &'a dyn Progress, passes: u64) -> Self {
        Self {
            progress,
            number: 0,
            passes,
        }
    }

    /// Reports that this pass has finished this many more core points.
    fn advance(&self, core_points: usize) {
        let units = |passes: u64| core_points as u64 * passes / self.passes;
        self.progress
            .advance(units(self.number + 1) - units(self.number));
    }
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
