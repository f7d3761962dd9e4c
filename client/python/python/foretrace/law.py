"""The law without a daemon: `Follower` tick by tick, `Guard` alone, `Chain` for kinematics.

The results are those of the Rust calls, bit for bit. Nothing here has a clock: time is an argument, in
nanoseconds of the host's monotonic clock or of a virtual one.
"""

from __future__ import annotations

import os
from collections.abc import Sequence as AbstractSequence
from dataclasses import dataclass
from typing import Any, Iterable, Mapping, NamedTuple, Sequence, Union

from . import _native
from ._given import told, whole
from ._native import Command, Invalid, Pose, Step, Verdict
from ._settings import Settings, named
from .messages import PenStep

__all__ = ["Chain", "ChainLimits", "Command", "Follower", "Guard", "Joints", "Limits", "Pen", "Pose", "Step", "Verdict"]


class Pen(NamedTuple):
    """A reading of the pen, in the pen's own plane."""

    stamp_ns: int
    x_m: float
    y_m: float
    contact: bool
    sequence: int = 0
    """Its number in its sender's sequence, from 1; 0: unknown."""


@dataclass(frozen=True)
class Joints:
    """A measured state of the arm, base first."""

    stamp_ns: int
    q: Sequence[float]
    """[rad]"""
    qd: Sequence[float]
    """[rad/s]"""
    motion_allowed: bool = True
    """The arm's own safety system allows motion."""
    effort: Sequence[float] | None = None
    effort_unit: str = "Nm"
    """`Nm`, `A` or `share` (of the joint's effort limit)."""


def _numbers(name: str, values: Any) -> list[float]:
    if hasattr(values, "tolist"):
        values = values.tolist()
    try:
        return [float(value) for value in values]
    except (TypeError, ValueError, OverflowError):
        raise Invalid(f"{name} is {told(values)}; legal: a list of numbers, one per joint") from None


def _stamp(name: str, value: Any, unit: str = " ns") -> int:
    kind = "whole nanoseconds, as time.monotonic_ns() gives" if unit else "whole numbers"
    return whole(name, value, kind, f"0 to 2^64 - 1{unit}")


def _preview(preview: Any) -> tuple[Any, ...] | None:
    if preview is None:
        return None
    try:
        step, positions, *rest = preview
        if len(rest) > 1:
            raise ValueError
        points = [[float(x), float(y)] for x, y in positions]
        radii = [] if not rest or rest[0] is None else [float(radius) for radius in rest[0]]
    except (TypeError, ValueError, OverflowError):
        legal = "a step or its index, positions as pairs [m], and perhaps as many radii [m]"
        raise Invalid(f"preview is {told(preview)}; legal: {legal}") from None
    return _stamp("preview's step", step.index if isinstance(step, PenStep) else step, ""), points, radii


def _reading(reading: Any) -> tuple[Any, ...]:
    try:
        stamp, x, y, contact, *rest = reading
        sequence = rest[0] if rest else 0
        return _stamp("pen stamp", stamp), float(x), float(y), bool(contact), _stamp("sequence", sequence, "")
    except (TypeError, ValueError, OverflowError):
        raise Invalid(f"a pen reading is {told(reading)}; legal: stamp [ns], x [m], y [m], contact") from None


