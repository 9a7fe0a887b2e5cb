//! Work away from the interpreter: on a thread of its own, with the interpreter released, so that other threads
//! of Python run, signals are seen, and progress is told by the thread that called.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use boresight::progress::Progress;
use boresight::{Error, Result};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::errors::exception;

/// How often signals are looked for and progress is told.
const TICK: Duration = Duration::from_millis(50);
/// That of a main thread: the library's own program works on one.
const STACK_BYTES: usize = 8 << 20;

/// What the listener is told.
enum Said {
    Stage(String, u64, u64),
    Line(String),
    Warning(String),
}

struct Stage {
    name: String,
    total: u64,
    /// Units done of the stage around this one.
    done_around: u64,
}

#[derive(Default)]
struct State {
    stages: Vec<Stage>,
    said: VecDeque<Said>,
    is_finished: bool,
}

/// What the working thread and the one that waits for it share.
#[derive(Default)]
struct Shared {
    is_cancelled: AtomicBool,
    /// Units done of the innermost stage.
    done: AtomicU64,
    state: Mutex<State>,
    finished: Condvar,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits a tick or until the work ends; returns what was said since, and whether it has ended.
    fn wait(&self) -> (VecDeque<Said>, bool) {
        let waited = self
            .finished
            .wait_timeout_while(self.state(), TICK, |state| !state.is_finished);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let mut said = std::mem::take(&mut state.said);
        if let Some(stage) = state.stages.last() {
            let done = self.done.load(Ordering::Relaxed);
            said.push_back(Said::Stage(stage.name.clone(), done, stage.total));
        }
        (said, state.is_finished)
    }
}

impl Progress for Shared {
    fn begin(&self, stage: &str, total: u64) {
        let mut state = self.state();
        state.stages.push(Stage {
            name: stage.to_owned(),
            total,
            done_around: self.done.swap(0, Ordering::Relaxed),
        });
        state
            .said
            .push_back(Said::Stage(stage.to_owned(), 0, total));
    }

    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    fn end(&self) {
        let mut state = self.state();
        if let Some(stage) = state.stages.pop() {
            let done = self.done.swap(stage.done_around, Ordering::Relaxed);
            state
                .said
                .push_back(Said::Stage(stage.name, done, stage.total));
        }
    }

    fn say(&self, message: &str) {
        self.state().said.push_back(Said::Line(message.to_owned()));
    }

    fn warn(&self, message: &str) {
        let warning = Said::Warning(message.to_owned());
        self.state().said.push_back(warning);
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }
}

/// Wakes the thread that waits, also when the work panics.
struct Finish<'a>(&'a Shared);

impl Drop for Finish<'_> {
    fn drop(&mut self) {
        self.0.state().is_finished = true;
        self.0.finished.notify_all();
    }
}

/// Runs `work` on `threads` threads (one per core if `None`). `listener` has the methods `stage(name, done, total)`,
/// `say(text)` and `warn(text)`. A signal, or an exception of the listener, cancels the work and is raised once it
/// has stopped.
pub(crate) fn run<T: Send>(
    listener: &Bound<'_, PyAny>,
    threads: Option<usize>,
    work: impl FnOnce(&dyn Progress) -> Result<T> + Send,
) -> PyResult<T> {
    let py = listener.py();
    let shared = Shared::default();
    let mut raised: Option<PyErr> = None;
    let ended = thread::scope(|scope| {
        let worker = thread::Builder::new()
            .name("boresight".into())
            .stack_size(STACK_BYTES)
            .spawn_scoped(scope, || {
                let _finish = Finish(&shared);
                on_threads(threads, || work(&shared))
            })?;
        loop {
            let (said, is_finished) = py.detach(|| shared.wait());
            if raised.is_none()
                && let Err(error) = py.check_signals().and_then(|()| tell(listener, said))
            {
                raised = Some(error);
                shared.is_cancelled.store(true, Ordering::Relaxed);
            }
            if is_finished {
                return Ok::<_, PyErr>(worker.join());
            }
        }
    })?;
    if let Some(error) = raised {
        return Err(error);
    }
    match ended {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(exception(py, &error)),
        Err(_) => Err(PyRuntimeError::new_err(
            "a mistake in boresight, see the message above: please report it",
        )),
    }
}

/// A pool for each call: threads do not survive the fork of a process, and a pool kept from before it would hang.
fn on_threads<T: Send>(
    threads: Option<usize>,
    work: impl FnOnce() -> Result<T> + Send,
) -> Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0));
    let pool = pool.build().map_err(|error| {
        Error::data(
            format!("the threads cannot be started: {error}"),
            "use fewer with `threads`",
        )
    })?;
    pool.install(work)
}

fn tell(listener: &Bound<'_, PyAny>, said: VecDeque<Said>) -> PyResult<()> {
    for item in said {
        match item {
            Said::Stage(name, done, total) => {
                listener.call_method1("stage", (name, done, total))?
            }
            Said::Line(text) => listener.call_method1("say", (text,))?,
            Said::Warning(text) => listener.call_method1("warn", (text,))?,
        };
    }
    Ok(())
}
