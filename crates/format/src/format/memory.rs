//! Memory limits, and the peak memory of the program.

/// Memory of the program before it reads a point, with its file buffers, bytes.
const BYTES_BEFORE: u64 = 150 << 20;
/// Fewest points in a tile: with fewer, halos would outweigh tiles.
const LEAST_TILE: u64 = 20_000;
/// Most points in a tile.
const MOST_TILE: u64 = 1 << 30;
/// Memory limit if the system does not report its memory, bytes.
const UNKNOWN: u64 = 4 << 30;

/// A memory limit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Budget {
    /// Bytes.
    pub(crate) bytes: u64,
}

impl Budget {
    /// The given number of bytes, or half of the free memory.
    pub(crate) fn new(bytes: Option<u64>) -> Self {
        Self {
            bytes: bytes.unwrap_or_else(|| free_bytes().unwrap_or(UNKNOWN) / 2),
        }
    }

    /// Number of points of this size that fit in one piece.
    pub(crate) fn points(&self, bytes_a_point: u64) -> u64 {
        self.bytes.saturating_sub(BYTES_BEFORE) / bytes_a_point
    }

    /// Number of points of this size in a tile.
    pub(crate) fn tile_points(&self, bytes_a_point: u64) -> usize {
        self.points(bytes_a_point).clamp(LEAST_TILE, MOST_TILE) as usize
    }
}

/// Peak memory of the program so far, bytes; `None` if the system does not report it.
#[cfg(target_os = "linux")]
pub fn peak_memory_bytes() -> Option<u64> {
    // `getrusage` also counts the process that started this one.
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let peak = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = peak.trim().strip_suffix(" kB")?.parse().ok()?;
    kilobytes.checked_mul(1024)
}

/// Peak memory of the program so far, bytes; `None` if the system does not report it.
#[cfg(all(unix, not(target_os = "linux")))]
pub fn peak_memory_bytes() -> Option<u64> {
    use nix::sys::resource::{UsageWho, getrusage};
    let peak = u64::try_from(getrusage(UsageWho::RUSAGE_SELF).ok()?.max_rss()).ok()?;
    // Apple counts bytes, the others kilobytes.
    let unit = if cfg!(target_vendor = "apple") {
        1
    } else {
        1024
    };
    peak.checked_mul(unit)
}

/// Peak memory of the program so far, bytes; `None` if the system does not report it.
#[cfg(not(unix))]
pub fn peak_memory_bytes() -> Option<u64> {
    None
}

/// Limits the memory of this program: allocations beyond `bytes` fail, which ends the program.
/// Returns whether the system can do that.
pub fn limit_memory(bytes: u64) -> bool {
    #[cfg(unix)]
    {
        use nix::sys::resource::{Resource, setrlimit};
        // Fails where the system's limit is lower, which then stays in force.
        setrlimit(Resource::RLIMIT_DATA, bytes, bytes).is_ok()
    }
    #[cfg(not(unix))]
    {
        let _ = bytes;
        false
    }
}

/// Available memory, bytes; `None` if the system does not report it.
pub fn free_bytes() -> Option<u64> {
    let mut system = sysinfo::System::new();
    system.refresh_memory_specifics(sysinfo::MemoryRefreshKind::nothing().with_ram());
    let free = system.available_memory();
    // A container may have less memory than its machine. Cached files can be evicted and do not
    // count.
    let limit = system.cgroup_limits().map_or(u64::MAX, |limits| {
        limits.total_memory.saturating_sub(limits.rss)
    });
    Some(free.min(limit)).filter(|&bytes| bytes > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_reports_free_and_peak_memory() {
        assert!(free_bytes().is_some());
        assert!(cfg!(not(unix)) || peak_memory_bytes().is_some_and(|peak| peak > 1 << 20));
        assert_eq!(Budget::new(Some(7)).bytes, 7);
    }
}