class Follower:
    """The control law of one arm, as the daemon runs it in every tick.

    `settings`: a preset (`ur5`), the path of a TOML file, or a dict (`{"preset": "ur5", "predictor.kind":
    "dybm"}`); `changes` go over them. With `learn` the learner of the settings runs in step: what it
    promotes in a tick the next tick uses. A step needs 256 KiB of stack, which threads have unless
    `threading.stack_size` says otherwise; one follower belongs to one thread at a time.

    Raises `Invalid` with all that is wrong with the settings.
    """

    def __init__(self, settings: Settings = "ur5", changes: Mapping[str, Any] | None = None, *, learn: bool = True):
        self._law = _native.LawFollower(named(settings, changes), learn)
        self.period_ns: int = self._law.period_ns
        """Length of a tick [ns]."""
        self.grid_ns: int = self._law.grid_ns
        """Step of the pen's grid [ns]."""
        self.horizon: int = self._law.horizon
        """Steps of the plan."""
        self.home: tuple[float, ...] = tuple(self._law.home)
        """Posture near the middle of the writing plane [rad]."""
        self.learns: bool = self._law.learns
        self.settings_name: str = self._law.settings_name
        self.remarks: list[str] = self._law.remarks
        """On legal settings: what they lack, or what will refuse them later."""
        self.predictors: list[str] = self._law.predictors
        self.limits = Limits._of(self._law.limits)
        """Limits that every command obeys."""
        self.chain = Chain._of(self._law.chain)
        """The arm, to the tip of its tool."""

    def step(
        self,
        now_ns: int,
        pen: Iterable[Any] = (),
        joints: Joints | None = None,
        request: Any = None,
        *,
        enable: tuple[int, bool] | None = None,
        halt: bool = False,
        unsent: bool = False,
        max_iterations: int = 100,
        shed: bool = False,
        preview: tuple[Any, ...] | None = None,
    ) -> Step:
        """One tick at `now_ns`, its nominal release [ns].

        `pen`: samples since the last tick, oldest first: `Pen`, tuples, or rows of an array (stamp [ns], x, y
        [m], contact). `joints`: the newest joint state, if one arrived. `request`: `"arm"`, `"disarm"`,
        `"stop"`, `"move home"`, `("trust", VALUE | "auto" | "freeze")`, `("predictor", NAME)`. `enable`: the
        newest dead-man message: its stamp [ns], and whether the operator let go. `halt`: stop now, without a
        request. `unsent`: the command of the last tick was not sent. `max_iterations`, `shed`: what the tick
        may spend on each solver. `preview`: of a predictor of your own, while predictor `external` is chosen:
        the step of `Step.pen_steps` after which it predicts (or its index), positions (x, y) [m] at the ends
        of the `wanted` to 64 steps after it, and if it knows them as many radii [m] in which the pen is
        expected in nine of ten cases. What became of it is in `Step.external`.

        Never fails on what the world does: bad samples are refused and counted in the result. Raises
        `Invalid` where an argument is none (lengths, words).
        """
        if hasattr(pen, "tolist"):
            pen = pen.tolist()
        state = None
        if joints is not None:
            state = {
                "stamp_ns": _stamp("joints.stamp_ns", joints.stamp_ns),
                "q": _numbers("joints.q", joints.q),
                "qd": _numbers("joints.qd", joints.qd),
                "motion_allowed": bool(joints.motion_allowed),
                "effort": None if joints.effort is None else _numbers("joints.effort", joints.effort),
                "effort_unit": joints.effort_unit,
            }
        if not 0 <= max_iterations < 1 << 32:
            raise Invalid(f"max_iterations is {max_iterations}; legal: 0 to 2^32 - 1")
        return self._law.step(
            _stamp("now_ns", now_ns),
            {
                "pen": [_reading(reading) for reading in pen],
                "joints": state,
                "request": _request(request),
                "enable": None if enable is None else (_stamp("enable", enable[0]), bool(enable[1])),
                "halt": bool(halt),
                "unsent": bool(unsent),
                "max_iterations": max_iterations,
                "shed": bool(shed),
                "preview": _preview(preview),
            },
        )

    def plane_from_pen(self, x_m: float, y_m: float) -> tuple[float, float]:
        """A point of the pen device [m] in the writing plane's frame [m]."""
        x, y = self._law.plane_from_pen(x_m, y_m)
        return x, y

    def base_from_plane(self, point_m: Sequence[float]) -> tuple[float, float, float]:
        """A point of the plane's frame (x, y, height) in the base link's frame [m]."""
        return _triple("point_m", self._law.base_from_plane(_triple("point_m", point_m)))

    def plane_from_base(self, point_m: Sequence[float]) -> tuple[float, float, float]:
        """A point of the base link's frame in the plane's (x, y, height) [m]."""
        return _triple("point_m", self._law.plane_from_base(_triple("point_m", point_m)))


def _request(request: Any) -> Any:
    if request is None or isinstance(request, str):
        return request
    legal = 'legal: "arm", "disarm", "stop", "move home", ("trust", 0 to 1, "auto" or "freeze"), ("predictor", NAME)'
    if isinstance(request, AbstractSequence) and len(request) == 2 and isinstance(request[0], str):
        word, value = request
        if isinstance(value, str):
            return word, value
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return word, float(value)
    raise Invalid(f"request is {told(request)}; {legal}")


