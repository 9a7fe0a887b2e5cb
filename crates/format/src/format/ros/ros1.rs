//! The serialisation of ROS 1: little-endian, without padding. A string is its length as u32 and
//! its bytes; a header is a sequence number (u32), the stamp (two u32) and a string.

use super::wire::{Decoded, Rest, Wire, stamp_s};

/// A message being decoded.
pub(super) struct Ros1<'a> {
    rest: Rest<'a>,
}

impl<'a> Ros1<'a> {
    /// Begins to decode a message.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self {
            rest: Rest::new(bytes),
        }
    }
}

impl<'a> Wire<'a> for Ros1<'a> {
    fn word<const N: usize>(&mut self) -> Decoded<[u8; N]> {
        let mut word = [0; N];
        word.copy_from_slice(self.rest.take(N)?);
        Ok(word)
    }

    fn raw(&mut self, n: usize) -> Decoded<&'a [u8]> {
        self.rest.take(n)
    }

    fn text(&mut self) -> Decoded<&'a [u8]> {
        self.bytes()
    }

    fn header(&mut self) -> Decoded<(f64, &'a [u8])> {
        let _sequence = self.u32()?;
        let (seconds, nanoseconds) = (self.u32()?, self.u32()?);
        let frame = self.text()?;
        Ok((stamp_s(f64::from(seconds), nanoseconds)?, frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_is_skipped_to_its_end() {
        let mut message = [9u32, 100, 250_000_000, 2].map(u32::to_le_bytes).concat();
        message.extend(b"ab");
        message.push(7);
        let mut wire = Ros1::new(&message);
        assert_eq!(wire.header_stamp_s().unwrap(), 100.25);
        assert_eq!(wire.u8().unwrap(), 7);
        assert!(wire.f64().is_err());
    }
}
