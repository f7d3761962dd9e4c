"""The lab with an arm of your own: the control law in lock-step with a Python object, in virtual time.

    from functools import partial
    result = foretrace.lab.closed_loop(partial(foretrace.lab.FirstOrder, time_constant_s=0.02), text="hello")
    print(result.rows)

It runs `foretrace lab closed-loop --arm-socket` and answers at that socket (docs/extend/judge.md), so the
program `foretrace` has to be installed. Results do not depend on how long an arm thinks; more than `timeout_s`
for one step ends the run.
"""

from __future__ import annotations

import csv
import json
import math
import os
import select
import shutil
import socket
import struct
import subprocess
import tempfile
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Mapping, NamedTuple, Sequence, Union

from ._arrays import need_numpy
from ._given import whole
from ._native import Invalid, OtherVersion, Problem
from ._settings import Settings, named

__all__ = ["Answer", "ArmCommand", "Begin", "FirstOrder", "Result", "closed_loop"]

JOINTS = 6
MAGIC, VERSION = b"FTLS", 1
HEADER = struct.Struct("<4sHHII")
LAW_HELLO, ARM_HELLO = struct.Struct("<QQ6d"), struct.Struct("<ddII6d")
COMMAND, STATE = struct.Struct("<QQII6d6d"), struct.Struct("<QQII6d6d6d")
EFFORTS = {None: 0, "Nm": 1, "A": 2}
ENABLED = 1


@dataclass(frozen=True)
class Begin:
    """How a run begins: one per hand that is written."""

    period_s: float
    """Length of a tick [s]."""
    begin_ns: int
    """Instant of virtual time at which the run begins [ns]."""
    home: tuple[float, ...]
    """Where the settings have the arm begin [rad]."""


class ArmCommand(NamedTuple):
    """A command, one per tick: where to be at its end."""

    until_ns: int
    tick: int
    enabled: bool
    """The law is in charge: obey it; otherwise stand by yourself."""
    q: tuple[float, ...]
    """[rad]"""
    qd: tuple[float, ...]
    """[rad/s]"""


class Answer(NamedTuple):
    """What an arm measured at the end of a tick."""

    q: Sequence[float]
    """[rad], at most 4π from 0"""
    qd: Sequence[float]
    """[rad/s], at most 100"""
    effort: Sequence[float] | None = None
    """In the arm's `effort_unit`."""
    motion_allowed: bool = True
    """The arm's own safety system lets it move."""
    stamp_ns: int | None = None
    """When it was measured; None: at the end of the tick."""


class FirstOrder:
    """An arm whose every joint follows its command with a delay and a first-order lag.

    `time_constant_s` [s], exact for commands that are straight lines within a tick; `delay_ticks` whole
    ticks of dead time.
    """

    effort_unit = None

    def __init__(self, begin: Begin, time_constant_s: float = 0.02, delay_ticks: int = 1):
        if not (time_constant_s > 0.0 and math.isfinite(time_constant_s)):
            raise Invalid(f"time_constant_s is {time_constant_s} s; legal: positive and finite")
        if not 0 <= delay_ticks <= 500:
            raise Invalid(f"delay_ticks is {delay_ticks}; legal: 0 to 500")
        self.q = list(begin.home)
        self.group_delay_s = time_constant_s + delay_ticks * begin.period_s
        self._h, self._tau = begin.period_s, time_constant_s
        self._qd = [0.0] * JOINTS
        self._from = list(begin.home)
        self._waiting = [tuple(begin.home)] * delay_ticks

    def step(self, command: ArmCommand) -> Answer:
        """Towards the command for one tick."""
        asked = command.q if command.enabled else (self._waiting[-1] if self._waiting else tuple(self._from))
        self._waiting.append(tuple(asked))
        target, h, tau = self._waiting.pop(0), self._h, self._tau
        kept = math.exp(-h / tau)
        for j in range(JOINTS):
            # The command goes from the last target to this one in a straight line.
            begin, slope = self._from[j], (target[j] - self._from[j]) / h
            transient = self.q[j] - begin + slope * tau
            self.q[j] = target[j] - slope * tau + transient * kept
            self._qd[j] = slope - transient * kept / tau
        self._from = list(target)
        return Answer(list(self.q), list(self._qd))


