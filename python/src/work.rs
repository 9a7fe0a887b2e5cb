//! Work outside the interpreter: it runs on a separate thread with the interpreter released, so that other Python
//! threads can run and signals are handled. The calling thread reports the progress.

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

/// Interval between checks for signals and reports of the progress.
const TICK: Duration = Duration::from_millis(50);
/// Stack size of the working thread: that of a main thread, on which the program `boresight` works.
const STACK_BYTES: usize = 8 << 20;

/// A message to the listener.
enum Message {
    Stage(String, u64, u64),
    Line(String),
    Warning(String),
}

struct Stage {
    name: String,
    total: u64,
    /// Units done of the enclosing stage.
    done_around: u64,
}

#[derive(Default)]
struct State {
    stages: Vec<Stage>,
    messages: VecDeque<Message>,
    is_finished: bool,
}

/// The state shared by the working thread and the thread that waits for it.
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

    /// Waits for a tick or until the work ends; returns the messages since the last call, and whether the work has
    /// ended.
    fn wait(&self) -> (VecDeque<Message>, bool) {
        let waited = self
            .finished
            .wait_timeout_while(self.state(), TICK, |state| !state.is_finished);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let mut messages = std::mem::take(&mut state.messages);
        if let Some(stage) = state.stages.last() {
            let done = self.done.load(Ordering::Relaxed);
            messages.push_back(Message::Stage(stage.name.clone(), done, stage.total));
        }
        (messages, state.is_finished)
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
            .messages
            .push_back(Message::Stage(stage.to_owned(), 0, total));
    }

    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    fn end(&self) {
        let mut state = self.state();
        if let Some(stage) = state.stages.pop() {
            let done = self.done.swap(stage.done_around, Ordering::Relaxed);
            state
                .messages
                .push_back(Message::Stage(stage.name, done, stage.total));
        }
    }

    fn say(&self, message: &str) {
        self.state()
            .messages
            .push_back(Message::Line(message.to_owned()));
    }

    fn warn(&self, message: &str) {
        let warning = Message::Warning(message.to_owned());
        self.state().messages.push_back(warning);
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }
}

/// Wakes the waiting thread, even if the work panics.
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
            let (messages, is_finished) = py.detach(|| shared.wait());
            if raised.is_none()
                && let Err(error) = py.check_signals().and_then(|()| report(listener, messages))
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
            "a bug in boresight, see the message above: please report it",
        )),
    }
}

/// Runs the work in a new pool, because threads do not survive the fork of a process: an older pool would hang.
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

/// Passes messages to the listener.
fn report(listener: &Bound<'_, PyAny>, messages: VecDeque<Message>) -> PyResult<()> {
    for message in messages {
        match message {
            Message::Stage(name, done, total) => {
                listener.call_method1("stage", (name, done, total))?
            }
            Message::Line(text) => listener.call_method1("say", (text,))?,
            Message::Warning(text) => listener.call_method1("warn", (text,))?,
        };
    }
    Ok(())
}
