"""What converters of data sets share: the folder of InkML that they write, and what may stand in it.

The folder appears whole or not at all. Numbers and texts that the lab would refuse are refused.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import tempfile
from dataclasses import dataclass, field
from typing import Any, BinaryIO, NamedTuple, Sequence, Union
from xml.sax.saxutils import escape

from ._given import told
from ._native import Problem

Name = Union[str, "os.PathLike[str]"]

LARGEST_FILE = 128 << 20
LONGEST_NAME = 100
LARGEST_POSITION = 1e9
NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")


class Trace(NamedTuple):
    """A stroke, or with `contact` false a hover path: x, y (downwards) and time per point, as texts."""

    points: list[tuple[str, str, str]]
    contact: bool = True


class Ink(NamedTuple):
    """A sequence of one hand."""

    label: str
    writer: str
    traces: list[Trace]


@dataclass
class Converted:
    """What a converter wrote."""

    folder: str
    files: int = 0
    sequences: int = 0
    left_out: list[str] = field(default_factory=list)
    """What could not be used, each with file, place and reason."""


class Refused(Exception):
    """A part of a file that cannot be used; its text says where and why."""


class Target:
    """A new folder of InkML files, which gets its name when it is complete."""

    def __init__(self, folder: Name, time_unit: str, strict: bool):
        self.final = os.fsdecode(folder)
        if os.path.lexists(self.final):
            raise Problem(f"{self.final} exists already; give a new name, or remove it")
        self.part = ""
        self.unit, self.strict = time_unit, strict
        self.done = Converted(self.final)
        self.rows: list[tuple[str, str, str]] = []
        self.names: dict[str, str] = {}

    def __enter__(self) -> "Target":
        above, name = os.path.split(os.path.abspath(self.final))
        try:
            os.makedirs(above, exist_ok=True)
            self.part = tempfile.mkdtemp(prefix=f".{name}-", dir=above)
            os.chmod(self.part, 0o755)
        except (OSError, ValueError) as error:
            raise Problem(f"cannot write {self.final}: {why(error)}") from None
        return self

    def leave_out(self, reason: str) -> None:
        """Remembers what is not used; an error where strict."""
        if self.strict:
            raise Problem(reason)
        self.done.left_out.append(reason)

    def add(self, name: str, part: str, inks: Sequence[Ink], of: str) -> bool:
        """One file with these sequences, which were read from `of`; whether its name can be had."""
        name = re.sub(r"[^A-Za-z0-9._/-]", "_", name)
        if name in self.names:
            self.leave_out(f"{of}: its file would be {name}, which {self.names[name]} has already; rename one of them")
            return False
        lines = [
            '<?xml version="1.0" encoding="UTF-8"?>',
            '<ink xmlns="http://www.w3.org/2003/InkML">',
            '  <traceFormat><channel name="X" type="decimal"/><channel name="Y" type="decimal"/>'
            f'<channel name="T" type="decimal" units="{self.unit}"/></traceFormat>',
        ]
        for ink in inks:
            lines.append("  <traceGroup>")
            lines += [
                f'    <annotation type="{kind}">{escape(clean(text))}</annotation>'
                for kind, text in (("truth", ink.label), ("writer", ink.writer))
                if text
            ]
            for trace in ink.traces:
                points = ",".join(" ".join(point) for point in trace.points)
                kind = "" if trace.contact else ' type="penUp"'
                lines.append(f"    <trace{kind}>{points}</trace>")
            lines.append("  </traceGroup>")
        lines.append("</ink>")
        path = os.path.join(self.part, name)
        try:
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, "w", encoding="utf-8") as file:
                file.write("\n".join(lines) + "\n")
        except (OSError, ValueError) as error:
            if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
                # One name takes no other with it.
                self.leave_out(f"{of}: its file would be {shown(name)}…, a name that is too long here; shorten that of its source")
                return False
            raise Problem(f"cannot write {path}: {why(error)}") from None
        self.names[name] = of
        writers = {clean(ink.writer) for ink in inks}
        self.rows.append((part, name, writers.pop() if len(writers) == 1 else ""))
        self.done.files += 1
        self.done.sequences += len(inks)
        return True

    def __exit__(self, kind: Any, *_: Any) -> None:
        try:
            if kind is None and self.rows:
                self._finish()
                return
        except (OSError, ValueError) as error:
            raise Problem(f"cannot write {self.final}: {why(error)}") from None
        finally:
            # Nothing is left of it where it has its name by now.
            shutil.rmtree(self.part, ignore_errors=True)
        if kind is None:
            first = f"; the first: {self.done.left_out[0]}" if self.done.left_out else ""
            raise Problem(f"nothing could be converted ({len(self.done.left_out)} left out{first}); no folder was written")

    def _finish(self) -> None:
        table = "".join(f"{part}\t{name}\t{writer}\n" for part, name, writer in self.rows)
        with open(os.path.join(self.part, "split.tsv"), "w", encoding="utf-8") as file:
            file.write("set\tfile\twriter\n" + table)
        os.rename(self.part, self.final)


def why(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def clean(text: str) -> str:
    """In one line, without what XML and tables do not hold."""
    return re.sub(r"[\x00-\x1f\x7f\ufffe\uffff\ud800-\udfff]+", " ", text).strip()


def shown(value: Any) -> str:
    """The begin of a foreign value, for a message, in quotes: where it ends can be seen."""
    return repr(told(value)[:40])


def number(text: Any, what: str, most: float = 1e12) -> str:
    """`text`, if it is a finite number of ordinary size, in ASCII."""
    value = float("nan")
    try:
        if isinstance(text, str):
            text = text.strip()
            value = float(text) if len(text) <= 400 and NUMBER.fullmatch(text) else value
        elif isinstance(text, (int, float)) and not isinstance(text, bool):
            value = float(text)
    except OverflowError:
        pass
    if not -most <= value <= most:
        raise Refused(f"{what} is {shown(text)}; legal: numbers from -{most:g} to {most:g}")
    return str(text)


def position(text: Any, what: str) -> str:
    """As `number`, of a position."""
    return number(text, what, LARGEST_POSITION)


def label(value: Any, what: str) -> str:
    """A text, or nothing."""
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise Refused(f"{what} is {shown(value)}; legal: a text")
    return str(value)


def hand(value: Any, what: str) -> str:
    """As `label`, of a name, such as a writer's; the lab compares as much of it as is legal here."""
    text = label(value, what)
    if len(text) > LONGEST_NAME:
        raise Refused(f"{what} has {len(text)} characters; legal: at most {LONGEST_NAME}")
    return text


