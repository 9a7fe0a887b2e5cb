//! A drive of a campaign: its points in tiles, compared with the reference and between the scanners.

use serde_json::json;

use super::clouds::{self, Mounted};
use super::job::Job;
use super::open_project::OpenProject;
use super::outcome::{Options, Outcome};
use super::result::judge;
use super::rig::Rig;
use super::tiled::Tiling;
use super::{drives, stages};
use crate::comparison::{Against, Agreement, MountingKind, ReferenceSurface, agreements};
use crate::error::Result;
use crate::judgement;
use crate::progress::Progress;
use crate::project::Project;
use crate::report::{self, Content};
use crate::results::Results;
use crate::verdict::Verdict;

/// The page of a drive.
pub const PAGE: &str = "drive.html";

/// Places the points of a drive with the mountings of `rig` on its poses, writes them as tiles and compares them;
/// `mounting_verdict` is the verdict on its mountings, if any. Equal inputs give equal bytes, wherever their files are.
///
/// # Errors
/// Errors of the stages.
pub fn field(
    project: &Project,
    rig: &Rig,
    name: &str,
    tile_m: f64,
    mounting_verdict: Option<Verdict>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let mut job = Job::new(options, &project.inputs(), &[PAGE], progress)?;
    let project = &OpenProject::new(project);
    let poses = stages::poses(project, progress)?.poses;
    let bending = clouds::bending(rig, &poses.trajectory);
    let mounted = Mounted {
        rig,
        bending: &bending,
    };
    let tiling = Tiling::new(job.path("spool"), tile_m, project.scanners.len())?;
    let samples = job.timed("georeference", |progress| {
        let open: Box<clouds::OpenSink<'_>> = Box::new(|scanner, _| Ok(tiling.sink(scanner)));
        clouds::stream(project, &poses.trajectory, mounted, Some(&*open), progress)
    })?;
    let folder = job.path("tiles");
    std::fs::create_dir_all(&folder).map_err(|error| crate::Error::io(&folder, error))?;
    let shape = clouds::shape(project, &poses.trajectory)?;
    let tiles = job.timed("tiles", |progress| tiling.write(&folder, &shape, progress))?;
    let reference = stages::reference(project, progress)?;
    let placed = clouds::place(&poses.trajectory, mounted, &samples);
    let scanners: Vec<&str> = project.scanners.iter().map(|s| s.name.as_str()).collect();
    let placed = [(MountingKind::Final, placed)];
    let agreements = job.timed("compare", |progress| {
        let settings = &project.comparison;
        let surface = ReferenceSurface::upwards("the reference", &reference, settings, progress)?;
        agreements(
            name,
            &scanners,
            surface.as_ref(),
            &placed,
            settings,
            progress,
        )
    })?;
    let drive = drives::drive(name, poses, agreements);
    let warnings = job.warnings().to_vec();
    let drives = std::slice::from_ref(&drive);
    let results = Results {
        drives,
        ..Results::default()
    };
    let mut verdicts = judgement::judge(&results, &project.acceptance);
    verdicts.extend(mounting_verdict);
    verdicts.extend(judgement::agreement(drives, &project.acceptance));
    verdicts.sort_by_key(|verdict| std::cmp::Reverse(verdict.severity));
    let content = Content {
        title: name.to_owned(),
        imprint: project.imprint.clone(),
        drives: drives.into(),
        warnings: warnings.as_slice().into(),
        verdicts: verdicts.clone(),
        ..Content::default()
    };
    job.write(PAGE, report::render(&content))?;
    job.commit()?;
    let mut result = json!({
        "points": tiles.iter().map(|tile| tile.points).sum::<u64>(),
        "span_s": [drive.poses.first().map(|pose| pose.time_s), drive.poses.last().map(|pose| pose.time_s)],
        "tiles": tiles,
        "crs_wkt": shape.wkt,
        "agreement": drive.agreements.comparisons.iter().map(agreement).collect::<Vec<_>>(),
    });
    judge(&mut result, &verdicts);
    Ok(Outcome {
        result,
        verdicts: Some(verdicts),
        ..Outcome::default()
    })
}

fn agreement(agreement: &Agreement) -> serde_json::Value {
    let against = match &agreement.against {
        Against::Reference => None,
        Against::Scanner(name) => Some(name),
    };
    let mut value = json!(agreement.statistics);
    value["scanner"] = json!(agreement.scanner);
    value["against"] = json!(against);
    value["pair"] = json!(agreement.pair());
    value
}