def _triple(name: str, values: Sequence[float]) -> tuple[float, float, float]:
    found = _numbers(name, values)
    if len(found) != 3:
        raise Invalid(f"{name} has {len(found)} numbers; legal: 3")
    return found[0], found[1], found[2]


class Limits:
    """Joint limits, base first, for arms of 1 to 8 joints.

    `position`: (lowest, highest) per joint [rad], infinite for a continuous joint; `velocity` [rad/s];
    `acceleration` [rad/s²]; `jerk` [rad/s³] or None. `hold_s`, `braking`: what the arm does without
    commands: extrapolates for `hold_s` [s], then brakes [rad/s²] (default: at once, with its acceleration).
    Raises `Invalid`: which joint, which limit, what is legal.
    """

    def __init__(
        self,
        position: Sequence[Sequence[float]],
        velocity: Sequence[float],
        acceleration: Sequence[float],
        jerk: Sequence[float] | None = None,
        *,
        hold_s: float = 0.0,
        braking: Sequence[float] | None = None,
    ):
        try:
            pairs = [(float(low), float(high)) for low, high in position]
        except (TypeError, ValueError, OverflowError):
            raise Invalid("position is no list of pairs; legal: (lowest, highest) per joint [rad]") from None
        self._take(
            _native.LimitsOf(
                pairs, _numbers("velocity", velocity), _numbers("acceleration", acceleration),
                None if jerk is None else _numbers("jerk", jerk), float(hold_s),
                None if braking is None else _numbers("braking", braking),
            )
        )

    def _take(self, native: Any) -> None:
        self._native = native
        self.position: tuple[tuple[float, float], ...] = tuple(native.position)
        self.velocity: tuple[float, ...] = tuple(native.velocity)
        self.acceleration: tuple[float, ...] = tuple(native.acceleration)
        self.jerk: tuple[float, ...] | None = None if native.jerk is None else tuple(native.jerk)
        self.hold_s: float = native.hold_s
        self.braking: tuple[float, ...] = tuple(native.braking)

    @classmethod
    def _of(cls, native: Any) -> "Limits":
        limits = cls.__new__(cls)
        limits._take(native)
        return limits

    @classmethod
    def of(cls, settings: Settings, changes: Mapping[str, Any] | None = None) -> "Limits":
        """Those of settings: of the arm's description and of the settings together."""
        return cls._of(_native.LimitsOf.of_settings(named(settings, changes)))

    def __repr__(self) -> str:
        return f"Limits({self.position}, {self.velocity}, {self.acceleration}, jerk={self.jerk})"


class Guard:
    """The last stage before a command leaves: whatever is proposed, what comes out is legal.

    The answer is finite, continuous with the last one, inside position, velocity and acceleration limits, and
    leads to a state that stops inside them. It is no planner, and knows no collisions. Send nothing but its
    answers; after lost time call `after_silence` first; stop with `stop`.
    """

    def __init__(self, limits: Union[Limits, Settings]):
        self.limits = limits if isinstance(limits, Limits) else Limits.of(limits)
        self._guard = _native.LawGuard(self.limits._native)

    def begin(self, q: Sequence[float], t_ns: int, qd: Sequence[float] = (), qdd: Sequence[float] = ()) -> None:
        """The arm stands at `q` [rad] at `t_ns`, or moves with `qd` [rad/s] and `qdd` [rad/s²]."""
        numbers = _numbers("q", q), _stamp("t_ns", t_ns), _numbers("qd", qd), _numbers("qdd", qdd)
        self._guard.begin(*numbers)

    def clamp(self, q: Sequence[float], t_ns: int) -> Verdict:
        """The legal command for `t_ns` nearest to `q` [rad], joint by joint; any numbers may be proposed.

        The next call goes on from it. Raises `Invalid` before `begin`, or for a wrong number of joints.
        """
        return self._guard.clamp(_numbers("q", q), _stamp("t_ns", t_ns))

    def stop(self, t_ns: int) -> Verdict:
        """The command for `t_ns` of a stop as early as the limits allow; repeat until `at_rest`."""
        return self._guard.stop(_stamp("t_ns", t_ns))

    def after_silence(self, now_ns: int) -> Verdict:
        """Goes on from where an arm without commands is at `now_ns`: it extrapolated, then braked.

        Raises `Invalid` for an instant before the last command's: the guard does not go back in time.
        """
        return self._guard.after_silence(_stamp("now_ns", now_ns))

    @property
    def at_rest(self) -> bool:
        """Nothing moves, nothing accelerates."""
        return self._guard.at_rest

    @property
    def viable(self) -> bool:
        """Every joint is inside its limits and can stop there."""
        return self._guard.viable


