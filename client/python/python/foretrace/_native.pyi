"""What the package is built on, in Rust; use `foretrace`."""

from os import PathLike
from typing import Any, Sequence

from .messages import PenStep

class Problem(Exception): ...

class Refused(Problem):
    #: `messages.ControlStatus` of a request.
    status: int
    detail: int
    value: float

class NoDaemon(Problem): ...
class OtherVersion(Problem): ...
class Taken(Problem): ...
class Invalid(Problem): ...
class NoAnswer(Problem): ...

# A running daemon.

LAYOUT_HASH: int
VERSION: str

_Answer = tuple[int, int, float, str]
_Outcome = tuple[int, int, Exception | None]
_Target = tuple[str, bool, list[float] | None, list[float] | None, int, int, int, int]

def stop(number: int, root: str | None, timeout_s: float) -> tuple[int | None, float | None]: ...
def demand_at(command: bytes, now_ns: int) -> tuple[list[float], list[float]] | None: ...
def close_all() -> None: ...
def now_ns() -> int: ...

class Attachment:
    def __init__(self, number: int, root: str | None, wait_s: float) -> None: ...
    @property
    def number(self) -> int: ...
    @property
    def root(self) -> Any: ...
    def daemon_is_up(self) -> bool: ...
    def pen(self, name: str | None, take_over_s: float | None) -> PenHandle: ...
    def dead_man(self, name: str | None, take_over_s: float | None) -> DeadManHandle: ...
    def predictor(self) -> PredictorHandle: ...
    def status(self) -> StatusHandle: ...
    def watch(self, kind: str) -> WatchHandle: ...
    def history(self) -> HistoryHandle: ...
    def arm_interface(
        self, rate_hz: float, deceleration: list[float], pause_after_s: float, simulated: bool
    ) -> ArmHandle: ...
    def settings(self, timeout_s: float) -> tuple[int, str]: ...
    def arm_ports(self) -> ArmPortsHandle: ...
    def arm(self, timeout_s: float, decided_ns: int) -> _Answer: ...
    def move_home(self, timeout_s: float) -> _Answer: ...
    def disarm(self, timeout_s: float) -> _Answer: ...
    def query(self, timeout_s: float) -> _Answer: ...
    def set_trust(self, trust: float, timeout_s: float) -> _Answer: ...
    def freeze_trust(self, timeout_s: float) -> _Answer: ...
    def trust_auto(self, timeout_s: float) -> _Answer: ...
    def switch_predictor(self, name: str, timeout_s: float) -> _Answer: ...
    def reload(self, timeout_s: float) -> _Answer: ...
    def stop(self, timeout_s: float) -> tuple[int | None, float | None]: ...
    def close(self) -> bool: ...

class PenHandle:
    def send(self, samples: list[Any]) -> _Outcome: ...
    def handed_to(self) -> str | None: ...
    def close(self) -> None: ...

class GatewayHandle:
    def __init__(self, path: str) -> None: ...
    def send(self, samples: list[Any]) -> _Outcome: ...
    def close(self) -> str | None: ...

class DeadManHandle:
    def beat(self) -> None: ...
    def stop(self) -> None: ...
    def handed_to(self) -> str | None: ...
    def close(self) -> None: ...

class PredictorHandle:
    def next(self, timeout_s: float) -> bytes | None: ...
    def send(self, base_index: int, positions: list[list[float]], radii: list[float]) -> bool: ...
    @property
    def lost(self) -> int: ...
    def handed_to(self) -> str | None: ...
    def close(self) -> None: ...

class StatusHandle:
    def newer(self, after_ns: int, timeout_s: float) -> bytes: ...
    def close(self) -> None: ...

class WatchHandle:
    def drain(self, timeout_s: float) -> bytes: ...
    @property
    def lost(self) -> int: ...
    @property
    def refused(self) -> int: ...
    @property
    def record_size(self) -> int: ...
    def close(self) -> None: ...

class HistoryHandle:
    def at(self, t_ns: int) -> tuple[list[float], list[float], int]: ...
    def newest_ns(self) -> int | None: ...
    def close(self) -> None: ...

class ArmHandle:
    @property
    def rate_hz(self) -> float: ...
    def measured(
        self,
        stamp_ns: int | None,
        q: list[float],
        qd: list[float],
        effort: list[float] | None,
        effort_unit: int,
        safety_mode: int,
        robot_mode: int,
        robot_stamp_ns: int,
    ) -> bool: ...
    def target(self, wait: bool) -> _Target: ...
    def note(self, note: tuple[str, str] | None) -> None: ...
    def counts(self) -> dict[str, Any]: ...
    def close(self) -> None: ...

