//! Surfels: patches of the surface that scanners and reference saw, and the association of points with
//! them.

mod association;
mod cells;
mod grid;
mod level;
mod planes;
mod regions;
mod relief;

pub use association::associate;
pub use cells::{ReferenceCells, ReferencePlace};
pub use grid::{Grid, profiles};

use serde::{Deserialize, Serialize};

use crate::geometry::Vec3;

/// Fewest points that a surfel is fitted to.
const MIN_POINTS: f64 = 12.0;

/// Upper bounds of the classes of roughness, in sizes of a surfel: within a class the noise of rows is
/// alike. For surfels of 5 cm they are 0.4, 0.8, 1.6, 3 and 6 mm.
const CLASS_SIZES: [f64; 6] = [0.008, 0.016, 0.032, 0.06, 0.12, f64::INFINITY];

/// Upper bounds of the classes of coverage. The effect of a rough surface on the mean of a strip averages
/// out over the whole surfel.
const COVERAGE_SHARES: [f64; 3] = [0.35, 0.7, 1.0];
/// Number of classes of coverage.
pub const COVERAGES: usize = COVERAGE_SHARES.len();

/// Least standard deviation of a row and of the reference's offset, metres.
pub const LEAST_SIGMA_M: f64 = 1e-5;

/// Standard deviations of a surfel's offset (metres) and slopes without a reference, so wide that they only keep
/// the problem solvable: ten thousand surfels together must not hold the common height to less than a metre.
/// Slopes are relative to a plane through the points. Across a narrow strip of points hardly anything else
/// determines them: surfels that may stand upright follow every move of the points, and steps hardly become
/// shorter.
const SURFEL_SIGMA: [f64; 3] = [100.0, 0.2, 0.2];

/// Number of classes of roughness.
pub const CLASSES: usize = CLASS_SIZES.len();

/// A patch of the surface: the plane n·(x − c) = a + b u + c v with u and v along its own axes; a,
/// b and c are unknowns.
#[derive(Debug, Clone)]
#[cfg_attr(test, derive(Default))]
pub struct Surfel {
    /// World, metres.
    pub centre_m: Vec3,
    /// Unit vectors: normal, u, v.
    pub axes: [Vec3; 3],
    /// Edge of its voxels, metres.
    pub size_m: f64,
    /// Standard deviation of the points about the plane, metres.
    pub roughness_m: f64,
    /// Standard deviation of the scanners' points about the mean of their row, metres: noise and
    /// roughness, without errors of the poses.
    pub scatter_m: f64,
    /// Class of this scatter.
    pub class: usize,
    /// Whether it lies on the reference, or several passes or scanners saw it.
    pub is_checked: bool,
    /// Standard deviations of the offset (metres) and slopes of the plane, by the scatter of the points that it is
    /// fitted to.
    pub plane_sigma: [f64; 3],
    /// What is assumed about (a, b, c) without a reference.
    pub assumed: Assumed,
    /// The reference's prior of (a, b, c); `None` if the reference has no points there.
    pub prior: Option<ReferencePlane>,
}

/// What is assumed about (a, b, c) of a surfel: metres and slopes.
#[derive(Debug, Clone, Copy)]
pub struct Assumed {
    /// Standard deviations.
    pub sigma: [f64; 3],
    /// Index of the plane whose slopes it has; without one, (a, b, c) are near zero.
    pub plane: Option<u32>,
}

impl Assumed {
    /// The information that it adds about each of (a, b, c).
    pub fn information(&self) -> Vec3 {
        Vec3::from(self.sigma).map(|sigma| sigma.powi(-2))
    }
}

impl Default for Assumed {
    fn default() -> Self {
        Self {
            sigma: SURFEL_SIGMA,
            plane: None,
        }
    }
}

/// A plane in which several surfels lie. Its normal is n − p u − q v, with the unknown slopes p and q.
#[derive(Debug, Clone)]
pub struct SharedPlane {
    /// Unit vectors: normal, u, v.
    pub axes: [Vec3; 3],
}

/// A slope of a plane along an axis of a surfel.
pub struct SlopeOfPlane {
    pub value: f64,
    /// Derivatives by p and q.
    pub by_plane: [f64; 2],
}

