//! The topics of a recording: what is written under which name, and in which encoding.
//!
//! Contract: raw topics hold the messages of shared memory byte for byte, and the layout table that says what
//! the bytes are; the others hold protobuf for readers of others. Times are those of the host's clock since
//! 1970; stamps inside messages stay on the monotonic clock.

mod foxglove;
mod readable;
mod raw;
pub(crate) mod scene;

use foretrace_shm::layout::{Field, fnv1a};
use foretrace_shm::{Status, TickInput, TickRecord, Wire};

use crate::proto::{ProtoFile, ProtoShape, descriptor_set};
pub use foxglove::{FRAME_TRANSFORM, LOG};
pub(crate) use foxglove::{Turn, frame_transform};

pub(crate) use raw::layout_of;
use raw::{THING_LAYOUT, layout_table, pen_rows};
pub use raw::{thing_bytes, thing_of};
pub use readable::{RECORDER, TICK, frames, log, tick, warning};
pub use scene::SCENE_UPDATE;

/// Encoding of raw topics.
pub const WIRE: &str = "foretrace.wire";

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum RecordingTopic {
    /// Inputs of ticks, raw.
    Input,
    TickRaw,
    StatusRaw,
    /// Settings, weights and states, raw.
    Thing,
    /// Tick records in numbers and words.
    Tick,
    /// Where pen, tool and ghost are.
    Frames,
    /// The recorder's own counts.
    Recorder,
    /// What changed from tick to tick, in words.
    Log,
    /// The arm's shapes, what it keeps away from, and the paper.
    Scene,
    Preview,
}

impl RecordingTopic {
    pub const ALL: [Self; 10] = [
        Self::Input,
        Self::TickRaw,
        Self::StatusRaw,
        Self::Thing,
        Self::Tick,
        Self::Frames,
        Self::Recorder,
        Self::Log,
        Self::Scene,
        Self::Preview,
    ];

    /// Its name in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Input => "/raw/input",
            Self::TickRaw => "/raw/tick",
            Self::StatusRaw => "/raw/status",
            Self::Thing => "/raw/thing",
            Self::Tick => "/tick",
            Self::Frames => "/tf",
            Self::Recorder => "/recorder",
            Self::Log => "/log",
            Self::Scene => "/scene",
            Self::Preview => "/preview",
        }
    }

    /// The topic of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }

    /// Name, encoding and text of its schema.
    #[must_use]
    pub fn schema(self) -> (String, &'static str, Vec<u8>) {
        let raw = |name: &str, hash: u64, fields: &[Field], size: usize| {
            (name.to_owned(), WIRE, layout_table(hash, fields, size).into_bytes())
        };
        let proto = |shape: &ProtoShape, files: &[ProtoFile]| {
            (shape.name.to_owned(), "protobuf", descriptor_set(files))
        };
        match self {
            Self::Input => {
                let (name, encoding, mut table) =
                    raw("TickInput", TickInput::LAYOUT_HASH, TickInput::FIELDS, size_of::<TickInput>());
                table.extend(pen_rows().into_bytes());
                (name, encoding, table)
            }
            Self::TickRaw => {
                raw("TickRecord", TickRecord::LAYOUT_HASH, TickRecord::FIELDS, size_of::<TickRecord>())
            }
            Self::StatusRaw => raw("Status", Status::LAYOUT_HASH, Status::FIELDS, size_of::<Status>()),
            Self::Thing => raw("Thing", THING_LAYOUT, &[], 0),
            Self::Tick => proto(&TICK, &[readable::OURS]),
            Self::Frames => proto(&FRAME_TRANSFORM, foxglove::FRAME_FILES),
            Self::Recorder => proto(&RECORDER, &[readable::OURS]),
            Self::Log => proto(&LOG, foxglove::LOG_FILES),
            Self::Scene | Self::Preview => proto(&SCENE_UPDATE, scene::SCENE_FILES),
        }
    }

    /// Whether its messages are bytes of ours, from which everything else is made.
    #[must_use]
    pub const fn is_raw(self) -> bool {
        matches!(self, Self::Input | Self::TickRaw | Self::StatusRaw | Self::Thing)
    }

    /// Its encoding of messages.
    #[must_use]
    pub const fn encoding(self) -> &'static str {
        if self.is_raw() { WIRE } else { "protobuf" }
    }
}

/// Stands for the layouts of all raw topics of this version.
#[must_use]
pub fn layouts() -> u64 {
    let mut heads = Vec::new();
    for topic in RecordingTopic::ALL.into_iter().filter(|topic| topic.encoding() == WIRE) {
        heads.extend_from_slice(layout_of(&topic.schema().2));
    }
    fnv1a(&heads)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_message_has_exactly_the_fields_of_its_shape() {
        assert!(!tick(&TickRecord::default()).is_empty());
        for frame in frames(&TickRecord::default(), 1_700_000_000_123_456_789) {
            assert!(!frame.is_empty());
        }
    }
}
