//! Mending a recording whose recorder was killed, or whose disk was full.
//!
//! Contract: the damaged file is only read. The mended one has every message before the damage, with an index
//! and an end as readers of others want them, and appears under its name when it is whole.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions};

use crate::read::{RecordingEntry, RecordingReader};
use crate::write::part_of;
use crate::{RecordError, appear, whole};

#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Mended {
    /// Messages in the mended file.
    pub messages: u64,
    /// Why the damaged one ended early; `None`: it was whole.
    pub damage: Option<String>,
    /// What else is not in the mended file, in words.
    pub passed_over: Option<String>,
}

/// Writes what can be read of `from` to the new file `to`.
///
/// # Errors
///
/// `from` is not a recording, or no message of it can be saved; `to` exists, or cannot be written.
pub fn repair(from: &Path, to: &Path) -> Result<Mended, RecordError> {
    let mut reader = RecordingReader::open(from)?;
    whole(to, |file| {
        let file =
            file.try_clone().map_err(|source| RecordError::Write { path: to.to_path_buf(), source })?;
        copied(&mut reader, file, to)
    })
}

fn copied(reader: &mut RecordingReader, file: File, part: &Path) -> Result<Mended, RecordError> {
    let broken = |error: McapError| RecordError::of_mcap(part, error);
    let options = WriteOptions::new().compression(None).disable_seeking(true).profile("foretrace");
    let mut writer = options.create(NoSeek::new(BufWriter::new(file))).map_err(broken)?;
    let mut channels: BTreeMap<u16, u16> = BTreeMap::new();
    let mut messages = 0;
    while let Some(entry) = reader.next_entry()? {
        match entry {
            RecordingEntry::Facts(name, metadata) => {
                writer.write_metadata(&Metadata { name, metadata }).map_err(broken)?;
            }
            RecordingEntry::Message(message) => {
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
                            .add_channel(schema, &channel.name, &channel.encoding, &channel.metadata)
                            .map_err(broken)?;
                        channels.insert(message.channel, new);
                        new
                    }
                };
                let header = MessageHeader {
                    channel_id,
                    sequence: message.sequence,
                    log_time: message.time_ns,
                    publish_time: message.publish_ns,
                };
                writer.write_to_known_channel(&header, &message.data).map_err(broken)?;
                messages += 1;
            }
        }
    }
    let (damage, passed_over) = (reader.damage(), reader.passed_over());
    if messages == 0 {
        return Err(RecordError::NothingToMend { path: reader.path().to_path_buf(), damage });
    }
    let mut facts = BTreeMap::from([("messages".to_owned(), messages.to_string())]);
    facts.extend(damage.clone().map(|damage| ("damage".to_owned(), damage)));
    let end = Metadata { name: "foretrace.mended".to_owned(), metadata: facts };
    writer.write_metadata(&end).map_err(broken)?;
    writer.finish().map_err(broken)?;
    Ok(Mended { messages, damage, passed_over })
}

/// Mends what a killed recorder left of `target` and of its further files; returns where they are now.
///
/// # Errors
///
/// Another recorder is at work on one of them; it cannot be read, or the mended file not be written.
pub fn mend_leftovers(target: &Path) -> Result<Vec<(PathBuf, Mended)>, RecordError> {
    let mut mended = Vec::new();
    for target in further(target)? {
        mended.extend(mend(&target)?);
    }
    Ok(mended)
}

/// `target`, and the further files of it of which there is a part, by their numbers.
fn further(target: &Path) -> Result<Vec<PathBuf>, RecordError> {
    let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let failed = |source| RecordError::Read { path: folder.to_path_buf(), source };
    let mut numbers = Vec::new();
    for file in std::fs::read_dir(folder).map_err(failed)? {
        let name = file.map_err(failed)?.file_name();
        let words = name.to_string_lossy().into_owned();
        let words = words.split('.').filter_map(|word| word.parse().ok());
        numbers.extend(words.filter(|number: &usize| {
            let part = part_of(&numbered(target, &number.to_string()));
            part.file_name() == Some(&*name)
        }));
    }
    numbers.sort_unstable();
    let further = numbers.iter().map(|number| numbered(target, &number.to_string()));
    Ok(std::iter::once(target.to_path_buf()).chain(further).collect())
}

/// Mends the part of one file, if there is one.
fn mend(target: &Path) -> Result<Option<(PathBuf, Mended)>, RecordError> {
    let part = part_of(target);
    let file = match File::open(&part) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(RecordError::Read { path: part, source }),
    };
    file.try_lock().map_err(|_| RecordError::Busy { path: part.clone() })?;
    let place = (1..).map(|number| numbered(target, &format!("interrupted-{number}")));
    let place = place.into_iter().find(|place| !place.exists()).unwrap_or_else(|| target.to_path_buf());
    let kept = |damage: Option<String>| -> Result<Option<(PathBuf, Mended)>, RecordError> {
        appear(&part, &place)?;
        Ok(Some((place.clone(), Mended { messages: 0, damage, passed_over: None })))
    };
    let mended = match repair(&part, &place) {
        // Killed before its first bytes were on the disk, or by a power cut that left holes: kept as it is.
        Err(RecordError::NoRecording { why, .. }) => return kept(Some(why)),
        Err(RecordError::NothingToMend { damage, .. }) => return kept(damage),
        mended => mended?,
    };
    std::fs::remove_file(&part).map_err(|source| RecordError::Write { path: part, source })?;
    Ok(Some((place, mended)))
}

/// `name.mcap` with `word` before its extension.
pub fn numbered(target: &Path, word: &str) -> PathBuf {
    let stem = target.file_stem().unwrap_or_default().to_string_lossy();
    let extension = target.extension().map_or_else(String::new, |e| format!(".{}", e.to_string_lossy()));
    target.with_file_name(format!("{stem}.{word}{extension}"))
}
