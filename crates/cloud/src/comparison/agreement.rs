//! How well the clouds of one drive agree with the reference and with each other.

use serde::{Deserialize, Serialize};

use super::map::DistanceMap;
use super::passes::PassDistances;
use super::result::M3c2;
use super::settings::ComparisonSettings;
use super::statistics::Statistics;
use super::surface::ReferenceSurface;
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::progress::Progress;

/// The mounting with which the clouds of a comparison were georeferenced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum MountingKind {
    /// The initial values of the project.
    Initial,
    /// The result of the two-step calibration, with its poses, if the run has another result.
    TwoStep,
    /// The result of the run.
    Final,
    /// The true mounting, with the same poses (simulation).
    Truth,
}

impl MountingKind {
    /// Name in tables and figures.
    pub fn name(self) -> &'static str {
        match self {
            Self::Initial => "initial",
            Self::TwoStep => "two steps",
            Self::Final => "calibrated",
            Self::Truth => "true mounting",
        }
    }
}

/// The cloud to compare with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Against {
    /// The reference cloud.
    Reference,
    /// Another scanner, by name, whose cloud provides the core points.
    Scanner(String),
}

/// One comparison of two clouds.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Agreement {
    /// Name of the scanner compared.
    pub scanner: String,
    /// The cloud with which it is compared.
    pub against: Against,
    /// The mounting used for the clouds.
    pub mounting: MountingKind,
    /// Statistics of the distances.
    pub statistics: Statistics,
    /// Share of core points with a distance, among those inside the footprint of the compared cloud:
    /// inside it as seen from above, and within half a metre of its heights. NaN if no core point
    /// lies inside.
    pub coverage: f64,
    /// The distances at their positions.
    pub distances: DistanceMap,
}

impl Agreement {
    /// The two clouds in words.
    pub fn pair(&self) -> String {
        match &self.against {
            Against::Reference => format!("{} to reference", self.scanner),
            Against::Scanner(other) => format!("{other} against {}", self.scanner),
        }
    }

    /// Whether the same clouds are compared, regardless of the mounting.
    pub fn is_same_pair(&self, other: &Self) -> bool {
        (&self.scanner, &self.against) == (&other.scanner, &other.against)
    }
}

/// How far passes lie apart with one mounting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PassComparison {
    /// The mounting.
    pub mounting: MountingKind,
    /// Whether the poses are those of a file, not adjusted.
    pub on_given_poses: bool,
    /// The distances.
    pub distances: PassDistances,
}

/// All comparisons of one drive.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Agreements {
    /// The comparisons that have distances: every scanner with the reference, then every pair of
    /// scanners. Those of one pair are consecutive, in the order of [`MountingKind`].
    pub comparisons: Vec<Agreement>,
    /// Comparisons under the final mounting without any distance: the other cloud, and the reason.
    pub missing: Vec<(Against, String)>,
    /// Passes of the same scanner over the same ground; empty if there is no such ground. Without a reference and with
    /// one scanner, nothing else can be compared.
    pub passes: Vec<PassComparison>,
}

impl Agreements {
    /// The passes with the result of the run, on the poses that it found.
    pub fn final_passes(&self) -> Option<&PassDistances> {
        self.passes_of(MountingKind::Final, false)
    }

    /// The passes with one mounting on poses of one kind.
    pub fn passes_of(
        &self,
        mounting: MountingKind,
        on_given_poses: bool,
    ) -> Option<&PassDistances> {
        let mut all = self.passes.iter();
        let found = all.find(|p| p.mounting == mounting && p.on_given_poses == on_given_poses);
        found.map(|comparison| &comparison.distances)
    }

    /// Comparisons under one mounting.
    pub fn under(&self, mounting: MountingKind) -> impl Iterator<Item = &Agreement> {
        let all = self.comparisons.iter();
        all.filter(move |agreement| agreement.mounting == mounting)
    }

    /// The comparison of the same clouds as in `agreement` under another mounting.
    pub fn counterpart(&self, agreement: &Agreement, mounting: MountingKind) -> Option<&Agreement> {
        self.under(mounting)
            .find(|other| other.is_same_pair(agreement))
    }

