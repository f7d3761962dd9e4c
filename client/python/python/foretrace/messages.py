"""Messages of foretrace. Made by `foretrace schema python`; do not edit.

Lengths are metres, angles radians, times nanoseconds of CLOCK_MONOTONIC, which `time.monotonic_ns()` reads.
A record is a ctypes structure: `Status.from_buffer_copy(data)` reads one, `bytes(record)` writes it,
`Status.dtype()` is its numpy dtype. Enumerations and flags stand in its fields as numbers.
"""

from __future__ import annotations

import builtins
import ctypes
import enum
from typing import Any, ClassVar


class Enumeration(enum.IntEnum):
    """Numbers with words: `Mode.IDLE == 0`, `Mode.IDLE.label == "idle"`."""

    label: str

    def __new__(cls, number: int, label: str) -> Enumeration:
        member = int.__new__(cls, number)
        member._value_ = number
        member.label = label
        return member

    @classmethod
    def words(cls, number: int) -> str:
        """The label of a number, also of one that this version does not know."""
        return next((member.label for member in cls if member == number), f"unknown ({number})")


class Record(ctypes.LittleEndianStructure):
    """A message or a part of one."""

    #: The class of the enumeration or flags in a field.
    _kinds_: ClassVar[dict[str, type]] = {}

    def to_dict(self) -> dict[str, Any]:
        """All fields as plain values: words for enumerations, names for flags, lists for arrays."""
        return {name: self._plain(name, getattr(self, name)) for name, *_ in self._fields_}

    def _plain(self, name: str, value: Any) -> Any:
        if isinstance(value, ctypes.Array):
            # Each item is of the field's kind.
            return [self._plain(name, item) for item in value]
        kind = self._kinds_.get(name)
        if kind is not None and issubclass(kind, Enumeration):
            return kind.words(value)
        if kind is not None and issubclass(kind, enum.IntFlag):
            return [flag.name for flag in kind if value & flag]
        if isinstance(value, builtins.bytes):
            return value.decode("utf-8", "replace")
        if isinstance(value, Record):
            return value.to_dict()
        return value

    @classmethod
    def dtype(cls) -> Any:
        """The numpy dtype of this record; an array of it is `numpy.frombuffer(data, Status.dtype())`."""
        import numpy

        return numpy.dtype(cls)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and bytes(self) == bytes(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={value!r}" for name, value in self.to_dict().items())
        return f"{type(self).__name__}({fields})"


def _check(record: type[Record], size: int) -> None:
    if ctypes.sizeof(record) != size:
        raise ImportError(f"{record.__name__} has {ctypes.sizeof(record)} bytes here, {size} on the wire")


class Mode(Enumeration):
    IDLE = 0, "idle"
    ARMED = 1, "armed"
    FOLLOWING = 2, "following"
    HOLDING = 3, "holding"
    STOPPED = 4, "stopped"
    FAULT = 5, "fault"
    HOMING = 6, "moving home"


class Rung(Enumeration):
    FRESH_PLAN = 0, "fresh plan"
    PREVIOUS_PLAN = 1, "previous plan"
    STOP = 2, "stop"
    HOLD = 3, "hold"


class TrustReason(Enumeration):
    INACTIVE = 0, "inactive"
    WARM_UP = 1, "warm-up"
    MANUAL = 2, "manual"
    EVIDENCE = 3, "evidence"
    HYSTERESIS = 4, "hysteresis"
    PEN_STALE = 6, "pen stale"
    PEN_JUMP = 7, "pen jump"
    PREDICTOR_UNHEALTHY = 9, "predictor unhealthy"
    PREDICTOR_SWITCHED = 10, "predictor switched"
    WORSE_THAN_HOLD = 11, "worse than hold"
    WORSE_THAN_CONSTANT_VELOCITY = 12, "worse than constant velocity"
    FROZEN = 14, "frozen"
    UNPROVEN = 15, "no evidence yet"
    SURPRISED = 16, "pen outside the bands"
    SOLVER_UNHEALTHY = 17, "planner unhealthy"
    LEARNER_UNHEALTHY = 18, "learner unhealthy"
    ARM_LIMITED = 19, "arm at its limits"


class SolverPath(Enumeration):
    NOT_RUN = 0, "not run"
    GAIN = 1, "gain"
    ACTIVE_SET = 2, "active set"
    CLARABEL = 3, "clarabel"
    FALLBACK = 4, "fallback"


class FaultReason(Enumeration):
    NONE = 0, "none"
    TIME_LOST = 1, "time lost"
    JOINT_STATE_STALE = 2, "joint state stale"
    ROBOT_STOPPED = 3, "robot stopped"
    TRACKING_ERROR = 4, "tracking error"
    DEAD_MAN = 5, "dead-man"
    OVERRUNS = 8, "overruns"
    INTERNAL = 10, "internal"
    REQUESTED = 11, "requested"
    ENVELOPE = 12, "tool envelope"
    WAY_BLOCKED = 13, "blocked while homing"
    CONTACT = 14, "contact"


class StopCause(Enumeration):
    NONE = 0, "none"
    JOINT_DEVIATION = 1, "joint deviation"
    TOOL_DEVIATION = 2, "tool deviation"
    WRONG_DIRECTION = 3, "wrong direction"
    NO_MOTION = 4, "no motion"
    RUNAWAY = 5, "runaway"
    OSCILLATION = 6, "growing oscillation"
    SLOW_ARM = 7, "slow arm"
    HEIGHT = 8, "height over the paper"
    WORKSPACE = 9, "workspace"
    TILT = 10, "tilt"
    TOOL_SPEED = 11, "tool speed"
    LATE_TICKS = 12, "late ticks"
    CLEARANCE = 13, "too near"
    RESPONSE = 14, "response of a joint"
    EFFORT = 15, "effort"


class SafetyMode(Enumeration):
    UNKNOWN = 0, "unknown"
    NORMAL = 1, "normal"
    REDUCED = 2, "reduced"
    PROTECTIVE_STOP = 3, "protective stop"
    RECOVERY = 4, "recovery"
    SAFEGUARD_STOP = 5, "safeguard stop"
    SYSTEM_EMERGENCY_STOP = 6, "system emergency stop"
    ROBOT_EMERGENCY_STOP = 7, "robot emergency stop"
    VIOLATION = 8, "violation"
    FAULT = 9, "fault"
    VALIDATE_JOINT_ID = 10, "validate joint id"
    UNDEFINED = 11, "undefined"


class RobotMode(Enumeration):
    NO_CONTROLLER = 0, "no controller"
    DISCONNECTED = 1, "disconnected"
    CONFIRM_SAFETY = 2, "confirm safety"
    BOOTING = 3, "booting"
    POWER_OFF = 4, "power off"
    POWER_ON = 5, "power on"
    IDLE = 6, "idle"
    BACKDRIVE = 7, "backdrive"
    RUNNING = 8, "running"
    UPDATING_FIRMWARE = 9, "updating firmware"


class EffortUnit(Enumeration):
    NONE = 0, "none"
    NEWTON_METRES = 1, "Nm"
    AMPERES = 2, "A"
    SHARE = 3, "share of the limit"


class ControlOp(Enumeration):
    QUERY = 0, "query"
    ARM = 1, "arm"
    DISARM = 2, "disarm"
    STOP = 3, "stop"
    SET_TRUST = 4, "set-trust"
    TRUST_AUTO = 5, "trust-auto"
    SWITCH_PREDICTOR = 6, "switch-predictor"
    RELOAD = 7, "reload"
    FREEZE_TRUST = 8, "freeze-trust"
    MOVE_HOME = 9, "move-home"


class ControlStatus(Enumeration):
    OK = 0, "ok"
    ACCEPTED = 1, "accepted"
    INVALID = -1, "invalid request"
    FOREIGN_BOOT = -2, "foreign boot"
    WRONG_MODE = -3, "wrong mode"
    NO_JOINT_STATE = -4, "no joint state"
    JOINT_STATE_STALE = -5, "joint state stale"
    OUTSIDE_LIMITS = -6, "outside limits"
    ROBOT_NOT_READY = -7, "robot not ready"
    NOT_ENABLED = -8, "not enabled"
    PREDICTOR_UNAVAILABLE = -9, "predictor unavailable"
    SETTINGS_REJECTED = -10, "settings rejected"
    NEEDS_RESTART = -11, "needs restart"
    BUSY = -12, "busy"
    INTERNAL = -13, "internal error"
    UNSUPPORTED = -14, "unsupported"
    JUMP = -15, "jump refused"
    ARM_MOVES = -16, "arm moves"
    TOOL_OUTSIDE_WORKSPACE = -17, "tool outside workspace"
    TOOL_NOT_ALIGNED = -18, "tool not aligned"
    NOT_FOLLOWING = -19, "arm does not follow"
    STOP_CAME = -20, "superseded by a stop"
    WAY_BLOCKED = -21, "path home is blocked"


class Stage(Enumeration):
    WAKEUP = 0, "wakeup"
    RECEIVE = 1, "receive"
    PEN = 2, "pen"
    PREDICT = 3, "predict"
    TRUST = 4, "trust"
    MPC = 5, "mpc"
    IK = 6, "ik"
    GUARD = 7, "guard"
    SEND = 8, "send"
    STEP = 9, "step"


class RejectReason(Enumeration):
    NOT_FINITE = 0, "not finite"
    OUT_OF_RANGE = 1, "out of range"
    UNKNOWN_ENUM = 2, "unknown enum"
    UNKNOWN_FLAGS = 3, "unknown flags"
    FOREIGN_BOOT = 4, "foreign boot"
    TIME_BACKWARDS = 5, "time backwards"
    FROM_THE_FUTURE = 6, "from the future"
    REPLAYED = 7, "replayed"
    TOO_OLD = 8, "too old"


class RejectField(Enumeration):
    OTHER = 0, "another field"
    Q = 1, "q"
    QD = 2, "qd"
    EFFORT = 3, "effort"
    SAFETY_MODE = 4, "safety_mode"
    ROBOT_MODE = 5, "robot_mode"
    X = 6, "x_m"
    Y = 7, "y_m"
    PRESSURE = 8, "pressure"
    TILT_X = 9, "tilt_x_rad"
    TILT_Y = 10, "tilt_y_rad"
    FLAGS = 11, "flags"
    STAMP = 12, "stamp_ns"
    SEQUENCE = 13, "sequence"
    BOOT = 14, "boot_id"
    DEVICE_STAMP = 15, "device_stamp_ns"
    COMMAND_TICK = 16, "command_tick"
    PEN_SEQUENCE = 17, "pen_sequence"
    COMMAND_ACCEPTED = 18, "command_accepted_ns"
    EFFORT_UNIT = 19, "effort_unit"


class GhostState(Enumeration):
    OFF = 0, "off"
    APPROACHING = 1, "approaching"
    SETTLING = 2, "settling"
    COMPARABLE = 3, "comparable"


class PenMotion(Enumeration):
    START = 0, "start"
    CONTINUES = 1, "continues"
    JUMP = 2, "jump"


class PreviewRefusal(Enumeration):
    NONE = 0, "none"
    MALFORMED = 1, "malformed"
    NON_FINITE = 2, "non-finite"
    AHEAD = 3, "ahead"
    LATE = 4, "late"
    REPEATED = 5, "repeated"
    OTHER_STROKE = 6, "other stroke"
    WILD = 7, "wild"
    MESSAGE = 8, "message"


class PenFlags(enum.IntFlag):
    CONTACT = 0x1
    IN_RANGE = 0x2
    BUTTON_1 = 0x4
    BUTTON_2 = 0x8
    BUTTON_3 = 0x10
    ERASER = 0x20
    SYNTHETIC = 0x40


class CommandFlags(enum.IntFlag):
    ENABLED = 0x1
    BEGINS = 0x2
    STOPPING = 0x4


class ArmFlags(enum.IntFlag):
    WITHOUT_DEAD_MAN = 0x1
    SIMULATED = 0x2


class GuardMask(enum.IntFlag):
    NOT_FINITE = 0x1
    POSITION = 0x2
    VELOCITY = 0x4
    ACCELERATION = 0x8
    JERK = 0x10
    DISCONTINUOUS = 0x20
    UNSTOPPABLE = 0x40
    GAP = 0x80


class Health(enum.IntFlag):
    PEN_STALE = 0x1
    PEN_GAP = 0x2
    PEN_JUMP = 0x4
    PEN_DISORDER = 0x8
    PEN_REJECTED = 0x10
    PREDICTOR_UNHEALTHY = 0x20
    PREVIEW_CLAMPED = 0x40
    WORKSPACE_CLAMPED = 0x80
    SOFT_LIMIT = 0x100
    MPC_CAP = 0x200
    MPC_FALLBACK = 0x400
    IK_CAP = 0x800
    NEAR_SINGULAR = 0x1000
    IK_CLIPPED = 0x2000
    GUARD_CLIPPED = 0x4000
    GUARD_REFUSED = 0x8000
    JOINT_STATE_STALE = 0x10000
    TIME_LOST = 0x20000
    RESYNCHRONISED = 0x40000
    SHED = 0x80000
    OVERRUN = 0x100000
    WEIGHTS_REFUSED = 0x200000
    LEARNER_RING_FULL = 0x400000
    TELEMETRY_RING_FULL = 0x800000
    NOT_FINITE = 0x1000000
    ROBOT_NOT_READY = 0x2000000
    COMMAND_NOT_SENT = 0x4000000
    DEAD_MAN = 0x8000000
    ALLOCATED = 0x10000000
    IK_FAILED = 0x20000000
    CLEARANCE = 0x40000000
    STOP_OFF_PATH = 0x80000000


class MissingRights(enum.IntFlag):
    FIFO = 0x1
    MEMORY_LOCK = 0x2
    AFFINITY = 0x4
    CPU_LATENCY = 0x8
    TIMER_SLACK = 0x10
    PREEMPT_RT = 0x20
    SHARED_MEMORY_RESERVED = 0x40
    NOT_ASKED = 0x80


class PreviewFlags(enum.IntFlag):
    RADII = 0x1


class Header(Record):
    """First field of every message."""

    #: Sequence number of the message of its publisher, from 1.
    sequence: int
    #: Monotonic clock [ns]: when it was sent, except for commands (see JointCommand).
    stamp_ns: int
    #: The sender's host_boot_id().
    boot_id: int
    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("stamp_ns", ctypes.c_uint64),
        ("boot_id", ctypes.c_uint64),
    ]


