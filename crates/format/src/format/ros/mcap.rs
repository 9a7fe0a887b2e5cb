//! The records of MCAP (<https://mcap.dev/spec>): kind (u8), length (u64), content; little-endian.

use super::records::{Channel, ChunkHead, Cursor, Kind, Raw, Record, Span, TypeName, name};
use super::wire::Encoding;

/// The first and the last bytes of a file.
pub(super) const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Bytes before the content of a record.
pub(super) const PREFIX: usize = 9;

/// The records that end a file without a summary, and the last bytes of the file.
pub(super) fn end() -> Vec<u8> {
    const DATA_END: u8 = 15;
    const FOOTER: u8 = 2;
    let record = |kind: u8, length: u64| {
        let zeros = vec![0; length as usize];
        [&[kind], length.to_le_bytes().as_slice(), &zeros].concat()
    };
    [&record(DATA_END, 4), &record(FOOTER, 20), MAGIC].concat()
}

/// The kind of a record and the length of its content, from its first [`PREFIX`] bytes.
pub(super) fn prefix(mut bytes: Cursor<'_>) -> Option<(Kind, u64)> {
    let kind = match bytes.take(1)? {
        [0] => return None,
        [2 | 15] => Kind::End,
        [3] => Kind::Schema,
        [4] => Kind::Channel,
        [5] => Kind::Message,
        [6] => Kind::Chunk,
        [7] => Kind::Index,
        _ => Kind::Other,
    };
    Some((kind, bytes.u64()?))
}

/// Takes the next record of an unpacked chunk.
pub(super) fn split<'a>(bytes: &mut Cursor<'a>) -> Option<Raw<'a>> {
    let (kind, length) = prefix(Cursor(bytes.take(PREFIX)?))?;
    Some(Raw {
        kind,
        head: &[],
        data: bytes.take(usize::try_from(length).ok()?)?,
    })
}

/// The bytes of a schema, a channel or a message, which may also be outside of chunks.
pub(super) fn whole_record(raw: Raw<'_>) -> Option<Vec<u8>> {
    let kind = match raw.kind {
        Kind::Schema => 3,
        Kind::Channel => 4,
        Kind::Message => 5,
        _ => return None,
    };
    let length = raw.data.len() as u64;
    Some([&[kind], length.to_le_bytes().as_slice(), raw.data].concat())
}

/// The content of a schema, channel, message or index.
pub(super) fn parse(raw: Raw<'_>) -> Option<Record<'_>> {
    let mut data = Cursor(raw.data);
    Some(match raw.kind {
        Kind::Schema => Record::Schema {
            id: data.u16()?.into(),
            name: name(data.sized()?)?,
        },
        Kind::Channel => {
            let (id, schema) = (data.u16()?, data.u16()?);
            let topic = name(data.sized()?)?;
            let encoding = match data.sized()? {
                b"cdr" => Encoding::Cdr,
                b"ros1" => Encoding::Ros1,
                other => Encoding::Other(name(other)?),
            };
            Record::Channel {
                id: id.into(),
                channel: Channel {
                    topic,
                    message_type: TypeName::Schema(schema.into()),
                    encoding,
                },
            }
        }
        Kind::Message => {
            let channel = data.u16()?.into();
            let _sequence = data.u32()?;
            let recorded_ns = data.u64()?;
            let _published_ns = data.u64()?;
            Record::Message {
                channel,
                recorded_ns,
                data: data.0,
            }
        }
        Kind::Index => {
            let channel = data.u16()?.into();
            let mut entries = Cursor(data.sized()?);
            let mut span = Span::default();
            while !entries.0.is_empty() {
                span.add(Span::one(entries.u64()?));
                let _offset = entries.u64()?;
            }
            Record::Index { channel, span }
        }
        Kind::Chunk | Kind::End | Kind::Other => return None,
    })
}

/// The head of a chunk, from its content.
pub(super) fn chunk_head(content: &[u8]) -> Option<ChunkHead<'_>> {
    head_and_length(content).map(|(head, _)| head)
}

/// The head of a chunk and the length of its packed records, which end at the end of the content.
fn head_and_length(content: &[u8]) -> Option<(ChunkHead<'_>, u64)> {
    let mut data = Cursor(content);
    let _first_and_last_ns = data.take(16)?;
    let (size, crc) = (data.u64()?, data.u32()?);
    let compression = data.sized()?;
    let length = data.u64()?;
    let head = ChunkHead {
        compression,
        size,
        crc,
        start: content.len() - data.0.len(),
    };
    Some((head, length))
}

/// Whether a chunk that fits in `left` bytes begins here: its length is that of its head and its packed records.
pub(super) fn begins_chunk(mut bytes: Cursor<'_>, left: u64) -> bool {
    let mut length = || {
        let (kind, length) = prefix(Cursor(bytes.take(PREFIX)?))?;
        let (head, packed) = head_and_length(bytes.0).filter(|_| kind == Kind::Chunk)?;
        let is_known = matches!(head.compression, b"" | b"none" | b"lz4" | b"zstd" | b"bz2");
        let expected = (head.start as u64).checked_add(packed);
        (is_known && expected == Some(length)).then_some(length)
    };
    length().is_some_and(|length| length < left)
}
