//! Georeferenced clouds: streamed to files, with a sample of the points for comparison.

use std::path::{Path, PathBuf};

use super::job::Job;
use super::open_project::OpenProject;
use super::profiles::{all_profile_inputs, open_profiles, warn_of_remarks};
use super::rig::Rig;
use super::stages::{box_of, in_parallel, warn_of_missing};
use crate::comparison::TimedPoint;
use crate::error::{Error, Result};
use crate::format::{
    self, CloudClock, CloudPoint, CloudShape, CloudSink, CloudWriter, ExtraDimension, ExtraKind,
    ExtraValue,
};
use crate::geometry::{Bending, Vec3};
use crate::georeference::Georeferencer;
use crate::joint::{BENDING_STEP_S, Compliance, loads};
use crate::progress::Progress;
use crate::project::Project;
use crate::sensor::ScanPoint;
use crate::statistics::EvenSample;
use crate::trajectory::Trajectory;

/// Maximum number of points of the sample for comparison, per scanner and drive. M3C2 averages over cylinders; this
/// many points still put tens of points into each cylinder.
const MAX_SAMPLE: usize = 2_000_000;

/// The scanners on a body whose frame may bend.
#[derive(Debug, Clone, Copy)]
pub struct Mounted<'a> {
    /// The scanners.
    pub rig: &'a Rig,
    /// The motion of each scanner about its mounting along the drive; empty if mountings are rigid.
    pub bending: &'a [Bending],
}

impl<'a> Mounted<'a> {
    /// Mountings that are rigid.
    pub fn rigid(rig: &'a Rig) -> Self {
        Self { rig, bending: &[] }
    }

    /// Places points of the scanner with this number on a trajectory.
    fn georeferencer(&self, scanner: usize, trajectory: &'a Trajectory) -> Georeferencer<'a> {
        let place = self.rig.georeferencer(scanner, trajectory);
        place.with_bending(self.bending.get(scanner))
    }
}

/// The motion of the mountings along a drive by their compliance; empty if none has a compliance.
pub fn bending(rig: &Rig, trajectory: &Trajectory) -> Vec<Bending> {
    if rig.compliance.iter().all(Option::is_none) {
        return Vec::new();
    }
    // Loads are also known where poses are too uncertain to place points.
    let loads = loads(&trajectory.clone().without_limits());
    let bending = |compliance: &Option<Compliance>| {
        Bending::sampled(trajectory.span_s(), BENDING_STEP_S, |time_s| {
            let compliance = compliance.as_ref();
            compliance.map_or([0.0; 6], |c| c.offset(&loads.at(time_s)))
        })
    };
    rig.compliance.iter().map(bending).collect()
}

/// An even sample of the laser points of one scanner.
#[derive(Debug, Clone, Default)]
pub struct CloudSample {
    /// Number of points with a pose, from which the sample was taken.
    pub total: u64,
    /// Points in the scanner frame, in the order of measurement, each with the number of its profile among those with
    /// points in the recordings of the scanner, from 0.
    pub points: Vec<(u32, ScanPoint)>,
}

/// The values of a georeferenced point in addition to its position, time and intensity.
struct Values {
    scanner: u16,
    /// Number of the profile among those with points in the recordings of the scanner, from 0.
    profile: u32,
    time_s: f64,
    /// Standard deviation of the body's position at that time, √(σ_e² + σ_n² + σ_u²), metres.
    pose_sigma_m: f64,
}

impl Values {
    fn new(scanner: u16) -> Self {
        Self {
            scanner,
            profile: 0,
            time_s: f64::NAN,
            pose_sigma_m: f64::NAN,
        }
    }

    fn dimensions() -> Vec<ExtraDimension> {
        use ExtraKind::{F32, U32};
        vec![
            ExtraDimension::new("scanner", U32, "in the order of the project"),
            ExtraDimension::new("profile", U32, "number, of those with points"),
            ExtraDimension::new("pose_sigma_m", F32, "of the body's position"),
        ]
    }

    /// Advances to the next point: one at another time belongs to another profile. Returns whether it does.
    fn next(&mut self, time_s: f64) -> bool {
        if self.time_s == time_s {
            return false;
        }
        self.profile += u32::from(!self.time_s.is_nan());
        self.time_s = time_s;
        true
    }