impl SharedPlane {
    /// The slopes b and c, given p and q: −N·u'/N·n' and −N·v'/N·n' with the normal N and the axes of the surfel.
    pub fn along(&self, [p, q]: [f64; 2], surfel: &Surfel) -> [SlopeOfPlane; 2] {
        let [normal, u, v] = self.axes;
        let now = normal - u * p - v * q;
        let up = now.dot(&surfel.axes[0]);
        [surfel.axes[1], surfel.axes[2]].map(|axis| {
            let value = -now.dot(&axis) / up;
            SlopeOfPlane {
                value,
                by_plane: [u, v].map(|by| (by.dot(&axis) + value * by.dot(&surfel.axes[0])) / up),
            }
        })
    }
}

/// The reference's plane of a surfel. It defines the surfel's own frame, so that a = b = c = 0.
#[derive(Debug, Clone)]
pub struct ReferencePlane {
    /// Index of its patch of the reference's surface errors.
    pub patch: u32,
}

/// All observations of one surfel by one scanner within a step.
#[derive(Debug, Clone, Copy)]
pub struct ScanRow {
    pub surfel: u32,
    pub scanner: u32,
    /// Index of its first point.
    pub first: u32,
    pub count: u32,
    /// Effective number of points, (Σw)²/Σw² of their weights: this many points of equal weight have a mean
    /// with the same noise.
    pub effective: f64,
    /// Class of the part of the surfel that it saw.
    pub coverage: u8,
    /// Standard deviation of its points about the mean of their row, metres: that of its surfel, but no less than what the
    /// points of a scanner with rows of single points have, of which others on the surfel do not tell.
    pub scatter_m: f64,
    /// Mean distance of its points from the plane of its surfel when they were sorted, metres.
    pub distance_m: f64,
    /// Signed distance of its points from the scanner along the surfel's normal when they were sorted, metres.
    pub depth_m: f64,
    /// Squares of its derivatives by rotations (metres²) and by shifts of the mounting at that time.
    pub by_motion: [f64; 2],
    /// Number of rows of its scanner within the step.
    pub rows_in_step: u32,
    /// Trust in the row, 0 to 1.
    pub trust: f64,
}

/// A laser point of a row.
#[derive(Debug, Clone, Copy)]
pub struct RowPoint {
    /// Index of its profile in the scanner's sample of this drive.
    pub profile: u32,
    /// Scanner frame, metres.
    pub position_m: Vec3,
    /// Number of laser points that it represents.
    pub weight: f64,
}

/// The rows of a drive.
#[derive(Debug, Clone, Default)]
pub struct DriveRows {
    /// First row of each step, and the end.
    pub step_start: Vec<u32>,
    pub rows: Vec<ScanRow>,
    pub points: Vec<RowPoint>,
}

impl DriveRows {
    /// The rows of a step.
    pub fn of_step(&self, step: usize) -> &[ScanRow] {
        &self.rows[self.step_start[step] as usize..self.step_start[step + 1] as usize]
    }

    /// Counts the rows of each scanner within each step.
    pub fn count_rows_in_steps(&mut self, scanners: usize) {
        for step in 1..self.step_start.len() {
            let [from, to] = [self.step_start[step - 1], self.step_start[step]];
            let rows = &mut self.rows[from as usize..to as usize];
            let mut counts = vec![0; scanners];
            rows.iter()
                .for_each(|row| counts[row.scanner as usize] += 1);
            rows.iter_mut()
                .for_each(|row| row.rows_in_step = counts[row.scanner as usize]);
        }
    }

    /// Adds other rows of the same drive, whose surfels are numbered from `first_surfel`.
    fn append(&mut self, other: &Self, first_surfel: u32) {
        let first = self.points.len() as u32;
        let mut rows = Vec::with_capacity(self.rows.len() + other.rows.len());
        let mut step_start = vec![0];
        for step in 0..self.step_start.len() - 1 {
            rows.extend_from_slice(self.of_step(step));
            let others = other.of_step(step).iter();
            rows.extend(others.map(|row| ScanRow {
                first: first + row.first,
                surfel: first_surfel + row.surfel,
                ..*row
            }));
            step_start.push(rows.len() as u32);
        }
        self.points.extend_from_slice(&other.points);
        self.rows = rows;
        self.step_start = step_start;
    }