    /// The comparisons of each pair of clouds.
    pub fn pairs(&self) -> impl Iterator<Item = &[Agreement]> {
        self.comparisons.chunk_by(Agreement::is_same_pair)
    }
}

/// Compares the clouds of the drive `drive` for each kind of mounting: one cloud for each of the
/// `scanners`, in their order, world frame, metres. `reference` is the surface of the
/// reference, if there is one; that of the first scanner of a pair is found as
/// [`ReferenceSurface::upwards`] finds it.
///
/// # Errors
/// Invalid settings; [`Error::Cancelled`](crate::Error::Cancelled). Clouds that do not overlap are
/// listed in [`Agreements::missing`].
pub fn agreements(
    drive: &str,
    scanners: &[&str],
    reference: Option<&ReferenceSurface>,
    kinds: &[(MountingKind, Vec<Vec<Vec3>>)],
    settings: &ComparisonSettings,
    progress: &dyn Progress,
) -> Result<Agreements> {
    let mut all = Comparisons {
        drive,
        scanners,
        progress,
        compared: Vec::new(),
        missing: Vec::new(),
    };
    for (mounting, clouds) in kinds {
        if reference.is_some() {
            for (scanner, cloud) in clouds.iter().enumerate() {
                all.compare(reference, cloud, (None, scanner, *mounting))?;
            }
        }
        for (first, cloud) in clouds.iter().enumerate() {
            let others = first + 1..clouds.len();
            if others.is_empty() {
                break;
            }
            let name = format!("{} ({drive}, {})", scanners[first], mounting.name());
            let surface = ReferenceSurface::upwards(&name, cloud, settings, progress)?;
            for second in others {
                let sides = (Some(first), second, *mounting);
                all.compare(surface.as_ref(), &clouds[second], sides)?;
            }
        }
    }
    all.compared.sort_by_key(|(sides, _)| *sides);
    Ok(Agreements {
        comparisons: all
            .compared
            .into_iter()
            .map(|(_, agreement)| agreement)
            .collect(),
        missing: all.missing,
        passes: Vec::new(),
    })
}

/// Edge of the cells of a footprint, metres.
const FOOTPRINT_CELL_M: f64 = 0.1;

/// Distance that a cell of a footprint extends above and below its points, metres: points on another
/// storey are outside.
const FOOTPRINT_REACH_M: f64 = 0.5;

/// The coverage of a comparison; see [`Agreement::coverage`].
fn coverage(distances: &M3c2, compared: &[Vec3]) -> f64 {
    let cell = |point: &Vec3| voxel_key(&Vec3::new(point.x, point.y, 0.0), FOOTPRINT_CELL_M);
    let mut footprint: VoxelMap<VoxelKey, (f64, f64)> = VoxelMap::default();
    for point in compared {
        let (low, high) = footprint.entry(cell(point)).or_insert((point.z, point.z));
        (*low, *high) = (low.min(point.z), high.max(point.z));
    }
    let inside = distances.core.iter().filter(|core| {
        footprint
            .get(&cell(&core.point))
            .is_some_and(|(low, high)| {
                (low - FOOTPRINT_REACH_M..=high + FOOTPRINT_REACH_M).contains(&core.point.z)
            })
    });
    let (covered, all) = inside.fold((0.0, 0.0), |(covered, all), core| {
        (
            covered + f64::from(u8::from(core.distance_m.is_finite())),
            all + 1.0,
        )
    });
    covered / all
}

/// The cloud compared with (`None` for the reference), the scanner compared, and the mounting.
type Sides = (Option<usize>, usize, MountingKind);

/// The comparisons so far.
struct Comparisons<'a> {
    drive: &'a str,
    scanners: &'a [&'a str],
    progress: &'a dyn Progress,
    compared: Vec<(Sides, Agreement)>,
    missing: Vec<(Against, String)>,
}