@dataclass(frozen=True)
class Result:
    """What the lab found; `json` is the program's, with all its figures."""

    json: dict[str, Any]
    output: str
    """The table that the command prints."""
    notes: str
    """What it noted: files left out, stops."""
    arms: list[Any] = field(repr=False)
    """The arms, one per hand, as the runs left them."""
    ticks_csv: str | None = field(default=None, repr=False)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One row per method: errors, jerk, lag."""
        rows: list[dict[str, Any]] = self.json["rows"]
        return rows

    @property
    def trials(self) -> list[dict[str, Any]]:
        """One per hand: writer, stop, scores of its sequences."""
        trials: list[dict[str, Any]] = self.json["trials"]
        return trials

    def tick_columns(self) -> dict[str, list[Any]]:
        """Every tick, by column: numbers as float, words as text, empty fields as None."""
        if self.ticks_csv is None:
            raise Problem("the ticks were not kept; call closed_loop with ticks=True")
        rows = list(csv.reader(self.ticks_csv.splitlines()))
        return {name: [_value(row[at]) for row in rows[1:]] for at, name in enumerate(rows[0])} if rows else {}

    def tick_array(self, column: str) -> Any:
        """A column of numbers as a numpy array, NaN where a field is empty; needs numpy."""
        columns = self.tick_columns()
        if column not in columns:
            raise KeyError(f"no column {column}; there are: {', '.join(columns)}")
        values = [math.nan if value is None else value for value in columns[column]]
        return need_numpy("ticks as an array").array(values)


def _value(text: str) -> Any:
    if text == "":
        return None
    try:
        return float(text)
    except ValueError:
        return text


def _program(program: Union[None, str, "os.PathLike[str]"]) -> str:
    if program is not None:
        found = shutil.which(os.fspath(program))
        if found is None:
            raise Invalid(f"program is {os.fspath(program)!r}, which cannot be run; give the path of `foretrace`")
        return found
    found = shutil.which("foretrace")
    if found is None:
        raise Problem(
            "the program `foretrace` is not on the PATH; install it (cargo install --path client/cli), or give "
            "its path as program="
        )
    return found


def _receive(connection: socket.socket, kind: int, form: struct.Struct) -> tuple[Any, ...] | None:
    """The next message, which has to be of this kind; None where the law has gone."""
    length, data = HEADER.size + form.size, b""
    while len(data) < length:
        try:
            more = connection.recv(length - len(data))
        except ConnectionResetError:
            more = b""
        if not more:
            return None
        data += more
    found = HEADER.unpack_from(data)
    if found != (MAGIC, VERSION, kind, length, JOINTS):
        raise OtherVersion(
            f"the program sent {found} where {(MAGIC, VERSION, kind, length, JOINTS)} was expected: its lock-step "
            "messages are of another version; use the program and the package of one version"
        )
    return form.unpack_from(data, HEADER.size)


def _message(kind: int, body: bytes) -> bytes:
    return HEADER.pack(MAGIC, VERSION, kind, HEADER.size + len(body), JOINTS) + body


def _send(connection: socket.socket, data: bytes) -> None:
    """Sends; that the law has gone shows in the next receipt, and in what the program said."""
    try:
        connection.sendall(data)
    except (BrokenPipeError, ConnectionResetError):
        pass


def _joints(name: str, values: Any, tick: int | None) -> list[float]:
    when = "at its start" if tick is None else f"at tick {tick}"
    try:
        found = [float(value) for value in values]
    except (TypeError, ValueError, OverflowError):
        raise Invalid(f"the arm's {name} {when} is {str(values)[:80]}; legal: {JOINTS} numbers") from None
    if len(found) != JOINTS or not all(map(math.isfinite, found)):
        raise Invalid(f"the arm's {name} {when} is {found}; legal: {JOINTS} finite numbers")
    return found


def _answer(arm: Any, command: ArmCommand) -> bytes:
    answer = arm.step(command)
    try:
        answer = answer if isinstance(answer, Answer) else Answer(*answer)
    except TypeError:
        raise Invalid(
            f"the arm's step at tick {command.tick} gave {str(answer)[:80]}; legal: Answer, or a tuple of q, qd "
            "and perhaps effort"
        ) from None
    effort = [0.0] * JOINTS if answer.effort is None else _joints("effort", answer.effort, command.tick)
    end = command.until_ns
    stamp = end if answer.stamp_ns is None else answer.stamp_ns
    legal = f"0 to {end}, the tick's end"
    stamp = whole(f"the arm's stamp_ns at tick {command.tick}", stamp, "whole nanoseconds", legal, most=end)
    q, qd = _joints("q", answer.q, command.tick), _joints("qd", answer.qd, command.tick)
    return _message(4, STATE.pack(stamp, command.tick, int(bool(answer.motion_allowed)), 0, *q, *qd, *effort))


def _run(connection: socket.socket, make_arm: Callable[[Begin], Any]) -> Any:
    """One hand: until the law closes the connection."""
    hello = _receive(connection, 1, LAW_HELLO)
    if hello is None:
        return None
    period_ns, begin_ns, *home = hello
    arm = make_arm(Begin(period_ns * 1e-9, begin_ns, tuple(home)))
    unit = getattr(arm, "effort_unit", None)
    if unit not in EFFORTS:
        raise Invalid(f"the arm's effort_unit is {unit!r}; legal: None, 'Nm', 'A'")
    delay, rate = getattr(arm, "group_delay_s", None), getattr(arm, "rate_hz", None)
    try:
        rate_hz = 1e9 / period_ns if rate is None else float(rate)
    except (TypeError, ValueError, OverflowError):
        raise Invalid(f"the arm's rate_hz is {str(rate)[:80]}; legal: None, or a number [Hz]") from None
    try:
        rates = rate_hz, -1.0 if delay is None else float(delay)
    except (TypeError, ValueError, OverflowError):
        raise Invalid(f"the arm's group_delay_s is {str(delay)[:80]}; legal: None, or a number [s]") from None
    _send(connection, _message(2, ARM_HELLO.pack(*rates, EFFORTS[unit], 0, *_joints("q", arm.q, None))))
    while (found := _receive(connection, 3, COMMAND)) is not None:
        until, tick, flags, _, *numbers = found
        command = ArmCommand(until, tick, bool(flags & ENABLED), tuple(numbers[:JOINTS]), tuple(numbers[JOINTS:]))
        _send(connection, _answer(arm, command))
    return arm


def closed_loop(
    arm: Callable[[Begin], Any],
    *,
    text: Union[None, str, Sequence[str]] = None,
    data: Union[None, str, "os.PathLike[str]"] = None,
    split: str | None = None,
    limit: int | None = None,
    hands: int | None = None,
    predictor: str = "mixture",
    settings: Settings = "ur5",
    changes: Mapping[str, Any] | None = None,
    lifts: str | None = None,
    unit: str | None = None,
    strict: bool = False,
    stop_at_s: float | None = None,
    after_stop_s: float | None = None,
    ticks: bool = False,
    timeout_s: float = 30.0,
    program: Union[None, str, "os.PathLike[str]"] = None,
) -> Result:
    """Writes `text` (the built-in writer) or `data` (a set's folder) with the law in front of your arm.

    `arm` is called once per hand with `Begin`, and returns an object with

    - `q`: where it stands, at rest, 6 × [rad];
    - `step(command: ArmCommand) -> Answer`, or a tuple (q, qd) or (q, qd, effort): one tick;
    - if it likes `group_delay_s` (from command to motion [s]; None: unknown), `rate_hz` (of its own
      controller), `effort_unit` (`"Nm"`, `"A"`; None: no effort).

    `predictor`: one, as `foretrace lab closed-loop --predictors` names them. `settings`, `changes`: as of
    `Follower`. `stop_at_s`: asks for a stop; `after_stop_s` [s]: how long the run then goes on. `ticks`: keep
    what happened in every tick. `timeout_s` [s]: how long a step of the arm may take.

    Exceptions of the arm end the run and are raised. `Problem`: the program's own words; `Invalid`: an
    argument, or an answer of the arm.
    """
    if not callable(arm):
        raise Invalid(f"arm is a {type(arm).__name__}; legal: a callable that makes an arm from `Begin`")
    if (text is None) == (data is None):
        raise Invalid("give either text (for the built-in writer) or data (a set's folder)")
    command = [_program(program), "lab", "closed-loop", "--predictors", predictor, "--arm-timeout", repr(float(timeout_s))]
    for word in [text] if isinstance(text, str) else text or []:
        command += ["--text", word]
    for option, value in [
        ("--data", data), ("--split", split), ("--limit", limit), ("--hands", hands), ("--lifts", lifts),
        ("--unit", unit), ("--stop-at", stop_at_s), ("--after-stop", after_stop_s),
    ]:
        if value is not None:
            command += [option, os.fspath(value) if isinstance(value, os.PathLike) else str(value)]
    command += ["--strict"] * strict + _settings_options(settings, changes)
    # A folder of its own, for this user alone; paths of sockets are short.
    with tempfile.TemporaryDirectory(prefix="ft-") as folder:
        paths = {name: os.path.join(folder, name) for name in ("arm", "run.json", "ticks.csv", "out", "err")}
        command += ["--arm-socket", paths["arm"], "--json", paths["run.json"], "--out", os.path.join(folder, "p")]
        command += ["--ticks", paths["ticks.csv"]] if ticks else []
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
            try:
                listener.bind(paths["arm"])
                listener.listen(1)
            except OSError as error:
                what = f"no socket can be made at {paths['arm']}: {error}"
                raise Problem(f"{what}; set TMPDIR to a folder with a short path") from None
            arms = _serve(listener, command, paths, arm)
        try:
            with open(paths["run.json"], encoding="utf-8") as file:
                found = json.load(file)
        except (OSError, ValueError) as error:
            raise Problem(f"the program wrote no result: {error}; use the program and the package of one version") from None
        kept = _text(paths["ticks.csv"]) if ticks else None
        return Result(found, _text(paths["out"]), _text(paths["err"]), arms, kept)


def _settings_options(settings: Settings, changes: Mapping[str, Any] | None) -> list[str]:
    found = named(settings, changes)
    if found["preset"] is not None:
        options = ["--preset", found["preset"]]
    elif found["file"] is not None:
        options = ["--config", found["file"]]
    else:
        raise Invalid("settings as a dict need a preset here; legal: {'preset': 'ur5', ...}, a name, or a path")
    for key, value in found["changes"]:
        options += ["--set", f"{key}={value}"]
    return options


def _text(path: str) -> str:
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return file.read()
    except FileNotFoundError:
        return ""


def _serve(listener: socket.socket, command: list[str], paths: dict[str, str], make_arm: Callable[[Begin], Any]) -> list[Any]:
    """Answers until the program ends; whatever goes wrong here ends the program."""
    arms = []
    with open(paths["out"], "wb") as out, open(paths["err"], "wb") as err:
        try:
            running = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=err)
        except OSError as error:
            raise Problem(f"{command[0]} cannot be run: {error}") from None
    try:
        while running.poll() is None:
            if select.select([listener], [], [], 0.05)[0]:
                connection, _ = listener.accept()
                with connection:
                    made = _run(connection, make_arm)
                if made is not None:
                    arms.append(made)
    except BaseException:
        running.terminate()
        end = time.monotonic() + 5.0
        while running.poll() is None and time.monotonic() < end:
            time.sleep(0.01)
        if running.poll() is None:
            running.kill()
        running.wait()
        raise
    if running.returncode != 0:
        said = _text(paths["err"]).strip() or f"it ended with exit code {running.returncode}"
        raise Problem(said)
    return arms
