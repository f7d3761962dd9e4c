"""Recordings: topics as arrays, what happened in words, replays bit for bit and with another law."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping as AbstractMapping
from dataclasses import dataclass
from typing import Any, Callable, Iterator, Mapping, Sequence, TypeVar, Union

from . import _native
from ._arrays import PEN, PATH_SIZE, Rows
from ._native import Invalid, Problem
from ._settings import flat, toml_value

__all__ = [
    "Arm", "Difference", "Message", "Moment", "Piece", "Recording", "RecordingRemark", "Replay", "Score", "Stop",
    "Topic", "WhatIf", "read", "replay",
]

WIRE = "foretrace.wire"
_T = TypeVar("_T")
MOST_BYTES = 2 << 30
"""Bytes of a topic, of all pieces, of the pen or of all stops that are read into memory at most; set it as you
like. While arrays are made it is twice as much."""


class RecordingRemark(UserWarning):
    """A recording that ends early, or holds what is not read."""


@dataclass(frozen=True)
class Stop:
    """A stop that latched. `amount` and `limit` have the unit that `text` names."""

    tick: int
    after_s: float
    """After the first record of the file [s]."""
    reason: str
    cause: str
    joint: int | None
    """Base first, from 0; None: the tool, or no joint."""
    amount: float
    limit: float
    at_ns: int
    """Release of the tick that latched it, on the monotonic clock [ns]; 0: unknown."""
    text: str


@dataclass(frozen=True)
class Moment:
    """A moment that matters, in words."""

    tick: int
    after_s: float
    what: str


@dataclass(frozen=True)
class Piece:
    """What a replay needs beside the ticks' inputs: `settings` (TOML), `weights`, `state`, `law` (name of the
    build) or `preview` (of another process)."""

    kind: str
    daemon: int
    number: int
    """Of settings and law 0; of weights their version; of a state the tick before it; of a preview the tick
    that was given it."""
    data: bytes


@dataclass(frozen=True)
class Message:
    """A message in bytes."""

    time_ns: int
    """When it was recorded [ns since 1970]."""
    data: bytes


class Topic:
    """One topic of a recording. Every field of the file's own layout is there, by its own name."""

    def __init__(self, path: str, name: str, every: int):
        self.name = name
        self._what = f"{name} as an array"
        if not 0 <= every < 1 << 64:
            raise Invalid(f"every is {every}; legal: 1 (all messages) and more")
        found = _native.recording_rows(path, name, every, MOST_BYTES)
        self.encoding: str = found["encoding"]
        """`foretrace.wire` for raw topics, which have columns; `protobuf` for the others."""
        self.schema_name: str = found["schema"]
        self.schema: bytes = found["schema_text"]
        """Table of fields of a raw topic; a FileDescriptorSet of the others."""
        self._times, self._ends, self._data = found["times"], found["ends"], found["bytes"]
        fields = [("time_ns", "u64", 0, 1), *((f, number, at + 8, count) for f, number, at, count in found["fields"])]
        self._rows = Rows(self._data, found["size"] + 8, fields) if found["size"] else None
        """A time in front of each message; None: messages of changing size."""

    def __len__(self) -> int:
        return len(self._times) // 8

    def _table(self) -> Rows:
        if self._rows is None:
            raise Problem(f"{self.name} has no columns: its messages are {self.encoding} of changing size; "
                          f"take `messages`")
        return self._rows

    @property
    def columns(self) -> list[str]:
        """Names of the fields: `time_ns` (of the message [ns since 1970]), then those of the layout."""
        return [name for name, *_ in self._table().fields]

    def column(self, name: str) -> list[Any]:
        """One field as a list, one entry per message (tuples where the field has several numbers). No numpy."""
        return self._table().column(name)

    @property
    def array(self) -> Any:
        """A structured numpy array, one row per message; needs numpy."""
        return self._table().array(self._what)

    @property
    def messages(self) -> list[Message]:
        """The messages as bytes, of any topic."""
        lead = 8 if self.encoding == WIRE else 0
        found, begin = [], 0
        for at in range(0, len(self._times), 8):
            end = int.from_bytes(self._ends[at : at + 8], "little")
            time_ns = int.from_bytes(self._times[at : at + 8], "little")
            found.append(Message(time_ns, self._data[begin + lead : end]))
            begin = end
        return found

    def __repr__(self) -> str:
        return f"<Topic {self.name}: {len(self)} messages, {self.encoding}>"