    fn look_up_sigma(&mut self, trajectory: &Trajectory) {
        let sigma = trajectory.sigma_at(self.time_s);
        self.pose_sigma_m = sigma.map_or(f64::NAN, |sigma| sigma.position_m.norm());
    }

    fn array(&self) -> [ExtraValue; 3] {
        let (scanner, profile) = (f64::from(self.scanner), f64::from(self.profile));
        [scanner, profile, self.pose_sigma_m].map(ExtraValue::Number)
    }
}

/// The coordinate reference system of the world, which is that of the reference.
fn wkt(project: &OpenProject) -> Result<Option<String>> {
    let Some(reference) = &project.reference else {
        return Ok(None);
    };
    let input = &project.input(&reference.path);
    // The clouds are in metres, a system in feet is not theirs.
    match format::unit_m(input)? {
        Some(_) => Ok(None),
        None => format::crs_wkt(input),
    }
}

/// The properties of a drive's clouds that are known before their points are placed.
///
/// # Errors
/// The reference, which has the coordinate reference system of the clouds, cannot be read.
pub fn shape(project: &OpenProject, trajectory: &Trajectory) -> Result<CloudShape> {
    let (first_s, last_s) = trajectory.span_s();
    Ok(CloudShape {
        clock: CloudClock::of_span(first_s, last_s),
        has_time: true,
        has_intensity: true,
        dimensions: Values::dimensions(),
        wkt: wkt(project)?,
        ..CloudShape::default()
    })
}

/// Opens the sink for the points of the scanner with this number.
pub type OpenSink<'a> = dyn Fn(usize, &CloudShape) -> Result<Box<dyn CloudSink + 'a>> + Sync + 'a;

/// Opens LAS or LAZ files, one per scanner, for the points along this trajectory: their coordinates are counted from the
/// middle of the drive, because the files hold only points that are near.
pub fn into_files<'a>(
    files: &'a [PathBuf],
    project: &OpenProject,
    trajectory: &Trajectory,
) -> Box<OpenSink<'a>> {
    let places = trajectory.poses().iter();
    let places = places.map(|pose| pose.world_from_body.translation_m);
    let middle_m = box_of(places).map_or_else(Vec3::zeros, |(low, high)| (low + high) / 2.0);
    let offset_m = project.origin_m() + middle_m;
    Box::new(move |index, shape| {
        Ok(Box::new(WholeFile {
            path: &files[index],
            writer: Some(CloudWriter::around(&files[index], offset_m, shape)?),
            is_complete: false,
        }))
    })
}

/// A cloud file that is removed unless it is completed.
struct WholeFile<'a> {
    path: &'a Path,
    /// `None` when the file is finished.
    writer: Option<CloudWriter>,
    is_complete: bool,
}

impl CloudSink for WholeFile<'_> {
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()> {
        self.writer
            .as_mut()
            .map_or(Ok(()), |writer| writer.push(point))
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.writer.take().map_or(Ok(()), CloudWriter::finish)?;
        self.is_complete = true;
        Ok(())
    }
}

impl Drop for WholeFile<'_> {
    fn drop(&mut self) {
        if !self.is_complete {
            // Nothing more can be done for a file that cannot be removed.
            let _ = std::fs::remove_file(self.path);
        }
    }
}

