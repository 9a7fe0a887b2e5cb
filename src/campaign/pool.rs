//! All items on one machine: a pool of processes, one per item, so that the failure of one does not affect the others.

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

/// Interval between checks of a process.
const POLL: Duration = Duration::from_millis(10);
/// Number of bytes of the end of a process's output that are kept for the failure.
const KEPT: usize = 1 << 16;
/// Time that a process has to clean up after it was asked to stop.
const PATIENCE: Duration = Duration::from_secs(20);

/// The way in which items are run on one machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Pool {
    /// Number of items at the same time.
    pub workers: usize,
    /// The program that runs one item: it reads the item as a line of JSON, runs it, and ends when its standard input
    /// is closed. If it fails, it prints a [`Failure`] as JSON.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<OsString>,
    /// Memory of each item, for messages, bytes.
    pub memory_bytes: u64,
}

/// The numbers of items by their outcome.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Tally {
    /// Number of items done in this call.
    pub done: usize,
    /// Number of items finished in an earlier call.
    pub finished_before: usize,
    /// Number of items that failed in this call.
    pub failed: usize,
}

/// The state of an item.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Waiting,
    Running,
    Finished,
    Failed,
}

/// The states of all items.
struct States {
    by_item: Vec<State>,
    /// Index before which no item is waiting.
    first: usize,
}

struct Shared<'a> {
    items: &'a [Item],
    by_name: BTreeMap<&'a str, usize>,
    states: Mutex<States>,
    changed: Condvar,
}

