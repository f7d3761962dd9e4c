//! Everything of foretrace that crosses a process border: plain-old-data messages, the names and quality of
//! service of their services, and the files of an instance.
//!
//! Contract: every wire type is `#[repr(C)]`, `Copy`, made of fixed-width integers, floats and arrays of
//! them, has no implicit padding, and carries its layout version in its type name and its layout hash in a
//! service attribute. A receiver copies a message once and validates the copy; refusals are counted by
//! reason. Absent: domain mathematics, threads, policy.
//!
//! Three modules, each of which uses only those before it: `wire` (the messages), `instance` (names, root,
//! occupancy, leftovers, the stop path) and `transport` (sessions, services, ports). `os` has the system
//! calls.
//!
//! Source: iceoryx2 0.9.3; it compares type name, size and alignment only, hence the layout hash.

#![warn(missing_docs)]

mod os;
mod wire;
mod instance;
mod transport;

pub use os::{effective_user, peer_user, shared_memory_free_bytes};

pub use wire::{
    AXES, JOINTS,
    arm_lag::ArmLag,
    arm_line::ArmLine,
    arm_note::{ArmNote, NOTE_BYTES, NoteWords},
    c_header::{C_LAYOUT_HASH, c_header},
    check::{Rejection, Rejections, Validate},
    clock::{host_boot_id, monotonic_now_ns},
    control::{ControlRequest, ControlResponse, MESSAGE_BYTES, ORDER_AHEAD_NS},
    counters::Counters,
    flags::{
        arm_flags, command_flags, guard_mask, health, input_flags, missing_rights, pen_flags, preview_flags,
    },
    gateway,
    header::{Header, HeaderBounds, HeaderCheck},
    joints::{
        EFFORT_LIMIT, Enable, JOINT_POSITION_LIMIT_RAD, JOINT_VELOCITY_LIMIT_RADPS, JointCommand, JointState,
    },
    latency::{LATENCY_BINS, Latency},
    layout::{self, Wire},
    pen::{PEN_POSITION_LIMIT_M, PenSample},
    pen_step::{PREVIEW_STEPS, PenMotion, PenPreview, PenStep},
    piece::{Assembly, LARGEST_THING_BYTES, PIECE_BYTES, Piece, PieceKind, Thing},
    predictor_name::{PREDICTOR_NAME_BYTES, PredictorName},
    python_module::python_module,
    refused::{Refused, RejectField},
    robot_mode::{RobotMode, SafetyMode},
    status::{
        ExternalState, GhostState, PREVIEW_REFUSALS, Percentiles, PreviewRefusal, Status, Tracking, WayHome,
    },
    stop_detail::{StopCause, StopDetail, ToolExtent},
    tick_input::{PEN_PER_PART, PenInput, TickInput},
    tick_record::{Chain, PATH_POINTS, TickRecord},
    vocabulary::{
        ControlOp, ControlStatus, EffortUnit, FaultReason, Mode, REJECT_REASONS, RejectReason, Rung, STAGES,
        SolverPath, Stage, TrustReason, UnknownValue,
    },
};

pub use instance::{
    SHARED_MEMORY,
    holder::{Claimant, Holder, HolderKind, Place},
    leftovers::{Cleaned, Leftovers, Prefixed, prefixed},
    occupancy::{DaemonMark, InstanceLock, Purge, SharedMemory},
    place::{Claim, PlaceError},
    root::{Instance, InstanceError, LONGEST_ROOT_BYTES},
    stop_path::{
        LOOP, STOP_ANSWER_BYTES, STOP_FRAME_BYTES, SignalError, SignalledStop, StopAnswer, StopFrame,
        StopFrameError,
    },
};

pub use transport::{
    control_ports::{AskError, Call, ControlClient, ControlServer},
    control_topic::{CONTROL_CLIENTS, CONTROL_OPEN_REQUESTS, CONTROL_SERVICE, ControlTopic},
    ports::{PublishError, Publisher, Subscriber},
    session::{PEER_MEMORY_LIMIT_BYTES, ServiceError, Session},
    topic::{MAX_PEERS, Message, Qos, SHARED_MEMORY_LIMIT_BYTES, Services, Topic},
};