impl Comparisons<'_> {
    fn compare(
        &mut self,
        reference: Option<&ReferenceSurface>,
        compared: &[Vec3],
        sides @ (against, scanner, mounting): Sides,
    ) -> Result<()> {
        let (drive, scanner) = (self.drive, self.scanners[scanner]);
        let other = against.map(|other| self.scanners[other]);
        let against = other.map_or(Against::Reference, |name| Against::Scanner(name.into()));
        let is_final = mounting == MountingKind::Final;
        let Some(reference) = reference.filter(|_| !compared.is_empty()) else {
            let text = format!("{drive}: scanner `{scanner}` has no points to compare");
            self.missing.extend(is_final.then_some((against, text)));
            return Ok(());
        };
        let stage = format!(
            "comparing {scanner} with {} ({drive}, {})",
            other.unwrap_or("reference"),
            mounting.name()
        );
        let _stage = self.progress.stage(&stage, reference.core().len() as u64);
        let distances = reference.distances(compared, self.progress)?;
        match Statistics::of(&distances) {
            Ok(statistics) => {
                let agreement = Agreement {
                    coverage: coverage(&distances, compared),
                    scanner: scanner.into(),
                    against,
                    mounting,
                    statistics,
                    distances: DistanceMap::of(&distances),
                };
                self.compared.push((sides, agreement));
            }
            Err(reason) => {
                let text = format!("{drive}: {reason}");
                self.missing.extend(is_final.then_some((against, text)));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::checks::Normals;
    use super::super::core_points::core_points;
    use super::super::m3c2::m3c2;
    use super::*;
    use crate::progress::Silent;

    /// A plate of 0.4 m by 0.4 m, whose heights alternate about `height_m`.
    fn plate(height_m: f64) -> Vec<Vec3> {
        let point = |i: u32| {
            let (x, y) = (f64::from(i % 80) * 0.005, f64::from(i / 80) * 0.005);
            Vec3::new(x, y, height_m + 0.001 * f64::from(i * i % 7))
        };
        (0..6400).map(point).collect()
    }

    #[test]
    fn agreements_are_those_of_separate_comparisons() {
        let settings = ComparisonSettings::default();
        let reference = plate(0.0);
        let clouds = [plate(0.003), Vec::new(), plate(0.007)];
        let scanners = ["a", "b", "c"];
        let all = |reference: &[Vec3]| {
            let surface = ReferenceSurface::upwards("the reference", reference, &settings, &Silent);
            let kinds = [MountingKind::Initial, MountingKind::Final];
            let kinds = kinds.map(|kind| (kind, clouds.to_vec()));
            let surface = surface.expect("a plate has normals");
            let surface = surface.as_ref();
            agreements("drive", &scanners, surface, &kinds, &settings, &Silent)
                .expect("clouds overlap")
        };
        let with = |before: &[Vec3], after: &[Vec3]| {
            let core = core_points(before, &settings);
            let up = Normals::UPWARDS;
            m3c2(before, after, &core, up, &settings, &Silent).expect("clouds overlap")
        };
        let agreements = all(&reference);
        let pairs: Vec<&[Agreement]> = agreements.pairs().collect();
        let expected = [
            ("a to reference", with(&reference, &clouds[0])),
            ("c to reference", with(&reference, &clouds[2])),
            ("a against c", with(&clouds[0], &clouds[2])),
        ];
        assert_eq!(pairs.len(), expected.len());
        for (pair, (name, distances)) in pairs.iter().zip(&expected) {
            let kinds: Vec<MountingKind> =
                pair.iter().map(|agreement| agreement.mounting).collect();
            assert_eq!(kinds, [MountingKind::Initial, MountingKind::Final]);
            for agreement in *pair {
                let statistics = Statistics::of(distances).expect("clouds overlap");
                assert_eq!(
                    (agreement.pair().as_str(), &agreement.statistics),
                    (*name, &statistics)
                );
                assert_eq!(agreement.distances, DistanceMap::of(distances));
            }
        }
        // Under the final mounting: to the reference, and both pairs of the scanner without points.
        let missing = agreements.missing.iter().map(|(against, _)| against);
        let [a, b] = ["a", "b"].map(|name| Against::Scanner(name.into()));
        assert!(missing.eq([&Against::Reference, &a, &b]));

        let alone = all(&[]);
        assert_eq!(alone.pairs().count(), 1);
        assert_eq!(alone.missing.len(), 2);
    }
}
