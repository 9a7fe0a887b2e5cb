//! Room on the disk of a recording.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use sysinfo::{DiskRefreshKind, Disks};

/// Time between two looks.
const LOOK: Duration = Duration::from_secs(10);
/// Room is short where it lasts no longer than this at the rate so far, seconds, or is less than this, bytes.
const SHORT_S: f64 = 1800.0;
const SHORT_BYTES: f64 = 500e6;

/// Room on the disk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Bytes.
    pub free: f64,
    /// How long it lasts at the rate so far, seconds; infinite while nothing arrives.
    pub lasts_s: f64,
}

impl Room {
    /// Of so many free bytes, at so many bytes a second.
    fn new(free: f64, rate: f64) -> Self {
        Self {
            free,
            lasts_s: free / rate.max(0.0),
        }
    }

    /// Whether the recording should end soon, or go elsewhere.
    pub fn is_short(&self) -> bool {
        self.lasts_s < SHORT_S || self.free < SHORT_BYTES
    }
}

/// Looks at the disk of a folder from time to time.
pub struct DiskWatch {
    folder: PathBuf,
    looked: Option<Instant>,
    room: Option<Room>,
}

impl DiskWatch {
    /// The disk of a folder that exists.
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.canonicalize().unwrap_or_else(|_| folder.to_owned()),
            looked: None,
            room: None,
        }
    }

    /// The room there is, where that can be told, at so many bytes a second.
    pub fn room(&mut self, rate: f64) -> Option<Room> {
        if self.looked.is_none_or(|looked| looked.elapsed() > LOOK) {
            self.looked = Some(Instant::now());
            self.room = free_bytes(&self.folder).map(|free| Room::new(free as f64, rate));
        }
        self.room
    }
}

/// Free bytes of the disk whose place in the file system is the longest part of the path.
fn free_bytes(folder: &Path) -> Option<u64> {
    let disks = Disks::new_with_refreshed_list_specifics(DiskRefreshKind::nothing().with_storage());
    let own = disks
        .iter()
        .filter(|disk| folder.starts_with(disk.mount_point()));
    let nearest = own.max_by_key(|disk| disk.mount_point().components().count());
    nearest.map(sysinfo::Disk::available_space)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn room_is_short_by_time_or_by_size() {
        let short = |free: f64, rate: f64| Room::new(free, rate).is_short();
        assert!(!short(20e9, 1e6));
        assert!(short(20e9, 20e6));
        assert!(short(0.4e9, 1e3));
        assert!(!short(1e9, 0.0));
        assert_eq!(Room::new(1e9, 1e6).lasts_s, 1000.0);
    }

    #[test]
    fn the_disk_of_a_folder_is_found() {
        let folder = tempfile::tempdir().unwrap();
        // Some containers list no disks.
        if let Some(room) = DiskWatch::new(folder.path()).room(0.0) {
            assert!(room.free > 0.0 && room.lasts_s == f64::INFINITY);
        }
    }
}