def files_of(source: Name, ends: str) -> list[str]:
    """The file, or all files below the folder whose names end so, by name."""
    source = os.fsdecode(source)
    if os.path.isfile(source):
        return [source]
    if not os.path.isdir(source):
        raise Problem(f"{source}: no such file or folder")
    found = [
        os.path.join(folder, name)
        for folder, _, names in os.walk(source)
        for name in names
        if name.lower().endswith(ends)
    ]
    if not found:
        raise Problem(f"{source}: no file that ends in {ends} is below this folder")
    return sorted(found)


def opened(path: str) -> BinaryIO:
    """A regular file, to read; whatever else stands there is refused and never waited for."""
    try:
        file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")
    except (OSError, ValueError) as error:
        raise Refused(f"{path}: {why(error)}") from None
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise Refused(f"{path}: not a regular file")
    return file


def content(path: str, most: int = LARGEST_FILE) -> bytes:
    """All of a regular file of ordinary size."""
    parts, size = [], 0
    with opened(path) as file:
        try:
            # One read of `most` bytes would ask for the memory of all of them first.
            while size <= most and (part := file.read(min(1 << 20, most + 1 - size))):
                parts.append(part)
                size += len(part)
        except OSError as error:
            raise Refused(f"{path}: {why(error)}") from None
    if size > most:
        raise Refused(f"{path}: it has more than {most} bytes, the most that are read")
    return b"".join(parts)