_check(Header, 24)


class PenSample(Record):
    """One reading of the pen. Positions are in metres in the device's plane, x right, y away from the writer."""

    #: Stamp: when it was sent.
    header: Header
    #: When the pen was there [ns], mapped by the reader to this host's monotonic clock.
    device_stamp_ns: int
    #: Position [m].
    x_m: float
    #: Position [m].
    y_m: float
    #: 0 to 1; negative: unknown.
    pressure: float
    #: Tilt towards x from the plane's normal [rad].
    tilt_x_rad: float
    #: Tilt towards y from the plane's normal [rad].
    tilt_y_rad: float
    #: pen_flags.
    flags: int
    _kinds_ = {"flags": PenFlags}
    _fields_ = [
        ("header", Header),
        ("device_stamp_ns", ctypes.c_uint64),
        ("x_m", ctypes.c_double),
        ("y_m", ctypes.c_double),
        ("pressure", ctypes.c_float),
        ("tilt_x_rad", ctypes.c_float),
        ("tilt_y_rad", ctypes.c_float),
        ("flags", ctypes.c_uint32),
    ]


_check(PenSample, 64)


class JointCommand(Record):
    """Joint positions to be reached at header.stamp_ns, one control period after the tick that made them."""

    #: Stamp: the time at which q holds; up to one period in the future.
    header: Header
    #: When it was sent [ns].
    published_ns: int
    #: The tick that made it.
    tick: int
    #: The consumer brakes from this time on [ns].
    valid_until_ns: int
    #: Identity of the newest pen sample behind it: its number in its publisher's sequence; 0: none.
    pen_sequence: int
    #: Identity of the newest pen sample behind it: its device stamp [ns]; 0: none.
    pen_stamp_ns: int
    #: Joint positions at the stamp [rad].
    q: ctypes.Array[ctypes.c_double]
    #: Joint velocities up to the stamp [rad/s].
    qd: ctypes.Array[ctypes.c_double]
    #: Mode.
    mode: int
    #: command_flags.
    flags: int
    _kinds_ = {"mode": Mode, "flags": CommandFlags}
    _fields_ = [
        ("header", Header),
        ("published_ns", ctypes.c_uint64),
        ("tick", ctypes.c_uint64),
        ("valid_until_ns", ctypes.c_uint64),
        ("pen_sequence", ctypes.c_uint64),
        ("pen_stamp_ns", ctypes.c_uint64),
        ("q", ctypes.c_double * 6),
        ("qd", ctypes.c_double * 6),
        ("mode", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
    ]


_check(JointCommand, 168)


class ArmLine(Record):
    """The line between an arm's process and the arm's own controller. All zero where there is none."""

    #: From a state of the arm to the cycle of its controller that used the answer to it [ns]; 0: unknown.
    round_trip_ns: int
    #: Cycles of the controller that had no fresh command, while the arm followed.
    late_cycles: int
    #: Commands that the controller never saw, because a newer one came within the same cycle.
    lost_commands: int
    #: crate.arm_flags.
    flags: int
    #: Zero.
    reserved: int
    _kinds_ = {"flags": ArmFlags}
    _fields_ = [
        ("round_trip_ns", ctypes.c_uint64),
        ("late_cycles", ctypes.c_uint64),
        ("lost_commands", ctypes.c_uint64),
        ("flags", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]


_check(ArmLine, 32)


class JointState(Record):
    """Measured state of the arm."""

    #: Stamp: when it was measured, on this host's clock.
    header: Header
    #: The robot's own clock [ns]; 0: none.
    robot_stamp_ns: int
    #: Tick of the newest command accepted; 0: none. This and the next three are filled in by echo.
    command_tick: int
    #: When that command was accepted, on this host's clock [ns]; 0: unknown.
    command_accepted_ns: int
    #: pen_sequence of that command.
    pen_sequence: int
    #: pen_stamp_ns of that command.
    pen_stamp_ns: int
    #: Commands accepted so far.
    commands_received: int
    #: Commands refused so far (stale, foreign, malformed).
    commands_refused: int
    #: Joint positions [rad].
    q: ctypes.Array[ctypes.c_double]
    #: Joint velocities [rad/s].
    qd: ctypes.Array[ctypes.c_double]
    #: Joint currents or torques, positive along each joint's axis, in effort_unit.
    effort: ctypes.Array[ctypes.c_double]
    #: SafetyMode.
    safety_mode: int
    #: RobotMode.
    robot_mode: int
    #: EffortUnit; 0: the arm reports no effort.
    effort_unit: int
    #: Number of the crate.ArmNote that is in force; 0: none.
    note: int
    #: The line to the arm's controller.
    line: ArmLine
    _kinds_ = {"safety_mode": SafetyMode, "robot_mode": RobotMode, "effort_unit": EffortUnit}
    _fields_ = [
        ("header", Header),
        ("robot_stamp_ns", ctypes.c_uint64),
        ("command_tick", ctypes.c_uint64),
        ("command_accepted_ns", ctypes.c_uint64),
        ("pen_sequence", ctypes.c_uint64),
        ("pen_stamp_ns", ctypes.c_uint64),
        ("commands_received", ctypes.c_uint64),
        ("commands_refused", ctypes.c_uint64),
        ("q", ctypes.c_double * 6),
        ("qd", ctypes.c_double * 6),
        ("effort", ctypes.c_double * 6),
        ("safety_mode", ctypes.c_uint32),
        ("robot_mode", ctypes.c_uint32),
        ("effort_unit", ctypes.c_uint32),
        ("note", ctypes.c_uint32),
        ("line", ArmLine),
    ]


_check(JointState, 272)


class Chain(Record):
    """The latency from pen to arm in parts [ns]; u64.MAX: unknown.  Not to be summed: a command is stamped one control period after its tick, so compute and transport within that period delay nothing. The arm's own lag, from a command's stamp to the motion, is separate."""

    #: Device stamp to sent, of the newest pen sample: time of the device and its reader.
    pen_reader_ns: int
    #: Sent to received by a tick, of the newest pen sample: shared memory, and waiting for the tick.
    pen_transport_ns: int
    #: Device stamp of the newest pen sample to the release of the tick.
    pen_age_ns: int
    #: Start of the tick to the command handed to the middleware.
    compute_ns: int
    #: Handed to the middleware to accepted by the arm, of the newest command that the arm has echoed.
    command_transport_ns: int
    _fields_ = [
        ("pen_reader_ns", ctypes.c_uint64),
        ("pen_transport_ns", ctypes.c_uint64),
        ("pen_age_ns", ctypes.c_uint64),
        ("compute_ns", ctypes.c_uint64),
        ("command_transport_ns", ctypes.c_uint64),
    ]


_check(Chain, 40)


class PredictorName(Record):
    """A predictor's name, or none."""

    #: ASCII, padded with NUL.
    bytes: builtins.bytes
    _fields_ = [
        ("bytes", ctypes.c_char * 28),
    ]


_check(PredictorName, 28)


class Rejections(Record):
    """Refusals by reason, indexed by RejectReason."""

    #: One counter per reason.
    by_reason: ctypes.Array[ctypes.c_uint64]
    _fields_ = [
        ("by_reason", ctypes.c_uint64 * 9),
    ]


_check(Rejections, 72)


class Counters(Record):
    """Totals since the daemon started."""

    #: Ticks run.
    ticks: int
    #: Ticks that ended after their deadline.
    overruns: int
    #: Whole periods dropped.
    skipped_ticks: int
    #: Ticks run with a shed budget.
    shed_ticks: int
    #: Commands published.
    commands_sent: int
    #: Commands that could not be published.
    commands_failed: int
    #: Pen samples accepted.
    pen_received: int
    #: Pen samples missing in the sender's sequence.
    pen_dropped: int
    #: Pen samples whose device stamp went backwards or repeated.
    pen_out_of_order: int
    #: Pen samples accepted, but set aside as jump or outlier.
    pen_outliers: int
    #: Gaps in the pen's device stamps.
    pen_gaps: int
    #: Ticks that left pen samples for the next one, because a tick takes a bounded number.
    pen_deferred_ticks: int
    #: Pen samples refused, by reason.
    pen_rejected: Rejections
    #: Joint states accepted.
    joint_state_received: int
    #: Joint states missing in the sender's sequence.
    joint_state_dropped: int
    #: Ticks whose newest joint state was stale.
    joint_state_stale: int
    #: Joint states refused, by reason.
    joint_state_rejected: Rejections
    #: Dead-man messages refused, all reasons.
    enable_rejected: int
    #: Dead-man messages missing in the sender's sequence.
    enable_dropped: int
    #: Errors of the middleware while receiving.
    receive_failures: int
    #: Tick records lost because the ring to the ipc thread was full.
    telemetry_ring_dropped: int
    #: Tick records that could not be published.
    telemetry_failed: int
    #: Grid steps lost because the learner's ring was full.
    learner_ring_dropped: int
    #: Sets of weights refused by the loop.
    weights_refused: int
    #: Sets of weights that a newer set overtook before the loop took them up.
    weights_overtaken: int
    #: Events of the learner lost because its channel was full.
    learner_events_lost: int
    #: Requests answered.
    requests: int
    #: Requests answered with a refusal.
    requests_refused: int
    #: Heap allocations on the real-time thread after warm-up, except in ticks with a connection change.
    allocations: int
    #: Heap allocations in ticks in which a port connected or disconnected.
    connection_allocations: int
    #: Ticks in which a port connected or disconnected.
    connection_ticks: int
    #: Minor page faults of the real-time thread.
    page_faults_minor: int
    #: Major page faults of the real-time thread.
    page_faults_major: int
    _fields_ = [
        ("ticks", ctypes.c_uint64),
        ("overruns", ctypes.c_uint64),
        ("skipped_ticks", ctypes.c_uint64),
        ("shed_ticks", ctypes.c_uint64),
        ("commands_sent", ctypes.c_uint64),
        ("commands_failed", ctypes.c_uint64),
        ("pen_received", ctypes.c_uint64),
        ("pen_dropped", ctypes.c_uint64),
        ("pen_out_of_order", ctypes.c_uint64),
        ("pen_outliers", ctypes.c_uint64),
        ("pen_gaps", ctypes.c_uint64),
        ("pen_deferred_ticks", ctypes.c_uint64),
        ("pen_rejected", Rejections),
        ("joint_state_received", ctypes.c_uint64),
        ("joint_state_dropped", ctypes.c_uint64),
        ("joint_state_stale", ctypes.c_uint64),
        ("joint_state_rejected", Rejections),
        ("enable_rejected", ctypes.c_uint64),
        ("enable_dropped", ctypes.c_uint64),
        ("receive_failures", ctypes.c_uint64),
        ("telemetry_ring_dropped", ctypes.c_uint64),
        ("telemetry_failed", ctypes.c_uint64),
        ("learner_ring_dropped", ctypes.c_uint64),
        ("weights_refused", ctypes.c_uint64),
        ("weights_overtaken", ctypes.c_uint64),
        ("learner_events_lost", ctypes.c_uint64),
        ("requests", ctypes.c_uint64),
        ("requests_refused", ctypes.c_uint64),
        ("allocations", ctypes.c_uint64),
        ("connection_allocations", ctypes.c_uint64),
        ("connection_ticks", ctypes.c_uint64),
        ("page_faults_minor", ctypes.c_uint64),
        ("page_faults_major", ctypes.c_uint64),
    ]


_check(Counters, 392)


class ArmLag(Record):
    """The arm's lag from a command's stamp to the motion, measured in normal operation."""

    #: Dead time by which the plan looks ahead [ns].
    dead_time_ns: int
    #: Group delay at low frequency [s].
    lag_s: float
    #: Its standard deviation [s]; negative: the lag is unknown, and the fields beside it are meaningless.
    std_s: float
    #: Shift of the commands that fits the recent motion best [s]; shorter than the group delay if the arm is a filter.
    shift_s: float
    _fields_ = [
        ("dead_time_ns", ctypes.c_uint64),
        ("lag_s", ctypes.c_double),
        ("std_s", ctypes.c_double),
        ("shift_s", ctypes.c_double),
    ]


_check(ArmLag, 32)


class StopDetail(Record):
    """Evidence behind a latched stop: which joint, how much, and the limit that was broken."""

    #: StopCause, which determines the unit of amount and limit.
    cause: int
    #: Joint index from 0, base first; −1: the tool, or no joint.
    joint: int
    #: Observed value.
    amount: float
    #: Allowed value.
    limit: float
    #: Release of the tick in which the stop latched [ns]; 0: no stop has latched.
    at_ns: int
    _kinds_ = {"cause": StopCause}
    _fields_ = [
        ("cause", ctypes.c_uint32),
        ("joint", ctypes.c_int32),
        ("amount", ctypes.c_double),
        ("limit", ctypes.c_double),
        ("at_ns", ctypes.c_uint64),
    ]


_check(StopDetail, 32)


class TickRecord(Record):
    """One tick's evidence."""

    #: Stamp: end of the tick.
    header: Header
    #: Number of the tick, from 1.
    tick: int
    #: When it should have started [ns].
    release_ns: int
    #: The time at which its command holds [ns].
    command_stamp_ns: int
    #: Time left to the deadline [ns]; negative after an overrun.
    slack_ns: int
    #: Cost of each Stage [ns], saturated.
    stage_ns: ctypes.Array[ctypes.c_uint32]
    #: Caps of iterations the tick was given: MPC.
    budget_mpc_iterations: int
    #: Caps of iterations the tick was given: IK.
    budget_ik_iterations: int
    #: 1: the budget was shed.
    shed: int
    #: Whole periods dropped before this tick.
    skipped_ticks: int
    #: Identity of the newest pen sample: its number in its publisher's sequence; 0: none yet.
    pen_sequence: int
    #: Identity of the newest pen sample: its device stamp [ns]; 0: none yet.
    pen_stamp_ns: int
    #: Latencies, part by part.
    chain: Chain
    #: Newest pen position [m].
    pen_m: ctypes.Array[ctypes.c_double]
    #: Pen samples accepted in this tick.
    pen_samples: int
    #: crate.pen_flags of the newest sample.
    pen_flags: int
    #: Age of the newest joint state [ns].
    joint_state_age_ns: int
    #: Newest measured joint positions [rad].
    measured_q: ctypes.Array[ctypes.c_double]
    #: Tick of the newest command that the arm has echoed; 0: none.
    echo_tick: int
    #: Identity of the pen sample behind that command, as echoed: its number.
    echo_pen_sequence: int
    #: Identity of the pen sample behind that command, as echoed: its device stamp [ns].
    echo_pen_stamp_ns: int
    #: Reference of the tool at the command's stamp [m].
    reference_m: ctypes.Array[ctypes.c_double]
    #: Setpoint: position [m].
    setpoint_m: ctypes.Array[ctypes.c_double]
    #: Setpoint: velocity [m/s].
    setpoint_mps: ctypes.Array[ctypes.c_double]
    #: Setpoint: acceleration [m/s²].
    setpoint_mps2: ctypes.Array[ctypes.c_double]
    #: Jerk of the setpoint since the tick before [m/s³]; 0 where that tick sent no command.
    jerk_mps3: ctypes.Array[ctypes.c_double]
    #: Tool position of the published command [m].
    tool_m: ctypes.Array[ctypes.c_double]
    #: Published joint positions [rad].
    q: ctypes.Array[ctypes.c_double]
    #: Published joint velocities [rad/s].
    qd: ctypes.Array[ctypes.c_double]
    #: Trust α: 1 prediction only, 0 hold only.
    trust: float
    #: Target of α.
    trust_target: float
    #: Part of another process's predictor in the preview, [0, 1]; negative: it is not chosen.
    confidence: float
    #: TrustReason.
    trust_reason: int
    #: Rung.
    rung: int
    #: Mode.
    mode: int
    #: FaultReason.
    fault: int
    #: health.
    health: int
    #: guard_mask.
    guard_mask: int
    #: Joints the guard altered, one bit per joint.
    guard_joints: int
    #: Soft limits of the MPC exceeded, all axes.
    mpc_soft: int
    #: Active limits of the MPC, per axis.
    mpc_active: ctypes.Array[ctypes.c_uint32]
    #: Solver iterations, per axis.
    mpc_iterations: ctypes.Array[ctypes.c_uint32]
    #: SolverPath, per axis.
    mpc_path: ctypes.Array[ctypes.c_uint32]
    #: Joints at a limit in the IK, one bit per joint.
    ik_active: int
    #: Solver iterations.
    ik_iterations: int
    #: SolverPath.
    ik_path: int
    #: KKT residual, normalised, per axis; negative: not computed.
    mpc_residual: ctypes.Array[ctypes.c_double]
    #: KKT residual, normalised; negative: not computed.
    ik_residual: float
    #: Length of the orientation error [rad].
    orientation_error_rad: float
    #: Distance to the nearest singularity [m]; negative: not computed.
    singularity_m: float
    #: One-step error of the predictor at the newest closed grid step [m]; negative: none.
    predictor_error_m: float
    #: Radius about the plan's first reference in which the pen is expected in nine of ten cases [m]; negative: unknown.
    predictor_band_m: float
    #: Version of the weights in use.
    learner_version: int
    #: Age of the weights in use [ns].
    learner_age_ns: int
    #: The active predictor.
    predictor: PredictorName
    #: Steps of the roll-out.
    preview_steps: int
    #: Heap allocations in this tick.
    allocations: int
    #: 1: a port connected or disconnected in this tick.
    connections_changed: int
    #: Totals up to this tick.
    counters: Counters
    #: The arm's lag, and the plan's dead time.
    arm_lag: ArmLag
    #: Tool position of the command at the same stamp at Hold (trust 0) [m]; zero without a ghost.
    ghost_tool_m: ctypes.Array[ctypes.c_double]
    #: The time of the next two distances, a tenth of a second back [ns]; 0: none in this tick.
    compared_ns: int
    #: Distance of the measured tool from the pen at that time, in the plane [m]; negative: none in this tick.
    error_m: float
    #: The same for the ghost's tool, behind an arm of the same lag [m]; negative: none in this tick.
    ghost_error_m: float
    #: GhostState.
    ghost_state: int
    #: 1: the pen wrote at that time.
    compared_contact: int
    #: Evidence behind the newest latched stop.
    stop: StopDetail
    #: Fraction of the commanded speed at which the arm moves; negative: unknown.
    arm_speed_share: float
    #: The line to the arm's controller.
    arm_line: ArmLine
    #: Points of the next field that are known; 0: there was no preview, or no plan.
    path_points: int
    #: 0.
    reserved: int
    #: The previewed path that the plan was to follow, as far as it trusted it: x and y of each point in turn, from soon to late, the plan's last reference at the end [m].
    path_m: ctypes.Array[ctypes.c_float]
    _kinds_ = {"pen_flags": PenFlags, "trust_reason": TrustReason, "rung": Rung, "mode": Mode, "fault": FaultReason, "health": Health, "guard_mask": GuardMask, "mpc_path": SolverPath, "ik_path": SolverPath, "ghost_state": GhostState}
    _fields_ = [
        ("header", Header),
        ("tick", ctypes.c_uint64),
        ("release_ns", ctypes.c_uint64),
        ("command_stamp_ns", ctypes.c_uint64),
        ("slack_ns", ctypes.c_int64),
        ("stage_ns", ctypes.c_uint32 * 10),
        ("budget_mpc_iterations", ctypes.c_uint32),
        ("budget_ik_iterations", ctypes.c_uint32),
        ("shed", ctypes.c_uint32),
        ("skipped_ticks", ctypes.c_uint32),
        ("pen_sequence", ctypes.c_uint64),
        ("pen_stamp_ns", ctypes.c_uint64),
        ("chain", Chain),
        ("pen_m", ctypes.c_double * 3),
        ("pen_samples", ctypes.c_uint32),
        ("pen_flags", ctypes.c_uint32),
        ("joint_state_age_ns", ctypes.c_uint64),
        ("measured_q", ctypes.c_double * 6),
        ("echo_tick", ctypes.c_uint64),
        ("echo_pen_sequence", ctypes.c_uint64),
        ("echo_pen_stamp_ns", ctypes.c_uint64),
        ("reference_m", ctypes.c_double * 3),
        ("setpoint_m", ctypes.c_double * 3),
        ("setpoint_mps", ctypes.c_double * 3),
        ("setpoint_mps2", ctypes.c_double * 3),
        ("jerk_mps3", ctypes.c_double * 3),
        ("tool_m", ctypes.c_double * 3),
        ("q", ctypes.c_double * 6),
        ("qd", ctypes.c_double * 6),
        ("trust", ctypes.c_double),
        ("trust_target", ctypes.c_double),
        ("confidence", ctypes.c_double),
        ("trust_reason", ctypes.c_uint32),
        ("rung", ctypes.c_uint32),
        ("mode", ctypes.c_uint32),
        ("fault", ctypes.c_uint32),
        ("health", ctypes.c_uint32),
        ("guard_mask", ctypes.c_uint32),
        ("guard_joints", ctypes.c_uint32),
        ("mpc_soft", ctypes.c_uint32),
        ("mpc_active", ctypes.c_uint32 * 3),
        ("mpc_iterations", ctypes.c_uint32 * 3),
        ("mpc_path", ctypes.c_uint32 * 3),
        ("ik_active", ctypes.c_uint32),
        ("ik_iterations", ctypes.c_uint32),
        ("ik_path", ctypes.c_uint32),
        ("mpc_residual", ctypes.c_double * 3),
        ("ik_residual", ctypes.c_double),
        ("orientation_error_rad", ctypes.c_double),
        ("singularity_m", ctypes.c_double),
        ("predictor_error_m", ctypes.c_double),
        ("predictor_band_m", ctypes.c_double),
        ("learner_version", ctypes.c_uint64),
        ("learner_age_ns", ctypes.c_uint64),
        ("predictor", PredictorName),
        ("preview_steps", ctypes.c_uint32),
        ("allocations", ctypes.c_uint32),
        ("connections_changed", ctypes.c_uint32),
        ("counters", Counters),
        ("arm_lag", ArmLag),
        ("ghost_tool_m", ctypes.c_double * 3),
        ("compared_ns", ctypes.c_uint64),
        ("error_m", ctypes.c_double),
        ("ghost_error_m", ctypes.c_double),
        ("ghost_state", ctypes.c_uint32),
        ("compared_contact", ctypes.c_uint32),
        ("stop", StopDetail),
        ("arm_speed_share", ctypes.c_double),
        ("arm_line", ArmLine),
        ("path_points", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("path_m", ctypes.c_float * 20),
    ]


_check(TickRecord, 1384)


class Percentiles(Record):
    """Distribution of a duration [ns], saturated."""

    #: Median.
    p50_ns: int
    #: 99 of 100 are at most this.
    p99_ns: int
    #: 999 of 1000 are at most this.
    p99_9_ns: int
    #: The largest.
    max_ns: int
    _fields_ = [
        ("p50_ns", ctypes.c_uint32),
        ("p99_ns", ctypes.c_uint32),
        ("p99_9_ns", ctypes.c_uint32),
        ("max_ns", ctypes.c_uint32),
    ]


_check(Percentiles, 16)


class Latency(Record):
    """Distribution of a latency since the daemon started, after warm-up."""

    #: Number of measurements.
    count: int
    #: Percentiles, saturated at 4.29 s.
    percentiles: Percentiles
    #: Counts of measurements below Latency.edge_us and not below the edge before; the last bin counts the rest, saturated.
    bins: ctypes.Array[ctypes.c_uint32]
    _fields_ = [
        ("count", ctypes.c_uint64),
        ("percentiles", Percentiles),
        ("bins", ctypes.c_uint32 * 20),
    ]


_check(Latency, 104)


class Tracking(Record):
    """How well a tool follows the pen, since the loop was armed. Distances in the plane; negative: unknown. Lags are the shift of the pen that fits the tool best, −0.05 to 0.2; NaN: unknown."""

    #: Root mean square distance while the pen writes, over the last seconds of writing [m].
    recent_rms_m: float
    #: The same since arming [m].
    session_rms_m: float
    #: The same since arming, hovering included [m].
    hover_rms_m: float
    #: Lag of the tool behind the pen, over the last seconds of writing [s].
    recent_lag_s: float
    #: The same since arming [s].
    session_lag_s: float
    _fields_ = [
        ("recent_rms_m", ctypes.c_double),
        ("session_rms_m", ctypes.c_double),
        ("hover_rms_m", ctypes.c_double),
        ("recent_lag_s", ctypes.c_double),
        ("session_lag_s", ctypes.c_double),
    ]


_check(Tracking, 40)


class ToolExtent(Record):
    """Extremes of the measured tool since the daemon took charge, by forward kinematics of the *measured* joints in the plane's frame. NaN: not measured yet."""

    #: Lowest height over the paper [m].
    height_min_m: float
    #: Greatest height over the paper [m].
    height_max_m: float
    #: Farthest outside the workspace in the plane, 0 inside [m].
    outside_max_m: float
    #: Largest angle between the tool's axis and the plane's normal [rad].
    tilt_max_rad: float
    _fields_ = [
        ("height_min_m", ctypes.c_double),
        ("height_max_m", ctypes.c_double),
        ("outside_max_m", ctypes.c_double),
        ("tilt_max_rad", ctypes.c_double),
    ]


_check(ToolExtent, 32)


class Refused(Record):
    """The newest refusal of one kind of message."""

    #: RejectReason.
    reason: int
    #: RejectField.
    field: int
    #: Element of the field, if it is an array; −1: none.
    index: int
    #: Zero.
    reserved: int
    #: The value found, in the field's unit; for stamps the distance from the expected value [s].
    value: float
    #: The bound that was broken, in the same unit; NaN: none.
    bound: float
    #: When it was refused [ns]; 0: nothing was refused yet.
    at_ns: int
    _kinds_ = {"reason": RejectReason, "field": RejectField}
    _fields_ = [
        ("reason", ctypes.c_uint32),
        ("field", ctypes.c_uint32),
        ("index", ctypes.c_int32),
        ("reserved", ctypes.c_uint32),
        ("value", ctypes.c_double),
        ("bound", ctypes.c_double),
        ("at_ns", ctypes.c_uint64),
    ]


_check(Refused, 40)


class WayHome(Record):
    """The straight way home from the measured joints, or the rest of it while the arm moves along it."""

    #: Distance from home of the joint that turns farthest [rad]; negative: unknown.
    farthest_rad: float
    #: Duration of the way, or of the rest of it, without obstacles [s]; negative: unknown.
    left_s: float
    #: In mode Mode.Homing, the fraction of the way done; negative: in another mode.
    share: float
    #: The joint that turns farthest, from 0, base first.
    joint: int
    #: In mode Mode.Homing: 1 once the way was found clear, and the motion has begun.
    moving: int
    _fields_ = [
        ("farthest_rad", ctypes.c_double),
        ("left_s", ctypes.c_double),
        ("share", ctypes.c_double),
        ("joint", ctypes.c_uint32),
        ("moving", ctypes.c_uint32),
    ]


_check(WayHome, 32)


class NoteWords(Record):
    """What happened, and what to do about it: UTF-8, padded with NUL."""

    #: What happened; all NUL: none.
    text: builtins.bytes
    #: What to do about it.
    to_do: builtins.bytes
    _fields_ = [
        ("text", ctypes.c_char * 192),
        ("to_do", ctypes.c_char * 192),
    ]


_check(NoteWords, 384)


class ExternalState(Record):
    """The predictor of another process. Counts are since the daemon started, saturated."""

    #: Its part in the preview in force, 0 to 1; the rest is the fallback's. Negative: it is not chosen.
    weight: float
    #: Evidence that it is better than the fallback, -10 to 10: used from 5 on, until it falls below 0.
    evidence: float
    #: Mean of weight over the steps that closed while it was chosen; negative: none did.
    share: float
    #: Grid steps that closed while it was chosen.
    steps: int
    #: Those of them that had a preview of their own before the next one closed.
    hits: int
    #: Previews that were taken over.
    taken: int
    #: Previews that a newer one of the same tick replaced, or that found no room.
    lost: int
    #: Grid steps that could not be sent.
    unsent: int
    #: Previews refused by reason, in the order of PreviewRefusal from Malformed on.
    refused: ctypes.Array[ctypes.c_uint32]
    #: From a grid step sent to its preview received, over the last two seconds; 0: nothing came.
    latency: Percentiles
    _fields_ = [
        ("weight", ctypes.c_float),
        ("evidence", ctypes.c_float),
        ("share", ctypes.c_float),
        ("steps", ctypes.c_uint32),
        ("hits", ctypes.c_uint32),
        ("taken", ctypes.c_uint32),
        ("lost", ctypes.c_uint32),
        ("unsent", ctypes.c_uint32),
        ("refused", ctypes.c_uint32 * 8),
        ("latency", Percentiles),
    ]


_check(ExternalState, 80)


class Status(Record):
    """State of the daemon. Distributions are over all ticks since start, after warm-up."""

    #: Stamp: when it was sent.
    header: Header
    #: Identifies this start of the daemon.
    daemon_id: int
    #: Process number.
    pid: int
    #: Mode.
    mode: int
    #: FaultReason.
    fault: int
    #: missing_rights.
    missing_rights: int
    #: Ticks per second, configured [Hz].
    rate_hz: float
    #: Ticks per second over the last second, measured [Hz].
    measured_rate_hz: float
    #: Newest tick.
    tick: int
    #: Since the daemon started [ns].
    uptime_ns: int
    #: Number of changes of live settings.
    settings_revision: int
    #: Hash of the settings.
    settings_hash: int
    #: Distribution of each Stage.
    stages: ctypes.Array[Percentiles]
    #: Totals.
    counters: Counters
    #: Trust α.
    trust: float
    #: Target of α.
    trust_target: float
    #: TrustReason.
    trust_reason: int
    #: The active predictor; none before the first tick.
    predictor: PredictorName
    #: Age of the newest pen sample [ns]; u64.MAX: none.
    pen_age_ns: int
    #: Age of the newest joint state [ns]; u64.MAX: none.
    joint_state_age_ns: int
    #: Parts of the latency, each the median over about the last second.
    chain: Chain
    #: From the device stamp of a pen sample to the first command handed over after it was received.
    pen_to_command: Latency
    #: From a command handed over to its motion: to its stamp, plus the arm's measured lag.
    command_to_motion: Latency
    #: Version of the weights in use.
    learner_version: int
    #: Grid steps learnt from.
    learner_updates: int
    #: Sets of weights handed to the loop.
    learner_promotions: int
    #: Sets of weights rolled back.
    learner_rollbacks: int
    #: Sets of weights not handed over: non-finite or worse.
    learner_refused: int
    #: Age of the weights in use [ns].
    learner_age_ns: int
    #: Root mean square of the one-step prediction error, recent [m]; negative: none.
    predictor_rms_m: float
    #: Radius about the plan's first reference in which the pen is expected in nine of ten cases [m]; negative: unknown.
    predictor_band_m: float
    #: The arm's lag, and the plan's dead time.
    arm_lag: ArmLag
    #: Score of the measured arm.
    tracking: Tracking
    #: Score of the arm as it would be at Hold (trust 0), at the same instants.
    ghost: Tracking
    #: How long the pen wrote while both were compared [s].
    compared_s: float
    #: GhostState.
    ghost_state: int
    #: Median cost of the ghost per tick, on a thread that no tick waits for [ns].
    ghost_cost_ns: int
    #: Heap allocations per tick after warm-up, ticks with a connection change left out.
    allocations_per_tick: float
    #: Evidence behind the newest latched stop.
    stop: StopDetail
    #: Extremes of the measured tool.
    extent: ToolExtent
    #: Fraction of the commanded speed at which the arm moves; negative: unknown.
    arm_speed_share: float
    #: The newest pen sample that was refused.
    pen_refused: Refused
    #: The newest joint state that was refused.
    joints_refused: Refused
    #: The newest dead-man message that was refused.
    enable_refused: Refused
    #: The newest echo of a command that was rejected.
    echo_refused: Refused
    #: The way home.
    way_home: WayHome
    #: The line to the arm's controller.
    arm_line: ArmLine
    #: Measured joints [rad]; zero while there is no joint state.
    joints_q: ctypes.Array[ctypes.c_double]
    #: The measured tool in the base frame: position [m], then rotation vector [rad], as a pendant shows it.
    tool_base: ctypes.Array[ctypes.c_double]
    #: The measured tool in the plane's frame [m]: along the paper, across it, above it.
    tool_plane_m: ctypes.Array[ctypes.c_double]
    #: When the note of the arm's process came into force [ns]; 0: there is none.
    note_since_ns: int
    #: That note.
    note: NoteWords
    #: The predictor of another process.
    external: ExternalState
    _kinds_ = {"mode": Mode, "fault": FaultReason, "missing_rights": MissingRights, "trust_reason": TrustReason, "ghost_state": GhostState}
    _fields_ = [
        ("header", Header),
        ("daemon_id", ctypes.c_uint64),
        ("pid", ctypes.c_uint32),
        ("mode", ctypes.c_uint32),
        ("fault", ctypes.c_uint32),
        ("missing_rights", ctypes.c_uint32),
        ("rate_hz", ctypes.c_double),
        ("measured_rate_hz", ctypes.c_double),
        ("tick", ctypes.c_uint64),
        ("uptime_ns", ctypes.c_uint64),
        ("settings_revision", ctypes.c_uint64),
        ("settings_hash", ctypes.c_uint64),
        ("stages", Percentiles * 10),
        ("counters", Counters),
        ("trust", ctypes.c_double),
        ("trust_target", ctypes.c_double),
        ("trust_reason", ctypes.c_uint32),
        ("predictor", PredictorName),
        ("pen_age_ns", ctypes.c_uint64),
        ("joint_state_age_ns", ctypes.c_uint64),
        ("chain", Chain),
        ("pen_to_command", Latency),
        ("command_to_motion", Latency),
        ("learner_version", ctypes.c_uint64),
        ("learner_updates", ctypes.c_uint64),
        ("learner_promotions", ctypes.c_uint64),
        ("learner_rollbacks", ctypes.c_uint64),
        ("learner_refused", ctypes.c_uint64),
        ("learner_age_ns", ctypes.c_uint64),
        ("predictor_rms_m", ctypes.c_double),
        ("predictor_band_m", ctypes.c_double),
        ("arm_lag", ArmLag),
        ("tracking", Tracking),
        ("ghost", Tracking),
        ("compared_s", ctypes.c_double),
        ("ghost_state", ctypes.c_uint32),
        ("ghost_cost_ns", ctypes.c_uint32),
        ("allocations_per_tick", ctypes.c_double),
        ("stop", StopDetail),
        ("extent", ToolExtent),
        ("arm_speed_share", ctypes.c_double),
        ("pen_refused", Refused),
        ("joints_refused", Refused),
        ("enable_refused", Refused),
        ("echo_refused", Refused),
        ("way_home", WayHome),
        ("arm_line", ArmLine),
        ("joints_q", ctypes.c_double * 6),
        ("tool_base", ctypes.c_double * 6),
        ("tool_plane_m", ctypes.c_double * 3),
        ("note_since_ns", ctypes.c_uint64),
        ("note", NoteWords),
        ("external", ExternalState),
    ]


_check(Status, 2048)


class ControlResponse(Record):
    """One answer."""

    #: The request's token.
    token: int
    #: The daemon's host_boot_id().
    boot_id: int
    #: The daemon's daemon_id, as in its status.
    daemon_id: int
    #: A number of the answer: trust α for most, the invalid value for refusals.
    value: float
    #: ControlStatus.
    status: int
    #: A number of the answer: the crate.Mode for Ok, joint or line for refusals.
    detail: int
    #: Bytes of message in use.
    message_len: int
    #: Zero.
    reserved: int
    #: Readable text, UTF-8.
    message: builtins.bytes
    _kinds_ = {"status": ControlStatus}
    _fields_ = [
        ("token", ctypes.c_uint64),
        ("boot_id", ctypes.c_uint64),
        ("daemon_id", ctypes.c_uint64),
        ("value", ctypes.c_double),
        ("status", ctypes.c_int32),
        ("detail", ctypes.c_uint32),
        ("message_len", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
        ("message", ctypes.c_char * 160),
    ]


_check(ControlResponse, 208)


class PenStep(Record):
    """A closed step of the pen's grid."""

    #: Stamp: when the tick that closed it ended.
    header: Header
    #: Its number on the grid, one more per step.
    index: int
    #: The instant at its end [ns].
    time_ns: int
    #: Length of a step [ns].
    step_ns: int
    #: Position at its end [m].
    x_m: float
    #: Position at its end [m].
    y_m: float
    #: Displacement since the step before [m]; 0 unless the motion continues.
    dx_m: float
    #: Displacement since the step before [m]; 0 unless the motion continues.
    dy_m: float
    #: Running scale [m per unit]: of normalised displacements the root mean square is 10 per axis.
    scale_m: float
    #: Longest displacement per step that is taken over [m]; longer ones are shortened to it, and four times as long ones refused.
    longest_m: float
    #: PenMotion.
    motion: int
    #: 1: the pen touches the paper.
    contact: int
    #: Positions that a preview should have: as many as the plan looks at, and more for a late one.
    wanted: int
    #: Zero.
    reserved: int
    _kinds_ = {"motion": PenMotion}
    _fields_ = [
        ("header", Header),
        ("index", ctypes.c_uint64),
        ("time_ns", ctypes.c_uint64),
        ("step_ns", ctypes.c_uint64),
        ("x_m", ctypes.c_double),
        ("y_m", ctypes.c_double),
        ("dx_m", ctypes.c_double),
        ("dy_m", ctypes.c_double),
        ("scale_m", ctypes.c_double),
        ("longest_m", ctypes.c_double),
        ("motion", ctypes.c_uint32),
        ("contact", ctypes.c_uint32),
        ("wanted", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]


_check(PenStep, 112)


class PenPreview(Record):
    """Where the pen will be after a grid step."""

    #: Stamp: when it was sent.
    header: Header
    #: Number of the step after which it predicts (PenStep.index).
    base_index: int
    #: Positions that count, at most PREVIEW_STEPS; see PenStep.wanted.
    count: int
    #: preview_flags.
    flags: int
    #: Position i + 1 steps after the base [m].
    x_m: ctypes.Array[ctypes.c_double]
    #: Position i + 1 steps after the base [m].
    y_m: ctypes.Array[ctypes.c_double]
    #: Radius about it in which the pen is expected in nine of ten cases [m]; see flags.
    radius_m: ctypes.Array[ctypes.c_double]
    _kinds_ = {"flags": PreviewFlags}
    _fields_ = [
        ("header", Header),
        ("base_index", ctypes.c_uint64),
        ("count", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("x_m", ctypes.c_double * 64),
        ("y_m", ctypes.c_double * 64),
        ("radius_m", ctypes.c_double * 64),
    ]


_check(PenPreview, 1576)


#: The layout of everything above, in one number.
LAYOUT_HASH = 0x6f32550d2a5bc394
