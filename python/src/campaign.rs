//! Campaigns: planning, single items, all of them on one machine, and the index and page.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::PathBuf;

use boresight::campaign::{
    Campaign, ContentHash, Failure, Item, Listing, Plan, Pool, Share, check_memory, clean,
    conclude, work,
};
use boresight::error::Location;
use boresight::tiles::{self, limit_memory};
use boresight::{Error, Result};
use pyo3::prelude::*;

use crate::drives::{OutcomeParts, parts};
use crate::errors::exception;
use crate::work::run;

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Hash>()?;
    module.add_class::<Planned>()?;
    module.add_function(wrap_pyfunction!(campaign_share, module)?)?;
    module.add_function(wrap_pyfunction!(campaign_check_memory, module)?)?;
    module.add_function(wrap_pyfunction!(campaign_texts, module)?)?;
    module.add_function(wrap_pyfunction!(campaign_hashes, module)?)?;
    module.add_function(wrap_pyfunction!(campaign_work, module)?)?;
    module.add_function(wrap_pyfunction!(campaign_clean, module)?)?;
    module.add_function(wrap_pyfunction!(campaign_pool, module)?)?;
    module.add_function(wrap_pyfunction!(campaign_conclude, module)?)
}

/// A hash of content that comes in pieces.
#[pyclass(name = "ContentHash", module = "boresight._boresight")]
#[derive(Default)]
struct Hash(ContentHash);

#[pymethods]
impl Hash {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Goes on with the next piece.
    fn update(&mut self, py: Python<'_>, bytes: &[u8]) {
        py.detach(|| self.0.update(bytes));
    }

    /// 32 hexadecimal digits.
    fn digits(&self) -> String {
        self.0.digits()
    }
}

/// The items of a campaign among its files.
#[pyclass(frozen, name = "CampaignPlan", module = "boresight._boresight")]
struct Planned(Plan);

#[pymethods]
impl Planned {
    /// Of the files of a listing; without one, of those below the campaign's folder but for `out`.
    #[new]
    #[pyo3(signature = (path, listing, out))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        listing: Option<Vec<String>>,
        out: Option<PathBuf>,
    ) -> PyResult<Self> {
        let plan = || {
            let campaign = Campaign::read(&path)?;
            let listing = match listing {
                Some(files) => files.into_iter().collect(),
                None => Listing::of_folder(campaign.folder(), &out.unwrap_or_default())?,
            };
            campaign.plan(&listing)
        };
        let planned = py.detach(plan);
        planned.map(Self).map_err(|error| exception(py, &error))
    }

    /// Every file that an item reads, relative to the campaign's folder, or absolute where it is not below it.
    fn files(&self) -> Vec<String> {
        self.0.files()
    }

    /// The items as JSON, each behind those that it needs, by the hashes of the files.
    fn items(&self, py: Python<'_>, hashes: BTreeMap<String, String>) -> PyResult<Vec<String>> {
        let items = py.detach(|| self.0.items(&hashes));
        let texts = items.iter().map(serde_json::to_string);
        let texts: serde_json::Result<_> = texts.collect();
        texts.map_err(|error| exception(py, &not_json(&error)))
    }
}

fn not_json(error: &serde_json::Error) -> Error {
    Error::format(
        "item",
        Location::Whole,
        error.to_string(),
        "an item of a campaign",
    )
}

fn item(text: &str) -> Result<Item> {
    serde_json::from_str(text).map_err(|error| not_json(&error))
}

fn items(texts: &[String]) -> Result<Vec<Item>> {
    texts.iter().map(|text| item(text)).collect()
}

/// Items at the same time on a machine with so many cores, and threads and memory (MB) of each.
#[pyfunction]
#[pyo3(signature = (cores, workers, memory_mb))]
fn campaign_share(
    py: Python<'_>,
    cores: usize,
    workers: Option<usize>,
    memory_mb: Option<u64>,
) -> PyResult<(usize, usize, u64)> {
    let share = || Share::of(cores, tiles::free_bytes(), workers, memory_mb);
    let share = py.detach(share).map_err(|error| exception(py, &error))?;
    Ok((share.workers, share.threads, share.memory_mb))
}

