//! Unpacking of chunks: bz2, lz4 (frames) and zstd.

use std::io::Read;

/// Bytes unpacked at a time.
const PIECE: usize = 1 << 16;
/// Memory reserved before unpacking, in multiples of the packed size; it grows if a chunk unpacks to more.
const USUAL_RATIO: usize = 8;

/// The result of unpacking.
pub(crate) struct Unpacked {
    /// The unpacked bytes, at most as many as allowed.
    pub(crate) bytes: Vec<u8>,
    /// The reason why unpacking stopped before the end of the packed data, if it did.
    pub(crate) fault: Option<String>,
}

/// Unpacks `packed` to at most `most` bytes, with allocations of at most `limit` bytes; `None` if the
/// name of the compression is unknown.
pub(crate) fn unpack(
    compression: &[u8],
    packed: &[u8],
    most: usize,
    limit: u64,
) -> Option<Unpacked> {
    Some(match compression {
        b"bz2" => read(bzip2::bufread::BzDecoder::new(packed), packed.len(), most),
        b"lz4" => read(
            lz4_flex::frame::FrameDecoder::new(packed),
            packed.len(),
            most,
        ),
        b"zstd" => {
            let mut decoder = ruzstd::decoding::FrameDecoder::new();
            // The decoder keeps the window and a few blocks in a buffer whose size is a power of two.
            let largest_buffer = 1 << limit.max(1).ilog2();
            decoder.set_max_window_size(largest_buffer - largest_buffer / 64);
            match ruzstd::decoding::StreamingDecoder::new_with_decoder(packed, decoder) {
                Ok(decoder) => read(decoder, packed.len(), most),
                Err(e) => Unpacked {
                    bytes: Vec::new(),
                    fault: Some(e.to_string()),
                },
            }
        }
        _ => return None,
    })
}

/// Reads until the end, a fault or `most` bytes. Memory grows with the data, not with the size that the
/// file claims.
pub(crate) fn read(mut source: impl Read, packed: usize, most: usize) -> Unpacked {
    let mut bytes = Vec::with_capacity(most.min(packed.saturating_mul(USUAL_RATIO)));
    let mut piece = vec![0; PIECE];
    let fault = loop {
        let n = match source.read(&mut piece) {
            Ok(0) => break None,
            Ok(n) => n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(e) => break Some(e.to_string()),
        };
        let left = most - bytes.len();
        let taken = n.min(left);
        if bytes.capacity() - bytes.len() < taken {
            // Doubles the capacity, but never beyond the limit.
            bytes.reserve_exact(bytes.len().max(PIECE).min(left));
        }
        bytes.extend_from_slice(&piece[..taken]);
        if n > left {
            break Some(format!("more than {most} bytes"));
        }
    };
    Unpacked { bytes, fault }
}
