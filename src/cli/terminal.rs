//! Progress on stderr, and the log.

use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use super::picture::{Gallery, Picture};
use super::tracker::{Shown, Tracker, duration, line, time_left};
use crate::error::Result;
use crate::progress::{EachPoint, Progress};

/// Interval between updates of the display.
const TICK: Duration = Duration::from_millis(200);
/// If stderr is not a terminal, a line reports the progress after this time without any other line, seconds.
const LINE_AFTER_S: f64 = 10.0;
/// Number of steps of a bar.
const BAR_STEPS: u64 = 1000;

/// Shows bars on a terminal and lines elsewhere, and keeps every line for the log.
pub(super) struct Terminal {
    quiet: bool,
    verbose: bool,
    /// Whether stderr is a terminal.
    bars: bool,
    start: Instant,
    state: Arc<Mutex<State>>,
    gallery: Mutex<Gallery>,
}

/// The messages of the work so far.
#[derive(Default)]
pub(super) struct State {
    /// The running stages.
    tracker: Tracker,
    /// The bar of the innermost stage, on a terminal.
    bar: Option<ProgressBar>,
    log: String,
    /// Warnings so far: each is shown only once.
    warned: Vec<String>,
    /// When a line was last shown, seconds since the start.
    shown_s: f64,
    /// Whether pictures are watched.
    is_watched: bool,
    pictures: Vec<Picture>,
}

/// The view of the work that a page shows.
pub(super) struct View {
    state: Arc<Mutex<State>>,
    start: Instant,
}

impl View {
    /// The progress, the lines of the log from position `log_from` on, and the position of its end.
    pub fn event(&self, log_from: usize) -> (Value, usize) {
        let mut state = locked(&self.state);
        let stages = state.tracker.shown(self.start.elapsed().as_secs_f64());
        let stages = stages.iter().map(|stage| {
            json!({
                "name": stage.name,
                "began_s": stage.began_s,
                "share": stage.share,
                "left_s": stage.left_s,
            })
        });
        let pictures = state.pictures.iter().map(|picture| {
            json!({
                "moment": picture.moment,
                "legend": picture.legend,
                "size_m": picture.size_m,
            })
        });
        let event = json!({
            "stages": stages.collect::<Value>(),
            "pictures": pictures.collect::<Value>(),
            "warnings": state.warned,
            "log_from": log_from,
            "log": state.log.get(log_from..),
        });
        (event, state.log.len())
    }

    /// A picture of the clouds as a file; `None` if there is none with this number.
    pub fn picture(&self, number: usize) -> Option<Vec<u8>> {
        let state = locked(&self.state);
        Some(state.pictures.get(number)?.png.clone())
    }
}

impl Terminal {
    pub fn new(quiet: bool, verbose: bool) -> Self {
        let terminal = Self {
            quiet,
            verbose,
            bars: !quiet && std::io::stderr().is_terminal(),
            start: Instant::now(),
            state: Arc::default(),
            gallery: Mutex::default(),
        };
        if !quiet {
            let (bars, start) = (terminal.bars, terminal.start);
            let state = Arc::downgrade(&terminal.state);
            // If the thread cannot start, the work continues with fewer updates.
            let _ = std::thread::Builder::new().spawn(move || tick(&state, bars, start));
        }
        terminal
    }

    /// Whether only results and errors are shown.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Adds `line` to the log without showing it.
    pub fn note(&self, line: &str) {
        self.keep(&mut self.state(), line);
    }

    /// Writes all lines so far, below these.
    pub fn write_log(&self, path: &Path, head: &str) -> Result<()> {
        let text = format!("{head}{}", self.state().log);
        crate::output::write_whole(path, text.as_bytes())
    }

    /// The view for pages. From now on, pictures of clouds are made.
    pub fn watched(&self) -> View {
        self.state().is_watched = true;
        View {
            state: self.state.clone(),
            start: self.start,
        }
    }

    fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        locked(&self.state)
    }

    fn keep(&self, state: &mut State, line: &str) {
        let seconds = self.now_s();
        for line in line.lines() {
            state.log.push_str(&format!("{seconds:9.3} s  {line}\n"));
        }
    }

    /// Shows `line` above the running bar.
    fn show(&self, state: &mut State, line: &str) {
        state.shown_s = self.now_s();
        match &state.bar {
            Some(bar) => bar.suspend(|| print(line)),
            None => print(line),
        }
    }

    /// Replaces the bar by one for the innermost stage.
    fn renew_bar(&self, state: &mut State) {
        if !self.bars {
            return;
        }
        if let Some(bar) = state.bar.take() {
            bar.finish_and_clear();
        }
        let stages = state.tracker.shown(self.now_s());
        if stages.is_empty() {
            return;
        }
        let bar = ProgressBar::new(BAR_STEPS);
        update(&bar, &stages);
        state.bar = Some(bar);
    }
}

