//! The messages of Foxglove's WebSocket protocol: what a viewer may say (`client_message`), what it is sent
//! (`server_message`).
//!
//! Source: the specification in github.com/foxglove/ws-protocol; the messages of
//! github.com/foxglove/foxglove-sdk.

mod client_message;
mod server_message;

pub(crate) use client_message::{ViewerMessage, ViewerSetting, binary, text};
use foretrace_record::topics::RecordingTopic;
pub(crate) use server_message::{
    StatusLevel, advertise, advertise_services, call_done, call_failed, message_data, parameter_values,
    remove_status, server_info, status, time,
};

/// Largest message of a viewer \[bytes\].
pub(crate) const MESSAGE_BYTES: usize = 64 << 10;
/// Topics that viewers get, each at the channel of its index here, from 1.
pub(crate) const CHANNELS: [RecordingTopic; 5] = [
    RecordingTopic::Tick,
    RecordingTopic::Frames,
    RecordingTopic::Log,
    RecordingTopic::Scene,
    RecordingTopic::Preview,
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ViewerService {
    Stop,
    Arm,
}

impl ViewerService {
    pub(crate) const ALL: [Self; 2] = [Self::Stop, Self::Arm];

    pub(crate) const fn id(self) -> u32 {
        match self {
            Self::Stop => 1,
            Self::Arm => 2,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Stop => "/foretrace/stop",
            Self::Arm => "/foretrace/arm",
        }
    }
}
