//! The pen of a recording, by the layout that the file itself names: recordings of other versions have one
//! too.

use std::collections::BTreeMap;

use foretrace_sim::data::{PenSeen, PenTable};

use crate::RecordError;
use crate::read::{RecordingEntry, RecordingReader};
use crate::topics::RecordingTopic;

/// Calls `use_sample` for every pen sample that a tick of the recording was given, in order, until it fails.
/// Returns how it failed, if it did.
///
/// # Errors
///
/// The recording does not tell where its pen samples are, holds a message that is none, or the disk fails.
pub fn pen_samples<E>(
    reader: &mut RecordingReader,
    mut use_sample: impl FnMut(PenSeen) -> Result<(), E>,
) -> Result<Result<(), E>, RecordError> {
    let mut tables: BTreeMap<u16, Option<PenTable>> = BTreeMap::new();
    let mut done = Ok(());
    while let Some(entry) = reader.next_entry()? {
        let RecordingEntry::Message(message) = entry else { continue };
        let Some(channel) = reader.channels().get(&message.channel) else { continue };
        if channel.name != RecordingTopic::Input.name() {
            continue;
        }
        let table = tables
            .entry(message.channel)
            .or_insert_with(|| std::str::from_utf8(&channel.schema.2).ok().and_then(PenTable::of));
        let path = || reader.path().to_path_buf();
        let Some(table) = table else {
            let why = format!("{} does not tell where its pen samples are", channel.name);
            return Err(RecordError::Format { path: path(), why });
        };
        let whole = table.samples(&message.data, |seen| {
            if done.is_ok() {
                done = use_sample(seen);
            }
        });
        whole.ok_or_else(|| RecordError::Damaged { path: path(), topic: channel.name.clone() })?;
        if done.is_err() {
            break;
        }
    }
    Ok(done)
}
