//! Profiles of LMI Gocator scanners, as they arrive over the data channel of the Gocator protocol.
//!
//! # Layout
//!
//! All values are little-endian (Gocator user manual, section "Gocator Protocol", "Data Types"). A
//! message begins with its size in bytes (u32, itself included) and a control word (u16): the lower
//! 15 bits are its type, the highest marks the last message of a group (section "Data Results").
//! One group, here called a data set, holds what belongs to one or several frames: their stamps,
//! their profiles, their intensity.
//!
//! | type | message | section of the manual |
//! |---|---|---|
//! | 1 | stamps | "Stamp" |
//! | 5 | points (x, z) | "Profile Point Cloud"; "Profile" in older manuals |
//! | 6 | ranges z at a constant spacing in x | "Uniform Profile"; "Resampled Profile" in older manuals |
//! | 7 | intensity of either | "Profile Intensity" |
//!
//! The types 5 to 7 say how long their attributes are (that size does not count itself) before their
//! samples begin; stamps say how long each of them is. Both grew: attributes by the stream step and
//! its identifier, then by two fields of arrays of data; stamps by a time of PTP. What is longer than
//! known here is passed over, what is shorter lacks these fields.
//!
//! # Where the sources differ
//!
//! * **Unit of the time stamp.** The manual says µs. The maker's SDK (`GoStamp` in `GoDataTypes.h`,
//!   versions for firmware 5.3 and 6) says "internal units approximating microseconds", the time in µs being
//!   the value divided by 1.024, and LMI's knowledge base says the same of the CSV files ("Unit of
//!   timestamp in Gocator CSV export file"). The SDK passes the value on as it arrives, so it is
//!   taken for ticks of 1/1.024 µs here. [`Stamp::time_ticks`] is the value as it arrived. A fit of
//!   it against arrival or PTP decides within a second: the two units are 2.4 % apart.
//! * **Size of a stamp.** The manual's table ends at byte 52 and says 56; the SDK has another reserved
//!   u64 at byte 48, and the time of PTP at 56 where a stamp has 64 bytes.
//! * **Size of the attributes.** The manual says "current: 32" for the point cloud and puts its
//!   samples at byte 48, which needs 40. The SDK writes 48 for types 5 and 6 and 40 for type 7. The
//!   stated size decides, so this makes no difference.
//! * **Invalid points.** The manual gives 0x8000 as the null value of i16; the SDK's samples look at
//!   x only in a point cloud. A point is taken as invalid here if either is null.
//!
//! # What is unknown
//!
//! No recording of a real scanner was at hand. Not documented are: whether the time of PTP is zero
//! where PTP is off, the order of messages in a data set (any order is read), and whether several
//! stamp messages occur in a set (those of the main sensor are preferred).
//!
//! # What a client has to do
//!
//! Connect to TCP port 3196 of the scanner and read; nothing is sent. The scanner accepts several
//! clients at a time (Gocator user manual, section "Data Results"). It sends only
//!
//! * in the Running state: it starts when its web interface or a command says so, or by itself when
//!   its autostart is on (section "Control Commands", "States"),
//! * what the active job selects: Output page, Ethernet, protocol Gocator, with the profiles (and
//!   the intensity) checked (section "Ethernet Output").
//!
//! A client that does not read for ten seconds is disconnected, unless "Auto Disconnect" is
//! unchecked (section "Ethernet Output").
//!
//! The commands of the control channel (TCP port 3190) are not needed for this and not implemented.
//! A command is a length (u32, itself included) and an identifier (u16), a reply these two and a
//! status (i32, 1 if it succeeded), little-endian. Start is 0x100D, Stop 0x1001, Set Auto Start
//! Enabled 0x452B followed by a byte, Protocol Version 0x4511 (sections "Start", "Stop",
//! "Set Auto Start Enabled", "Protocol Version"). No handshake is documented for the data channel.

mod encode;
mod frames;
mod layout;
mod message;
mod profile;
mod recording;
mod splitter;

pub use encode::{Encoder, Scales};
pub use frames::{ScannerFrame, ScannerSettings, data_set};
pub use layout::{LARGEST_MESSAGE, NULL_RANGE};
pub use message::{Attributes, Kind, Message, Samples, Stamp, Stamps, TICKS_PER_US};
pub use profile::{Counts, Profile, ProfileReader};
pub(crate) use recording::STREAM;
pub use splitter::{Piece, Splitter};
