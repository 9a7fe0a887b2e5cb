//! `boresight campaign`, and the process that runs one of its items.

use std::io::{BufRead, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::context::{Context, Force, out_folder};
use crate::campaign::{
    Campaign as Settings, Failure, Item, Listing, Pool, RESULTS, Share, conclude, hashes, work,
};
use crate::error::{Error, Location, Result};
use crate::output::refuse_kept;
use crate::pipeline::Outcome;
use crate::progress::Progress;
use crate::tiles::{free_bytes, limit_memory};

/// Process many plots and dates: place points, tile clouds, compare with references and earlier dates
///
/// Finished items are not run again, even if the last call was interrupted. Exits with 1 if an item failed; the page
/// says which and why.
#[derive(Debug, clap::Args)]
pub(super) struct Campaign {
    /// The campaign file
    campaign: PathBuf,
    /// Folder for the results [default: `out` next to the campaign file]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Items at the same time [default: one per core, as far as memory allows]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    workers: Option<u16>,
    /// Memory of each item; an item that needs more fails [default: an even share of the free memory]
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..))]
    memory_mb: Option<u64>,
    #[command(flatten)]
    force: Force,
}

impl Campaign {
    /// The outcome, and whether all items are finished.
    pub fn execute(&self, context: &Context, threads: usize) -> Result<(Outcome, bool)> {
        let campaign = Settings::read(&self.campaign)?;
        let out = out_folder(&self.out, &campaign.path);
        let out = std::path::absolute(&out).map_err(|error| Error::io(&out, error))?;
        let mut is_complete = true;
        let inputs = std::slice::from_ref(&campaign.path);
        let outcome = context.logged(&out, inputs, self.force, |options| {
            refuse_kept(&out, &RESULTS, &options.kept)?;
            context.claim(&out)?;
            let progress: &dyn Progress = &context.terminal;
            let listing = Listing::of_folder(campaign.folder(), &out)?;
            let plan = campaign.plan(&listing)?;
            let items = plan.items(&hashes(&plan.files(), campaign.folder(), &out, progress)?);
            let pool = self.pool(campaign.folder(), &out, threads)?;
            progress.say(&format!(
                "{} items, {} at a time, {} MB each",
                items.len(),
                pool.workers,
                pool.memory_bytes / 1_000_000
            ));
            let tally = pool.run(&items, &out, progress)?;
            is_complete = tally.failed == 0;
            let mut outcome = conclude(&campaign, &items, &out)?;
            outcome.summary = format!(
                "{} done, {} kept from before; {}",
                tally.done, tally.finished_before, outcome.summary
            );
            Ok(outcome)
        })?;
        Ok((outcome, is_complete))
    }

    fn pool(&self, root: &Path, out: &Path, threads: usize) -> Result<Pool> {
        let workers = self.workers.map(usize::from);
        let share = Share::of(threads, free_bytes(), workers, self.memory_mb)?;
        let program =
            std::env::current_exe().map_err(|error| Error::io("the running program", error))?;
        let mut arguments = vec![
            "--threads".into(),
            share.threads.to_string().into(),
            "campaign-item".into(),
        ];
        arguments.extend([root.into(), out.into(), share.memory_mb.to_string().into()]);
        Ok(Pool {
            workers: share.workers,
            program,
            arguments,
            memory_bytes: 1_000_000 * share.memory_mb,
        })
    }
}

/// Run an item of a campaign, given as JSON on standard input, and stop when the input is closed
#[derive(Debug, clap::Args)]
pub(super) struct CampaignItem {
    /// The campaign's folder
    root: PathBuf,
    /// Folder of the results
    out: PathBuf,
    /// Memory limit
    memory_mb: u64,
}

impl CampaignItem {
    pub fn execute(&self) -> Result<Outcome> {
        let mut line = String::new();
        let read = std::io::stdin().lock().read_line(&mut line);
        read.map_err(|error| Error::io("stdin", error))?;
        let item: Item = serde_json::from_str(&line).map_err(|error| {
            Error::format(
                "stdin",
                Location::Whole,
                error.to_string(),
                "an item of a campaign",
            )
        })?;
        let memory_bytes = 1_000_000 * self.memory_mb;
        limit_memory(memory_bytes);
        // A comparison gets half of the limit: the rest is for memory that it does not count.
        let done = work(
            &item,
            &self.root,
            &self.out,
            Some(memory_bytes / 2),
            &Parent::watch(),
        );
        done.inspect_err(|error| {
            let failure = Failure::from(error).relative_to(&self.root);
            let text = serde_json::to_string(&failure).unwrap_or_default();
            // If the parent has ended, nobody reads the text.
            let _ = writeln!(std::io::stdout(), "{text}");
        })?;
        Ok(Outcome::default())
    }
}

/// The process that started this one: if it ends, the work stops.
struct Parent {
    is_gone: Arc<AtomicBool>,
}

impl Parent {
    fn watch() -> Self {
        let is_gone = Arc::new(AtomicBool::new(false));
        let set_when_gone = Arc::clone(&is_gone);
        std::thread::spawn(move || {
            // The parent sends nothing more, and the system closes its end of the pipe when it ends.
            let _ = std::io::stdin().read(&mut [0]);
            set_when_gone.store(true, Ordering::Relaxed);
        });
        Self { is_gone }
    }
}

impl Progress for Parent {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn end(&self) {}
    fn say(&self, _: &str) {}
    fn warn(&self, _: &str) {}

    fn is_cancelled(&self) -> bool {
        self.is_gone.load(Ordering::Relaxed)
    }
}
