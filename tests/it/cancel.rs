//! Every long call can be cancelled: it returns `Cancelled`, ends its stages, and leaves no file behind.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use crate::common::{TINY_SCENARIO, files, simulated};
use boresight::pipeline::online::{Source, online};
use boresight::pipeline::{self, Options, Outcome};
use boresight::progress::Progress;
use boresight::project::Project;
use boresight::simulation::Scenario;
use boresight::tiles::{Comparison, FeatureSettings, NormalSource, Orientation};
use boresight::{Error, Result};

/// Cancels the work when it asks for the `at`-th time, and from then on.
struct StopAt {
    at: u64,
    asked: AtomicU64,
    open: AtomicI64,
}

impl StopAt {
    fn new(at: u64) -> Self {
        Self {
            at,
            asked: AtomicU64::new(0),
            open: AtomicI64::new(0),
        }
    }
}

impl Progress for StopAt {
    fn begin(&self, _stage: &str, _total: u64) {
        self.open.fetch_add(1, Ordering::SeqCst);
    }
    fn advance(&self, _units: u64) {}
    fn end(&self) {
        self.open.fetch_sub(1, Ordering::SeqCst);
    }
    fn say(&self, _message: &str) {}
    fn warn(&self, _message: &str) {}
    fn is_cancelled(&self) -> bool {
        self.asked.fetch_add(1, Ordering::SeqCst) + 1 >= self.at
    }
}

/// The first and the last time that the work asks, and some in between, as shares of all.
const EVERYWHERE: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// Counts how often `work` asks whether it is cancelled, which must be at least `least` times, then cancels it at these
/// shares of that number.
fn assert_cancellable(
    what: &str,
    least: u64,
    shares: &[f64],
    work: impl Fn(&Options, &dyn Progress) -> Result<Outcome>,
) {
    let folder = tempfile::tempdir().unwrap();
    let options = |name: &str| Options {
        out: folder.path().join(name),
        seed: None,
        fresh: true,
        kept: Vec::new(),
    };
    let never = StopAt::new(u64::MAX);
    work(&options("whole"), &never).unwrap();
    let asked = never.asked.into_inner();
    assert_eq!(never.open.into_inner(), 0, "{what}");
    assert!(asked >= least, "{what} asks {asked} times");

    let out = options("out");
    fs::create_dir(&out.out).unwrap();
    fs::write(out.out.join("result.json"), "the user's own").unwrap();
    let before = files(&out.out);
    for share in shares {
        let at = ((share * asked as f64) as u64).max(1);
        let stop = StopAt::new(at);
        let outcome = work(&out, &stop);
        assert!(
            matches!(outcome, Err(Error::Cancelled)),
            "{what}, {at} of {asked}: {outcome:?}"
        );
        assert_eq!(stop.open.into_inner(), 0, "{what}, {at} of {asked}");
        assert!(before == files(&out.out), "{what}, {at} of {asked}");
    }
}

fn scenario(folder: &Path) -> String {
    let path = folder.join("tiny.toml");
    fs::write(&path, TINY_SCENARIO).unwrap();
    path.to_str().unwrap().to_owned()
}

/// A simulated drive: its temporary folder, its project, and its reference.
fn drive() -> (tempfile::TempDir, Project, PathBuf) {
    let (temp, drive) = simulated();
    let project = Project::read(&drive.join("project.toml")).unwrap();
    (temp, project, drive.join("../tls.laz"))
}

#[test]
fn simulations_can_be_cancelled() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = scenario(folder.path());
    assert_cancellable("simulate", 4, &EVERYWHERE, |options, progress| {
        pipeline::simulate(Scenario::load(&scenario)?, options, progress)
    });
}

#[test]
fn commands_on_projects_can_be_cancelled() {
    let (_temp, project, _) = drive();
    assert_cancellable("trajectory", 4, &EVERYWHERE, |options, progress| {
        pipeline::trajectory(&project, options, progress)
    });
    assert_cancellable(
        "trajectory --online",
        1000,
        &EVERYWHERE,
        |options, progress| {
            let rows = &mut std::io::sink();
            online(&project, Source::Replay, options, rows, progress)
        },
    );
    let placement = pipeline::Placement::new(&project, None, None).unwrap();
    assert_cancellable("georeference", 6, &EVERYWHERE, |options, progress| {
        pipeline::georeference(&placement, options, progress)
    });
    assert_cancellable("run", 20, &[0.5], |options, progress| {
        pipeline::run(&project, options, progress)
    });
}

#[test]
#[ignore = "just acceptance"]
fn calibrations_and_runs_can_be_cancelled_at_any_moment() {
    let (_temp, project, _) = drive();
    assert_cancellable("calibrate", 8, &EVERYWHERE, |options, progress| {
        pipeline::calibrate(&project, options, progress)
    });
    assert_cancellable("run", 20, &EVERYWHERE, |options, progress| {
        pipeline::run(&project, options, progress)
    });
}

#[test]
fn commands_on_clouds_can_be_cancelled() {
    let (_temp, _, cloud) = drive();
    // In one piece, and by tiles.
    for memory_bytes in [None, Some(1)] {
        let comparison = Comparison {
            cloud: cloud.clone(),
            reference: cloud.clone(),
            core: None,
            normals: NormalSource::Core {
                orientation: Orientation::default(),
            },
            settings: Default::default(),
            memory_bytes,
        };
        assert_cancellable("compare", 3, &EVERYWHERE, |options, progress| {
            pipeline::compare(&comparison, options, progress)
        });
        let settings = FeatureSettings {
            memory_bytes,
            ..FeatureSettings::default()
        };
        assert_cancellable("features", 4, &EVERYWHERE, |options, progress| {
            pipeline::features(&cloud, &settings, options, progress)
        });
    }
    assert_cancellable("thin", 2, &EVERYWHERE, |options, progress| {
        pipeline::thin(&cloud, 0.1, options, progress)
    });
}
