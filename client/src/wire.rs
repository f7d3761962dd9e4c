//! The messages that cross the process border, and every type in them: plain data with fixed layouts.
//!
//! Enumerations are numbers in a message: `TryFrom<u32>` reads them, `Into<u32>` writes them. A field that a
//! message has for alignment is called `reserved`.

#[doc(inline)]
pub use foretrace_shm::layout::Field;
#[doc(inline)]
pub use foretrace_shm::{
    AXES, ArmLag, ArmLine, ArmNote, Chain, ControlOp, ControlRequest, ControlResponse, ControlStatus,
    Counters, EffortUnit, Enable, ExternalState, FaultReason, GhostState, Header, HeaderBounds, JOINTS,
    JointCommand, JointState, LATENCY_BINS, Latency, Message, Mode, NoteWords, ORDER_AHEAD_NS, PATH_POINTS,
    PREVIEW_REFUSALS, PREVIEW_STEPS, PenInput, PenMotion, PenPreview, PenSample, PenStep, Percentiles, Piece,
    PieceKind, PredictorName, PreviewRefusal, Qos, REJECT_REASONS, Refused, RejectField, RejectReason,
    Rejection, Rejections, RobotMode, Rung, STAGES, SafetyMode, SolverPath, Stage, Status, StopCause,
    StopDetail, Thing, TickInput, TickRecord, ToolExtent, Tracking, TrustReason, UnknownValue, Validate,
    WayHome, Wire, arm_flags, command_flags, guard_mask, health, input_flags, missing_rights, pen_flags,
    preview_flags,
};