@dataclass(frozen=True)
class ChainLimits:
    """What the description says of the joints, base first."""

    names: list[str]
    position: list[tuple[float, float]]
    """[rad], infinite for a continuous joint."""
    velocity: list[float]
    """[rad/s]"""
    effort: list[float]
    """[Nm]"""
    friction: list[tuple[float, float]]
    """Coulomb [Nm] and viscous [Nm s/rad]; 0 where none is stated."""


class Chain:
    """The kinematic chain of an arm of 1 to 8 revolute joints, from a URDF.

    `urdf`: the text, or the path of a file. `base`, `tip`: links (default: the only root, the only leaf).
    `tool_m`: moves the tip, in the tip link's frame [m]. Positions and axes are in the frame of the base
    link; metres and radians. Raises `Problem` that names the joint or link at fault.
    """

    def __init__(
        self,
        urdf: Union[str, "os.PathLike[str]"],
        *,
        base: str | None = None,
        tip: str | None = None,
        tool_m: Sequence[float] = (0.0, 0.0, 0.0),
    ):
        is_text = isinstance(urdf, str) and "<" in urdf
        text = str(urdf) if is_text else None
        path = None if is_text else os.fspath(urdf)
        self._take(_native.ChainOf(text, path, base, tip, _triple("tool_m", tool_m)))

    def _take(self, native: Any) -> None:
        self._chain = native
        self.joints: int = native.joints
        self.base: str = native.base
        self.tip: str = native.tip
        self.limits = ChainLimits(**native.limits)

    @classmethod
    def _of(cls, native: Any) -> "Chain":
        chain = cls.__new__(cls)
        chain._take(native)
        return chain

    @classmethod
    def of(cls, settings: Settings, changes: Mapping[str, Any] | None = None) -> "Chain":
        """That of settings, to the tip of their tool."""
        return cls._of(_native.ChainOf.of_settings(named(settings, changes)))

    def forward(self, q: Sequence[float]) -> Pose:
        """Pose and Jacobian of the tool at joint positions `q` [rad]."""
        pose: Pose = self._chain.forward(_numbers("q", q))
        return pose

    def jacobian(self, q: Sequence[float]) -> list[list[float]]:
        """6 rows of one number per joint: tool origin [m/rad], rotation [rad/rad], in the base frame."""
        return self.forward(q).jacobian

    def tool_motion(self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float]) -> tuple[tuple[float, ...], ...]:
        """Position [m], velocity [m/s] and acceleration [m/s²] of the tool's origin in the base frame."""
        found = self._chain.tool_motion(_numbers("q", q), _numbers("qd", qd), _numbers("qdd", qdd))
        return tuple(tuple(row) for row in found)

    def inverse(
        self,
        position: Sequence[float],
        near: Sequence[float],
        *,
        rotation: Sequence[Sequence[float]] | None = None,
        axis: Sequence[float] | None = None,
        spin: Sequence[float] | None = None,
    ) -> list[float] | None:
        """Joint positions [rad] inside the description's limits with the tool at `position` [m].

        Either `rotation` (tool frame to base frame, 3 rows of 3), or `axis` (where the tool's z points, a
        unit vector) with any rotation about it, or with `spin` (where its x points). `near` [rad] selects the
        branch. None: not within 1 nm and 10 nrad: out of reach, behind a limit, or too far from `near`.
        """
        if rotation is not None and axis is None:
            rows = [_triple("rotation", row) for row in rotation]
            if len(rows) != 3 or spin is not None:
                raise Invalid("rotation has to be 3 rows of 3 numbers, without spin")
            axis, spin = [row[2] for row in rows], [row[0] for row in rows]
        elif axis is None or rotation is not None:
            raise Invalid("give either rotation or axis")
        spun = None if spin is None else _triple("spin", spin)
        where, along = _triple("position", position), _triple("axis", axis)
        found: list[float] | None = self._chain.inverse(where, along, spun, _numbers("near", near))
        return found

    def __repr__(self) -> str:
        return f"<Chain of {self.joints} joints from {self.base} to {self.tip}>"
