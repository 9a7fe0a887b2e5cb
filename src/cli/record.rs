//! `boresight record`

use std::io::{IsTerminal, Write};
use std::path::PathBuf;

use serde_json::{Map, Value, json};

use super::context::Context;
use super::interrupt;
use crate::error::{Error, Result};
use crate::pipeline::Outcome;
use crate::record::{Clock, Field, LiveView, Room, SourceState, View, folder_for, record};

/// Record the sensors of a field.toml while driving, until Ctrl-C
#[derive(Debug, clap::Args)]
pub(super) struct Record {
    /// The description of the sensors
    field: PathBuf,
    /// Folder of the recording, a new one [default: one named by date and time, beside the description]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only test for some seconds whether every sensor sends, and keep nothing
    #[arg(long, conflicts_with = "out")]
    check: bool,
    /// Stop after this many seconds
    #[arg(long = "for", value_name = "SECONDS", value_parser = super::values::positive_seconds)]
    duration: Option<std::time::Duration>,
}

/// Duration of a check, seconds.
const CHECK_S: f64 = 5.0;
/// Interval between lines if stderr is not a terminal, seconds.
const LINES_S: f64 = 10.0;

impl Record {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let field = Field::read(&self.field)?;
        let clock = Clock::default();
        let folder = match (&self.out, self.check) {
            (Some(out), _) => out.clone(),
            (None, false) => folder_for(&field, &clock),
            (None, true) => {
                let name = format!("boresight-check-{}", std::process::id());
                std::env::temp_dir().join(name)
            }
        };
        let most_s = self.duration.map(|duration| duration.as_secs_f64());
        let most_s = most_s.or(self.check.then_some(CHECK_S));
        let mut screen = Screen::new(context.terminal.is_quiet());
        let mut last = None;
        let ended = record(&field, &folder, &clock, |view| {
            screen.show(view);
            last = Some(view.clone());
            !interrupt::is_asked() && most_s.is_none_or(|most_s| view.time_s < most_s)
        });
        if self.check {
            // The data of a check are not kept.
            let _ = std::fs::remove_dir_all(&folder);
        }
        ended?;
        let sources = last.map_or(Vec::new(), |view| view.sources);
        if self.check {
            let missing = sources.iter().filter(|(_, source)| source.records == 0);
            let missing: Vec<String> = missing
                .map(|(name, source)| {
                    let why = source
                        .error
                        .clone()
                        .unwrap_or_else(|| "it sends nothing".into());
                    format!("{name}: {why}")
                })
                .collect();
            if !missing.is_empty() {
                return Err(Error::data(
                    missing.join("; "),
                    "check cables, addresses and rates",
                ));
            }
        }
        let mut summary = summary_of(&sources);
        if !self.check {
            summary = format!("{}\n{summary}", folder.display());
        }
        Ok(Outcome {
            result: json!({ "folder": folder, "sources": records_of(&sources) }),
            summary,
            ..Outcome::default()
        })
    }
}

/// A line per source.
pub(super) fn summary_of(sources: &[(String, SourceState)]) -> String {
    let lines = sources
        .iter()
        .map(|(name, source)| source_line(name, source));
    lines.collect::<Vec<_>>().join("\n")
}

/// The number of records of each source.
pub(super) fn records_of(sources: &[(String, SourceState)]) -> Map<String, Value> {
    let records = sources.iter().map(|(name, source)| {
        let counts = json!({
            "records": source.records,
            "bytes": source.bytes,
            "damaged_bytes": source.damaged,
        });
        (name.clone(), counts)
    });
    records.collect()
}

/// Shows a recording: in place on a terminal, otherwise line by line.
pub(super) struct Screen {
    is_quiet: bool,
    is_terminal: bool,
    /// Number of lines that are shown on the terminal.
    shown: usize,
    next_s: f64,
    was_silent: Vec<bool>,
    was_short: bool,
}

impl Screen {
    pub(super) fn new(is_quiet: bool) -> Self {
        Self {
            is_quiet,
            is_terminal: std::io::stderr().is_terminal(),
            shown: 0,
            next_s: 0.0,
            was_silent: Vec::new(),
            was_short: false,
        }
    }

