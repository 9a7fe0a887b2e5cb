//! How much memory a cloud may take, and how much the program took.

/// What the program takes before it has read a point, and buffers of files, bytes.
const BYTES_BEFORE: u64 = 150 << 20;
/// The least number of points in a tile: with fewer, halos outweigh tiles.
const LEAST_TILE: u64 = 20_000;
/// The most points in a tile.
const MOST_TILE: u64 = 1 << 30;
/// Memory where the system does not tell how much there is, bytes.
const UNKNOWN: u64 = 4 << 30;

/// Memory to keep to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Budget {
    /// Bytes.
    pub(super) bytes: u64,
}

impl Budget {
    /// That many bytes, or half of the memory that is free.
    pub(super) fn new(bytes: Option<u64>) -> Self {
        Self {
            bytes: bytes.unwrap_or_else(|| free_bytes().unwrap_or(UNKNOWN) / 2),
        }
    }

    /// Number of points that fit in one piece, of so many bytes each.
    pub(super) fn points(&self, bytes_a_point: u64) -> u64 {
        self.bytes.saturating_sub(BYTES_BEFORE) / bytes_a_point
    }

    /// Number of points in a tile, of so many bytes each.
    pub(super) fn tile_points(&self, bytes_a_point: u64) -> usize {
        self.points(bytes_a_point).clamp(LEAST_TILE, MOST_TILE) as usize
    }
}

/// The most memory the program has held so far, bytes; `None` where the system does not tell.
#[cfg(target_os = "linux")]
pub fn peak_memory_bytes() -> Option<u64> {
    // `getrusage` counts the process that started this one as well.
    let status = procfs::process::Process::myself().ok()?.status().ok()?;
    status.vmhwm.map(|kilobytes| kilobytes * 1024)
}

/// The most memory the program has held so far, bytes; `None` where the system does not tell.
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

/// The most memory the program has held so far, bytes; `None` where the system does not tell.
#[cfg(not(unix))]
pub fn peak_memory_bytes() -> Option<u64> {
    None
}

/// Memory that programs can still take, bytes; `None` where the system does not tell.
fn free_bytes() -> Option<u64> {
    let mut system = sysinfo::System::new();
    system.refresh_memory_specifics(sysinfo::MemoryRefreshKind::nothing().with_ram());
    let free = system.available_memory();
    // A container may have less than its machine. Cached files give way and do not count.
    let limit = system.cgroup_limits().map_or(u64::MAX, |limits| {
        limits.total_memory.saturating_sub(limits.rss)
    });
    Some(free.min(limit)).filter(|&bytes| bytes > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_tells_how_much_memory_there_is_and_was() {
        assert!(free_bytes().is_some());
        assert!(cfg!(not(unix)) || peak_memory_bytes().is_some_and(|peak| peak > 1 << 20));
        assert_eq!(Budget::new(Some(7)).bytes, 7);
    }
}
