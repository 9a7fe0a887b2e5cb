//! Recordings of ROS 2 as SQLite (`.db3`), which rosbag2 wrote until ROS 2 Humble: a table of topics and one of messages.

use super::records::{Channel, Kind, Raw, Record, TypeName, name};
use super::sqlite::{self, Rows, Source, Value};
use super::wire::Encoding;
use crate::error::Result;

/// The tables that are still to be read.
#[derive(Default)]
pub(super) struct Tables {
    rows: Rows,
    /// The kind of the records of the current table.
    kind: Option<Kind>,
    /// Roots of the tables to come, the last one first.
    roots: Vec<(Kind, u32)>,
    /// Whether messages are read without what lies on pages of its own, to count them.
    pub(super) is_skimmed: bool,
    /// The farthest byte that was read: pages are in any order.
    pub(super) farthest: u64,
}

impl Tables {
    /// Finds the tables of a recording.
    ///
    /// # Errors
    /// A damaged database, or that of another program.
    pub(super) fn find(file: &mut dyn Source) -> Result<Self> {
        let mut header = vec![0; sqlite::HEADER];
        file.stand_at(0);
        if file.total() >= header.len() as u64 {
            file.fill(&mut header)?;
        }
        let Some(rows) = Rows::of(&header, file.total()) else {
            let (found, expected) = ("an impossible size of pages", "a power of two from 512");
            return Err(file.damage(found.into(), expected.into()));
        };
        let mut tables = Self {
            rows,
            ..Self::default()
        };
        tables.rows.begin(file, 1)?;
        let (mut names, mut record) = (Vec::new(), Vec::new());
        while tables.rows.next(file, false, &mut record)?.is_some() {
            if let Some([kind, name, _, root]) = sqlite::values(&record)
                && kind == Value::Bytes(b"table")
            {
                let name = name.bytes().unwrap_or_default();
                names.push(String::from_utf8_lossy(name).into_owned());
                let root = root.integer().and_then(|root| u32::try_from(root).ok());
                let kind = match name {
                    b"messages" => Some(Kind::Message),
                    b"topics" => Some(Kind::Channel),
                    _ => None,
                };
                tables.roots.extend(kind.zip(root));
            }
        }
        // The topics are read first.
        tables.roots.sort_by_key(|(kind, _)| *kind == Kind::Channel);
        if tables.roots.len() == 2 {
            return Ok(tables);
        }
        file.stand_at(0);
        Err(file.damage(
            format!("an SQLite database with the tables {}", names.join(", ")),
            "a recording of rosbag2, with the tables topics and messages".into(),
        ))
    }

    /// The next row, whose record is put into `record`: its kind and its number. `None` after the last one.
    ///
    /// # Errors
    /// A damaged place, after which the next call goes on.
    pub(super) fn next(
        &mut self,
        file: &mut dyn Source,
        record: &mut Vec<u8>,
    ) -> Result<Option<(Kind, i64)>> {
        loop {
            if let Some(kind) = self.kind {
                let is_skimmed = self.is_skimmed && kind == Kind::Message;
                if let Some(row) = self.rows.next(file, is_skimmed, record)? {
                    return Ok(Some((kind, row)));
                }
            }
            let Some((kind, root)) = self.roots.pop() else {
                return Ok(None);
            };
            self.kind = Some(kind);
            self.rows.begin(file, root)?;
        }
    }
}

/// The content of a row, whose number is in the head.
pub(super) fn parse(raw: Raw<'_>) -> Option<Record<'_>> {
    let row = i64::from_le_bytes(*raw.head.first_chunk()?);
    let number = |value: Value<'_>| u32::try_from(value.integer()?).ok();
    match raw.kind {
        Kind::Channel => {
            let [_, topic, message_type, encoding] = sqlite::values(raw.data)?;
            Some(Record::Channel {
                id: u32::try_from(row).ok()?,
                channel: Channel {
                    topic: name(topic.bytes()?)?,
                    message_type: TypeName::Known(name(message_type.bytes()?)?),
                    encoding: match encoding.bytes()? {
                        b"cdr" => Encoding::Cdr,
                        other => Encoding::Other(name(other)?),
                    },
                },
            })
        }
        Kind::Message => {
            let [_, topic, recorded_ns, data] = sqlite::values(raw.data)?;
            let data = data.bytes()?;
            // The bytes of a message end with its record.
            let is_last = data.as_ptr_range().end == raw.data.as_ptr_range().end;
            is_last.then_some(Record::Message {
                channel: number(topic)?,
                recorded_ns: u64::try_from(recorded_ns.integer()?).ok()?,
                data,
            })
        }
        _ => None,
    }
}