class Recording(AbstractMapping[str, Any]):
    """A recording of `foretrace record`: a mapping from topics to structured numpy arrays.

    Topics are read when they are asked for. Without numpy take `topic(name)`, whose columns are lists.
    """

    def __init__(self, path: Union[str, "os.PathLike[str]"]):
        self.path = os.fspath(path)
        self.info: dict[str, Any] = _native.recording_info(self.path)
        """What `foretrace record --info` tells: `begin`, `end` (facts of the recorder), `topics` (messages
        by name), `foreign` (topics of another layout), `seconds`, `ticks` (first, last), `missing_ticks`,
        `states`, `daemons`, `laws` (builds by daemon), `damage` (why it ends early), `passed_over`."""
        for words in self._remarks():
            warnings.warn(words, RecordingRemark, stacklevel=3)
        self._topics: dict[str, Topic] = {}
        self._kept: dict[str, Any] = {}

    def _remarks(self) -> Iterator[str]:
        if self.info["damage"] is not None:
            yield (
                f"{self.path} ends early, {self.info['damage']}; the result is of what comes before; "
                f"`foretrace record --repair {self.path}` makes a whole file of that"
            )
        if self.info["passed_over"] is not None:
            yield f"{self.path}: passed over: {self.info['passed_over']}"

    def topic(self, name: str, every: int = 1) -> Topic:
        """Every `every`-th message of a topic.

        Raises `Invalid` where the file has no such topic, with those that it has; `Problem` where it is more
        than `MOST_BYTES`.
        """
        if every != 1:
            return Topic(self.path, name, every)
        if name not in self._topics:
            self._topics[name] = Topic(self.path, name, 1)
        return self._topics[name]

    def __getitem__(self, name: str) -> Any:
        if name not in self:
            what = "messages but no columns: take topic(name).messages" if name in self.info["topics"] else "no such topic"
            raise KeyError(f"{name}: {self.path} has {what}; topics with columns: {', '.join(self)}")
        return self.topic(name).array

    def __contains__(self, name: object) -> bool:
        return name in set(self)

    def __iter__(self) -> Iterator[str]:
        """Topics that have columns."""
        return (name for name in self.info["topics"] if name.startswith("/raw/") and name != "/raw/thing")

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _once(self, key: str, make: Callable[[], _T]) -> _T:
        if key not in self._kept:
            self._kept[key] = make()
        kept: _T = self._kept[key]
        return kept

    @property
    def pieces(self) -> list[Piece]:
        """Settings, weights, states and builds of the law, as they were recorded."""
        return self._once("pieces", lambda: [Piece(*piece) for piece in _native.recording_pieces(self.path, MOST_BYTES)])

    @property
    def settings_text(self) -> str:
        """The settings of the first daemon as TOML."""
        for piece in self.pieces:
            if piece.kind == "settings":
                return piece.data.decode("utf-8", "replace")
        raise Problem(f"{self.path}: the recording holds no settings: it is too short; record for a second at least")

    @property
    def settings(self) -> dict[str, Any]:
        """The same as plain dicts, numbers, texts and lists."""
        return _native.toml_table(self.settings_text)

    @property
    def stops(self) -> list[Stop]:
        """Every stop that latched in the recording, in order of time. One that its first tick finds is older."""
        return self._once("stops", lambda: [Stop(**stop) for stop in _native.recording_stops(self.path, MOST_BYTES)])

    @property
    def moments(self) -> list[Moment]:
        """The moments that matter most: those of `foretrace explain`."""
        return self._once(
            "moments", lambda: [Moment(*moment) for moment in _native.recording_moments(self.path)["moments"]]
        )

    def explain(self, tick: int) -> list[str]:
        """What a tick saw, decided and cost, as sentences: those of `foretrace explain --tick`."""
        if not 0 <= tick < 1 << 64:
            raise Invalid(f"tick is {tick}; legal: the number of a tick")
        return _native.recording_tick(self.path, tick)

    @property
    def pen(self) -> Any:
        """All pen samples that ticks were given: `stamp_ns` (monotonic), `x_m`, `y_m` (the pen's own plane),
        `contact`; a structured array, or without numpy a list of tuples."""
        rows = Rows(_native.recording_pen(self.path, MOST_BYTES), PATH_SIZE, PEN)
        from ._arrays import numpy

        if numpy is None:
            return list(zip(*(rows.column(name) for name, *_ in PEN)))
        return rows.array("the pen")

    def replay(self, what_if: Any = None) -> "Replay | WhatIf":
        """As `foretrace.replay`."""
        return replay(self.path, what_if=what_if)

    def __repr__(self) -> str:
        return f"<Recording {self.path}: {self.info['seconds']:.1f} s, {len(self.info['topics'])} topics>"


def read(path: Union[str, "os.PathLike[str]"]) -> Recording:
    """Opens a recording (`foretrace record`, `foretrace demo`).

    `recording["/raw/tick"]` is a structured numpy array with one row per tick and the recording's own names;
    `recording.settings`, `.info`, `.stops`, `.pen` are plain data. Recordings of other versions are read by
    the layouts that they name. Raises `Problem` with what is wrong with the file, `OtherVersion` where words
    (stops, moments) need tick records of this version. A file that ends early gives what comes before, with a
    warning (`RecordingRemark`).
    """
    return Recording(path)


@dataclass(frozen=True)
class Difference:
    """The first difference between recording and replay, as texts with all digits."""

    tick: int
    field: str
    recorded: str
    replayed: str


