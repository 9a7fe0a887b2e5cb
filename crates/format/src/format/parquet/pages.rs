//! The pages of a column of a row group, unpacked within a limit that all columns share.

use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use ::parquet::basic::{CompressionCodec, Type};
use ::parquet::column::page::{Page, PageMetadata, PageReader};
use ::parquet::errors::{ParquetError, Result};
use ::parquet::file::metadata::ColumnChunkMetaData;
use ::parquet::file::serialized_reader::SerializedPageReader;

use super::unpack::unpack;

/// Memory that the pages of all columns share.
#[derive(Debug)]
pub(super) struct Pool {
    most: usize,
    used: AtomicUsize,
}

impl Pool {
    pub(super) fn of(most: usize) -> Arc<Self> {
        Arc::new(Self {
            most,
            used: AtomicUsize::new(0),
        })
    }

    fn left(&self) -> usize {
        self.most.saturating_sub(self.used.load(Ordering::Relaxed))
    }
}

/// A share of the pool, returned when dropped.
struct Allotment {
    pool: Arc<Pool>,
    bytes: usize,
}

impl Allotment {
    fn set(&mut self, bytes: usize) {
        self.pool.used.fetch_sub(self.bytes, Ordering::Relaxed);
        self.pool.used.fetch_add(bytes, Ordering::Relaxed);
        self.bytes = bytes;
    }
}

impl Drop for Allotment {
    fn drop(&mut self) {
        self.set(0);
    }
}

/// Reads the pages of a column.
pub(super) struct Pages {
    /// Was told that pages are not compressed, and so returns them packed.
    packed: SerializedPageReader<File>,
    codec: CompressionCodec,
    /// Bytes per value.
    width: usize,
    dictionary: Allotment,
    data: Allotment,
}

impl Pages {
    /// The pages of a column whose bytes lie within the file.
    pub(super) fn of(
        file: &Arc<File>,
        column: &ColumnChunkMetaData,
        rows: usize,
        pool: &Arc<Pool>,
    ) -> Result<Self> {
        let codec = column.compression_codec();
        let width = match column.column_type() {
            Type::INT32 | Type::FLOAT => 4,
            _ => 8,
        };
        let uncompressed = column
            .clone()
            .into_builder()
            .set_compression_codec(CompressionCodec::UNCOMPRESSED)
            .build()?;
        let allotment = || Allotment {
            pool: pool.clone(),
            bytes: 0,
        };
        Ok(Self {
            packed: SerializedPageReader::new(file.clone(), &uncompressed, rows, None)?,
            codec,
            width,
            dictionary: allotment(),
            data: allotment(),
        })
    }

    /// Unpacks the bytes after the first `plain` ones, which are not compressed.
    fn unpack(&self, packed: &[u8], plain: usize, most: usize) -> Result<Vec<u8>> {
        let Some((plain, packed)) = packed.split_at_checked(plain) else {
            return Err(general("a page that is shorter than its levels"));
        };
        let mut bytes = plain.to_vec();
        // A page without values has nothing to unpack.
        if !packed.is_empty() {
            let most = most.saturating_sub(bytes.len());
            let unpacked = unpack(self.codec, packed, most).map_err(|fault| {
                ParquetError::General(format!("a page that cannot be unpacked: {fault}"))
            })?;
            if bytes.is_empty() {
                bytes = unpacked
            } else {
                bytes.extend_from_slice(&unpacked)
            }
        }
        Ok(bytes)
    }
}

fn general(text: &str) -> ParquetError {
    ParquetError::General(text.to_owned())
}

impl PageReader for Pages {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        let Some(mut page) = self.packed.get_next_page()? else {
            return Ok(None);
        };
        let is_dictionary = page.is_dictionary_page();
        // The previous page stays in memory until this one has been unpacked, and a dictionary is
        // decoded as a whole.
        let most = if is_dictionary {
            self.dictionary.pool.left() / 2
        } else {
            self.data.pool.left()
        };
        let (plain, is_packed) = match &page {
            Page::DataPageV2 {
                def_levels_byte_len,
                rep_levels_byte_len,
                is_compressed,
                ..
            } => {
                let levels = def_levels_byte_len.saturating_add(*rep_levels_byte_len);
                (levels as usize, *is_compressed)
            }
            _ => (0, true),
        };
        if is_packed && self.codec != CompressionCodec::UNCOMPRESSED {
            let bytes = self.unpack(page.buffer(), plain, most)?;
            match &mut page {
                Page::DataPage { buf, .. }
                | Page::DataPageV2 { buf, .. }
                | Page::DictionaryPage { buf, .. } => *buf = bytes.into(),
            }
        }
        let length = page.buffer().len();
        if length > most {
            return Err(ParquetError::General(format!(
                "a page of {length} bytes, with {most} bytes left for pages"
            )));
        }
        if is_dictionary {
            let claimed = (page.num_values() as usize).saturating_mul(self.width);
            if claimed > length {
                return Err(ParquetError::General(format!(
                    "a dictionary of {} values in {length} bytes",
                    page.num_values()
                )));
            }
            self.dictionary.set(2 * length);
        } else {
            self.data.set(length);
        }
        Ok(Some(page))
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        Err(general("pages can only be read in order"))
    }

    fn skip_next_page(&mut self) -> Result<()> {
        Err(general("pages can only be read in order"))
    }
}

impl Iterator for Pages {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}
