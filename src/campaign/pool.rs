//! All items on one machine: a pool of processes, one an item, so that none takes another with it.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use super::item::{Failure, Item, failure_of};
use super::work::clean;
use crate::error::{Error, Result};
use crate::output::write_whole;
use crate::progress::Progress;

/// Time between two looks at a process.
const LOOK: Duration = Duration::from_millis(10);
/// A process that is asked to stop has this long to clean up.
const PATIENCE: Duration = Duration::from_secs(20);

/// How items are done on one machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Pool {
    /// Items at the same time.
    pub workers: usize,
    /// The program that does one: it reads the item as a line of JSON, does it, and ends when its standard input is
    /// closed. If it fails it prints a [`Failure`] as JSON.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<OsString>,
    /// Memory of each, for messages, bytes.
    pub memory_bytes: u64,
}

/// What became of the items.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Tally {
    /// Done now.
    pub done: usize,
    /// Finished in an earlier call.
    pub kept: usize,
    /// Failed now.
    pub failed: usize,
}

/// Where an item stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Waiting,
    Running,
    Finished,
    Failed,
}

/// Where all items stand.
struct States {
    of: Vec<State>,
    /// No item before this one waits.
    first: usize,
}

struct Shared<'a> {
    items: &'a [Item],
    by_name: BTreeMap<&'a str, usize>,
    states: Mutex<States>,
    changed: Condvar,
}

impl Pool {
    /// Does all items that are not finished, those first that others need. Failures are written to files and counted;
    /// what failed in an earlier call is tried again.
    ///
    /// # Errors
    /// The program cannot be started, a failure cannot be written, [`Error::Cancelled`].
    pub fn run(&self, items: &[Item], out: &Path, progress: &dyn Progress) -> Result<Tally> {
        let states: Vec<State> = items
            .iter()
            .map(|item| match item.is_finished(out) {
                true => State::Finished,
                false => State::Waiting,
            })
            .collect();
        let kept = states
            .iter()
            .filter(|state| **state == State::Finished)
            .count();
        let shared = Shared {
            items,
            by_name: items
                .iter()
                .enumerate()
                .map(|(at, item)| (item.name.as_str(), at))
                .collect(),
            states: Mutex::new(States {
                of: states,
                first: 0,
            }),
            changed: Condvar::new(),
        };
        let stage = progress.stage("items", (items.len() - kept) as u64);
        let ends: Vec<Result<()>> = thread::scope(|scope| {
            let workers: Vec<_> = (0..self.workers.max(1))
                .map(|_| {
                    scope.spawn(|| {
                        let end = self.worker(&shared, out, progress);
                        // The others do not wait for what this one would have done.
                        if end.is_err() {
                            shared.stop();
                        }
                        end
                    })
                })
                .collect();
            let join = |worker: thread::ScopedJoinHandle<'_, Result<()>>| {
                worker.join().unwrap_or(Err(Error::Cancelled))
            };
            workers.into_iter().map(join).collect()
        });
        drop(stage);
        // An error of one cancels the others.
        let is_cause = |end: &Result<()>| !matches!(end, Ok(()) | Err(Error::Cancelled));
        if let Some(cause) = ends.iter().position(is_cause) {
            return ends
                .into_iter()
                .nth(cause)
                .unwrap_or(Ok(()))
                .map(|()| Tally::default());
        }
        ends.into_iter().collect::<Result<()>>()?;
        let states = shared
            .states
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        let count = |state| states.of.iter().filter(|other| **other == state).count();
        Ok(Tally {
            done: count(State::Finished) - kept,
            kept,
            failed: count(State::Failed),
        })
    }

    fn worker(&self, shared: &Shared<'_>, out: &Path, progress: &dyn Progress) -> Result<()> {
        loop {
            progress.check()?;
            let Some((at, failed)) = shared.next(progress)? else {
                return Ok(());
            };
            let failure = match failed {
                Some(needed) => Some(not_tried(&shared.items[needed])),
                None => self.one(&shared.items[at], out, progress)?,
            };
            let item = &shared.items[at];
            let state = match failure {
                None => State::Finished,
                Some(failure) => {
                    progress.warn(&format!("{item}: {}", failure.problem));
                    keep_failure(item, &failure, out)?;
                    State::Failed
                }
            };
            shared.lock().of[at] = state;
            shared.changed.notify_all();
            progress.advance(1);
        }
    }

    /// Does one item in a process of its own; a failure is why it is not finished.
    fn one(&self, item: &Item, out: &Path, progress: &dyn Progress) -> Result<Option<Failure>> {
        let failed = |error| Error::io(&self.program, error);
        let mut command = Command::new(&self.program);
        // A terminal interrupts all processes of a group, and this one is to end when its input is closed.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command
            .args(&self.arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(failed)?;
        let line = serde_json::to_string(item).unwrap_or_default() + "\n";
        // A full pipe would stop it.
        let texts = [
            in_background(child.stdout.take()),
            in_background(child.stderr.take()),
        ];
        let mut input = child.stdin.take();
        if let Some(input) = &mut input {
            // One that has ended already says why.
            let _ = input.write_all(line.as_bytes());
        }
        let status = loop {
            if let Some(status) = child.try_wait().map_err(failed)? {
                break status;
            }
            if progress.is_cancelled() {
                drop(input.take());
                end(&mut child);
                return Err(Error::Cancelled);
            }
            thread::sleep(LOOK);
        };
        if status.success() && item.is_finished(out) {
            return Ok(None);
        }
        // What it printed only explains how it ended.
        let texts = texts.map(|text| text.join().unwrap_or_default());
        let said = serde_json::from_str(&texts[0]).ok();
        clean(item, out);
        Ok(Some(said.unwrap_or_else(|| self.ended(status, &texts[1]))))
    }

    /// Why a process that said nothing has ended.
    fn ended(&self, status: ExitStatus, said: &str) -> Failure {
        let lines = || said.lines().map(str::trim).filter(|line| !line.is_empty());
        // What is printed about the ending itself comes behind it.
        let lack = lines().find(|line| line.contains("memory allocation"));
        let last = lines().next_back().unwrap_or_default();
        let megabytes = self.memory_bytes / 1_000_000;
        match lack {
            Some(lack) => Failure {
                problem: format!("out of memory: {megabytes} MB are not enough ({lack})"),
                remedy: Some("give each item more with --memory-mb, or do fewer at a time with --workers".into()),
            },
            None => Failure {
                problem: format!("its process ended: {status} {last}").trim_end().to_owned(),
                remedy: Some("run the campaign again; if it repeats, this drive has met a fault of boresight".into()),
            },
        }
    }
}