impl Pool {
    /// Runs all items that are not finished, each after those that it needs. Failures are written to files and counted;
    /// items that failed in an earlier call are tried again.
    ///
    /// # Errors
    /// The program cannot be started, a failure cannot be written, [`Error::Cancelled`].
    pub fn run(&self, items: &[Item], out: &Path, progress: &dyn Progress) -> Result<Tally> {
        let states: Vec<State> = items
            .iter()
            .map(|item| {
                if item.is_finished(out) {
                    State::Finished
                } else {
                    State::Waiting
                }
            })
            .collect();
        let finished_before = states
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
                by_item: states,
                first: 0,
            }),
            changed: Condvar::new(),
        };
        let stage = progress.stage("items", (items.len() - finished_before) as u64);
        let ends: Vec<Result<()>> = thread::scope(|scope| {
            let workers: Vec<_> = (0..self.workers.max(1))
                .map(|_| {
                    scope.spawn(|| {
                        let end = self.worker(&shared, out, progress);
                        // The other threads must not wait for results of this one.
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
        // An error of one thread cancels the others.
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
        let count = |state| {
            states
                .by_item
                .iter()
                .filter(|other| **other == state)
                .count()
        };
        Ok(Tally {
            done: count(State::Finished) - finished_before,
            finished_before,
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
                None => self.run_one(&shared.items[at], out, progress)?,
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
            shared.lock().by_item[at] = state;
            shared.changed.notify_all();
            progress.advance(1);
        }
    }

    /// Runs one item in a process of its own; returns the failure if it does not finish.
    fn run_one(&self, item: &Item, out: &Path, progress: &dyn Progress) -> Result<Option<Failure>> {
        let failed = |error| Error::io(&self.program, error);
        let mut command = Command::new(&self.program);
        // Ctrl-C in a terminal interrupts all processes of a group, but this one must end when its input is closed.
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
        // Both pipes are read all the time, because a full pipe would block the process.
        let texts = [
            in_background(child.stdout.take()),
            in_background(child.stderr.take()),
        ];
        let mut input = child.stdin.take();
        if let Some(input) = &mut input {
            // A process that has already ended explains the reason itself.
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
            thread::sleep(POLL);
        };
        if status.success() && item.is_finished(out) {
            return Ok(None);
        }
        // The output only explains the exit status.
        let texts = texts.map(|text| text.join().unwrap_or_default());
        let failure = serde_json::from_str(&texts[0]).ok();
        clean(item, out);
        Ok(Some(
            failure.unwrap_or_else(|| self.failure_at_end(status, &texts[1])),
        ))
    }

    /// The failure of a process that ended without printing one.
    fn failure_at_end(&self, status: ExitStatus, stderr: &str) -> Failure {
        let lines = || {
            stderr
                .lines()
                .map(str::trim)
                .filter(|line| !line.is_empty())
        };
        // Messages about the end of the process come after its cause.
        let out_of_memory = lines().find(|line| line.contains("memory allocation"));
        let last = lines().next_back().unwrap_or_default();
        let megabytes = self.memory_bytes / 1_000_000;
        match out_of_memory {
            Some(line) => Failure {
                problem: format!("out of memory: {megabytes} MB are not enough ({line})"),
                remedy: Some("give each item more with --memory-mb, or run fewer at a time with --workers".into()),
            },
            None => Failure {
                problem: format!("its process ended: {status} {last}").trim_end().to_owned(),
                remedy: Some("run the campaign again; if this drive fails again, report it as a bug in boresight".into()),
            },
        }
    }
}

/// The failure of an item that is not tried because an item that it needs failed.
pub fn not_tried(needed: &Item) -> Failure {
    Failure {
        problem: format!("not tried, as it needs {needed}, which failed"),
        remedy: None,
    }
}

/// Writes the failure of an item to its file.
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

/// Reads a pipe to its end in a thread of its own; returns the last [`KEPT`] bytes.
fn in_background(mut pipe: Option<impl Read + Send + 'static>) -> thread::JoinHandle<String> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        // If reading fails, the bytes read so far are used.
        while let Some(pipe) = &mut pipe
            && matches!(pipe.take(KEPT as u64).read_to_end(&mut bytes), Ok(1..))
        {
            bytes.drain(..bytes.len().saturating_sub(KEPT));
        }
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

/// Waits for a process that was asked to stop, and kills it after [`PATIENCE`].
fn end(child: &mut Child) {
    let asked = Instant::now();
    while asked.elapsed() < PATIENCE && matches!(child.try_wait(), Ok(None)) {
        thread::sleep(POLL);
    }
    // The process may have ended in the meantime.
    let _ = child.kill();
    let _ = child.wait();
}

impl Shared<'_> {
    fn lock(&self) -> MutexGuard<'_, States> {
        self.states.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the next item that is ready, or one that cannot run because an item it needs failed; returns it with that
    /// failed item. Waits while the needed items of others are running; `None` when no items are left.
    fn next(&self, progress: &dyn Progress) -> Result<Option<(usize, Option<usize>)>> {
        let mut states = self.lock();
        loop {
            let left = states.by_item[states.first..].iter();
            let past = left.take_while(|state| **state != State::Waiting).count();
            states.first += past;
            if states.first == self.items.len() {
                return Ok(None);
            }
            let next =
                (states.first..self.items.len()).find_map(|at| self.candidate(at, &states.by_item));
            if let Some((at, _)) = next {
                states.by_item[at] = State::Running;
                return Ok(next);
            }
            progress.check()?;
            let waited = self
                .changed
                .wait_timeout(states, Duration::from_millis(100));
            states = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The item with this number and the needed item that failed, if any; `None` if it cannot be tried yet.
    fn candidate(&self, at: usize, states: &[State]) -> Option<(usize, Option<usize>)> {
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

    /// Makes the pool end without running the waiting items.
    fn stop(&self) {
        let mut states = self.lock();
        let waiting = states.by_item.iter_mut();
        waiting
            .filter(|state| **state == State::Waiting)
            .for_each(|state| *state = State::Running);
        drop(states);
        self.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_end_of_an_output_is_kept() {
        let text = "x".repeat(1 << 20) + "the end";
        let kept = in_background(Some(std::io::Cursor::new(text)))
            .join()
            .unwrap();
        assert!(
            kept.len() == KEPT && kept.ends_with("xthe end"),
            "{}",
            kept.len()
        );
    }
}
