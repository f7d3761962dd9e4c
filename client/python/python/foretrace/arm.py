"""An arm whose program is in Python."""

from __future__ import annotations

from typing import Any, Iterator, NamedTuple, Sequence

from . import _native, messages
from ._given import told
from ._native import Invalid, Problem
from .handles import Closable, _bits, _each, _stamp

#: Joints of an arm.
JOINTS = 6


class Target(NamedTuple):
    """What the arm is to do at an instant."""

    #: "follow" a command; "brake", because commands ended; "stand"; "paused", because targets were not read.
    state: str
    #: Send `q` to the arm. False: the arm must stand, by its own stop.
    move: bool
    #: Joint positions [rad]; none before the first command.
    q: list[float] | None
    #: Joint velocities [rad/s].
    qd: list[float] | None
    #: The instant [ns], of `time.monotonic_ns()`.
    at_ns: int
    #: Number of the daemon's tick behind it; 0: none.
    tick: int
    #: The daemon's `messages.Mode`.
    mode: int
    #: `messages.CommandFlags` of the command.
    flags: int


def decelerations(given: float | Sequence[float]) -> list[float]:
    """One for all joints, or one per joint [rad/s²]."""
    return _joints("deceleration", _each(given, JOINTS), "rad/s²")


def _joints(name: str, values: Sequence[float], unit: str) -> list[float]:
    try:
        joints = [float(value) for value in values]
    except (TypeError, ValueError, OverflowError):
        raise Invalid(f"{name} is {told(values)}; legal: {JOINTS} numbers, one per joint [{unit}]") from None
    if len(joints) != JOINTS:
        raise Invalid(f"{name} has {len(joints)} values: {JOINTS}, one per joint [{unit}]")
    return joints


class ArmInterface(Closable):
    """Between the daemon and an arm that Python drives; made by `Foretrace.arm_interface`.

    A thread of the package takes commands, interpolates, brakes when they end, and sends each measurement with its
    stamp and the echo of the command that was read, without the interpreter. `for target in arm:` gives the target of
    each cycle. Where Python falls silent no state is sent, and the daemon stops the arm. Where Python reads no target
    for `pause_after` while the arm moves, targets say "stand" until somebody arms again: the arm does not jump to where
    it would have been.
    """

    def __init__(self, native: _native.ArmHandle) -> None:
        self._native = native
        self._closed = False

    @property
    def rate_hz(self) -> float:
        """Cycles per second."""
        return self._native.rate_hz

    def measured(
        self,
        q: Sequence[float],
        qd: Sequence[float],
        effort: Sequence[float] | None = None,
        stamp: int | None = None,
        *,
        effort_unit: int = messages.EffortUnit.NONE,
        safety_mode: int = messages.SafetyMode.UNKNOWN,
        robot_mode: int = messages.RobotMode.NO_CONTROLLER,
        robot_stamp: int = 0,
    ) -> bool:
        """Reports where the arm is: positions [rad], velocities [rad/s], efforts in `effort_unit`, at `stamp` [ns] of
        `time.monotonic_ns()`; none: now. `robot_stamp`: the controller's own clock [ns].

        A controller that knows its modes must report them: 0 counts as "may move". Returns false, and sends nothing, if
        the stamp is that of the measurement before: that is no new one.

        Raises `Invalid` for what the daemon would refuse: not finite, degrees, millimetres, a stamp of another clock.
        """
        if effort is not None and not effort_unit:
            raise Invalid("effort is given without effort_unit: messages.EffortUnit.NEWTON_METRES, AMPERES or SHARE")
        return self._native.measured(
            None if stamp is None else _stamp("stamp", stamp),
            _joints("q", q, "rad"),
            _joints("qd", qd, "rad/s"),
            None if effort is None else _joints("effort", effort, "effort_unit"),
            _bits("effort_unit", effort_unit),
            _bits("safety_mode", safety_mode),
            _bits("robot_mode", robot_mode),
            _stamp("robot_stamp", robot_stamp),
        )

    def target(self) -> Target:
        """The newest target; reading it counts as obeying it."""
        return Target(*self._native.target(False))

    def next_target(self) -> Target:
        """Waits for the target of the next cycle; at once where Python is behind."""
        return Target(*self._native.target(True))

    def __iter__(self) -> Iterator[Target]:
        while not self._closed:
            try:
                target = self.next_target()
            except Problem:
                # Another thread closed it: the end of this loop, not an error.
                if self._closed:
                    return
                raise
            yield target

    def say(self, text: str, to_do: str = "") -> None:
        """From now on `text` is why the arm does not follow, and `to_do` what an operator can do about it; both stand in
        `foretrace status`, and are cut after 192 bytes."""
        self._native.note((text, to_do))

    def say_nothing(self) -> None:
        """Nothing keeps the arm from following any more."""
        self._native.note(None)

    def counts(self) -> dict[str, Any]:
        """Totals: cycles, states, commands, pauses; and under `trouble` why the newest state was not sent."""
        return self._native.counts()

    def close(self) -> None:
        """Ends the interface: the daemon hears no states any more, and stops the arm. The arm itself is stopped by its
        own program or controller."""
        self._closed = True
        self._native.close()


class ArmPorts(Closable):
    """The messages of an arm as they are, for a loop that is written in Python; made by `Foretrace.arm_ports`.

    Prefer `ArmInterface`: here braking, pauses and stamps are the caller's.
    """

    def __init__(self, native: _native.ArmPortsHandle) -> None:
        self._native = native

    def latest(self) -> tuple[messages.JointCommand, messages.JointState] | None:
        """The newest command, and a joint state that echoes it, to be filled in; none before the first."""
        newest = self._native.latest()
        if newest is None:
            return None
        command, echo = newest
        return messages.JointCommand.from_buffer_copy(command), messages.JointState.from_buffer_copy(echo)

    def publish(self, state: messages.JointState, stamp: int) -> bool:
        """Sends a state that was measured at `stamp` [ns]. Returns whether a daemon heard it. Raises `Invalid`."""
        return self._native.publish(_stamp("stamp", stamp), bytes(state))

    def close(self) -> None:
        """Leaves the arm's place to others."""
        self._native.close()


def demand_at(command: messages.JointCommand, now_ns: int) -> tuple[list[float], list[float]] | None:
    """Positions [rad] and velocities [rad/s] of a command at an instant [ns]; none: brake."""
    return _native.demand_at(bytes(command), _stamp("now_ns", now_ns))