/// Why an item is not tried whose need failed.
pub fn not_tried(needed: &Item) -> Failure {
    Failure {
        problem: format!("not tried, as it needs {needed}, which failed"),
        remedy: None,
    }
}

/// Writes why an item failed.
///
/// # Errors
/// The file cannot be written.
pub fn keep_failure(item: &Item, failure: &Failure, out: &Path) -> Result<()> {
    let document = serde_json::json!({ "name": item.name, "kind": item.kind, "plot": item.plot, "date": item.date,
        "error": failure });
    write_whole(
        &failure_of(out, &item.name),
        format!("{document:#}\n").as_bytes(),
    )
}

/// Reads a pipe to its end in a thread of its own.
fn in_background(pipe: Option<impl Read + Send + 'static>) -> thread::JoinHandle<String> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        // What was read until it breaks is what there is.
        let _ = pipe.map(|mut pipe| pipe.read_to_end(&mut bytes));
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

/// Waits for a process that was asked to stop, and then no longer.
fn end(child: &mut Child) {
    let asked = Instant::now();
    while asked.elapsed() < PATIENCE && matches!(child.try_wait(), Ok(None)) {
        thread::sleep(LOOK);
    }
    // It may have ended in between.
    let _ = child.kill();
    let _ = child.wait();
}

impl Shared<'_> {
    fn lock(&self) -> MutexGuard<'_, States> {
        self.states.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the first item whose needs are finished, or one of which failed: the item, and that need. Waits where items
    /// that others need are running; `None` when nothing is left.
    fn next(&self, progress: &dyn Progress) -> Result<Option<(usize, Option<usize>)>> {
        let mut states = self.lock();
        loop {
            let left = states.of[states.first..].iter();
            let past = left.take_while(|state| **state != State::Waiting).count();
            states.first += past;
            if states.first == self.items.len() {
                return Ok(None);
            }
            let found = (states.first..self.items.len()).find_map(|at| self.tried(at, &states.of));
            if let Some((at, _)) = found {
                states.of[at] = State::Running;
                return Ok(found);
            }
            progress.check()?;
            let waited = self
                .changed
                .wait_timeout(states, Duration::from_millis(100));
            states = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// An item, and the one that it needs and that failed; `None` where it cannot be done yet.
    fn tried(&self, at: usize, states: &[State]) -> Option<(usize, Option<usize>)> {
        if states[at] != State::Waiting {
            return None;
        }
        let needs = self.items[at].needs.iter();
        let mut needs = needs.filter_map(|name| self.by_name.get(name.as_str()).copied());
        match needs.find(|need| states[*need] != State::Finished) {
            None => Some((at, None)),
            Some(need) if states[need] == State::Failed => Some((at, Some(need))),
            Some(_) => None,
        }
    }

    /// Leaves what waits undone.
    fn stop(&self) {
        let mut states = self.lock();
        let waiting = states.of.iter_mut();
        waiting
            .filter(|state| **state == State::Waiting)
            .for_each(|state| *state = State::Running);
        drop(states);
        self.changed.notify_all();
    }
}
