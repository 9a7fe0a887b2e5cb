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
        let free = || kilobytes("/proc/meminfo", "MemAvailable:");
        Self {
            bytes: bytes.unwrap_or_else(|| free().unwrap_or(UNKNOWN) / 2),
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
pub fn peak_memory_bytes() -> Option<u64> {
    kilobytes("/proc/self/status", "VmHWM:")
}

/// Bytes of the line of `file` that begins with `name` and counts kilobytes.
fn kilobytes(file: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find(|line| line.starts_with(name))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes * 1024)
}
