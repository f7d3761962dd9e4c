//! Attach to a running foretrace: feed pen samples, read commands, telemetry and status, send requests.
//!
#![doc = include_str!("../README.md")]
//!
//! # Contract
//!
//! Attaching succeeds only where a daemon of the same message layout is up; every error says what to do.
//! Handles are made by [`Foretrace`] and are not `Send`, as the middleware's ports are not; [`Requests`] and
//! [`Foretrace`] itself are.

#![warn(missing_docs)]
#![forbid(unsafe_code)]

mod attach;
mod lookout;
mod seat;
mod pen;
mod gateway;
mod arm;
mod watch;
mod operate;
mod predict;
mod stop;
pub mod instance;
pub mod wire;

pub use arm::{Commands, Demand, JointStateError, JointStates, demand_at};
pub use attach::{Attachment, Foretrace};
pub use gateway::{GatewayError, GatewayFeed};
pub use lookout::{DaemonChange, Lasting, Lookout};
pub use operate::{DeadMan, DeadManError, RequestError, Requests};
pub use pen::{FeedError, PenFeed, PenReading};
pub use predict::{PenSteps, PreviewSendError, Previews};
pub use stop::{StopError, Stopped, stop};
pub use watch::{InputWatch, JointWatch, MessageWatch, PenWatch, StatusReader, Telemetry};

#[doc(inline)]
pub use wire::{
    JOINTS, JointCommand, JointState, Mode, PenSample, RobotMode, SafetyMode, Stage, Status, TickRecord,
};

// Instances, who holds what in them, and why they cannot be used.
#[doc(inline)]
pub use foretrace_shm::{
    AskError, Claimant, DaemonMark, Holder, HolderKind, Instance, InstanceError, Place, PlaceError,
    PublishError, ServiceError, SignalError, host_boot_id, monotonic_now_ns,
};

foretrace_shm::debug_as_display!(
    FeedError,
    DeadManError,
    StopError,
    JointStateError,
    RequestError,
    PreviewSendError,
    GatewayError
);
