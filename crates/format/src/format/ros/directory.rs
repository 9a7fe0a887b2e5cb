//! The topics of bags of all kinds.

use std::collections::BTreeMap;

use super::bag::Topic;
use super::records::{Channel, Cursor, Kind, Record, Span, TypeName, short_type};
use super::split;
use super::walk::Walk;
use super::wire::Encoding;
use crate::error::Result;
use crate::format::input::Input;

/// Largest accepted number of channels; a larger one is damage.
const MOST_CHANNELS: usize = 1 << 16;

/// Lists the topics of a bag by name.
pub(super) fn topics(input: &Input) -> Result<Vec<Topic>> {
    let mut merged = Merged::new();
    for (number, file) in split::files(input)?.iter().enumerate() {
        let directory = match Directory::from_indices(file)? {
            Some(directory) => directory,
            None => Directory::from_messages(file)?,
        };
        directory.merge_into(&mut merged, number);
    }
    let topic = |((name, message_type, encoding), (span, channels)): (_, (Span, _))| Topic {
        name,
        message_type,
        count: span.count,
        recorded_s: (span.count > 0)
            .then_some((span.first_ns as f64 * 1e-9, span.last_ns as f64 * 1e-9)),
        encoding,
        channels,
    };
    Ok(merged.into_iter().map(topic).collect())
}

/// Topics by name, type and encoding: their messages, and their channels in each file.
type Merged = BTreeMap<(String, String, Encoding), (Span, Vec<(usize, u32)>)>;

/// The channels and schemas of a bag.
#[derive(Default)]
struct Directory {
    schemas: BTreeMap<u32, String>,
    channels: BTreeMap<u32, Channel>,
    spans: BTreeMap<u32, Span>,
}

impl Directory {
    /// Reads the indices after the chunks without unpacking the chunks; `None` if the indices are incomplete.
    fn from_indices(input: &Input) -> Result<Option<Self>> {
        let mut walk = Walk::open(input)?;
        walk.tables.is_skimmed = true;
        let mut directory = Self::default();
        let mut is_index_due = false;
        let wanted = [Kind::Schema, Kind::Channel, Kind::Message, Kind::Index];
        while let Some(kind) = walk.step(&wanted)? {
            if is_index_due && kind != Kind::Index {
                return Ok(None);
            }
            is_index_due = kind == Kind::Chunk;
            if wanted.contains(&kind) {
                match walk.record() {
                    Some(record) => directory.note(record, &walk)?,
                    None => return Ok(None),
                }
            }
        }
        let is_known = |id: &u32| match &directory.channels.get(id)?.message_type {
            TypeName::Known(_) => Some(()),
            TypeName::Schema(id) => directory.schemas.get(id).map(|_| ()),
        };
        let is_complete = directory.spans.keys().all(|id| is_known(id).is_some());
        Ok((is_complete && !is_index_due && !walk.is_cut).then_some(directory))
    }

    /// Reads every record.
    fn from_messages(input: &Input) -> Result<Self> {
        let mut walk = Walk::open(input)?;
        let mut directory = Self::default();
        let mut block = Vec::new();
        let wanted = [Kind::Schema, Kind::Channel, Kind::Message];
        let with_chunks = [wanted.as_slice(), &[Kind::Chunk]].concat();
        while let Some(kind) = walk.step(&with_chunks)? {
            if kind == Kind::Chunk {
                let start = walk.unpack(&mut block)?;
                let mut rest = Cursor(&block[start..]);
                while let Some(raw) = walk.split(&mut rest) {
                    let record = wanted.contains(&raw.kind).then(|| walk.parse(raw));
                    if let Some(record) = record.flatten() {
                        directory.note(record, &walk)?;
                    }
                }
            } else if wanted.contains(&kind) {
                match walk.record() {
                    Some(record) => directory.note(record, &walk)?,
                    None => walk.pass_over(walk.unreadable(kind)),
                }
            }
        }
        let is_empty = directory.channels.is_empty();
        match walk.take_damage().filter(|_| is_empty) {
            Some(damage) => Err(damage),
            None => Ok(directory),
        }
    }

    /// Adds the content of a record of `walk`.
    fn note(&mut self, record: Record<'_>, walk: &Walk) -> Result<()> {
        let (channel, span) = match record {
            Record::Schema { id, name } => {
                self.schemas.insert(id, name);
                return Ok(());
            }
            Record::Channel { id, channel } => {
                self.channels.insert(id, channel);
                return self.check(self.channels.len(), walk);
            }
            Record::Index { channel, span } => (channel, span),
            Record::Message {
                channel,
                recorded_ns,
                ..
            } => (channel, Span::one(recorded_ns)),
        };
        self.spans.entry(channel).or_default().add(span);
        self.check(self.spans.len(), walk)
    }

    /// Checks that there are no more channels than MCAP can number.
    fn check(&self, channels: usize, walk: &Walk) -> Result<()> {
        if channels <= MOST_CHANNELS {
            return Ok(());
        }
        Err(walk.error(
            format!("more than {MOST_CHANNELS} channels"),
            format!("at most {MOST_CHANNELS}"),
        ))
    }

    /// Adds the topics of a file with this number; channels of one topic with the same type are merged.
    fn merge_into(self, merged: &mut Merged, number: usize) {
        for (id, channel) in self.channels {
            let message_type = match channel.message_type {
                TypeName::Known(name) => name,
                TypeName::Schema(id) => self.schemas.get(&id).cloned().unwrap_or_default(),
            };
            let key = (channel.topic, short_type(&message_type), channel.encoding);
            let (span, channels) = merged.entry(key).or_default();
            span.add(self.spans.get(&id).copied().unwrap_or_default());
            channels.push((number, id));
        }
    }
}