@dataclass(frozen=True)
class Replay:
    """A replay: the recorded inputs through the law of this package, compared bit for bit."""

    same: bool
    """Ticks were run again, and every command is the same in every bit."""
    verdict: str
    """The command's words: that all is the same, or what differs first and what to do."""
    summary: str
    start: str
    """`first_tick` or `state`."""
    first_tick: int
    ticks: int
    seconds: float
    end: str
    """`of_recording`, `gap`, `incomplete`, `no_preview`, `no_weights`, `other_daemon` or `damaged`."""
    next_tick: int | None
    """After a gap the first recorded tick; of `no_preview` the tick whose preview the file does not hold."""
    missing_weights: int | None
    damage: str | None
    """Why the file ends early; the verdict is of what comes before."""
    gone: list[str]
    """Recorded settings that this version has not, each with the reason."""
    difference: Difference | None
    different_ticks: int
    largest_rad: float
    """Largest distance of a recorded and a replayed joint [rad]."""
    recorded_build: str | None
    same_build: bool | None


@dataclass(frozen=True)
class Arm:
    """The arm as it was fitted to the recording."""

    delay_s: float
    filter_s: float
    joint_loop_s: float
    rms_rad: float


@dataclass(frozen=True)
class Score:
    """How a law did behind the fitted arm; distances of tool and pen while it writes."""

    name: str
    rms_mm: float
    max_mm: float
    lag_ms: float
    jerk_mps3: float
    saturated: float | None
    """Share of the ticks whose plan ran into a limit; None: not known of a recorded run."""
    worst_stroke_mm: float
    worst_stroke_at_s: float
    stopped: str | None
    """When and why a stop latched, or why the law never took charge."""
    error_mm: list[tuple[float, float]]
    """Time [s] and rms [mm] of stretches of equal length."""
    stroke_tool: list[tuple[float, float, float]]
    """The tool in the stroke that is shown: t [s], x, y [m]."""
    stroke_mm: float


@dataclass(frozen=True)
class WhatIf:
    """The hand of a recording in front of other laws."""

    seconds: float
    ticks: int
    damage: str | None
    gone: list[str]
    previews_missing: int
    """Previews of another process that the file does not hold: the fallback served there."""
    arm: Arm
    arm_misfit_mm: float
    """From the modelled to the recorded tool under the recorded commands, rms [mm]."""
    rows: list[Score]
    """As it was recorded; with the recorded settings behind the modelled arm; then the variants."""
    stretch_s: float
    stroke: list[tuple[float, float, float]]
    """The pen in the stroke that the tool followed worst as recorded: t [s], x, y [m]."""

    def __getitem__(self, name: str) -> Score:
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(f"no row {name!r}; there are: {', '.join(row.name for row in self.rows)}")


def _variant(change: Any) -> tuple[str, list[tuple[str, str]] | None]:
    if isinstance(change, str):
        return change, None
    if isinstance(change, Mapping):
        short = {key: value for key, value in change.items() if key in ("predictor", "trust") and not isinstance(value, Mapping)}
        pairs = [(key, value if isinstance(value, str) else toml_value(key, value)) for key, value in short.items()]
        pairs += flat({key: value for key, value in change.items() if key not in short})
        name = ",".join(f"{key}={value}" for key, value in pairs)
        return name or "no change", pairs
    raise Invalid(f"what_if holds a {type(change).__name__}; legal: a dict of settings, or KEY=VALUE,... as text")


def replay(
    path: Union[str, "os.PathLike[str]"],
    what_if: Union[None, str, Mapping[str, Any], Sequence[Union[str, Mapping[str, Any]]]] = None,
) -> Union[Replay, WhatIf]:
    """Runs a recording again: the verdict bit for bit, or with `what_if` the figures of other laws.

    `what_if`: one variant, or a list of them; each a dict of settings (`{"predictor": "dybm", "trust": 0}`,
    `{"mpc.velocity_lead_ms": 20}`) or the command's text (`"predictor=dybm,trust=0"`). The work is done
    without the interpreter's lock; Ctrl-C ends the wait. Raises `Problem`, `OtherVersion` or `Invalid` with
    the words of `foretrace replay`.
    """
    path = os.fspath(path)
    if what_if is None:
        found = _native.replay(path)
        difference = found.pop("difference")
        return Replay(difference=Difference(*difference) if difference else None, **found)
    changes = [what_if] if isinstance(what_if, (str, Mapping)) else list(what_if)
    if not changes:
        raise Invalid("what_if is empty; legal: at least one variant, or None for a replay bit for bit")
    found = _native.what_if(path, [_variant(change) for change in changes])
    arm = Arm(*(found.pop(key) for key in ("delay_s", "filter_s", "joint_loop_s", "rms_rad")))
    return WhatIf(arm=arm, rows=[Score(**row) for row in found.pop("rows")], **found)
