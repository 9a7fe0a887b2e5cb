//! What a comparison takes from the reference alone.

use rayon::prelude::*;

use super::cells::Cells;
use super::checks::{Normals, check, check_core, check_points};
use super::core_points::core_points;
use super::detection::{Sample, level_of_detection};
use super::normals::{self, Normal, Orientation};
use super::result::{CoreDistance, M3c2};
use super::search::{Indexed, Pass, Search};
use super::settings::ComparisonSettings;
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// The surface of a reference at core points: the normals there, and the mean and spread of the
/// reference's points in the cylinders. It is computed once, to compare any number of clouds with it.
#[derive(Debug, Clone)]
pub struct ReferenceSurface {
    search: Search,
    core: Vec<Vec3>,
    normals: Vec<Normal>,
    /// The reference's points in the cylinder of each core point.
    samples: Vec<Sample>,
}

impl ReferenceSurface {
    /// The surface of `reference` at the points `core` (metres, in one frame), for comparisons with
    /// these settings. The reference's points that are not finite are ignored.
    ///
    /// The caller begins, names and ends the stage, which advances by one for each core point.
    ///
    /// # Errors
    /// As [`m3c2`](super::m3c2()), except those about the compared cloud.
    pub fn new(
        reference: &[Vec3],
        core: &[Vec3],
        normals: Normals<'_>,
        settings: &ComparisonSettings,
        progress: &dyn Progress,
    ) -> Result<Self> {
        check_points(reference, "reference")?;
        let search = Search::new(normals, settings)?;
        let reference = IndexedReference::new(&search, reference);
        let first = Pass::first(progress, passes(normals));
        reference.surface(core, normals, first)
    }

    /// The surface of a cloud (metres) at its [`core_points`], with normals that point upwards;
    /// `None` if the cloud has no finite point. Begins and ends its own stages, whose names contain
    /// `name`.
    ///
    /// # Errors
    /// Invalid settings; [`Error::Cancelled`].
    pub fn upwards(
        name: &str,
        cloud: &[Vec3],
        settings: &ComparisonSettings,
        progress: &dyn Progress,
    ) -> Result<Option<Self>> {
        let normals = Normals::UPWARDS;
        let search = Search::new(normals, settings)?;
        let stage = progress.stage(&format!("sorting the points of {name}"), 0);
        let core = core_points(cloud, settings);
        if core.is_empty() {
            return Ok(None);
        }
        let reference = IndexedReference::new(&search, cloud);
        drop(stage);
        progress.check()?;
        let stage = format!("finding normals of {name}");
        let _stage = progress.stage(&stage, core.len() as u64);
        let first = Pass::first(progress, passes(normals));
        reference.surface(&core, normals, first).map(Some)
    }

    /// Compares a cloud (metres, in the reference's frame) with the reference; the result is that
    /// of [`m3c2`](super::m3c2()), to the last bit.
    ///
    /// The caller begins, names and ends the stage, which advances by one for each core point.
    ///
    /// # Errors
    /// [`Error::Data`] if the cloud has no finite point; [`Error::Cancelled`].
    pub fn distances(&self, compared: &[Vec3], progress: &dyn Progress) -> Result<M3c2> {
        check_points(compared, "compared")?;
        self.distances_of(&self.search.index(compared), Pass::first(progress, 1))
    }

    /// The core points.
    pub fn core(&self) -> &[Vec3] {
        &self.core
    }

    /// Compares an indexed cloud, in one pass over the core points.
    fn distances_of(&self, compared: &Indexed, pass: Pass<'_>) -> Result<M3c2> {
        let search = &self.search;
        let compared = search.samples(compared, &self.core, &self.normals, pass);
        pass.progress.check()?;
        let places = self.core.par_iter().zip(&self.normals);
        let samples = self.samples.par_iter().zip(&compared);
        let core = places
            .zip(samples)
            .map(|((point, normal), (reference, compared))| CoreDistance {
                point: *point,
                normal: normal.direction,
                normal_radius_m: normal.radius_m,
                ..core_distance(reference, compared, &search.settings)
            });
        Ok(M3c2 {
            core: core.collect(),
        })
    }
}

