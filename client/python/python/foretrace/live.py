"""A running daemon: attach, ask, watch."""

from __future__ import annotations

import atexit
import os
import sys
import threading
import time
import warnings
from types import TracebackType
from typing import Any, Callable, NamedTuple, Sequence, TypeVar

from . import _native, messages
from ._given import told, whole
from ._native import Invalid, NoAnswer, Problem, Taken
from .arm import ArmInterface, ArmPorts, decelerations
from .clocks import mapping
from .handles import FRESH_NS, Closable, DeadMan, Pen, Records, StatusWatch, _seconds, _stamp
from .pace import Pace
from .predictor import PredictorInterface

if messages.LAYOUT_HASH != _native.LAYOUT_HASH:
    raise ImportError(
        f"foretrace/messages.py has layout {messages.LAYOUT_HASH:016x}, the library beside it (foretrace "
        f"{_native.VERSION}) {_native.LAYOUT_HASH:016x}: install the package again"
    )

# Before the interpreter ends: stops what was set in motion, and ends the threads of the package.
atexit.register(_native.close_all)

_Handle = TypeVar("_Handle", bound=Closable)


class Answer(NamedTuple):
    """What the daemon answered."""

    #: The mode after it.
    mode: int
    #: The trust in the prediction, 0 to 1.
    trust: float
    #: Its words, often none.
    message: str


class Stopped(NamedTuple):
    """A stop that the loop has taken."""

    #: The mode after it; none: it was taken as a signal, and nothing was there to tell the mode.
    mode: int | None
    #: Trust at that moment; none as above.
    trust: float | None


class Settings(NamedTuple):
    """The settings of a running daemon."""

    #: How often they were changed since its start.
    revision: int
    #: As TOML.
    text: str


class JointsAt(NamedTuple):
    """Measured joints at an instant."""

    #: Positions [rad].
    q: tuple[float, ...]
    #: Velocities [rad/s].
    qd: tuple[float, ...]
    #: Between the two states around the instant [ns]; 0: a state of this very instant.
    gap_ns: int


def now_ns() -> int:
    """The clock of all stamps [ns]: CLOCK_MONOTONIC, as `time.monotonic_ns()`."""
    return _native.now_ns()


def attach(instance: int = 0, *, root: str | os.PathLike[str] | None = None, wait: float = 0.0) -> Foretrace:
    """Attaches to a daemon of this user, and waits for it up to `wait` [s].

    `root`: the instance's directory, where it is not the usual one. Use it as `with foretrace.attach() as ft:`.
    Raises `NoDaemon`; `OtherVersion`, which names both layouts; `Problem` for damaged files, with what to do.
    """
    return Foretrace(_native.Attachment(_instance(instance), None if root is None else os.fspath(root), wait))


def stop(instance: int = 0, *, root: str | os.PathLike[str] | None = None, timeout: float = 1.0) -> Stopped:
    """Stops the arm of an instance smoothly, and keeps it stopped until it is armed again. Needs no attachment.

    Raises `NoDaemon`, or `NoAnswer`: then use the arm's own stop button.
    """
    return Stopped(*_native.stop(_instance(instance), None if root is None else os.fspath(root), timeout))


def _instance(number: int) -> int:
    return whole("instance", number, "a whole number", f"0 to {2**32 - 1}", 2**32 - 1)


def _holder(name: str | None) -> str:
    """Who holds a place, as others are told."""
    if name is not None:
        return name
    file = os.path.basename(sys.argv[0]) if sys.argv else ""
    return "python" if file in ("", "-c", "-m") else file


