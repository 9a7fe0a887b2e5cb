//! `boresight replay`

use std::path::PathBuf;

use serde_json::json;

use super::context::Context;
use super::interrupt;
use super::record::{Screen, records_of, summary_of};
use crate::error::Result;
use crate::pipeline::Outcome;
use crate::record::{Player, record};

/// Replay a recording: send its data over sockets as the sensors did, and record them as while driving
#[derive(Debug, clap::Args)]
pub(super) struct Replay {
    /// The folder of the recording
    folder: PathBuf,
    /// Replay this many times as fast
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = speed)]
    speed: f64,
    /// Folder of the new recording [default: nothing is kept]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Time after the last record, seconds of the recording.
const AFTER_S: f64 = 1.0;

impl Replay {
    pub fn execute(&self, context: &Context) -> Result<Outcome> {
        let player = Player::start(&self.folder, self.speed)?;
        let folder = self.out.clone().unwrap_or_else(|| {
            let name = format!("boresight-replay-{}", std::process::id());
            std::env::temp_dir().join(name)
        });
        let end_s = player.span_s() + AFTER_S;
        let mut screen = Screen::new(context.terminal.is_quiet());
        let mut last = None;
        let ended = record(player.field(), &folder, player.clock(), |view| {
            screen.show(view);
            last = Some(view.clone());
            !interrupt::is_asked() && view.time_s < end_s
        });
        let played = player.finish();
        if self.out.is_none() {
            // The recording is not kept.
            let _ = std::fs::remove_dir_all(&folder);
        }
        ended?;
        played?;
        let sources = last.map_or(Vec::new(), |view| view.sources);
        let mut summary = summary_of(&sources);
        if self.out.is_some() {
            summary = format!("{}\n{summary}", folder.display());
        }
        Ok(Outcome {
            result: json!({ "folder": self.out, "sources": records_of(&sources) }),
            summary,
            ..Outcome::default()
        })
    }
}

fn speed(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(speed) if (0.01..=1000.0).contains(&speed) => Ok(speed),
        _ => Err("expected a factor from 0.01 to 1000".into()),
    }
}
