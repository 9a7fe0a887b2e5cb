//! How well the clouds of one drive agree: with the reference, and scanner against scanner.

use crate::comparison::{M3c2, Normals, Statistics, core_points, m3c2};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::project::Project;
use crate::report::content::MountingKind;

/// One comparison of two clouds.
#[derive(Debug, Clone)]
pub struct Agreement {
    /// Index of the scanner compared.
    pub scanner: usize,
    /// What it is compared with.
    pub against: Against,
    /// Mounting behind the clouds.
    pub mounting: MountingKind,
    /// Distances in numbers.
    pub statistics: Statistics,
    /// Distances one by one.
    pub distances: M3c2,
}

/// The other side of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Against {
    /// The reference cloud.
    Reference,
    /// Another scanner, by index, whose cloud holds the core points.
    Scanner(usize),
}

/// All comparisons of one drive.
#[derive(Debug, Clone)]
pub struct Drive {
    /// Name.
    pub name: String,
    /// Kind by kind: every scanner to the reference, then every pair of scanners.
    pub agreements: Vec<Agreement>,
    /// Comparisons that found nothing to compare, in words.
    pub missing: Vec<String>,
}

impl Agreement {
    /// The two sides in words.
    pub fn pair(&self, project: &Project) -> String {
        let name = |index: usize| project.scanners[index].name.as_str();
        match self.against {
            Against::Reference => format!("{} to reference", name(self.scanner)),
            Against::Scanner(other) => format!("{} against {}", name(other), name(self.scanner)),
        }
    }
}

/// Compares the clouds of one drive for each kind of mounting. `reference` may be empty.
///
/// Core points lie on the reference, or on the first scanner of a pair; their normals come from
/// there and point up.
///
/// # Errors
/// Settings that make no sense. Clouds that do not meet are listed in [`Drive::missing`].
pub fn evaluate(
    name: &str,
    project: &Project,
    reference: &[Vec3],
    kinds: &[(MountingKind, Vec<Vec<Vec3>>)],
    progress: &dyn Progress,
) -> Result<Drive> {
    let mut drive = Drive {
        name: name.into(),
        agreements: Vec::new(),
        missing: Vec::new(),
    };
    let core = core_points(reference, &project.comparison);
    for (mounting, clouds) in kinds {
        for (scanner, cloud) in clouds.iter().enumerate() {
            if !reference.is_empty() {
                let sides = (reference, cloud.as_slice(), core.as_slice());
                let pair = (scanner, Against::Reference, *mounting);
                drive.compare(project, sides, pair, progress)?;
            }
        }
        for first in 0..clouds.len() {
            let core = core_points(&clouds[first], &project.comparison);
            for second in first + 1..clouds.len() {
                let sides = (
                    clouds[first].as_slice(),
                    clouds[second].as_slice(),
                    core.as_slice(),
                );
                let pair = (second, Against::Scanner(first), *mounting);
                drive.compare(project, sides, pair, progress)?;
            }
        }
    }
    Ok(drive)
}

impl Drive {
    fn compare(
        &mut self,
        project: &Project,
        (reference, compared, core): (&[Vec3], &[Vec3], &[Vec3]),
        (scanner, against, mounting): (usize, Against, MountingKind),
        progress: &dyn Progress,
    ) -> Result<()> {
        if compared.is_empty() || core.is_empty() {
            let name = &project.scanners[scanner].name;
            self.missing.push(format!(
                "{}: scanner `{name}` has no points to compare",
                self.name
            ));
            return Ok(());
        }
        let settings = &project.comparison;
        let other = match against {
            Against::Reference => "reference",
            Against::Scanner(other) => &project.scanners[other].name,
        };
        let kind = match mounting {
            MountingKind::Initial => "initial",
            MountingKind::Final => "calibrated",
            MountingKind::Truth => "true",
        };
        let stage = format!(
            "comparing {} with {other} ({}, {kind})",
            project.scanners[scanner].name, self.name
        );
        let _stage = progress.stage(&stage, core.len() as u64);
        let distances = m3c2(
            reference,
            compared,
            core,
            Normals::UPWARDS,
            settings,
            progress,
        )?;
        match Statistics::of(&distances) {
            Ok(statistics) => {
                let found = Agreement {
                    scanner,
                    against,
                    mounting,
                    statistics,
                    distances,
                };
                self.agreements.push(found);
            }
            Err(reason) => self.missing.push(format!("{}: {reason}", self.name)),
        }
        Ok(())
    }

    /// The comparison of `scanner` with `against` under this mounting.
    pub fn find(
        &self,
        scanner: usize,
        against: Against,
        mounting: MountingKind,
    ) -> Option<&Agreement> {
        self.agreements.iter().find(|found| {
            found.scanner == scanner && found.against == against && found.mounting == mounting
        })
    }
}
