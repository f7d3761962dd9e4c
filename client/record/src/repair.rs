//! Mending a recording whose recorder was killed, or whose disk was full.
//!
//! Contract: the damaged file is only read. The mended one has every message before the damage, with an index
//! and an end as readers of others want them, and appears under its name when it is whole.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::BufWriter;
use std::path::Path;

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions};

use crate::read::{Entry, Reader};
use crate::write::part_of;
use crate::{RecordError, appear};

/// What was mended.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Mended {
    /// Messages in the mended file.
    pub messages: u64,
    /// Why the damaged one ended early; `None`: it was whole.
    pub damage: Option<String>,
}

/// Writes what can be read of `from` to the new file `to`.
///
/// # Errors
///
/// `from` is no recording; `to` exists, or cannot be written.
pub fn repair(from: &Path, to: &Path) -> Result<Mended, RecordError> {
    let mut reader = Reader::open(from)?;
    let part = part_of(to);
    if to.exists() {
        return Err(RecordError::Exists { path: to.to_path_buf() });
    }
    let file = OpenOptions::new().write(true).create_new(true).open(&part).map_err(|source| match source
        .kind()
    {
        std::io::ErrorKind::AlreadyExists => RecordError::Exists { path: part.clone() },
        _ => RecordError::Write { path: part.clone(), source },
    })?;
    let mended = copied(&mut reader, file, &part);
    match mended {
        Ok(mended) => appear(&part, to).map(|()| mended),
        Err(error) => {
            // Half a file helps nobody.
            let _ = std::fs::remove_file(&part);
            Err(error)
        }
    }
}

fn copied(reader: &mut Reader, file: std::fs::File, part: &Path) -> Result<Mended, RecordError> {
    let broken = |error: McapError| RecordError::of_mcap(part, error);
    let options = WriteOptions::new().compression(None).disable_seeking(true).profile("foretrace");
    let mut writer = options.create(NoSeek::new(BufWriter::new(file))).map_err(broken)?;
    let mut channels: BTreeMap<u16, u16> = BTreeMap::new();
    let mut messages = 0;
    while let Some(entry) = reader.next_entry()? {
        match entry {
            Entry::Facts(name, metadata) => {
                writer.write_metadata(&Metadata { name, metadata }).map_err(broken)?;
            }
            Entry::Message(message) => {
                let channel_id = match channels.get(&message.channel) {
                    Some(known) => *known,
                    None => {
                        let Some(channel) = reader.channels().get(&message.channel) else { continue };
                        let (name, encoding, text) = &*channel.schema;
                        let schema = if name.is_empty() {
                            0
                        } else {
                            writer.add_schema(name, encoding, text).map_err(broken)?
                        };
                        let new = writer
                            .add_channel(schema, &channel.name, &channel.encoding, &BTreeMap::new())
                            .map_err(broken)?;
                        channels.insert(message.channel, new);
                        new
                    }
                };
                let header = MessageHeader {
                    channel_id,
                    sequence: message.sequence,
                    log_time: message.time_ns,
                    publish_time: message.time_ns,
                };
                writer.write_to_known_channel(&header, &message.data).map_err(broken)?;
                messages += 1;
            }
        }
    }
    let damage = reader.damage();
    let mut facts = BTreeMap::from([("messages".to_owned(), messages.to_string())]);
    facts.extend(damage.clone().map(|damage| ("damage".to_owned(), damage)));
    let end = Metadata { name: "foretrace.mended".to_owned(), metadata: facts };
    writer.write_metadata(&end).map_err(broken)?;
    writer.finish().map_err(broken)?;
    Ok(Mended { messages, damage })
}