class Foretrace(Closable):
    """An attachment to an instance; made by `foretrace.attach`.

    Leaving its `with` block, also by an exception, stops the arm if this block armed it or sent it home, and closes all
    handles. It follows the daemon over restarts, and may be used from any Python thread.

    Requests raise `Refused` with the daemon's reason and remedy, `NoDaemon`, or `NoAnswer` after `timeout` [s].
    """

    def __init__(self, native: _native.Attachment) -> None:
        self._native = native
        self._lock = threading.Lock()
        self._handles: list[Closable] = []
        self._status: _native.StatusHandle | None = None
        self._history: _native.HistoryHandle | None = None
        self._asked_ns = 0

    @property
    def instance(self) -> int:
        """Number of the instance."""
        return self._native.number

    @property
    def root(self) -> str:
        """Directory of the instance."""
        return str(self._native.root)

    def daemon_is_up(self) -> bool:
        """Whether a daemon runs at this moment."""
        return self._native.daemon_is_up()

    # Requests.

    def arm(self, *, timeout: float = 2.0, decided_ns: int = 0) -> Answer:
        """Takes over the arm where it stands. Refused if a stop came since `decided_ns`, when an operator decided it."""
        return self._answer(self._native.arm(timeout, decided_ns))

    def disarm(self, *, timeout: float = 2.0) -> Answer:
        """Stops smoothly and goes idle."""
        return self._answer(self._native.disarm(timeout))

    def stop(self, *, timeout: float = 1.0) -> Stopped:
        """Stops smoothly, and stays stopped until armed again. Works where every other way is closed."""
        stopped = Stopped(*self._native.stop(timeout))
        self._asked_ns = now_ns()
        return stopped

    def move_home(self, *, timeout: float = 5.0) -> Answer:
        """Moves the arm home, slowly and straight in joint space; the answer comes when the way has been checked."""
        return self._answer(self._native.move_home(timeout))

    def trust(self, value: float | str, *, timeout: float = 2.0) -> Answer:
        """Sets the trust in the prediction: 0 (hold only) to 1 (prediction only), "auto" or "freeze"."""
        if value == "auto":
            return self._answer(self._native.trust_auto(timeout))
        if value == "freeze":
            return self._answer(self._native.freeze_trust(timeout))
        if isinstance(value, str) or not 0.0 <= value <= 1.0:
            raise Invalid(f'trust = {told(value)}: a number from 0 to 1, "auto" or "freeze"')
        return self._answer(self._native.set_trust(value, timeout))

    def predictor(self, name: str, *, timeout: float = 2.0) -> Answer:
        """Predicts with another predictor, by its name in the settings; trust goes through 0."""
        return self._answer(self._native.switch_predictor(name, timeout))

    def reload(self, *, timeout: float = 12.0) -> Answer:
        """Reads the settings file again; only live settings may have changed."""
        return self._answer(self._native.reload(timeout))

    def query(self, *, timeout: float = 2.0) -> Answer:
        """Mode and trust; changes nothing."""
        return self._answer(self._native.query(timeout))

    def _answer(self, parts: tuple[int, int, float, str]) -> Answer:
        self._asked_ns = now_ns()
        _, detail, value, text = parts
        return Answer(detail, value, text)

    def settings(self, *, timeout: float = 3.0) -> Settings:
        """The settings in force. Raises `Taken` where two others record, which use the places that this needs."""
        return Settings(*self._native.settings(timeout))

    # Watching.

    def status(self, *, timeout: float = 1.0) -> messages.Status:
        """The daemon's status, not older than the newest request of this attachment; `str(...)` of it and `to_dict()`
        have words. Raises `NoDaemon` or `NoAnswer` if none comes within `timeout` [s]."""
        after_ns = max(now_ns() - FRESH_NS, self._asked_ns)
        return messages.Status.from_buffer_copy(self._status_handle().newer(after_ns, timeout))

    def watch(self, *, timeout: float = 1.0) -> StatusWatch:
        """The newest status, again and again: ten per second, and one on every change. An iterator, which leaves out what was
        overtaken while nobody asked; raises `NoDaemon` or `NoAnswer` where none comes within `timeout` [s], and goes on
        after it."""
        return StatusWatch(self._status_handle(), timeout)

    def wait_until(self, condition: Callable[[messages.Status], bool], *, timeout: float) -> messages.Status:
        """Waits up to `timeout` [s] for a status that meets `condition`: `lambda status: status.mode == Mode.FOLLOWING`.
        Raises `NoAnswer` with the newest mode."""
        deadline = time.monotonic() + _seconds("timeout", timeout)
        status = self.status()
        watch = self.watch()
        while not condition(status):
            if time.monotonic() >= deadline:
                mode = messages.Mode.words(status.mode)
                raise NoAnswer(f"what was waited for has not come within {timeout} s; the mode is {mode}")
            status = next(watch)
        return status

    def records(self, kind: str) -> Records:
        """Every message of a kind from now on, in bulk: "ticks" (`TickRecord`, what each tick saw, decided and cost),
        "pen" (`PenSample`), "joints" (`JointState`), "commands" (`JointCommand`). Raises `Taken` where all places for
        watchers are in use."""
        kinds: dict[str, type[messages.Record]] = {
            "ticks": messages.TickRecord,
            "pen": messages.PenSample,
            "joints": messages.JointState,
            "commands": messages.JointCommand,
        }
        native = self._native.watch(kind)
        return self._keep(Records(native, kinds[kind]))

    def state_at(self, t_ns: int, *, timeout: float = 0.1) -> JointsAt:
        """The measured joints at `t_ns` of `time.monotonic_ns()`, between the two states around it: what the arm did
        when a camera took its picture. Waits up to `timeout` [s] for the later of the two.

        The last 8192 states are kept, from the first call on. Raises `Invalid` for a time before these, in a silence of
        the arm, or not reached yet.
        """
        t_ns, timeout = _stamp("t_ns", t_ns), _seconds("timeout", timeout)
        with self._lock:
            if self._history is None:
                self._history = self._native.history()
            history = self._history
        deadline = time.monotonic() + timeout
        while (history.newest_ns() or 0) < t_ns and time.monotonic() < deadline:
            time.sleep(0.002)
        q, qd, gap_ns = history.at(t_ns)
        return JointsAt(tuple(q), tuple(qd), gap_ns)

    def pace(self, rate_hz: float) -> Pace:
        """A loop at a steady rate: `for count in ft.pace(50): ...`."""
        return Pace(rate_hz)

    # Handles.

    def pen(self, *, clock: str = "monotonic", name: str | None = None, take_over: float | None = None) -> Pen:
        """The pen, held in the name of `name`; none: of this program's file, or "python" where there is none.

        `clock`: of which the stamps are: "monotonic" (`time.monotonic_ns()`), "realtime" (`time.time_ns()`), "device" (a
        device's own nanoseconds, mapped by the smallest delay seen). `take_over`: ask its holder, and wait so long [s].
        Raises `Taken`, which names the holder.
        """
        mapping(clock)
        return self._keep(Pen(self._native.pen(_holder(name), take_over), clock))

    def dead_man(self, *, name: str | None = None, take_over: float | None = None) -> DeadMan:
        """The dead-man switch; `name`, `take_over` and errors as with `pen`."""
        return self._keep(DeadMan(self._native.dead_man(_holder(name), take_over)))

    def predictor_interface(self) -> PredictorInterface:
        """Makes this program the predictor `external`; see `PredictorInterface`. Raises `Taken` if there is one already."""
        return self._keep(PredictorInterface(self._native.predictor()))

    def arm_interface(
        self,
        rate_hz: float,
        *,
        deceleration: float | Sequence[float] | None = None,
        pause_after: float = 0.05,
        simulated: bool = False,
    ) -> ArmInterface:
        """Makes this program the arm: targets at `rate_hz`, measurements back.

        `deceleration` [rad/s²]: how the joints brake where commands end, one for all or one per joint; none: what the
        daemon assumes by its `robot.stale_deceleration_radps2`. `pause_after` [s]: reading no target for longer, while the
        arm moves, makes it stand until it is armed again. `simulated`: nothing real moves. Raises `Taken` if there is an
        arm already.
        """
        braking = self._assumed_braking() if deceleration is None else decelerations(deceleration)
        return self._keep(ArmInterface(self._native.arm_interface(rate_hz, braking, pause_after, simulated)))

    def _assumed_braking(self) -> list[float]:
        try:
            robot = _native.toml_table(self.settings().text)["robot"]
        except (Taken, NoAnswer) as problem:
            text = f"{problem}; or give deceleration, which is read from the settings otherwise"
            raise type(problem)(text) from None
        # Without one of its own the law takes the acceleration.
        return decelerations(robot.get("stale_deceleration_radps2") or robot["acceleration_radps2"])

    def arm_ports(self) -> ArmPorts:
        """The messages of an arm as they are; see `ArmPorts`."""
        return self._keep(ArmPorts(self._native.arm_ports()))

    # The end.

    def close(self) -> bool:
        """Stops the arm if this attachment armed it or sent it home, and closes all handles. Returns whether it stopped
        the arm. Raises `NoAnswer` if it is not known that the arm stops: use its own stop button."""
        try:
            return self._native.close()
        finally:
            with self._lock:
                handles: list[Any] = self._handles
                handles += [one for one in (self._status, self._history) if one is not None]
                self._handles, self._status, self._history = [], None, None
            for handle in reversed(handles):
                handle.close()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            self.close()
        except Problem as problem:
            if error is None:
                raise
            # The error of the block comes first; this one must be seen all the same.
            warnings.warn(f"leaving the block did not stop the arm: {problem}", RuntimeWarning, stacklevel=2)

    def _keep(self, handle: _Handle) -> _Handle:
        with self._lock:
            self._handles.append(handle)
        return handle

    def _status_handle(self) -> _native.StatusHandle:
        with self._lock:
            if self._status is None:
                self._status = self._native.status()
            return self._status
