//! The records of a ROS 1 bag, version 2.0 (<https://wiki.ros.org/Bags/Format/2.0>): length of the
//! header (u32), header, length of the data (u32), data; little-endian. A header consists of fields
//! `name=value`, each after its length (u32); the field `op` gives the kind of the record.

use super::records::{Channel, ChunkHead, Cursor, Kind, Raw, Record, Span, TypeName, name};
use super::wire::Encoding;

/// The first bytes of a file of any version.
pub(super) const ANY_VERSION: &[u8] = b"#ROSBAG V";
/// The first bytes of a file of the version that is read.
pub(super) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// Largest accepted length of a record's header, bytes; a longer header is damage.
pub(super) const LONGEST_HEADER: u32 = 1 << 20;

/// The value of a field of a header.
fn field<'a>(header: &'a [u8], wanted: &[u8]) -> Option<&'a [u8]> {
    let mut rest = Cursor(header);
    while !rest.0.is_empty() {
        let field = rest.sized()?;
        let equals = field.iter().position(|b| *b == b'=')?;
        if &field[..equals] == wanted {
            return Some(&field[equals + 1..]);
        }
    }
    None
}

/// A field that is a number of 32 bits.
fn number(header: &[u8], wanted: &[u8]) -> Option<u32> {
    Cursor(field(header, wanted)?).u32()
}

/// A time in nanoseconds: u32 seconds, u32 nanoseconds.
fn time_ns(data: &mut Cursor<'_>) -> Option<u64> {
    let (seconds, nanoseconds) = (data.u32()?, data.u32()?);
    Some(u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds))
}

/// The kind of a record, from its header.
pub(super) fn kind(header: &[u8]) -> Option<Kind> {
    Some(match field(header, b"op")? {
        [2] => Kind::Message,
        [4] => Kind::Index,
        [5] => Kind::Chunk,
        [7] => Kind::Channel,
        _ => Kind::Other,
    })
}

/// Takes the next record of an unpacked chunk.
pub(super) fn split<'a>(bytes: &mut Cursor<'a>) -> Option<Raw<'a>> {
    let head = bytes.sized()?;
    Some(Raw {
        kind: kind(head)?,
        head,
        data: bytes.sized()?,
    })
}

/// The byte offset of the index, from the header of the first record; 0 if the recording was not
/// finished.
pub(super) fn index_start(header: &[u8]) -> Option<u64> {
    if field(header, b"op")? != [3] {
        return None;
    }
    Cursor(field(header, b"index_pos")?).u64()
}

/// The header of the first record of a bag, with 0 for the position of the index: the bag is then read without one.
/// `None` for another record.
pub(super) fn without_index(header: &[u8]) -> Option<Vec<u8>> {
    index_start(header)?;
    const KEY: &[u8] = b"index_pos=";
    let at = header.windows(KEY.len()).position(|bytes| bytes == KEY)? + KEY.len();
    let mut header = header.to_vec();
    header.get_mut(at..at + 8)?.fill(0);
    Some(header)
}

/// The content of a channel, message or index.
pub(super) fn parse(raw: Raw<'_>) -> Option<Record<'_>> {
    let Raw { kind, head, data } = raw;
    let channel = number(head, b"conn")?;
    Some(match kind {
        Kind::Channel => Record::Channel {
            id: channel,
            channel: Channel {
                topic: name(field(head, b"topic")?)?,
                // The data consist of fields like those of the header.
                message_type: TypeName::Known(name(field(data, b"type")?)?),
                encoding: Encoding::Ros1,
            },
        },
        Kind::Message => Record::Message {
            channel,
            recorded_ns: time_ns(&mut Cursor(field(head, b"time")?))?,
            data,
        },
        Kind::Index => {
            let mut entries = Cursor(data);
            let mut span = Span::default();
            while !entries.0.is_empty() {
                span.add(Span::one(time_ns(&mut entries)?));
                let _offset = entries.u32()?;
            }
            Record::Index { channel, span }
        }
        Kind::Schema | Kind::Chunk | Kind::End | Kind::Other => return None,
    })
}

/// The head of a chunk, from its header.
pub(super) fn chunk_head(header: &[u8]) -> Option<ChunkHead<'_>> {
    Some(ChunkHead {
        compression: field(header, b"compression")?,
        size: number(header, b"size")?.into(),
        crc: 0,
        start: 0,
    })
}
