//! Free space on the disk of a recording.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use sysinfo::{DiskRefreshKind, Disks};

/// Time between two checks.
const CHECK: Duration = Duration::from_secs(10);
/// Space is short if it lasts less than this at the mean rate so far, seconds, or is less than this, bytes.
const SHORT_S: f64 = 1800.0;
const SHORT_BYTES: f64 = 500e6;

/// Free space on the disk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Free space, bytes.
    pub free: f64,
    /// Time until the disk is full at the mean rate so far, seconds; infinite while nothing arrives.
    pub lasts_s: f64,
}

impl Room {
    /// From the free space (bytes) and the rate (bytes per second).
    fn new(free: f64, rate: f64) -> Self {
        Self {
            free,
            lasts_s: free / rate.max(0.0),
        }
    }

    /// Whether the recording should end soon, or continue on another disk.
    pub fn is_short(&self) -> bool {
        self.lasts_s < SHORT_S || self.free < SHORT_BYTES
    }
}

/// Checks the free space for a folder from time to time.
pub struct DiskWatch {
    folder: PathBuf,
    checked: Option<Instant>,
    room: Option<Room>,
}

impl DiskWatch {
    /// For the disk of an existing folder.
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.canonicalize().unwrap_or_else(|_| folder.to_owned()),
            checked: None,
            room: None,
        }
    }

    /// The free space, given the rate (bytes per second); `None` if the system does not report it.
    pub fn room(&mut self, rate: f64) -> Option<Room> {
        if self.checked.is_none_or(|checked| checked.elapsed() > CHECK) {
            self.checked = Some(Instant::now());
            self.room = free_bytes(&self.folder).map(|free| Room::new(free as f64, rate));
        }
        self.room
    }
}

/// Free bytes of the disk whose mount point is the longest prefix of the path.
fn free_bytes(folder: &Path) -> Option<u64> {
    let disks = Disks::new_with_refreshed_list_specifics(DiskRefreshKind::nothing().with_storage());
    let containing = disks
        .iter()
        .filter(|disk| folder.starts_with(disk.mount_point()));
    let nearest = containing.max_by_key(|disk| disk.mount_point().components().count());
    nearest.map(sysinfo::Disk::available_space)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn space_is_short_by_time_or_by_size() {
        let short = |free: f64, rate: f64| Room::new(free, rate).is_short();
        assert!(!short(20e9, 1e6));
        assert!(short(20e9, 20e6));
        assert!(short(0.4e9, 1e3));
        assert!(!short(1e9, 0.0));
        assert_eq!(Room::new(1e9, 1e6).lasts_s, 1000.0);
    }

    #[test]
    fn the_disk_of_a_folder_reports_its_free_space() {
        let folder = tempfile::tempdir().unwrap();
        // Some containers list no disks.
        if let Some(room) = DiskWatch::new(folder.path()).room(0.0) {
            assert!(room.free > 0.0 && room.lasts_s == f64::INFINITY);
        }
    }
}
