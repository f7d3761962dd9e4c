//! What is in a recording: facts, topics, ticks and gaps.

use std::collections::BTreeMap;
use std::path::Path;

use foretrace_shm::PieceKind;
use serde::Serialize;

use crate::RecordError;
use crate::read::{Content, RecordingEntry, RecordingReader};

/// A summary; keys are stable.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Info {
    /// What the recorder wrote at the beginning.
    pub begin: BTreeMap<String, String>,
    /// What it wrote at the end; empty if it was killed.
    pub end: BTreeMap<String, String>,
    pub topics: BTreeMap<String, u64>,
    /// Topics whose messages have another layout than this program's.
    pub foreign: Vec<String>,
    /// From the first message to the last \[s\].
    pub seconds: f64,
    /// First and last tick of the inputs.
    pub ticks: Option<(u64, u64)>,
    /// Ticks that are missing in between.
    pub missing_ticks: u64,
    /// Ticks after which a replay can start.
    pub states: Vec<u64>,
    /// Daemons, by their starts.
    pub daemons: Vec<u64>,
    /// Builds of the daemons' laws, by their starts.
    pub laws: BTreeMap<u64, String>,
    /// Why the file ends early; `None`: it is whole.
    pub damage: Option<String>,
    /// What was passed over: attachments, messages of unknown channels.
    pub passed_over: Option<String>,
}

/// Reads all of `path`.
///
/// # Errors
///
/// It is not a recording, or the disk fails.
pub fn info(path: &Path) -> Result<Info, RecordError> {
    let mut reader = RecordingReader::open(path)?;
    let mut info = Info::default();
    let (mut first, mut last) = (u64::MAX, 0);
    while let Some(entry) = reader.next_entry()? {
        match entry {
            RecordingEntry::Facts(name, facts) if name == "foretrace" => info.begin = facts,
            RecordingEntry::Facts(_, facts) => info.end.extend(facts),
            RecordingEntry::Message(message) => {
                first = first.min(message.time_ns);
                last = last.max(message.time_ns);
                let name = reader.channels().get(&message.channel).map(|channel| channel.name.clone());
                let name = name.unwrap_or_else(|| format!("channel {}", message.channel));
                *info.topics.entry(name.clone()).or_default() += 1;
                match reader.content(&message) {
                    Ok(Content::Input(input)) => {
                        if !info.daemons.contains(&input.daemon_id) {
                            info.daemons.push(input.daemon_id);
                        }
                        if input.part == 0 {
                            let (begin, end) = info.ticks.unwrap_or((input.tick, input.tick));
                            info.missing_ticks += input.tick.saturating_sub(end.saturating_add(1));
                            info.ticks = Some((begin, input.tick));
                        }
                    }
                    Ok(Content::Thing(thing)) => match thing.kind {
                        PieceKind::State => info.states.push(thing.number),
                        PieceKind::Law => {
                            let build = String::from_utf8_lossy(&thing.bytes).into_owned();
                            info.laws.insert(thing.daemon_id, build);
                        }
                        PieceKind::Settings | PieceKind::Weights | PieceKind::Preview => {}
                    },
                    Err(RecordError::OtherLayout { topic, .. }) if !info.foreign.contains(&topic) => {
                        info.foreign.push(topic);
                    }
                    _ => {}
                }
            }
        }
    }
    if first <= last {
        info.seconds = (last - first) as f64 * 1e-9;
    }
    (info.damage, info.passed_over) = (reader.damage(), reader.passed_over());
    Ok(info)
}