    pub(super) fn show(&mut self, view: &View) {
        let is_silent: Vec<bool> = view
            .sources
            .iter()
            .map(|(_, source)| source.is_silent)
            .collect();
        let stopped = is_silent
            .iter()
            .zip(&self.was_silent)
            .any(|(now, then)| *now && !then);
        self.was_silent = is_silent;
        let is_short = view.room.is_some_and(|room| room.is_short());
        let is_alarm = stopped || view.set_s.is_some() || (is_short && !self.was_short);
        self.was_short = is_short;
        if self.is_quiet || (!self.is_terminal && !is_alarm && view.time_s < self.next_s) {
            return;
        }
        self.next_s = view.time_s + LINES_S;
        let mut lines: Vec<String> = view
            .sources
            .iter()
            .map(|(name, source)| source_line(name, source))
            .collect();
        lines.push(clock_line(view));
        lines.extend(view.room.as_ref().map(disk_line));
        lines.extend(
            view.live
                .iter()
                .flat_map(|live| live_lines(live, view.common_s)),
        );
        let mut text = String::new();
        if self.is_terminal {
            // The new lines overwrite the previous ones.
            text.push_str(&"\x1b[A\x1b[2K".repeat(self.shown));
            self.shown = lines.len();
            if is_alarm {
                text.push('\x07');
            }
        }
        text.push_str(&lines.join("\n"));
        // If the lines cannot be printed, recording continues.
        let _ = writeln!(std::io::stderr(), "{text}");
    }
}

/// The status of a source in a line.
fn source_line(name: &str, source: &SourceState) -> String {
    let state = match (&source.error, source.is_open, source.is_silent) {
        (Some(error), false, _) => format!("CLOSED {error}"),
        (None, false, _) => "opening".to_owned(),
        (_, true, true) => "SILENT".to_owned(),
        (_, true, false) => "ok".to_owned(),
    };
    let age = source
        .age_s
        .map_or("-".to_owned(), |age| format!("{age:.1} s"));
    let again = match source.reopened {
        0 => String::new(),
        times => format!(", opened again {times} times"),
    };
    let damaged = match source.damaged {
        0 => String::new(),
        bytes => format!(", {bytes} damaged bytes"),
    };
    let sensor_status = if source.sensor_status.is_empty() {
        String::new()
    } else {
        format!(", {}", source.sensor_status)
    };
    format!(
        "{name:<12} {:7.1} Hz  last {age:>7} ago  {:>9} records  {:8.1} MB  {state}{sensor_status}{again}{damaged}",
        source.rate_hz,
        source.records,
        1e-6 * source.bytes as f64
    )
}

fn clock_line(view: &View) -> String {
    let set = view
        .set_s
        .map_or(String::new(), |set_s| format!("  WAS SET by {set_s:+.3} s"));
    let state = match &view.clock {
        None => "chrony does not answer: its accuracy is unknown".to_owned(),
        Some(clock) if !clock.is_locked => "NOT SYNCHRONISED".to_owned(),
        Some(clock) => format!(
            "follows {}, off by {:.1} µs (rms {:.1} µs)",
            clock.reference,
            1e6 * clock.offset_s,
            1e6 * clock.rms_s
        ),
    };
    format!(
        "{:<12} {state}{set}  {:.0} s recorded",
        "clock", view.time_s
    )
}

/// Pose and boards.
fn live_lines(live: &LiveView, common_s: f64) -> Vec<String> {
    let pose = live.pose.as_ref().map(|pose| {
        let [east, north, up] = pose.position_m.into();
        format!(
            "east {east:.3}  north {north:.3}  up {up:.3} m ± {:.1} mm  heading {:.2}° ± {:.2}°  {:.1} s ago",
            1e3 * pose.sigma_m.norm(),
            pose.heading_rad.to_degrees().rem_euclid(360.0),
            pose.heading_sigma_rad.to_degrees(),
            common_s - pose.time_s
        )
    });
    let mut texts: Vec<String> = pose.into_iter().chain(live.trouble.clone()).collect();
    if texts.is_empty() {
        texts.push("no pose yet".to_owned());
    }
    let lines = ["pose", ""].iter().zip(&texts);
    let lines = lines.map(|(label, text)| format!("{label:<12} {text}"));
    let mut lines: Vec<String> = lines.collect();
    for board in &live.boards {
        let courses = board
            .courses
            .iter()
            .map(|(scanner, courses)| match courses.len() {
                0 => format!("{scanner} not yet"),
                _ => format!("{scanner} on course {}", courses.join(" ")),
            });
        let courses = courses.collect::<Vec<_>>().join(", ");
        lines.push(format!(
            "{:<12} {courses}",
            format!("board {}", board.board)
        ));
    }
    lines
}

fn disk_line(room: &Room) -> String {
    let lasts = match room.lasts_s {
        s if s < 360_000.0 => format!(", {:.1} h at this rate", s / 3600.0),
        _ => String::new(),
    };
    let state = if room.is_short() { "NEARLY FULL, " } else { "" };
    format!(
        "{:<12} {state}{:.1} GB free{lasts}",
        "disk",
        1e-9 * room.free
    )
}
