//! Attach to a running foretrace: feed pen samples, read commands, telemetry and status, send requests.
//!
//! Contract: attaching succeeds only where a daemon of the same message layout is up; every error says what
//! to do. Handles are made by [`Foretrace`] and stay in the thread that made them (the middleware's ports are
//! not `Send`); [`Foretrace`] itself may be shared, so each thread makes its own. No threads but for calls
//! that damaged shared memory could make hang, no logging, no settings file.
//!
//! ```no_run
//! use foretrace_client::{Foretrace, PenReading, monotonic_now_ns};
//!
//! let foretrace = Foretrace::attach(0)?;
//! let mut pen = foretrace.pen_feed()?;
//! let now = monotonic_now_ns();
//! pen.send(PenReading { device_stamp_ns: now, x_m: 0.1, y_m: 0.05, contact: true, ..Default::default() })?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)]
#![forbid(unsafe_code)]

mod attach;
pub use attach::*;
mod seat;
mod pen;
pub use pen::*;
mod gateway;
pub use gateway::*;
mod arm;
pub use arm::*;
mod watch;
pub use watch::*;
mod operate;
pub use operate::*;
mod stop;
pub use stop::*;

foretrace_shm::debug_as_display!(FeedError, DeadManError, StopError, StateError, RequestError, GatewayError);

pub use foretrace_shm::{
    ArmLag, ArmLine, ArmNote, AskError, Chain, Claimant, ControlOp, ControlResponse, ControlStatus, Counters,
    DaemonMark, EffortUnit, Enable, FaultReason, GhostState, HeaderBounds, Holder, HolderKind, Instance,
    InstanceError, JOINTS, JointCommand, JointState, LATENCY_BINS, Latency, Mode, NoteWords, ORDER_AHEAD_NS,
    PenSample, Percentiles, Place, PlaceError, PredictorName, PublishError, Refused, RejectField,
    RejectReason, Rejection, Rejections, RobotMode, Rung, SafetyMode, ServiceError, SolverPath, Stage,
    Status, StopCause, StopDetail, TickRecord, ToolExtent, Tracking, TrustReason, Validate, WayHome,
    arm_flags, command_flags, guard_mask, health, host_boot_id, missing_rights, monotonic_now_ns, pen_flags,
};