/// Locks the state; a poisoned state is still valid.
fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Prints a line to stderr; it is lost if stderr is closed.
fn print(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Updates the display of the progress until the terminal is dropped.
fn tick(state: &Weak<Mutex<State>>, bars: bool, start: Instant) {
    loop {
        std::thread::sleep(TICK);
        let Some(state) = state.upgrade() else {
            return;
        };
        let mut state = locked(&state);
        let now_s = start.elapsed().as_secs_f64();
        let stages = state.tracker.shown(now_s);
        if bars {
            if let Some(bar) = &state.bar {
                update(bar, &stages);
            }
        } else if let Some(line) = due(&mut state.shown_s, &stages, now_s) {
            print(&line);
        }
    }
}

/// The progress line that is due if stderr is not a terminal.
fn due(shown_s: &mut f64, stages: &[Shown], now_s: f64) -> Option<String> {
    if now_s - *shown_s < LINE_AFTER_S {
        return None;
    }
    let line = line(stages)?;
    *shown_s = now_s;
    Some(line)
}

/// Shows the progress of the stages: a bar if anything can be counted, otherwise the elapsed time.
fn update(bar: &ProgressBar, stages: &[Shown]) {
    let names: Vec<&str> = stages.iter().map(|stage| stage.name.as_str()).collect();
    let counted = stages.iter().rev().find(|stage| stage.share.is_some());
    let template = match counted {
        Some(_) => "{spinner} {msg}  {bar:20} {percent:>3} % {prefix}",
        None => "{spinner} {msg}  {prefix}",
    };
    let style = ProgressStyle::with_template(template);
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_message(names.join(", "));
    let share = counted.and_then(|stage| stage.share).unwrap_or(0.0);
    bar.set_position((share * BAR_STEPS as f64) as u64);
    let so_far = stages.last().map_or(0.0, |stage| stage.ran_s);
    bar.set_prefix(match counted {
        Some(stage) => stage.left_s.map(time_left).unwrap_or_default(),
        None => duration(so_far),
    });
    bar.tick();
}

impl Progress for Terminal {
    fn is_cancelled(&self) -> bool {
        super::interrupt::is_asked()
    }

    fn clouds(&self, moment: &str, names: &[&str], points: &EachPoint<'_>) {
        let state = self.state();
        // Nested stages repeat the calibration under other conditions.
        let shows = state.is_watched && state.tracker.depth() <= 1;
        drop(state);
        if !shows {
            return;
        }
        // The state is unlocked, so that pages and the bar are updated while the picture is drawn.
        let mut gallery = self.gallery.lock().unwrap_or_else(PoisonError::into_inner);
        let picture = gallery.picture(moment, names, points);
        self.state().pictures.extend(picture);
    }

    fn begin(&self, stage: &str, total: u64) {
        let mut state = self.state();
        state.tracker.begin(stage, total, self.now_s());
        self.renew_bar(&mut state);
    }

    fn advance(&self, units: u64) {
        self.state().tracker.advance(units, self.now_s());
    }

    fn end(&self) {
        let mut state = self.state();
        let Some(ended) = state.tracker.end(self.now_s()) else {
            return;
        };
        let depth = "  ".repeat(ended.depth);
        let line = format!("{depth}{}: {}", ended.name, duration(ended.took_s));
        self.keep(&mut state, &line);
        if !self.quiet {
            self.show(&mut state, &line);
        }
        self.renew_bar(&mut state);
    }

    fn say(&self, message: &str) {
        let mut state = self.state();
        self.keep(&mut state, message);
        if self.verbose {
            self.show(&mut state, message);
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
            self.show(&mut state, &line);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_progress_line_appears_after_ten_seconds_without_other_lines() {
        let mut tracker = Tracker::default();
        let mut shown_s = 0.0;
        let mut lines = Vec::new();
        tracker.begin("calibration", 50, 0.0);
        for second in 1..=50 {
            let now_s = f64::from(second);
            tracker.advance(1, now_s);
            if second == 25 {
                shown_s = now_s; // another line
            }
            lines.extend(due(&mut shown_s, &tracker.shown(now_s), now_s));
        }
        let expected = [
            "calibration: 20 %, 40 s left",
            "calibration: 40 %, 30 s left",
            "calibration: 70 %, 15 s left",
            "calibration: 90 %, 5 s left",
        ];
        assert_eq!(lines, expected);
        assert_eq!(due(&mut shown_s, &[], 1000.0), None);
    }

    #[test]
    fn the_log_has_all_lines_in_order_even_when_quiet() {
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
