//! The serialisation of ROS 2: Common Data Representation of the OMG (XCDR 1 and plain XCDR 2).
//!
//! The first four bytes give byte order and version. Numbers are aligned to their size, counted from
//! the end of these four bytes; plain XCDR 2 aligns 64-bit numbers to 4 bytes. A string is its length
//! including the final zero byte (u32), its bytes and the zero byte.

use super::wire::{Decoded, Fault, Rest, Wire, stamp_s};

/// A message being decoded.
pub(super) struct Cdr<'a> {
    /// Unread bytes after the first four.
    rest: Rest<'a>,
    big_endian: bool,
    /// Largest alignment of a number, bytes.
    widest: usize,
}

impl<'a> Cdr<'a> {
    /// Reads the first four bytes of a message.
    pub(super) fn new(bytes: &'a [u8]) -> Decoded<Self> {
        let kind = Rest::new(bytes).take(4)?;
        let (big_endian, widest) = match kind {
            [0, 0, ..] => (true, 8),
            [0, 1, ..] => (false, 8),
            [0, 6, ..] => (true, 4),
            [0, 7, ..] => (false, 4),
            _ => {
                return Err(Fault::new(
                    format!("a message that starts with the bytes {kind:02x?}"),
                    "CDR: 00 00 or 00 01 (plain), 00 06 or 00 07 (plain, version 2)",
                ));
            }
        };
        Ok(Self {
            rest: Rest::new(&bytes[4..]),
            big_endian,
            widest,
        })
    }
}

impl<'a> Wire<'a> for Cdr<'a> {
    fn word<const N: usize>(&mut self) -> Decoded<[u8; N]> {
        let unit = N.clamp(1, self.widest);
        let padding = self.rest.at.next_multiple_of(unit) - self.rest.at;
        self.rest.take(padding)?;
        let mut word = [0; N];
        word.copy_from_slice(self.rest.take(N)?);
        if self.big_endian {
            word.reverse();
        }
        Ok(word)
    }

    fn raw(&mut self, n: usize) -> Decoded<&'a [u8]> {
        self.rest.take(n)
    }

    fn text(&mut self) -> Decoded<&'a [u8]> {
        let text = self.bytes()?;
        // Some writers write the empty string without its zero byte.
        Ok(text.strip_suffix(&[0]).unwrap_or(text))
    }

    fn header(&mut self) -> Decoded<(f64, &'a [u8])> {
        let seconds = i32::from_le_bytes(self.word()?);
        let nanoseconds = self.u32()?;
        let frame = self.text()?;
        Ok((stamp_s(f64::from(seconds), nanoseconds)?, frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_after_the_first_four_bytes() {
        let mut message = vec![0, 1, 0, 0, 7, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 0];
        message.extend([0; 4]);
        message.extend(1.5f64.to_le_bytes());
        let mut wire = Cdr::new(&message).unwrap();
        assert_eq!(wire.u8().unwrap(), 7);
        assert_eq!(wire.text().unwrap(), b"ab");
        assert_eq!(wire.f64().unwrap(), 1.5);
        assert!(wire.u8().is_err());
    }

    #[test]
    fn byte_order_and_version_follow_from_the_start() {
        let mut message = vec![0, 6, 0, 0, 0, 0, 0, 5];
        message.extend(2.5f64.to_be_bytes());
        let mut wire = Cdr::new(&message).unwrap();
        assert_eq!((wire.u32().unwrap(), wire.f64().unwrap()), (5, 2.5));
        assert!(Cdr::new(&[0, 3, 0, 0]).is_err() && Cdr::new(&[0]).is_err());
    }

    #[test]
    fn a_stamp_with_too_many_nanoseconds_is_a_fault() {
        let start = [0, 1, 0, 0];
        let stamp = |ns: u32| {
            let rest = [5u32, ns, 0].map(u32::to_le_bytes).concat();
            let message = [start.as_slice(), &rest].concat();
            Cdr::new(&message).and_then(|mut wire| wire.header_stamp_s())
        };
        assert_eq!(stamp(500_000_000).unwrap(), 5.5);
        assert!(stamp(1_000_000_000).is_err());
    }
}
