//! Unpacking of the chunks of a bag into records.

use super::compression::{Unpacked, unpack};
use super::records::{Cursor, Raw};
use super::walk::{Container, Walk};
use super::wire::{Decoded, Fault};
use super::{mcap, rosbag};
use crate::error::{Error, Result};
use crate::format::file;

/// Allocations never exceed four times the size of the file plus this, bytes.
const SPARE_BYTES: u64 = 16 << 20;

/// All chunks together may unpack to at most this many times the size of the file plus this many bytes. A file
/// that unpacks to more is a decompression bomb.
const MAX_UNPACKED_RATIO: u64 = 250;
const UNPACKED_ALLOWANCE_BYTES: u64 = 12 << 20;

impl Walk {
    /// Unpacks the last record, a chunk whose data were read, into `into`. Returns the start of its records
    /// in `into`; a damaged chunk is passed over.
    ///
    /// # Errors
    /// More bytes than the file may unpack to, a compression that is not known.
    pub(super) fn unpack(&mut self, into: &mut Vec<u8>) -> Result<usize> {
        match self.unpack_whole(into)? {
            Ok(start) => Ok(start),
            Err(damage) => {
                into.clear();
                self.pass_over(damage);
                Ok(0)
            }
        }
    }

    /// Like [`unpack`](Self::unpack); the inner error is that of a damaged chunk.
    pub(super) fn unpack_whole(&mut self, into: &mut Vec<u8>) -> Result<Result<usize>> {
        let head = match self.container {
            Container::Mcap => mcap::chunk_head(&self.data),
            Container::Rosbag => rosbag::chunk_head(&self.head),
            Container::Db3 => None,
        };
        let Some(head) = head else {
            into.clear();
            return Ok(if self.is_cut {
                Ok(0)
            } else {
                Err(self.error(
                    "a chunk without a valid head",
                    "a head with size and compression",
                ))
            });
        };
        let (size, crc, start) = (head.size, head.crc, head.start);
        if matches!(head.compression, b"" | b"none") {
            std::mem::swap(into, &mut self.data);
            let actual = (into.len() - start) as u64;
            let checked = self.check(size, actual, crc, &into[start..], None);
            return Ok(checked.map(|()| start));
        }
        let limit = self.largest_allocation();
        if size > limit && !self.is_cut {
            return Err(self.too_large(size));
        }
        // The head of an incomplete chunk does not have its size.
        let most = if self.is_cut { limit } else { size };
        let left = self.most_unpacked() - self.unpacked;
        if !self.is_cut && size > left {
            return Err(self.error(
                format!(
                    "chunks that unpack to {} bytes",
                    self.unpacked.saturating_add(size)
                ),
                format!("at most {} in a file of this size", self.most_unpacked()),
            ));
        }
        let most = usize::try_from(most.min(left)).unwrap_or(usize::MAX);
        let packed = self.data.get(start..).unwrap_or_default();
        let unpacked = file::guarded(self.path(), "bag", || {
            Ok(unpack(head.compression, packed, most, limit))
        })?;
        let Some(unpacked) = unpacked else {
            let name: String = String::from_utf8_lossy(head.compression)
                .chars()
                .take(40)
                .collect();
            return Err(self.error(
                format!("a chunk with the compression `{name}`"),
                "none, bz2, lz4 or zstd",
            ));
        };
        *into = unpacked.bytes;
        // `unpack` returned at most `left` bytes, so this does not exceed the limit.
        self.unpacked += into.len() as u64;
        let checked = self.check(size, into.len() as u64, crc, into, unpacked.fault);
        Ok(checked.map(|()| 0))
    }

    /// Unpacks a message that was compressed by itself.
    pub(super) fn unpack_message(&mut self, packed: &[u8]) -> Decoded<Vec<u8>> {
        let limit = self.largest_allocation();
        let most = limit.min(self.most_unpacked() - self.unpacked);
        let most = usize::try_from(most).unwrap_or(usize::MAX);
        let unpacked = file::guarded(self.path(), "bag", || {
            Ok(unpack(b"zstd", packed, most, limit))
        });
        let fault = |why: &str| {
            let found = format!("compression that cannot be unpacked ({why})");
            Fault::new(found, "an undamaged message, compressed with zstd")
        };
        match unpacked {
            Ok(Some(Unpacked { bytes, fault: None })) => {
                self.unpacked += bytes.len() as u64;
                Ok(bytes)
            }
            Ok(Some(Unpacked {
                fault: Some(why), ..
            })) => Err(fault(&why)),
            Ok(None) | Err(_) => Err(fault("damaged")),
        }
    }

    /// Checks size and checksum of an unpacked chunk against its head, unless the chunk is cut off.
    fn check(
        &self,
        claimed: u64,
        found: u64,
        crc: u32,
        records: &[u8],
        fault: Option<String>,
    ) -> Result<()> {
        if self.is_cut {
            return Ok(());
        }
        if let Some(fault) = fault {
            return Err(self.error(
                format!("a chunk that cannot be unpacked ({fault})"),
                "an undamaged chunk",
            ));
        }
        if found != claimed {
            return Err(self.error(
                format!("a chunk of {found} bytes"),
                format!("{claimed} bytes, as in its head"),
            ));
        }
        if crc != 0 && crc32fast::hash(records) != crc {
            return Err(self.error(
                "a chunk whose checksum differs from that in its head",
                "an undamaged chunk",
            ));
        }
        Ok(())
    }

    /// Takes the next record from an unpacked chunk; `None` at its end, and where it is damaged.
    pub(super) fn split<'a>(&mut self, bytes: &mut Cursor<'a>) -> Option<Raw<'a>> {
        if bytes.0.is_empty() {
            return None;
        }
        let record = self.container.split(bytes);
        if record.is_none() && !self.is_cut {
            let found = format!(
                "{} bytes at the end of a chunk that are not a record",
                bytes.0.len()
            );
            let error = self.error(found, "a record");
            self.pass_over(error);
        }
        record
    }

    /// The error for a size that only a damaged file can claim.
    pub(super) fn too_large(&self, size: u64) -> Error {
        let limit = self.largest_allocation();
        self.error(
            format!("a chunk of {size} bytes"),
            format!("at most {limit} in a file of this size"),
        )
    }

    /// Most bytes that all chunks together may unpack to.
    pub(super) fn most_unpacked(&self) -> u64 {
        let most = self.bytes_total().saturating_mul(MAX_UNPACKED_RATIO);
        most.saturating_add(UNPACKED_ALLOWANCE_BYTES)
    }

    /// Most bytes that may be allocated at once.
    pub(super) fn largest_allocation(&self) -> u64 {
        self.bytes_total()
            .saturating_mul(4)
            .saturating_add(SPARE_BYTES)
    }
}
