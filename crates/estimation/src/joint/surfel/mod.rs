//! Surfels: patches of the surface that scanners and reference saw, and which points belong to
//! which.

mod association;
mod cells;
mod regions;

pub use association::associate;
pub use cells::{ReferenceCells, ReferencePlace};

use crate::geometry::Vec3;
use crate::stored::stored;

/// Fewest points that a surfel is fitted to.
const MIN_POINTS: f64 = 12.0;

/// Upper bounds of the classes of roughness, in sizes of a surfel: within a class the noise of rows is
/// alike. For surfels of 5 cm they are 0.4, 0.8, 1.6, 3 and 6 mm.
const CLASS_SIZES: [f64; 6] = [0.008, 0.016, 0.032, 0.06, 0.12, f64::INFINITY];

/// Upper bounds of the classes of coverage. What a rough surface does to the mean of a strip averages
/// out over the whole surfel.
const COVERAGE_SHARES: [f64; 3] = [0.35, 0.7, 1.0];
/// Number of classes of coverage.
pub const COVERAGES: usize = COVERAGE_SHARES.len();

/// Number of classes of roughness.
pub const CLASSES: usize = CLASS_SIZES.len();

/// A patch of the surface: the plane n·(x − c) = a + b u + c v with u and v along its own axes; a,
/// b and c are unknowns.
#[derive(Debug, Clone)]
pub struct Surfel {
    /// World, metres.
    pub centre_m: Vec3,
    /// Unit vectors: normal, u, v.
    pub axes: [Vec3; 3],
    /// Standard deviation of the points about the plane, metres.
    pub roughness_m: f64,
    /// Standard deviation of the scanners' points about the mean of their row, metres: noise and
    /// roughness, without what poses do.
    pub scatter_m: f64,
    /// Class of this scatter.
    pub class: usize,
    /// Whether the reference knows it, or several passes or scanners saw it.
    pub is_checked: bool,
    /// What the reference says about (a, b, c); `None` without one.
    pub prior: Option<ReferencePlane>,
}

/// The reference's plane of a surfel: it is the surfel's own frame, so that a = b = c = 0.
#[derive(Debug, Clone)]
pub struct ReferencePlane {
    /// Standard deviations of offset (metres) and slopes.
    pub sigma: [f64; 3],
    /// Its patch of the reference's surface errors.
    pub patch: u32,
}

/// All observations of one surfel by one scanner within a step.
#[derive(Debug, Clone, Copy)]
pub struct ScanRow {
    pub surfel: u32,
    pub scanner: u32,
    /// Places among the points.
    pub first: u32,
    pub count: u32,
    /// (Σw)²/Σw² of the weights of its points: how many points of equal weight have the noise of
    /// their mean.
    pub effective: f64,
    /// Class of the part of the surfel that it saw.
    pub coverage: u8,
    /// How far its points lay from the scanner along the surfel's normal, metres, with its sign.
    pub depth_m: f64,
    /// Squares of its derivatives by rotations (metres²) and by shifts of the mounting, as it was then.
    pub by_motion: [f64; 2],
    /// Rows of its scanner within the step.
    pub beside: u32,
    /// How far it is trusted, 0 to 1.
    pub trust: f64,
}

/// A laser point of a row.
#[derive(Debug, Clone, Copy)]
pub struct RowPoint {
    /// Of its scanner in this drive.
    pub profile: u32,
    /// Scanner frame, metres.
    pub position_m: Vec3,
    /// Number of laser points that it stands for.
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
    pub fn count_beside(&mut self, scanners: usize) {
        for step in 1..self.step_start.len() {
            let [from, to] = [self.step_start[step - 1], self.step_start[step]];
            let rows = &mut self.rows[from as usize..to as usize];
            let mut counts = vec![0; scanners];
            rows.iter()
                .for_each(|row| counts[row.scanner as usize] += 1);
            rows.iter_mut()
                .for_each(|row| row.beside = counts[row.scanner as usize]);
        }
    }

    /// Keeps the rows for which `surfel` returns one, by its new number, given their step.
    fn retain(&mut self, surfel: impl Fn(usize, &ScanRow) -> Option<u32>) {
        let mut kept = Vec::with_capacity(self.rows.len());
        let mut step_start = vec![0];
        for step in 0..self.step_start.len() - 1 {
            kept.extend(self.of_step(step).iter().filter_map(|row| {
                let surfel = surfel(step, row)?;
                Some(ScanRow { surfel, ..*row })
            }));
            step_start.push(kept.len() as u32);
        }
        self.rows = kept;
        self.step_start = step_start;
    }

    /// The points of a row.
    pub fn points_of(&self, row: &ScanRow) -> &[RowPoint] {
        &self.points[row.first as usize..(row.first + row.count) as usize]
    }
}

/// Surfels and the rows that see them.
#[derive(Debug, Clone, Default)]
pub struct Association {
    pub surfels: Vec<Surfel>,
    /// One a drive.
    pub drives: Vec<DriveRows>,
    /// Patches of the reference's surface errors.
    pub patches: usize,
    /// Where the reference was put.
    pub reference: ReferencePlace,
    /// Regions in which scans and reference disagree.
    pub regions: Vec<Region>,
}

impl Association {
    /// The rows of all drives, one drive behind the other.
    pub fn rows(&self) -> impl Iterator<Item = &ScanRow> {
        self.drives.iter().flat_map(|drive| &drive.rows)
    }

    /// The same, to be changed.
    pub fn rows_mut(&mut self) -> impl Iterator<Item = &mut ScanRow> {
        self.drives.iter_mut().flat_map(|drive| &mut drive.rows)
    }
}

/// A region in which scans and reference disagree, as where a board was moved.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Region {
    /// Mean of its surfels, world, metres.
    pub centre_m: Vec3,
    /// How far the scans lie above the reference along its normal, which looks up, metres.
    pub offset_m: f64,
    /// Number of its surfels.
    pub surfels: usize,
}

impl Region {
    /// Where it is and how far off, in words; `origin_m` is added to its place.
    pub fn describe(&self, origin_m: &Vec3) -> String {
        let place = self.centre_m + origin_m;
        let side = if self.offset_m > 0.0 {
            "above"
        } else {
            "below"
        };
        format!(
            "around east {:.1}, north {:.1} m the scans lie {:.1} mm {side} the reference, and \
             nowhere near it elsewhere: was something moved after the reference was scanned?",
            place.x,
            place.y,
            1e3 * self.offset_m.abs()
        )
    }
}

/// What the points of one surfel add up to.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    /// Squared distances of points from the mean of their row, and degrees of freedom.
    squares_m2: f64,
    free: f64,
    /// Points near the surfel, and the sum of their distances: also of those beyond the gate.
    near: f64,
    distance_m: f64,
}

/// What decides which points belong to a surfel.
#[derive(Debug, Clone)]
pub struct Gates {
    /// Edge of the voxels, metres.
    pub size_m: f64,
    /// How far scans and reference may yet lie apart, metres.
    pub misfit_m: f64,
    /// Edge of the patches of the reference's surface errors, metres.
    pub patch_m: f64,
    /// Of so many steps in turn one has rows, for each scanner.
    pub keyframe_steps: Vec<usize>,
}

stored!(struct Region { centre_m, offset_m, surfels });