/// Checks that an item with this number of threads can start with this memory.
#[pyfunction]
fn campaign_check_memory(py: Python<'_>, memory_mb: u64, threads: usize) -> PyResult<()> {
    check_memory(memory_mb, threads).map_err(|error| exception(py, &error))
}

/// The small text files that planning reads, relative to the campaign's folder.
#[pyfunction]
fn campaign_texts(py: Python<'_>, path: PathBuf, listing: Vec<String>) -> PyResult<Vec<String>> {
    let texts = || Campaign::read(&path)?.texts(&listing.into_iter().collect());
    py.detach(texts).map_err(|error| exception(py, &error))
}

/// Hashes of the contents of files, kept in the folder of the results.
#[pyfunction]
#[pyo3(signature = (files, root, out, listener, threads))]
fn campaign_hashes(
    files: Vec<String>,
    root: PathBuf,
    out: PathBuf,
    listener: &Bound<'_, PyAny>,
    threads: Option<usize>,
) -> PyResult<BTreeMap<String, String>> {
    run(listener, threads, |progress| {
        boresight::campaign::hashes(&files, &root, &out, progress)
    })
}

/// Does an item, with the memory of this process limited; returns why it failed, as JSON, if it did.
#[pyfunction]
#[pyo3(signature = (text, root, out, memory_bytes, listener, threads))]
fn campaign_work(
    text: &str,
    root: PathBuf,
    out: PathBuf,
    memory_bytes: Option<u64>,
    listener: &Bound<'_, PyAny>,
    threads: Option<usize>,
) -> PyResult<Option<String>> {
    if let Some(bytes) = memory_bytes {
        limit_memory(bytes);
    }
    run(listener, threads, |progress| {
        // A comparison shares the limit with what it does not count.
        let counted = memory_bytes.map(|bytes| bytes / 2);
        match work(&item(text)?, &root, &out, counted, progress) {
            Ok(()) => Ok(None),
            Err(Error::Cancelled) => Err(Error::Cancelled),
            Err(error) => {
                let failure = Failure::from(&error).relative_to(&root);
                let text = serde_json::to_string(&failure);
                text.map(Some).map_err(|error| not_json(&error))
            }
        }
    })
}

/// Removes what a process that ended in the middle of an item left.
#[pyfunction]
fn campaign_clean(py: Python<'_>, text: &str, out: PathBuf) -> PyResult<()> {
    let cleaned = || item(text).map(|item| clean(&item, &out));
    py.detach(cleaned).map_err(|error| exception(py, &error))
}

/// Does all items by processes of `command`, `workers` at a time; returns how many were done, kept and failed.
#[pyfunction]
#[pyo3(signature = (texts, out, workers, memory_bytes, command, listener))]
fn campaign_pool(
    texts: Vec<String>,
    out: PathBuf,
    workers: usize,
    memory_bytes: u64,
    command: Vec<OsString>,
    listener: &Bound<'_, PyAny>,
) -> PyResult<(usize, usize, usize)> {
    let mut words = command.into_iter();
    let pool = Pool {
        workers,
        program: words.next().unwrap_or_default().into(),
        arguments: words.collect(),
        memory_bytes,
    };
    run(listener, Some(1), |progress| {
        let tally = pool.run(&items(&texts)?, &out, progress)?;
        Ok((tally.done, tally.finished_before, tally.failed))
    })
}

/// Writes the index and the page of a campaign.
#[pyfunction]
fn campaign_conclude(
    py: Python<'_>,
    path: PathBuf,
    texts: Vec<String>,
    out: PathBuf,
) -> PyResult<OutcomeParts> {
    let concluded = || conclude(&Campaign::read(&path)?, &items(&texts)?, &out);
    let outcome = py.detach(concluded);
    outcome.map(parts).map_err(|error| exception(py, &error))
}
