//! Decoding of ROS messages: the parts that both serialisations share.

/// Largest accepted number of rays of a laser scan; a larger one is damage.
const MOST_RAYS: u32 = 1 << 20;

/// The reason why a message cannot be read; the reader of the file adds the position.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    /// The content found.
    pub(super) found: String,
    /// The content expected.
    pub(super) expected: String,
    /// Whether the user can answer it in the project, so that it is none of the message's.
    pub(super) is_asked: bool,
}

impl Fault {
    /// A fault with these texts.
    pub(super) fn new(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self {
            found: found.into(),
            expected: expected.into(),
            is_asked: false,
        }
    }

    /// A fault that the user can answer in the project.
    pub(super) fn asked(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self {
            is_asked: true,
            ..Self::new(found, expected)
        }
    }

    /// The fault of a message that ends early.
    fn short(left: usize, wanted: usize) -> Self {
        Self::new(
            format!("only {left} bytes left in the message"),
            format!("{wanted} bytes"),
        )
    }
}

/// A decoded value or a fault.
pub(super) type Decoded<T> = Result<T, Fault>;

/// Serialisation of the messages of a topic.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Encoding {
    /// Common Data Representation, of ROS 2.
    Cdr,
    /// The serialisation of ROS 1.
    Ros1,
    /// Another serialisation, with its name in the file.
    Other(String),
}

/// The unread rest of a message.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rest<'a> {
    bytes: &'a [u8],
    /// Bytes taken so far.
    pub(super) at: usize,
}

impl<'a> Rest<'a> {
    /// The rest of a message of which nothing was read.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The next `n` bytes.
    pub(super) fn take(&mut self, n: usize) -> Decoded<&'a [u8]> {
        let left = self.bytes.len();
        let (taken, bytes) = self
            .bytes
            .split_at_checked(n)
            .ok_or_else(|| Fault::short(left, n))?;
        self.bytes = bytes;
        self.at += n;
        Ok(taken)
    }
}

/// A serialisation: decodes the values of a message one after another.
pub(super) trait Wire<'a> {
    /// The next number of `N` bytes, as little-endian bytes.
    fn word<const N: usize>(&mut self) -> Decoded<[u8; N]>;

    /// The next `n` bytes as they are.
    fn raw(&mut self, n: usize) -> Decoded<&'a [u8]>;

    /// The bytes of a string.
    fn text(&mut self) -> Decoded<&'a [u8]>;

    /// The time stamp (seconds) and the frame of a `std_msgs/Header`.
    fn header(&mut self) -> Decoded<(f64, &'a [u8])>;

    /// The time stamp of a `std_msgs/Header`, seconds; the rest of the header is skipped.
    fn header_stamp_s(&mut self) -> Decoded<f64> {
        Ok(self.header()?.0)
    }

    /// An unsigned byte or a Boolean.
    fn u8(&mut self) -> Decoded<u8> {
        let [byte] = self.word()?;
        Ok(byte)
    }

    /// An unsigned number of 16 bits.
    fn u16(&mut self) -> Decoded<u16> {
        Ok(u16::from_le_bytes(self.word()?))
    }

    /// An unsigned number of 32 bits.
    fn u32(&mut self) -> Decoded<u32> {
        Ok(u32::from_le_bytes(self.word()?))
    }

    /// A floating-point number of 32 bits.
    fn f32(&mut self) -> Decoded<f64> {
        Ok(f64::from(f32::from_le_bytes(self.word()?)))
    }

    /// A floating-point number of 64 bits.
    fn f64(&mut self) -> Decoded<f64> {
        Ok(f64::from_le_bytes(self.word()?))
    }

    /// An array of `N` floating-point numbers of 64 bits.
    fn f64s<const N: usize>(&mut self) -> Decoded<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// A sequence of bytes.
    fn bytes(&mut self) -> Decoded<&'a [u8]> {
        let count = self.u32()?;
        self.raw(count as usize)
    }

    /// A sequence of floating-point numbers of 32 bits. Memory grows with the data, not with the length that the
    /// message claims.
    fn f32s(&mut self) -> Decoded<Vec<f64>> {
        let count = self.u32()?;
        if count > MOST_RAYS {
            let found = format!("a sequence of {count} numbers");
            return Err(Fault::new(found, format!("at most {MOST_RAYS}")));
        }
        (0..count).map(|_| self.f32()).collect()
    }
}

/// A message type, decoded from either serialisation.
pub(super) trait Message<'a>: Sized {
    /// Decodes the fields of the message in the order of its definition; fields after the last one that is
    /// used may be left unread.
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self>;
}

/// Seconds of a time stamp.
pub(super) fn stamp_s(seconds: f64, nanoseconds: u32) -> Decoded<f64> {
    if nanoseconds >= 1_000_000_000 {
        return Err(Fault::new(
            format!("a time stamp with {nanoseconds} ns after its full seconds"),
            "less than 1000000000 ns",
        ));
    }
    Ok(seconds + f64::from(nanoseconds) * 1e-9)
}
