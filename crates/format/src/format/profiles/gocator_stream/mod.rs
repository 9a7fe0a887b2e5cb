//! Profiles of LMI Gocator scanners, as they arrive over the data channel of the Gocator protocol.
//!
//! # Layout
//!
//! All values are little-endian (Gocator user manual, section "Gocator Protocol", "Data Types"). A
//! message begins with its size in bytes (u32, itself included) and a control word (u16): the lower
//! 15 bits are its type, the highest bit marks the last message of a group (section "Data Results").
//! A group, here called a data set, holds the stamps, the profiles and the intensities of one or
//! several frames.
//!
//! | type | message | section of the manual |
//! |---|---|---|
//! | 1 | stamps | "Stamp" |
//! | 5 | points (x, z) | "Profile Point Cloud"; "Profile" in older manuals |
//! | 6 | ranges z at a constant spacing in x | "Uniform Profile"; "Resampled Profile" in older manuals |
//! | 7 | intensity of either | "Profile Intensity" |
//!
//! The types 5 to 7 contain the size of their attributes (without the size field itself) before the
//! samples; stamp messages contain the size of a stamp. Both sizes grew with the firmware: attributes
//! by the stream step and its identifier, then by two fields of arrays of data; stamps by a time of
//! PTP. Unknown fields at the end are skipped, and shorter messages lack the newer fields.
//!
//! # Where the sources differ
//!
//! * **Unit of the time stamp.** The manual says µs. The manufacturer's SDK (`GoStamp` in
//!   `GoDataTypes.h`, versions for firmware 5.3 and 6) says "internal units approximating microseconds",
//!   where the time in µs is the value divided by 1.024, and LMI's knowledge base says the same of the
//!   CSV files ("Unit of timestamp in Gocator CSV export file"). The SDK passes on the value as it
//!   arrives, so the value is read as ticks of 1/1.024 µs here. [`Stamp::time_ticks`] is the value as it
//!   arrived. A fit of the ticks against arrival or PTP decides within a second: the two units are
//!   2.4 % apart.
//! * **Size of a stamp.** The manual's table ends at byte 52 but gives a size of 56; the SDK has another
//!   reserved u64 at byte 48, and the time of PTP at byte 56 if a stamp has 64 bytes.
//! * **Size of the attributes.** The manual says "current: 32" for the point cloud and puts its
//!   samples at byte 48, which needs 40. The SDK writes 48 for types 5 and 6 and 40 for type 7. The
//!   size in the message decides, so this makes no difference.
//! * **Invalid points.** The manual gives 0x8000 as the null value of i16; the SDK's samples check
//!   only x of a point cloud. Here a point is invalid if either coordinate is null.
//!
//! # Open questions
//!
//! No recording of a real scanner was available. The documents do not say whether the time of PTP is
//! zero if PTP is off, in which order the messages of a data set come (any order is read), and whether
//! a set may have several stamp messages (those of the main sensor are preferred).
//!
//! # Connecting a client
//!
//! Connect to TCP port 3196 of the scanner and read; nothing is sent. The scanner accepts several
//! clients at a time (Gocator user manual, section "Data Results"). It sends data only
//!
//! * in the Running state: it starts on a command from its web interface or the control channel, or by
//!   itself when its autostart is on (section "Control Commands", "States"),
//! * of the kinds that the active job selects: Output page, Ethernet, protocol Gocator, with the
//!   profiles (and the intensity) checked (section "Ethernet Output").
//!
//! A client that does not read for ten seconds is disconnected, unless "Auto Disconnect" is
//! unchecked (section "Ethernet Output").
//!
//! The commands of the control channel (TCP port 3190) are not needed for this and not implemented.
//! A command is a length (u32, itself included) and an identifier (u16). A reply has these two fields
//! and a status (i32, 1 if the command succeeded), little-endian. Start is 0x100D, Stop 0x1001, Set Auto Start
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