class ArmPortsHandle:
    def latest(self) -> tuple[bytes, bytes] | None: ...
    def publish(self, stamp_ns: int, state: bytes) -> bool: ...
    def close(self) -> None: ...

# Files.
def is_preset(name: str) -> bool: ...
def recording_info(path: str) -> dict[str, Any]: ...
def recording_rows(path: str, topic: str, every: int, most: int) -> dict[str, Any]: ...
def recording_pieces(path: str, most: int) -> list[tuple[str, int, int, bytes]]: ...
def recording_pen(path: str, most: int) -> bytes: ...
def recording_stops(path: str, most: int) -> list[dict[str, Any]]: ...
def recording_moments(path: str) -> dict[str, Any]: ...
def recording_tick(path: str, tick: int) -> list[str]: ...
def toml_table(text: str) -> dict[str, Any]: ...
def replay(path: str) -> dict[str, Any]: ...
def what_if(path: str, variants: Sequence[tuple[str, Sequence[tuple[str, str]] | None]]) -> dict[str, Any]: ...
def load_set(path: str, split: str, strict: bool, unit: str | None, height_m: float) -> LoadedSet: ...
def set_splits(folder: str) -> list[str]: ...
def pen_path(names: Sequence[str], wishes: dict[str, Any], settings: dict[str, Any]) -> dict[str, Any]: ...

class LoadedSet:
    name: str
    files: list[tuple[str, str | None, float, bool, str | None]]
    errors: list[str]
    remarks: list[str]
    def __len__(self) -> int: ...
    def about(self, index: int) -> dict[str, Any]: ...
    def samples(self, index: int) -> dict[str, Any]: ...

# The law.
class Command:
    """A command that may leave: finite, inside every limit, continuous with the last one."""

    stamp_ns: int
    """The instant for which `q` holds [ns]."""
    valid_until_ns: int
    """Follow q + qd·(t − stamp) until here [ns], then brake."""
    q: list[float]
    """Joint positions [rad], base first."""
    qd: list[float]
    """Mean joint velocities over the period that ends at the stamp [rad/s]."""
    enabled: bool
    """The arm may move with this command; false once a latched stop has come to rest."""

class Step:
    """Everything that one tick decided. Positions are in the writing plane's frame: x, y, height [m]."""

    command: Command | None
    """None only while the loop is not in charge of the arm (`idle`)."""
    begins: bool
    """The command is the first since arming: it begins where the arm stands."""
    mode: str
    """`idle`, `armed`, `following`, `holding`, `stopped`, `fault`, `moving home`."""
    rung: str
    """What made the command: `fresh plan`, `previous plan`, `stop`, `hold`."""
    stop_reason: str | None
    """Why it is stopped, if it is."""
    stop: dict[str, Any] | None
    """The evidence: reason, cause, joint, amount, limit, at_ns, text."""
    accepted: bool | None
    """Answer to the request; None: there was none."""
    refusal: str | None
    """Why the request was refused, and what to do."""
    way_clear: bool | None
    """Result of checking the way home; comes ticks after the request."""
    way_refusal: str | None
    home: dict[str, Any] | None
    """While the arm is moved home: moving, share (0 to 1), left_s [s]."""
    health: list[str]
    """What degraded in this tick."""
    arm_speed_share: float | None
    """Fraction of the requested speed at which the arm moves."""
    trust: float
    """α used, 0 to 1."""
    trust_target: float
    trust_reason: str
    predictor: str
    external: dict[str, Any] | None
    """While predictor `external` is chosen: weight (its part in the preview, 0 to 1), evidence (-10 to 10; used
    from 5 on, until it falls below 0), age (grid steps since the base of its newest preview, or None), verdict
    (of the preview of this tick: `taken`, or why not; None: there was none)."""
    pen_steps: list[PenStep]
    """Steps of the pen's grid that closed in this tick: what predictors observe."""
    preview_steps: int
    """Steps after the newest closed one that the plan looks at: a preview has at least as many."""
    weights_version: int
    governor: float
    """Share of the way to the preview that the arm is asked to go; below 1 it is saturated in vain."""
    pen_stamp_ns: int | None
    """Of the newest accepted sample [ns]."""
    pen_m: list[float]
    """Newest accepted position [m]."""
    pen_contact: bool
    pen_sequence: int
    pen_counters: dict[str, int]
    """Counts of samples so far, by what became of them."""
    pen_refused: str | None
    """The newest refused sample, with the evidence."""
    predictor_error_m: float | None
    """Error of the one-step prediction of the newest closed grid step [m]."""
    predictor_band_m: float | None
    """Radius in which the pen is expected in nine of ten cases [m]."""
    dead_time_ns: int
    lag: dict[str, float] | None
    """Measured lag of the arm: lag_s, std_s, shift_s [s]; None: not known yet."""
    reference_m: list[float]
    """First reference of the plan."""
    preview_m: list[tuple[float, float]]
    """The previewed path that the plan followed, from soon to late; empty: there was none."""
    setpoint: list[tuple[float, float, float]]
    """Per axis: position [m], velocity [m/s], acceleration [m/s²]."""
    tool_m: list[float]
    """Where the command puts the tool."""
    axes: list[dict[str, Any]]
    """How each axis was solved: path, iterations, kkt_residual, limits that shape the plan."""
    ik: dict[str, Any]
    """How the joints were solved: source, iterations, kkt_residual, held_joints, errors, damping."""
    guard_altered: list[str]
    """Why the guard changed the command."""
    grid_steps: int
    """Steps of the pen's grid that closed in this tick."""