/// Number of passes over the core points that compute the surface of a reference.
fn passes(normals: Normals<'_>) -> u64 {
    match normals {
        Normals::MostPlanar { .. } | Normals::SeenFrom(_) => 2,
        Normals::Fixed(_) | Normals::Given(_) => 1,
    }
}

/// Combines the points of both clouds in the cylinder of a core point; leaves out the point itself
/// and its normal.
fn core_distance(
    reference: &Sample,
    compared: &Sample,
    settings: &ComparisonSettings,
) -> CoreDistance {
    let enough = reference.count.min(compared.count) >= settings.min_points;
    CoreDistance {
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

/// An indexed reference.
#[derive(Debug, Clone)]
struct IndexedReference {
    search: Search,
    /// Its cells for normals, where those for cylinders do not serve for them.
    for_normals: Option<Cells>,
    for_cylinders: Indexed,
}

impl IndexedReference {
    fn new(search: &Search, reference: &[Vec3]) -> Self {
        let (for_normals, for_cylinders) = rayon::join(
            || search.cells_for_normals(reference),
            || search.index(reference),
        );
        Self {
            search: search.clone(),
            for_normals,
            for_cylinders,
        }
    }

    /// The cells for normals.
    fn cells_for_normals(&self) -> Result<&Cells> {
        match (&self.for_normals, &self.for_cylinders) {
            (Some(cells), _) => Ok(cells),
            (None, Indexed::Cells(cells)) if self.search.is_shared() => Ok(cells),
            _ => Err(Error::data(
                "the clouds are indexed for given normals, but no normals are given",
                "index them for computed normals, or give normals",
            )),
        }
    }

    /// The surface at `core`, computed in passes from `first` on.
    fn surface(
        &self,
        core: &[Vec3],
        normals: Normals<'_>,
        first: Pass<'_>,
    ) -> Result<ReferenceSurface> {
        let search = &self.search;
        check_core(core, normals)?;
        check(normals, &search.settings)?;
        let given = |direction: &Vec3| Normal {
            direction: normals::unit(direction),
            radius_m: f64::NAN,
        };
        let mut core_normals = match normals {
            Normals::MostPlanar { orientation } => {
                let towards = Orientation::Direction(orientation);
                search.normals(self.cells_for_normals()?, core, &towards, first)
            }
            Normals::SeenFrom(places) => {
                let towards = Orientation::seen_from(places);
                search.normals(self.cells_for_normals()?, core, &towards, first)
            }
            Normals::Fixed(direction) => vec![given(&direction); core.len()],
            Normals::Given(directions) => directions.iter().map(given).collect(),
        };
        first.progress.check()?;
        // Core points beyond the lattice belong to no group and get no results.
        let lattice = search.lattice();
        for (normal, point) in core_normals.iter_mut().zip(core) {
            if !lattice.covers(point) {
                *normal = Normal::NONE;
            }
        }
        let pass = Pass {
            number: passes(normals) - 1,
            ..first
        };
        let samples = search.samples(&self.for_cylinders, core, &core_normals, pass);
        first.progress.check()?;
        Ok(ReferenceSurface {
            search: search.clone(),
            core: core.to_vec(),
            normals: core_normals,
            samples,
        })
    }
}

/// Two indexed clouds to compare.
#[derive(Debug, Clone)]
pub struct IndexedClouds {
    reference: IndexedReference,
    compared: Indexed,
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
        check_points(reference, "reference")?;
        check_points(compared, "compared")?;
        Self::of_pieces(reference, compared, normals, settings)
    }

    /// As [`Self::new`], for parts of two clouds, which may be empty: all points within
    /// [`reach_m`](super::reach_m) of the core points to come.
    ///
    /// # Errors
    /// As [`Self::new`], except that clouds may have no points.
    pub fn of_pieces(
        reference: &[Vec3],
        compared: &[Vec3],
        normals: Normals<'_>,
        settings: &ComparisonSettings,
    ) -> Result<Self> {
        let search = Search::new(normals, settings)?;
        let (reference, compared) = rayon::join(
            || IndexedReference::new(&search, reference),
            || search.index(compared),
        );
        Ok(Self {
            reference,
            compared,
        })
    }

    /// Compares the clouds at the points `core` (metres, in their frame).
    ///
    /// The cylinder reaches `max_distance_m` to both sides, at least its radius. Core points
    /// outside the overlap get NaN, which is not an error; see [`super::Statistics::of`] if no core
    /// point has a distance. The caller begins, names and ends the stage, which advances by one for
    /// each core point. The result at a core point does not depend on the number of threads, on
    /// other core points, or on points of the clouds farther away than
    /// [`reach_m`](super::reach_m), to the last bit.
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
        let passes = passes(normals) + 1;
        let first = Pass::first(progress, passes);
        let last = Pass {
            number: passes - 1,
            ..first
        };
        let surface = self.reference.surface(core, normals, first)?;
        surface.distances_of(&self.compared, last)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::super::m3c2::m3c2;
    use super::super::settings::{Aggregation, Detection};
    use super::*;
    use crate::progress::Silent;

    /// One lattice for normals and cylinders, one for each, and trees.
    fn searches() -> [ComparisonSettings; 3] {
        let shared = ComparisonSettings {
            normal_radii_m: vec![0.03, 0.05],
            cylinder_radius_m: 0.03,
            ..ComparisonSettings::default()
        };
        let apart = ComparisonSettings {
            normal_radii_m: vec![0.02],
            aggregation: Aggregation::Median,
            detection: Detection::Student,
            ..shared.clone()
        };
        let trees = ComparisonSettings {
            max_distance_m: 0.5,
            one_sided: true,
            min_points: 3,
            ..shared.clone()
        };
        [shared, apart, trees]
    }

    #[test]
    fn a_surface_compared_with_three_clouds_gives_the_bits_of_three_comparisons() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut cloud = |height_m: f64| -> Vec<Vec3> {
            let mut place = |width: f64| rng.random_range(0.0..width);
            let points = (0..4000).map(|_| {
                let (x, y) = (place(0.6), place(0.6));
                Vec3::new(x, y, 0.1 * (9.0 * x).sin() + height_m + place(0.02))
            });
            points.collect()
        };
        let reference = cloud(0.0);
        // The last is out of reach.
        let clouds = [0.01, 0.03, 2.0].map(&mut cloud);
        let mut core: Vec<Vec3> = reference.iter().step_by(7).copied().collect();
        core.push(core[0]);
        core.extend([f64::NAN, 1e300].map(|x| Vec3::new(x, 0.1, 0.0)));
        let mut directions = vec![Vec3::new(0.1, -0.2, 2.0); core.len()];
        directions[1] = Vec3::zeros();
        let kinds = [
            Normals::UPWARDS,
            Normals::SeenFrom(&[Vec3::new(0.2, 0.3, 2.0), Vec3::new(0.5, 0.1, 1.5)]),
            Normals::Fixed(Vec3::new(0.3, 0.0, 1.0)),
            Normals::Given(&directions),
        ];
        for settings in searches() {
            for normals in kinds {
                let surface = ReferenceSurface::new(&reference, &core, normals, &settings, &Silent)
                    .expect("the reference has points");
                assert_eq!(surface.core().len(), core.len());
                let known = clouds.each_ref().map(|compared| {
                    let alone = m3c2(&reference, compared, &core, normals, &settings, &Silent);
                    let alone = alone.expect("the clouds have points");
                    let found = surface.distances(compared, &Silent);
                    // Debug shows every bit, and NaN equals itself.
                    assert_eq!(
                        format!("{:?}", found.expect("the cloud has points")),
                        format!("{alone:?}")
                    );
                    alone.distances_m().count()
                });
                assert!(
                    known[0] > 400 && known[1] > 100 && known[2] == 0,
                    "{known:?}"
                );
            }
        }
    }
}