/// Reads all profiles of the project once and takes an even sample of each scanner's points. With `open`, all points
/// are also placed and written.
///
/// # Errors
/// Errors of the readers; no profile within the trajectory's span; a cloud cannot be
/// written; [`Error::Cancelled`].
pub fn stream(
    project: &OpenProject,
    trajectory: &Trajectory,
    mounted: Mounted<'_>,
    open: Option<&OpenSink<'_>>,
    progress: &dyn Progress,
) -> Result<Vec<CloudSample>> {
    let inputs = all_profile_inputs(project);
    let jobs = project
        .scanners
        .iter()
        .enumerate()
        .map(|(index, scanner)| {
            let number = u16::try_from(index).map_err(|_| {
                Error::data(
                    format!("scanner `{}` is number {index} in one cloud", scanner.name),
                    "a cloud can hold at most 65536 scanners: split the project",
                )
            })?;
            let readers = open_profiles(scanner, &inputs[index], trajectory)?;
            Ok((number, scanner, readers))
        })
        .collect::<Result<Vec<_>>>()?;
    let bytes = jobs
        .iter()
        .flat_map(|job| &job.2)
        .map(|reader| reader.bytes_total())
        .sum();
    let shape = open.map(|_| shape(project, trajectory)).transpose()?;
    let stage = progress.stage("georeferencing", bytes);
    let samples = in_parallel(jobs, |(number, scanner, readers)| {
        let index = usize::from(number);
        let mut writer = match (open, &shape) {
            (Some(open), Some(shape)) => Some(open(index, shape)?),
            _ => None,
        };
        let mut place = mounted.georeferencer(index, trajectory);
        let mut sample = EvenSample::new(MAX_SAMPLE);
        let mut chunk = Vec::new();
        let mut values = Values::new(number);
        for mut reader in readers {
            let mut bytes = 0;
            while reader.next_chunk(&mut chunk)? {
                for point in &chunk {
                    let time_s = point.time_s + mounted.rig.time_offsets_s[index];
                    if values.next(time_s) && writer.is_some() {
                        values.look_up_sigma(trajectory);
                    }
                    let Some(world) = place.place(point) else {
                        continue;
                    };
                    sample.push((values.profile, *point));
                    if let Some(writer) = &mut writer {
                        writer.push(&CloudPoint {
                            position: world + project.origin_m(),
                            time_s,
                            intensity: point.intensity,
                            values: &values.array(),
                        })?;
                    }
                }
                stage.advance(reader.bytes_read() - bytes)?;
                bytes = reader.bytes_read();
            }
        }
        // A cloud without a point is dropped unfinished, and is no result.
        place.check(&scanner.name)?;
        if let Some(writer) = writer {
            writer.finish()?;
        }
        let sample = CloudSample {
            total: sample.seen(),
            points: sample.into_values(),
        };
        Ok((sample, place))
    });
    drop(stage);
    let samples = samples.into_iter().collect::<Result<Vec<_>>>()?;
    let named = project.scanners.iter().zip(samples).zip(&inputs);
    Ok(named
        .map(|((scanner, (sample, place)), inputs)| {
            warn_of_remarks(&scanner.name, inputs, progress);
            warn_of_missing(
                &scanner.name,
                place.outside(),
                place.read(),
                place.excluded(),
                progress,
            );
            sample
        })
        .collect())
}

/// Places sampled points with these mountings.
pub fn place(
    trajectory: &Trajectory,
    mounted: Mounted<'_>,
    samples: &[CloudSample],
) -> Vec<Vec<Vec3>> {
    placed(trajectory, mounted, samples, |_, _, position_m| position_m)
}

/// The sampled points of all scanners with these mountings, each with its time.
pub fn place_timed(
    trajectory: &Trajectory,
    mounted: Mounted<'_>,
    samples: &[CloudSample],
) -> Vec<TimedPoint> {
    let timed = placed(
        trajectory,
        mounted,
        samples,
        |scanner, point, position_m| {
            Some(TimedPoint {
                scanner,
                time_s: point.time_s,
                position_m,
            })
        },
    );
    timed.concat()
}

/// What `keep` makes of each sampled point of each scanner and of its place, which is `None` without a pose.
fn placed<T: Send>(
    trajectory: &Trajectory,
    mounted: Mounted<'_>,
    samples: &[CloudSample],
    keep: impl Fn(usize, &ScanPoint, Option<Vec3>) -> Option<T> + Sync,
) -> Vec<Vec<T>> {
    let jobs: Vec<_> = samples.iter().enumerate().collect();
    in_parallel(jobs, |(scanner, sample)| {
        let mut place = mounted.georeferencer(scanner, trajectory);
        let points = sample.points.iter();
        points
            .filter_map(|(_, point)| keep(scanner, point, place.place(point)))
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

/// Writes the cloud of each scanner, placed with these mountings, and takes an even sample.
///
/// # Errors
/// As for [`stream`].
pub fn write(
    project: &OpenProject,
    trajectory: &Trajectory,
    mounted: Mounted<'_>,
    job: &mut Job<'_>,
) -> Result<Vec<CloudSample>> {
    let files: Vec<PathBuf> = names(project).iter().map(|name| job.path(name)).collect();
    job.timed("georeference", |progress| {
        let open = into_files(&files, project, trajectory);
        stream(project, trajectory, mounted, Some(&*open), progress)
    })
}