class LawFollower:
    period_ns: int
    grid_ns: int
    horizon: int
    home: list[float]
    learns: bool
    settings_name: str
    remarks: list[str]
    predictors: list[str]
    limits: LimitsOf
    chain: ChainOf
    def __init__(self, settings: dict[str, Any], learn: bool) -> None: ...
    def step(self, now_ns: int, input: dict[str, Any]) -> Step: ...
    def plane_from_pen(self, x_m: float, y_m: float) -> list[float]: ...
    def base_from_plane(self, point: Sequence[float]) -> list[float]: ...
    def plane_from_base(self, point: Sequence[float]) -> list[float]: ...

class LimitsOf:
    position: list[tuple[float, float]]
    velocity: list[float]
    acceleration: list[float]
    jerk: list[float] | None
    hold_s: float
    braking: list[float]
    def __init__(
        self,
        position: Sequence[tuple[float, float]],
        velocity: Sequence[float],
        acceleration: Sequence[float],
        jerk: Sequence[float] | None,
        hold_s: float,
        braking: Sequence[float] | None,
    ) -> None: ...
    @staticmethod
    def of_settings(settings: dict[str, Any]) -> LimitsOf: ...

class Verdict:
    """What the guard let pass."""

    stamp_ns: int
    q: list[float]
    """Joint positions [rad], base first."""
    qd: list[float]
    """Mean joint velocities of the step [rad/s]."""
    qdd: list[float]
    """Joint accelerations of the step [rad/s²]."""
    altered: list[int]
    """Joints whose position differs from the proposal, base first, from 0."""
    reasons: list[str]
    """`not finite`, `position`, `velocity`, `acceleration`, `jerk`, `stamp`, `gap`."""

class LawGuard:
    limits: LimitsOf
    at_rest: bool
    viable: bool
    def __init__(self, limits: LimitsOf) -> None: ...
    def begin(self, q: Sequence[float], t_ns: int, qd: Sequence[float], qdd: Sequence[float]) -> None: ...
    def clamp(self, q: Sequence[float], t_ns: int) -> Verdict: ...
    def stop(self, t_ns: int) -> Verdict: ...
    def after_silence(self, now_ns: int) -> Verdict: ...

class Pose:
    """Where the tool is, in the frame of the base link."""

    position: list[float]
    """Tool origin [m]."""
    rotation: list[list[float]]
    """Tool frame to base frame, by rows."""
    rotation_vector: list[float]
    """[rad], as a pendant shows it."""
    jacobian: list[list[float]]
    """6 rows of one number per joint: tool origin [m/rad], rotation [rad/rad]."""

class ChainOf:
    joints: int
    base: str
    tip: str
    limits: dict[str, Any]
    def __init__(
        self,
        text: str | None,
        path: str | PathLike[str] | None,
        base: str | None,
        tip: str | None,
        tool_m: Sequence[float],
    ) -> None: ...
    @staticmethod
    def of_settings(settings: dict[str, Any]) -> ChainOf: ...
    def forward(self, q: Sequence[float]) -> Pose: ...
    def tool_motion(self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float]) -> list[list[float]]: ...
    def inverse(
        self, position: Sequence[float], axis: Sequence[float], spin: Sequence[float] | None, near: Sequence[float]
    ) -> list[float] | None: ...