    /// Keeps the rows for which `surfel`, given a step and a row, returns the new index of the row's surfel.
    fn retain(&mut self, surfel: impl Fn(usize, &ScanRow) -> Option<u32>) {
        let mut rows = Vec::with_capacity(self.rows.len());
        let mut step_start = vec![0];
        for step in 0..self.step_start.len() - 1 {
            rows.extend(self.of_step(step).iter().filter_map(|row| {
                let surfel = surfel(step, row)?;
                Some(ScanRow { surfel, ..*row })
            }));
            step_start.push(rows.len() as u32);
        }
        self.rows = rows;
        self.step_start = step_start;
    }

    /// The points of a row.
    pub fn points_of(&self, row: &ScanRow) -> &[RowPoint] {
        &self.points[row.first as usize..(row.first + row.count) as usize]
    }
}

/// Keeps these surfels and their rows.
fn keep(surfels: &mut Vec<Surfel>, drives: &mut [DriveRows], kept: &[bool]) {
    let mut next = 0;
    let number: Vec<Option<u32>> = kept
        .iter()
        .map(|&is_kept| {
            is_kept.then(|| {
                next += 1;
                next - 1
            })
        })
        .collect();
    for drive in drives {
        drive.retain(|_, row| number[row.surfel as usize]);
    }
    let mut kept = kept.iter();
    surfels.retain(|_| kept.next() == Some(&true));
}

/// Surfels and the rows that see them.
#[derive(Debug, Clone, Default)]
pub struct Association {
    pub surfels: Vec<Surfel>,
    /// Planes in which several surfels lie.
    pub planes: Vec<SharedPlane>,
    /// The rows of each drive.
    pub drives: Vec<DriveRows>,
    /// Number of patches of the reference's surface errors.
    pub patches: usize,
    /// The displacement that was applied to the reference.
    pub reference: ReferencePlace,
    /// Regions in which scans and reference disagree.
    pub regions: Vec<Region>,
}

impl Association {
    /// The rows of all drives, one drive after the other.
    pub fn rows(&self) -> impl Iterator<Item = &ScanRow> {
        self.drives.iter().flat_map(|drive| &drive.rows)
    }

    /// The same rows, mutable.
    pub fn rows_mut(&mut self) -> impl Iterator<Item = &mut ScanRow> {
        self.drives.iter_mut().flat_map(|drive| &mut drive.rows)
    }
}

/// A region in which scans and reference disagree, for example because a board was moved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// Mean of its surfels, world, metres.
    pub centre_m: Vec3,
    /// Height of the scans above the reference along its upward normal, metres.
    pub offset_m: f64,
    /// Number of its surfels.
    pub surfels: usize,
}

impl Region {
    /// The position and the offset in words; `origin_m` is added to the position.
    pub fn describe(&self, origin_m: &Vec3) -> String {
        let place = self.centre_m + origin_m;
        let side = if self.offset_m > 0.0 {
            "above"
        } else {
            "below"
        };
        format!(
            "around east {:.1} m, north {:.1} m the scans lie {:.1} mm {side} the reference, far \
            more than elsewhere: was something moved after the reference was scanned?",
            place.x,
            place.y,
            1e3 * self.offset_m.abs()
        )
    }
}

/// Sums over the points of one surfel.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    /// Sum of squared distances of points from the mean of their row.
    squares_m2: f64,
    /// Degrees of freedom of this sum.
    free: f64,
    /// Number of points near the surfel, including those beyond the gate.
    near: f64,
    /// Sum of the distances of the points near the surfel.
    distance_m: f64,
}

/// The limits that decide which points belong to a surfel.
#[derive(Debug, Clone)]
pub struct Gates {
    /// Largest distance between scans and reference, metres.
    pub misfit_m: f64,
    /// Edge of the patches of the reference's surface errors, metres.
    pub patch_m: f64,
    /// For each scanner, the number of consecutive steps of which only one, the keyframe, has rows.
    pub keyframe_steps: Vec<usize>,
}
