//! Georeferenced clouds: written whole as they stream by, and kept thinned for comparing.

use super::stages::{in_parallel, open_profiles, warn_of_missing};
use crate::error::{Error, Result};
use crate::format::CloudWriter;
use crate::geometry::{Pose, Vec3};
use crate::georeference::Georeferencer;
use crate::progress::Progress;
use crate::project::{Project, Scanner};
use crate::sensor::ScanPoint;
use crate::trajectory::Trajectory;

/// Most points of one scanner and drive that are kept for comparing. M3C2 averages over cylinders;
/// what is left still gives tens of points to each.
const MOST_KEPT: usize = 2_000_000;

/// Keeps an even share of a stream of unknown length. A point is kept where a hash of its index is
/// below a bound that halves whenever too many are kept: every n-th point would be the same few
/// columns of every profile.
struct Evenly {
    bound: u64,
    shown: u64,
    kept: Vec<(u64, ScanPoint)>,
}

impl Evenly {
    fn new() -> Self {
        Self {
            bound: u64::MAX,
            shown: 0,
            kept: Vec::new(),
        }
    }

    fn show(&mut self, point: &ScanPoint) {
        // Multiples of the golden ratio are spread evenly over [0, 2^64).
        let hash = self.shown.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.shown += 1;
        if hash <= self.bound {
            self.kept.push((hash, *point));
            if self.kept.len() > MOST_KEPT {
                self.bound /= 2;
                self.kept.retain(|(hash, _)| *hash <= self.bound);
            }
        }
    }
}

/// An even share of each scanner's laser points, in the frame of the scanner.
pub type KeptPoints = Vec<Vec<ScanPoint>>;

/// Reads all profiles of the project once. Keeps an even share of each scanner's points and, where
/// `write` is given, writes all of them, placed with the given mountings, to the path that it
/// returns for a scanner.
///
/// # Errors
/// What the readers find; profiles of which none falls in the trajectory's span; a cloud cannot be
/// written.
pub fn stream(
    project: &Project,
    trajectory: &Trajectory,
    mountings: &[Pose],
    write: Option<&(dyn Fn(&Scanner) -> std::path::PathBuf + Sync)>,
    progress: &dyn Progress,
) -> Result<KeptPoints> {
    let jobs = project
        .scanners
        .iter()
        .zip(mountings)
        .enumerate()
        .map(|(index, (scanner, pose))| {
            let number = u16::try_from(index).map_err(|_| {
                Error::data(
                    format!("scanner `{}` is number {index}", scanner.name),
                    "a cloud can tell 65536 scanners apart: split the project",
                )
            })?;
            Ok((number, scanner, pose, open_profiles(scanner)?))
        })
        .collect::<Result<Vec<_>>>()?;
    let bytes = jobs
        .iter()
        .flat_map(|job| &job.3)
        .map(|reader| reader.bytes_total())
        .sum();
    progress.begin("georeferencing", bytes);
    let found = in_parallel(jobs, |(number, scanner, pose, readers)| {
        let mut place = Georeferencer::new(trajectory, *pose, scanner.time_offset_s);
        let mut writer = match write {
            Some(path) => Some(CloudWriter::create(&path(scanner), project.origin_m)?),
            None => None,
        };
        let mut kept = Evenly::new();
        let mut chunk = Vec::new();
        for mut reader in readers {
            let mut bytes = 0;
            while reader.next_chunk(&mut chunk)? {
                for point in &chunk {
                    let time_s = point.time_s + scanner.time_offset_s;
                    let Some(world) = place.place(point) else {
                        continue;
                    };
                    kept.show(point);
                    if let Some(writer) = &mut writer {
                        let position = world + project.origin_m;
                        writer.write(&position, time_s, point.intensity, number)?;
                    }
                }
                progress.advance(reader.bytes_read() - bytes);
                bytes = reader.bytes_read();
            }
        }
        if let Some(writer) = writer {
            writer.finish()?;
        }
        place.check(&scanner.name)?;
        let points = kept.kept.into_iter().map(|(_, point)| point).collect();
        Ok((points, place))
    });
    progress.end();
    let found = found.into_iter().collect::<Result<Vec<_>>>()?;
    let named = project.scanners.iter().zip(found);
    Ok(named
        .map(|(scanner, (points, place))| {
            warn_of_missing(
                &scanner.name,
                (place.outside(), place.read()),
                place.refused(),
                progress,
            );
            points
        })
        .collect())
}

/// Places kept points with these mountings.
pub fn place(
    project: &Project,
    trajectory: &Trajectory,
    mountings: &[Pose],
    kept: &KeptPoints,
) -> Vec<Vec<Vec3>> {
    let jobs: Vec<_> = project.scanners.iter().zip(mountings).zip(kept).collect();
    in_parallel(jobs, |((scanner, pose), points)| {
        let mut place = Georeferencer::new(trajectory, *pose, scanner.time_offset_s);
        points
            .iter()
            .filter_map(|point| place.place(point))
            .collect()
    })
}

/// The file name of a scanner's cloud.
pub fn file_name(scanner: &str) -> String {
    format!("cloud-{scanner}.laz")
}
