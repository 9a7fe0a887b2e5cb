//! Georeferenced clouds: written whole as they stream by, and kept thinned for comparing.

use std::path::PathBuf;

use super::job::Job;
use super::stages::{in_parallel, open_profiles, warn_of_missing};
use crate::error::{Error, Result};
use crate::format::CloudWriter;
use crate::geometry::{BodyFromScanner, Vec3};
use crate::georeference::Georeferencer;
use crate::progress::Progress;
use crate::project::Project;
use crate::sensor::ScanPoint;
use crate::statistics::EvenSample;
use crate::trajectory::Trajectory;

/// Most points of one scanner and drive that are kept for comparing. M3C2 averages over cylinders;
/// what is left still gives tens of points to each.
const MOST_KEPT: usize = 2_000_000;

/// An even share of each scanner's laser points, in the frame of the scanner.
pub type KeptPoints = Vec<Vec<ScanPoint>>;

/// Reads all profiles of the project once. Keeps an even share of each scanner's points and, where
/// `placed` is given, writes all of them: placed with a mounting for each scanner to a file for each.
///
/// # Errors
/// What the readers find; profiles of which none falls in the trajectory's span; a cloud cannot be
/// written; [`Error::Cancelled`](crate::Error::Cancelled).
pub fn stream(
    project: &Project,
    trajectory: &Trajectory,
    placed: Option<(&[BodyFromScanner], &[PathBuf])>,
    progress: &dyn Progress,
) -> Result<KeptPoints> {
    let jobs = project
        .scanners
        .iter()
        .enumerate()
        .map(|(index, scanner)| {
            let number = u16::try_from(index).map_err(|_| {
                Error::data(
                    format!("scanner `{}` is number {index}", scanner.name),
                    "a cloud can tell 65536 scanners apart: split the project",
                )
            })?;
            Ok((number, scanner, open_profiles(scanner)?))
        })
        .collect::<Result<Vec<_>>>()?;
    let bytes = jobs
        .iter()
        .flat_map(|job| &job.2)
        .map(|reader| reader.bytes_total())
        .sum();
    let stage = progress.stage("georeferencing", bytes);
    let found = in_parallel(jobs, |(number, scanner, readers)| {
        let (pose, mut writer) = match placed {
            Some((mountings, files)) => {
                let writer = CloudWriter::create(&files[usize::from(number)], project.origin_m)?;
                (mountings[usize::from(number)], Some(writer))
            }
            None => (scanner.body_from_scanner, None),
        };
        let mut place = Georeferencer::new(trajectory, pose, scanner.time_offset_s);
        let mut kept = EvenSample::new(MOST_KEPT);
        let mut chunk = Vec::new();
        for mut reader in readers {
            let mut bytes = 0;
            while reader.next_chunk(&mut chunk)? {
                for point in &chunk {
                    let time_s = point.time_s + scanner.time_offset_s;
                    let Some(world) = place.place(point) else {
                        continue;
                    };
                    kept.show(*point);
                    if let Some(writer) = &mut writer {
                        let position = world + project.origin_m;
                        writer.write(&position, time_s, point.intensity, number)?;
                    }
                }
                stage.advance(reader.bytes_read() - bytes)?;
                bytes = reader.bytes_read();
            }
        }
        if let Some(writer) = writer {
            writer.finish()?;
        }
        place.check(&scanner.name)?;
        Ok((kept.into_kept(), place))
    });
    drop(stage);
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
    mountings: &[BodyFromScanner],
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
pub fn name(scanner: &str) -> String {
    format!("cloud-{scanner}.laz")
}

/// The file names of the clouds, in the order of the scanners.
pub fn names(project: &Project) -> Vec<String> {
    let scanners = project.scanners.iter();
    scanners.map(|scanner| name(&scanner.name)).collect()
}

/// Writes the cloud of each scanner, placed with these mountings, and keeps an even share.
///
/// # Errors
/// As for [`stream`].
pub fn write(
    project: &Project,
    trajectory: &Trajectory,
    mountings: &[BodyFromScanner],
    job: &mut Job<'_>,
) -> Result<KeptPoints> {
    let files: Vec<PathBuf> = names(project).iter().map(|name| job.path(name)).collect();
    job.timed("georeference", |progress| {
        stream(project, trajectory, Some((mountings, &files)), progress)
    })
}
