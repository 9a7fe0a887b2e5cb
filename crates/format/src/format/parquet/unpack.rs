//! Unpacking of pages within a limit of bytes.

use ::parquet::basic::CompressionCodec;
use lz4_flex::block::DecompressError;

use crate::format::ros::compression;

/// The first bytes of an LZ4 frame.
const LZ4_FRAME: [u8; 4] = [0x04, 0x22, 0x4d, 0x18];
/// Largest buffer of zstd, bytes: for a window of 8 MiB, which RFC 8878 asks decoders to support.
const LARGEST_BUFFER: u64 = 16 << 20;
/// A byte of LZ4 unpacks to at most this many.
const LZ4_RATIO: usize = 255;

/// Unpacks `packed` to at most `most` bytes; the error is what was found instead.
pub(super) fn unpack(
    codec: CompressionCodec,
    packed: &[u8],
    most: usize,
) -> Result<Vec<u8>, String> {
    match codec {
        CompressionCodec::SNAPPY => {
            let length = snap::raw::decompress_len(packed).map_err(|e| e.to_string())?;
            if length > most {
                return Err(too_many(most));
            }
            snap::raw::Decoder::new()
                .decompress_vec(packed)
                .map_err(|e| e.to_string())
        }
        CompressionCodec::GZIP => {
            let gzip = flate2::read::MultiGzDecoder::new(packed);
            whole(compression::read(gzip, packed.len(), most))
        }
        CompressionCodec::ZSTD => framed(b"zstd", packed, most),
        CompressionCodec::LZ4_RAW => lz4_block(packed, most),
        CompressionCodec::LZ4 if packed.starts_with(&LZ4_FRAME) => framed(b"lz4", packed, most),
        CompressionCodec::LZ4 => match hadoop_blocks(packed) {
            Some(blocks) => {
                let mut bytes = Vec::new();
                for (block, length) in blocks {
                    let left = most - bytes.len();
                    let unpacked = lz4_block(block, left.min(length))?;
                    bytes.extend_from_slice(&unpacked);
                }
                Ok(bytes)
            }
            None => lz4_block(packed, most),
        },
        other => Err(format!("the compression {other}")),
    }
}

/// Whether pages of this codec can be unpacked.
pub(super) fn is_known(codec: CompressionCodec) -> bool {
    !matches!(codec, CompressionCodec::LZO | CompressionCodec::BROTLI)
}

fn too_many(most: usize) -> String {
    format!("more than {most} bytes")
}

fn framed(name: &[u8], packed: &[u8], most: usize) -> Result<Vec<u8>, String> {
    match compression::unpack(name, packed, most, LARGEST_BUFFER) {
        Some(unpacked) => whole(unpacked),
        None => Err("an unknown compression".to_owned()),
    }
}

fn whole(unpacked: compression::Unpacked) -> Result<Vec<u8>, String> {
    unpacked.fault.map_or(Ok(unpacked.bytes), Err)
}

/// An LZ4 block, which does not state its unpacked length.
fn lz4_block(packed: &[u8], most: usize) -> Result<Vec<u8>, String> {
    let most = most.min(packed.len().saturating_mul(LZ4_RATIO).saturating_add(64));
    let mut size = packed.len().saturating_mul(4).clamp(1 << 16, 1 << 24);
    loop {
        size = size.min(most);
        let mut bytes = vec![0; size];
        match lz4_flex::block::decompress_into(packed, &mut bytes) {
            Ok(length) => {
                bytes.truncate(length);
                return Ok(bytes);
            }
            Err(DecompressError::OutputTooSmall { .. }) if size < most => {
                size = size.saturating_mul(4);
            }
            Err(DecompressError::OutputTooSmall { .. }) => return Err(too_many(most)),
            Err(e) => return Err(e.to_string()),
        }
    }
}

/// The blocks of Hadoop's LZ4, each preceded by its unpacked and its packed length, big-endian; `None`
/// if these lengths do not fit.
fn hadoop_blocks(mut packed: &[u8]) -> Option<Vec<(&[u8], usize)>> {
    let mut blocks = Vec::new();
    while !packed.is_empty() {
        let (unpacked, rest) = packed.split_first_chunk::<4>()?;
        let (length, rest) = rest.split_first_chunk::<4>()?;
        let length = u32::from_be_bytes(*length) as usize;
        let (block, rest) = rest.split_at_checked(length)?;
        blocks.push((block, u32::from_be_bytes(*unpacked) as usize));
        packed = rest;
    }
    Some(blocks)
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};

    use super::*;

    #[test]
    fn pages_that_unpack_to_more_than_the_limit_are_refused() {
        let bytes = vec![7; 100_000];
        let snappy = snap::raw::Encoder::new().compress_vec(&bytes).unwrap();
        let mut gzip = Vec::new();
        flate2::read::GzEncoder::new(&bytes[..], flate2::Compression::fast())
            .read_to_end(&mut gzip)
            .unwrap();
        let zstd = ruzstd::encoding::compress_to_vec(
            &bytes[..],
            ruzstd::encoding::CompressionLevel::Fastest,
        );
        let block = lz4_flex::block::compress(&bytes);
        let mut hadoop = 100_000_u32.to_be_bytes().to_vec();
        hadoop.extend((block.len() as u32).to_be_bytes());
        hadoop.extend(&block);
        let mut frame = lz4_flex::frame::FrameEncoder::new(Vec::new());
        frame.write_all(&bytes).unwrap();
        let frame = frame.finish().unwrap();
        for (codec, packed) in [
            (CompressionCodec::SNAPPY, &snappy),
            (CompressionCodec::GZIP, &gzip),
            (CompressionCodec::ZSTD, &zstd),
            (CompressionCodec::LZ4_RAW, &block),
            (CompressionCodec::LZ4, &block),
            (CompressionCodec::LZ4, &hadoop),
            (CompressionCodec::LZ4, &frame),
        ] {
            assert!(packed.len() < 20_000, "{codec}");
            assert_eq!(unpack(codec, packed, 100_000).unwrap(), bytes, "{codec}");
            let text = unpack(codec, packed, 99_999).unwrap_err();
            assert!(text.contains("more than 99999 bytes"), "{codec}: {text}");
            assert!(unpack(codec, &packed[..packed.len() / 2], 100_000).is_err());
        }
        assert!(!is_known(CompressionCodec::BROTLI) && is_known(CompressionCodec::ZSTD));
    }
}
