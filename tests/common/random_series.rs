//! A series of random drives: each is run once, its result kept in a file, and all are counted together.
#![allow(dead_code)] // tests and examples use their parts

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use super::random_drive::{Draw, Ended, WRONG_SIGMAS, Way};
use super::ranks::{LEVEL, Ranks, probability, rank};
use boresight::calibration::PARAMETER_NAMES;
use boresight::error::{Error, Result};

/// Axes of the points whose ranks are tested.
const POINT_AXES: [&str; 3] = ["east", "north", "up"];

/// The results of a series, by seed.
pub struct Series(pub Vec<Ended>);

impl Series {
    /// Runs the drives of these seeds, one on each core, except for those whose results from the same program are in
    /// the folder: a series that was interrupted continues. Prints each as it ends.
    pub fn run(seeds: std::ops::Range<u64>, draw: &Draw, folder: &Path) -> Result<Self> {
        let folder = &folder.join(program()?);
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let next = AtomicU64::new(seeds.start);
        let all = Mutex::new(Vec::new());
        let work = || -> Result<()> {
            let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build();
            let pool = one_thread.map_err(|e| Error::data(e.to_string(), "a thread"))?;
            loop {
                let seed = next.fetch_add(1, Ordering::Relaxed);
                if seed >= seeds.end {
                    return Ok(());
                }
                let ended = pool.install(|| kept(seed, draw, folder))?;
                println!("{seed}: {}\n    {}", ended.drawn, ended.line());
                let mut all = all
                    .lock()
                    .expect("no thread panics while it holds the lock");
                all.push(ended);
            }
        };
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
            let mut results = threads.into_iter().map(|thread| thread.join());
            results.try_for_each(|result| result.expect("a drive does not panic"))
        })?;
        let mut all = all.into_inner().expect("all threads have ended");
        all.sort_by_key(|ended| ended.seed);
        Ok(Self(all))
    }

    /// The results for which something holds.
    pub fn count(&self, what: impl Fn(&Ended) -> bool) -> usize {
        self.0.iter().filter(|ended| what(ended)).count()
    }

    /// Ranks of the truth in the stated distributions: of each parameter of a mounting, for one scanner of each drive,
    /// and of the coordinates of one point of each drive. Others of the same drive depend on these.
    pub fn ranks(&self) -> Vec<Ranks> {
        let parameters = PARAMETER_NAMES.into_iter().map(|parameter| {
            let of_drive = |ended: &Ended| {
                let all = ended.deviations.iter();
                let all: Vec<_> = all.filter(|d| d.parameter == parameter).collect();
                let one = all.get(ended.seed as usize % all.len().max(1))?;
                Some(rank(one.error / one.sigma))
            };
            Ranks {
                quantity: parameter,
                ranks: self.0.iter().filter_map(of_drive).collect(),
            }
        });
        let points = (0..).zip(POINT_AXES).map(|(axis, quantity): (usize, _)| {
            let points = self.0.iter().filter_map(|ended| ended.points.as_ref());
            Ranks {
                quantity,
                ranks: points.map(|points| rank(points.one[axis])).collect(),
            }
        });
        parameters.chain(points).collect()
    }

    /// What the series shows, in lines.
    pub fn summary(&self) -> String {
        let joint = self.count(|ended| matches!(ended.way, Way::Joint(_)));
        let two_steps = self.count(|ended| matches!(ended.way, Way::TwoSteps(_)));
        let stopped = self.count(|ended| matches!(ended.way, Way::Stopped(_)));
        let wrong = self.count(|ended| ended.worst_sigmas() > WRONG_SIGMAS);
        let quiet = self.count(Ended::is_quietly_wrong);
        let alarms = self.count(|ended| !ended.false_alarms.is_empty());
        let named = self.count(|ended| ended.is_named == Some(true));
        let unnamed = self.count(|ended| ended.is_named == Some(false));
        let faults = if named + unnamed > 0 {
            format!("{named} faults named, {unnamed} not\n")
        } else {
            String::new()
        };
        let ranks = self.ranks().into_iter().map(|of| {
            let chance = probability(&of.ranks);
            let mark = if chance < LEVEL { "  not uniform" } else { "" };
            let count = of.ranks.len();
            format!(
                "{:5} {count:4} ranks, probability {chance:.3}{mark}\n",
                of.quantity
            )
        });
        format!(
            "{} drives: {joint} joint, {two_steps} two steps, {stopped} stopped; {wrong} beyond {WRONG_SIGMAS} sigma, \
             {quiet} of them quietly; {alarms} with false alarms\n{faults}{}",
            self.0.len(),
            ranks.collect::<String>(),
        )
    }
}

/// A name for the program that runs, from its bytes.
fn program() -> Result<String> {
    let file = std::env::current_exe().map_err(|e| Error::io("/proc/self/exe", e))?;
    let bytes = std::fs::read(&file).map_err(|e| Error::io(&file, e))?;
    Ok(format!("{:032x}", twox_hash::XxHash3_128::oneshot(&bytes)))
}

/// The result of a drive, from its file in the folder if there is one. Beside it is the scenario, with which
/// `boresight simulate --scenario` simulates the drive again.
fn kept(seed: u64, draw: &Draw, folder: &Path) -> Result<Ended> {
    let file = folder.join(format!("{seed}.json"));
    if let Ok(text) = std::fs::read_to_string(&file) {
        let wrong = |e| Error::data(format!("{}: {e}", file.display()), "the result of a drive");
        return serde_json::from_str(&text).map_err(wrong);
    }
    let write = |extension: &str, text: String| {
        let file = file.with_extension(extension);
        std::fs::write(&file, text).map_err(|e| Error::io(&file, e))
    };
    let scenario = toml::to_string(&draw(seed).0);
    write("toml", scenario.expect("a scenario can be written as TOML"))?;
    let scratch = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
    let ended = Ended::of_seed(seed, draw, scratch.path())?;
    let text = serde_json::to_string_pretty(&ended).expect("a result can be written as JSON");
    write("json", text)?;
    Ok(ended)
}
