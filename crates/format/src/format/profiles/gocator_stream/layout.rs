//! Sizes and offsets of the messages, and a check whether bytes can be the beginning of a message.

/// Largest message that is read, bytes. A scanner measures some thousand points per profile, so this is room
/// for hundreds of profiles in a message.
pub const LARGEST_MESSAGE: usize = 32 << 20;

/// Raw value of an invalid range (Gocator user manual, section "Data Types": null value of 16s).
pub const NULL_RANGE: i16 = i16::MIN;

/// Bytes of size and control (Gocator user manual, section "Data Results").
pub const HEADER_BYTES: usize = 6;
/// Bit of the control word that marks the last message of a data set (same section).
pub const LAST_FLAG: u16 = 0x8000;

/// Type of the stamp message (section "Stamp").
pub const STAMP: u16 = 1;
/// Type of the message of points (section "Profile Point Cloud").
pub const POINT_CLOUD: u16 = 5;
/// Type of the message of ranges at a constant spacing (section "Uniform Profile").
pub const UNIFORM_PROFILE: u16 = 6;
/// Type of the message of intensities (section "Profile Intensity").
pub const INTENSITY: u16 = 7;

/// Types run from 1 to 36 in the SDK for firmware 6 (`GoSdkDef.x.h`), with room for newer ones;
/// 0 is health, which has its own channel.
const TYPES: std::ops::RangeInclusive<u16> = 1..=63;

/// Offset of the first stamp (section "Stamp").
pub const STAMPS_AT: usize = 14;
/// Shortest stamp (section "Stamp": "min: 56").
pub const STAMP_BYTES: usize = 56;
/// Size of a stamp with a time of PTP (SDK, `GO_STAMP_MSG_STAMP_SIZE_1_64`).
pub const STAMP_BYTES_WITH_PTP: usize = 64;

/// Offset of the attributes, after their size (sections "Profile Point Cloud", "Uniform Profile",
/// "Profile Intensity").
pub const ATTRIBUTES_AT: usize = 8;

/// Least size of the attributes and size of a sample, bytes, in a message of samples (same sections); `None`
/// for other types.
pub fn samples_of(kind: u16) -> Option<(usize, usize)> {
    match kind {
        POINT_CLOUD => Some((32, 4)),
        UNIFORM_PROFILE => Some((32, 2)),
        INTENSITY => Some((24, 1)),
        _ => None,
    }
}

/// Number of bytes that always suffices to decide whether they begin a message.
pub const LONGEST_HEAD: usize = 16;

/// Result of [`beginning`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beginning {
    /// Too few bytes to decide.
    TooShort,
    /// Not a message.
    Invalid,
    /// A message of this size, of a type whose size cannot be checked.
    Possible(usize),
    /// A message of this size, of a known type whose counts give the same size.
    Certain(usize),
}

/// Checks whether a message of at most `largest` bytes begins with these bytes.
pub fn beginning(bytes: &[u8], largest: usize) -> Beginning {
    let Some(size) = u32_at(bytes, 0).map(|size| size as usize) else {
        return Beginning::TooShort;
    };
    if size < HEADER_BYTES || size > largest {
        return Beginning::Invalid;
    }
    let Some(control) = u16_at(bytes, 4) else {
        return Beginning::TooShort;
    };
    let kind = control & !LAST_FLAG;
    if !TYPES.contains(&kind) {
        return Beginning::Invalid;
    }
    let (needed, expected) = if kind == STAMP {
        (STAMPS_AT, stamps_size(bytes))
    } else if let Some((shortest, sample_bytes)) = samples_of(kind) {
        (
            ATTRIBUTES_AT + shortest,
            samples_size(bytes, shortest, sample_bytes),
        )
    } else {
        return Beginning::Possible(size);
    };
    if size < needed {
        return Beginning::Invalid;
    }
    match expected {
        None => Beginning::TooShort,
        Some(Some(expected)) if expected == size as u64 => Beginning::Certain(size),
        Some(_) => Beginning::Invalid,
    }
}

/// Size of a stamp message according to its counts: the outer option is `None` if bytes are missing, the inner if
/// the stamps are too short.
fn stamps_size(bytes: &[u8]) -> Option<Option<u64>> {
    let (count, stamp_bytes) = (u32_at(bytes, 6)?, u16_at(bytes, 10)?);
    let size = STAMPS_AT as u64 + u64::from(count) * u64::from(stamp_bytes);
    Some((usize::from(stamp_bytes) >= STAMP_BYTES).then_some(size))
}

/// The same for a message of samples.
fn samples_size(bytes: &[u8], shortest: usize, sample_bytes: usize) -> Option<Option<u64>> {
    let attributes = u16_at(bytes, 6)?;
    let (count, width) = (u32_at(bytes, 8)?, u32_at(bytes, 12)?);
    let size = u64::from(count)
        .checked_mul(u64::from(width))
        .and_then(|samples| samples.checked_mul(sample_bytes as u64))
        .and_then(|samples| samples.checked_add((ATTRIBUTES_AT as u64) + u64::from(attributes)));
    Some(size.filter(|_| usize::from(attributes) >= shortest))
}

/// The bytes of a field; `None` beyond the end.
pub fn field<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}

/// A u16 at this offset.
pub fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    field(bytes, at).map(u16::from_le_bytes)
}

/// A u32 at this offset.
pub fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    field(bytes, at).map(u32::from_le_bytes)
}

/// An i32 at this offset.
pub fn i32_at(bytes: &[u8], at: usize) -> Option<i32> {
    field(bytes, at).map(i32::from_le_bytes)
}

/// A u64 at this offset.
pub fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    field(bytes, at).map(u64::from_le_bytes)
}

/// An i64 at this offset.
pub fn i64_at(bytes: &[u8], at: usize) -> Option<i64> {
    field(bytes, at).map(i64::from_le_bytes)
}
