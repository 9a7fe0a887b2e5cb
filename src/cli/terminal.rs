//! Progress on stderr, and the log.

use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use crate::error::Result;
use crate::progress::Progress;

/// Time until the rate is certain enough to show the remaining time.
const RATE_KNOWN_AFTER: Duration = Duration::from_secs(2);

/// Shows bars on a terminal and one line per stage elsewhere, and keeps every line for the log.
pub(super) struct Terminal {
    quiet: bool,
    verbose: bool,
    /// Whether stderr is a terminal.
    bars: bool,
    start: Instant,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The running stages, innermost last.
    stages: Vec<Stage>,
    log: String,
    /// Warnings so far: each is shown only once.
    warned: Vec<String>,
}

struct Stage {
    name: String,
    start: Instant,
    total: u64,
    done: u64,
    bar: ProgressBar,
}

impl Terminal {
    pub fn new(quiet: bool, verbose: bool) -> Self {
        Self {
            quiet,
            verbose,
            bars: !quiet && std::io::stderr().is_terminal(),
            start: Instant::now(),
            state: Mutex::default(),
        }
    }

    /// Whether only results and errors are shown.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Adds `line` to the log without showing it.
    pub fn note(&self, line: &str) {
        self.keep(&mut self.state(), line);
    }

    /// Writes all lines so far.
    pub fn write_log(&self, path: &Path) -> Result<()> {
        crate::output::write_whole(path, self.state().log.as_bytes())
    }

    /// Locks the state; a poisoned state is still valid.
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn keep(&self, state: &mut State, line: &str) {
        let seconds = self.start.elapsed().as_secs_f64();
        for line in line.lines() {
            state.log.push_str(&format!("{seconds:9.3} s  {line}\n"));
        }
    }

    /// Shows `line` above the running bar; if stderr is closed, it is lost.
    fn show(&self, state: &State, line: &str) {
        let write = || {
            let _ = writeln!(std::io::stderr(), "{line}");
        };
        match state.stages.last() {
            Some(stage) => stage.bar.suspend(write),
            None => write(),
        }
    }

    fn bar(&self, name: &str, total: u64) -> ProgressBar {
        if !self.bars {
            return ProgressBar::hidden();
        }
        let (bar, template) = if total == 0 {
            (ProgressBar::new_spinner(), "{spinner} {msg}  {elapsed}")
        } else {
            let template = "{spinner} {msg}  {bar:20} {percent:>3} % {left}";
            (ProgressBar::new(total), template)
        };
        let style = ProgressStyle::with_template(template)
            .unwrap_or_else(|_| ProgressStyle::default_bar())
            .with_key("left", time_left);
        bar.set_style(style);
        bar.set_message(name.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        bar
    }
}

fn time_left(state: &ProgressState, out: &mut dyn std::fmt::Write) {
    if state.elapsed() > RATE_KNOWN_AFTER && state.pos() > 0 {
        // If it cannot be written, the bar only shows less.
        let _ = write!(out, " {} left", duration(state.eta()));
    }
}

/// `duration` as short text.
fn duration(duration: Duration) -> String {
    let seconds = duration.as_secs_f64();
    if seconds < 9.95 {
        format!("{seconds:.1} s")
    } else if seconds < 99.5 {
        format!("{seconds:.0} s")
    } else {
        let minutes = (seconds / 60.0).round();
        if minutes < 100.0 {
            format!("{minutes} min")
        } else {
            format!("{:.1} h", seconds / 3600.0)
        }
    }
}

impl Progress for Terminal {
    fn is_cancelled(&self) -> bool {
        super::interrupt::is_asked()
    }

    fn begin(&self, stage: &str, total: u64) {
        let mut state = self.state();
        // An outer bar is hidden while an inner one runs.
        if let Some(outer) = state.stages.last() {
            outer.bar.finish_and_clear();
        }
        let bar = self.bar(stage, total);
        state.stages.push(Stage {
            name: stage.to_owned(),
            start: Instant::now(),
            total,
            done: 0,
            bar,
        });
    }

    fn advance(&self, units: u64) {
        if let Some(stage) = self.state().stages.last_mut() {
            stage.done += units;
            stage.bar.inc(units);
        }
    }

    fn end(&self) {
        let mut state = self.state();
        let Some(stage) = state.stages.pop() else {
            return;
        };
        stage.bar.finish_and_clear();
        let depth = "  ".repeat(state.stages.len());
        let took = duration(stage.start.elapsed());
        let line = format!("{depth}{}: {took}", stage.name);
        self.keep(&mut state, &line);
        if !self.quiet {
            self.show(&state, &line);
        }
        if let (true, Some(outer)) = (self.bars, state.stages.last_mut()) {
            outer.bar = self
                .bar(&outer.name, outer.total)
                .with_position(outer.done)
                .with_elapsed(outer.start.elapsed());
        }
    }

    fn say(&self, message: &str) {
        let mut state = self.state();
        self.keep(&mut state, message);
        if self.verbose {
            self.show(&state, message);
        }
    }

    fn warn(&self, message: &str) {
        let mut state = self.state();
        let line = format!("warning: {message}");
        if state.warned.contains(&line) {
            return;
        }
        state.warned.push(line.clone());
        self.keep(&mut state, &line);
        if !self.quiet {
            self.show(&state, &line);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_short() {
        let said = |seconds| duration(Duration::from_secs_f64(seconds));
        assert_eq!(said(0.04), "0.0 s");
        assert_eq!(said(9.94), "9.9 s");
        assert_eq!(said(9.96), "10 s");
        assert_eq!(said(99.0), "99 s");
        assert_eq!(said(130.0), "2 min");
        assert_eq!(said(7000.0), "1.9 h");
    }

    #[test]
    fn the_log_keeps_everything_in_order_even_when_quiet() {
        let terminal = Terminal::new(true, false);
        terminal.begin("outer", 10);
        terminal.begin("inner", 0);
        terminal.advance(3);
        terminal.say("found\ntwo lines");
        terminal.warn("beware");
        terminal.warn("beware");
        terminal.end();
        terminal.end();
        terminal.end(); // a surplus end is harmless
        terminal.note("over");
        let state = terminal.state();
        let lines: Vec<&str> = state
            .log
            .lines()
            .map(|line| line.split_once(" s  ").unwrap().1)
            .collect();
        let expected = [
            "found",
            "two lines",
            "warning: beware",
            "  inner: 0.0 s",
            "outer: 0.0 s",
            "over",
        ];
        assert_eq!(lines, expected);
    }
}
