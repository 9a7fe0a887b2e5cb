//! The number of items that run at the same time on one machine, and the resources of each.

use crate::error::{Error, Result};

/// Share of the free memory that items use.
const SHARE: f64 = 0.9;
/// Memory of an item if the system does not report the free memory, MB.
const UNKNOWN_MB: u64 = 2000;
/// Smallest memory of an item and of each of its threads, MB: with less, threads may fail to start and wait for each
/// other.
const SMALLEST_MB: u64 = 16;
const SMALLEST_THREAD_MB: u64 = 8;
/// Least memory of an item for which another one is started, MB.
const LEAST_MB: u64 = 500;

/// The resources of each of the items that run at the same time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    /// Number of items at the same time.
    pub workers: usize,
    /// Threads of each.
    pub threads: usize,
    /// Memory of each, MB.
    pub memory_mb: u64,
}

impl Share {
    /// Divides the threads and the free memory among `workers`, by default as many as fit.
    ///
    /// # Errors
    /// See [`check_memory`].
    pub fn of(
        threads: usize,
        free_bytes: Option<u64>,
        workers: Option<usize>,
        memory_mb: Option<u64>,
    ) -> Result<Self> {
        let free_mb = free_bytes.map(|bytes| (SHARE * bytes as f64) as u64 / 1_000_000);
        let fitting = free_mb.map_or(1, |free_mb| free_mb / memory_mb.unwrap_or(LEAST_MB).max(1));
        let fitting = usize::try_from(fitting).unwrap_or(usize::MAX);
        let workers = workers.unwrap_or(threads.min(fitting)).max(1);
        let even_mb = || free_mb.map_or(UNKNOWN_MB, |free_mb| free_mb / workers as u64);
        let memory_mb = memory_mb.unwrap_or_else(even_mb);
        let threads = (threads / workers).max(1);
        check_memory(memory_mb, threads)?;
        Ok(Self {
            workers,
            threads,
            memory_mb,
        })
    }
}

/// Checks that an item with this number of threads can start with this memory.
///
/// # Errors
/// The memory is too small.
pub fn check_memory(memory_mb: u64, threads: usize) -> Result<()> {
    let least_mb = SMALLEST_MB + SMALLEST_THREAD_MB * threads as u64;
    if memory_mb >= least_mb {
        Ok(())
    } else {
        Err(Error::data(
            format!("{memory_mb} MB for an item with {threads} threads"),
            format!("give each item {least_mb} MB or more, or run fewer at a time"),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_and_memory_are_shared() {
        let share_of = |free_mb: Option<u64>, workers, memory_mb| {
            let free_bytes = free_mb.map(|free_mb| free_mb * 1_000_000);
            Share::of(8, free_bytes, workers, memory_mb).unwrap()
        };
        let share = |workers, threads, memory_mb| Share {
            workers,
            threads,
            memory_mb,
        };
        assert_eq!(share_of(Some(100_000), None, None), share(8, 1, 11_250));
        assert_eq!(share_of(Some(2000), None, None), share(3, 2, 600));
        assert_eq!(share_of(Some(2000), None, Some(900)), share(2, 4, 900));
        assert_eq!(share_of(Some(2000), Some(4), None), share(4, 2, 450));
        assert_eq!(share_of(None, None, None), share(1, 8, 2000));
        assert_eq!(share_of(Some(100), None, Some(200)), share(1, 8, 200));
        let error = check_memory(23, 1).unwrap_err().to_string();
        assert!(
            error.contains("23 MB for an item with 1 threads"),
            "{error}"
        );
        assert!(error.contains("24 MB or more"), "{error}");
        assert!(check_memory(24, 1).is_ok());
    }
}
