//! The blocks of unknowns and the groups of observations.

use super::bend::Bends;
use super::held::HeldMotion;
use super::input::JointInput;
use super::motion::{GaussMarkov, Motion};
use super::surfel::{Association, CLASSES, COVERAGES};

/// Errors of the reference: shift and rotation.
pub const REFERENCE: usize = 6;
/// Index of the upward shift among them.
pub const UP: usize = 2;

/// The blocks of unknowns: each drive's motion, surfels, patches, planes, knots of mountings, and at the end those that
/// couple with nearly everything: errors of the reference, constants, latencies, compliances and mountings.
#[derive(Debug, Clone)]
pub struct Layout {
    pub sizes: Vec<usize>,
    /// First block of each drive's motion.
    pub first_motion: Vec<usize>,
    pub first_surfel: usize,
    pub first_patch: usize,
    /// Of the slopes of planes in which several surfels lie.
    pub first_plane: usize,
    /// The block of the reference's errors, if there is a reference.
    pub reference: Option<usize>,
    /// The block of each constant of each drive; drives share those of the same name and base.
    pub constants: Vec<Vec<usize>>,
    /// The drive and column that stand for each constant.
    pub constant_owner: Vec<(usize, usize)>,
    pub first_constant: usize,
    /// The blocks of constants of the scanners.
    pub of_scanners: ScannerBlocks,
    /// The block of the first knot of each scanner of each drive, if mountings move.
    pub knots: Vec<Vec<usize>>,
    /// The block of each scanner's compliance, if mountings move.
    pub compliance: Vec<usize>,
    /// The block of each scanner's mounting.
    pub mountings: Vec<usize>,
}

/// The blocks of constants of the scanners, where they are estimated.
#[derive(Debug, Clone)]
pub struct ScannerBlocks {
    /// Of the latencies.
    pub late: Vec<Option<usize>>,
    /// Of what is added to all ranges.
    pub range: Vec<Option<usize>>,
    /// Slow motions of mountings, which are only ever held.
    pub motions: Vec<HeldMotion>,
}

impl Layout {
    pub fn new(
        input: &JointInput<'_>,
        motions: &[Box<dyn Motion>],
        association: &Association,
        bends: Option<&Bends>,
        has_reference: bool,
    ) -> Self {
        let mut sizes = Vec::new();
        let mut first_motion = Vec::new();
        for motion in motions {
            first_motion.push(sizes.len());
            sizes.extend(motion.blocks());
        }
        let mut add = |count: usize, size: usize| {
            let first = sizes.len();
            sizes.resize(first + count, size);
            first
        };
        let first_surfel = add(association.surfels.len(), 3);
        let first_patch = add(association.patches, 1);
        let first_plane = add(association.planes.len(), 2);
        let drives = bends.into_iter().flat_map(|bends| &bends.knots);
        let of_drive = |scanners: &Vec<GaussMarkov>| {
            let first = scanners.iter().map(|knots| add(knots.knot_s.len(), 6));
            first.collect()
        };
        let knots = drives.map(of_drive).collect();
        let reference = has_reference.then(|| add(1, REFERENCE));
        let mut constant_owner = Vec::new();
        let mut named: Vec<(String, f64)> = Vec::new();
        let places: Vec<Vec<usize>> = motions
            .iter()
            .enumerate()
            .map(|(drive, motion)| {
                let constants = motion.constants().into_iter().enumerate();
                let place = constants.map(|(column, constant)| {
                    let shared = named
                        .iter()
                        .position(|(name, base)| *name == constant.name && *base == constant.base);
                    shared.unwrap_or_else(|| {
                        named.push((constant.name, constant.base));
                        constant_owner.push((drive, column));
                        named.len() - 1
                    })
                });
                place.collect()
            })
            .collect();
        let first_constant = add(named.len(), 1);
        let constants = places
            .iter()
            .map(|places| places.iter().map(|place| first_constant + place).collect());
        let constants = constants.collect();
        let late = input.estimate_latency.iter();
        let of_scanners = ScannerBlocks {
            late: late.map(|estimate| estimate.then(|| add(1, 1))).collect(),
            range: vec![None; input.mountings.len()],
            motions: Vec::new(),
        };
        let count = if bends.is_some() {
            input.mountings.len()
        } else {
            0
        };
        let unknowns = bends.map_or(0, Bends::unknowns);
        let compliance = (0..count).map(|_| add(1, unknowns)).collect();
        let mountings = (0..input.mountings.len()).map(|_| add(1, 6)).collect();
        Self {
            first_motion,
            first_surfel,
            first_patch,
            first_plane,
            reference,
            constants,
            constant_owner,
            first_constant,
            of_scanners,
            knots,
            compliance,
            mountings,
            sizes,
        }
    }

    /// The first of the blocks that couple with nearly everything.
    pub fn last(&self) -> usize {
        self.reference.unwrap_or(self.first_constant)
    }
}

/// Start values of the scales of scans, for each class of scatter; on smooth surfaces, strips do not deviate.
const START_SCALE: [f64; CLASSES] = [0.35, 0.5, 0.75, 0.75, 0.75, 0.75];
/// Factors on these start values for each class of coverage.
const START_COVERAGE: [f64; COVERAGES] = [1.8, 1.1, 0.9];

/// The groups of observations whose noise is tested, and for scans and the reference estimated.
#[derive(Debug, Clone)]
pub struct Groups {
    pub names: Vec<String>,
    /// First group of each drive's motion.
    pub first_motion: Vec<usize>,
    pub first_scan: usize,
    pub first_reference: usize,
    /// Errors of the reference's surface over some decimetres.
    pub surface: usize,
    /// All other priors.
    pub assumed: usize,
    /// Factor on the standard deviations of each group.
    pub scale: Vec<f64>,
}

impl Groups {
    pub fn new(input: &JointInput<'_>) -> Self {
        let mut names = Vec::new();
        let mut first_motion = Vec::new();
        let several = input.drives.len() > 1;
        for drive in &input.drives {
            first_motion.push(names.len());
            let of_drive = drive.motion.groups().into_iter();
            names.extend(of_drive.map(|name| {
                if several {
                    format!("{}.{name}", drive.name)
                } else {
                    name
                }
            }));
        }
        let first_scan = names.len();
        for mounting in &input.mountings {
            names.extend((0..COVERAGES * CLASSES).map(|_| mounting.name.clone()));
        }
        let first_reference = names.len();
        names.extend((0..CLASSES).map(|_| "reference".to_owned()));
        let surface = names.len();
        names.extend(["surface".to_owned(), "assumed".to_owned()]);
        let mut scale = vec![1.0; names.len()];
        let groups = scale[first_scan..first_reference].chunks_exact_mut(CLASSES);
        for (group, factor) in groups.zip(START_COVERAGE.iter().cycle()) {
            group.copy_from_slice(&START_SCALE.map(|scale| scale * factor));
        }
        Self {
            scale,
            names,
            first_motion,
            first_scan,
            first_reference,
            surface,
            assumed: surface + 1,
        }
    }

    /// Whether the noise of a group is estimated from its residuals.
    pub fn is_estimated(&self, group: usize) -> bool {
        (self.first_scan..self.surface).contains(&group)
    }
}
