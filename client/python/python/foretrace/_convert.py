"""Sets in formats that the lab does not read, as folders of InkML with a `split.tsv` that it does.

Every converter writes a new folder, which appears whole or not at all. What cannot be used is left out and
named in the result; with `strict` it is an error. Numbers and texts that the lab would refuse are refused.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from typing import Any, BinaryIO, Iterable, Iterator, Mapping, NamedTuple, Sequence, Union
from xml.sax.saxutils import escape

from ._native import Invalid, Problem

Name = Union[str, "os.PathLike[str]"]

LARGEST_FILE = 128 << 20
LARGEST_TEXT = 1 << 20
LONGEST_LINE = 16 << 20
LONGEST_NAME = 100
LARGEST_POSITION = 1e9
DRAWINGS_PER_FILE = 500
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
            raise Problem(f"cannot write {self.final}: {_why(error)}") from None
        return self

    def leave_out(self, why: str) -> None:
        """Remembers what is not used; an error where strict."""
        if self.strict:
            raise Problem(why)
        self.done.left_out.append(why)

    def add(self, name: str, part: str, inks: Sequence[Ink], of: str) -> None:
        """One file with these sequences, which were read from `of`."""
        name = re.sub(r"[^A-Za-z0-9._/-]", "_", name)
        if name in self.names:
            self.leave_out(f"{of}: its file would be {name}, which {self.names[name]} has already; rename one of them")
            return
        self.names[name] = of
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
            raise Problem(f"cannot write {path}: {_why(error)}") from None
        writers = {clean(ink.writer) for ink in inks}
        self.rows.append((part, name, writers.pop() if len(writers) == 1 else ""))
        self.done.files += 1
        self.done.sequences += len(inks)

    def __exit__(self, kind: Any, *_: Any) -> None:
        try:
            if kind is None and self.rows:
                self._finish()
                return
        except (OSError, ValueError) as error:
            raise Problem(f"cannot write {self.final}: {_why(error)}") from None
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


def _why(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def clean(text: str) -> str:
    """In one line, without what XML and tables do not hold."""
    return re.sub(r"[\x00-\x1f\x7f\ufffe\uffff\ud800-\udfff]+", " ", text).strip()


def shown(value: Any) -> str:
    """The begin of a foreign value, for a message."""
    try:
        return repr(str(value)[:40])
    except ValueError:
        return "a number of thousands of digits"


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
    """As `label`, of a writer's name; the lab compares as much of it as is legal here."""
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
        raise Refused(f"{path}: {_why(error)}") from None
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise Refused(f"{path}: not a regular file")
    return file


def content(path: str, most: int = LARGEST_FILE) -> bytes:
    """All of a regular file of ordinary size."""
    with opened(path) as file:
        try:
            data = file.read(most + 1)
        except OSError as error:
            raise Refused(f"{path}: {_why(error)}") from None
    if len(data) > most:
        raise Refused(f"{path}: it has more than {most} bytes, the most that are read")
    return data


def xml_of(path: str) -> ElementTree.Element:
    """The document of a file; entities of its own are refused, which could fill the memory."""
    data = content(path)
    # Other encodings that the parser knows have zeros between the letters, or the same letters.
    if b"<!ENTITY" in data.replace(b"\0", b""):
        raise Refused(f"{path}: it defines entities; give files as IAM-OnDB publishes them")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise Refused(f"{path}: not XML: {error}") from None


def convert_iam_ondb(
    source: Name, target: Name, *, parts: Mapping[str, Name] | None = None, strict: bool = False
) -> Converted:
    """IAM-OnDB (XML, `WhiteboardCaptureSession`) to a set that the lab reads.

    `source`: the unpacked folder. The lines of a form (`lineStrokes/`) become its sequences where there are
    any, the whole form (`original/`) otherwise. Text and writer come from the forms (`Form writerID`,
    `TextLine`) or `ascii/` beside them. `parts`: a word for each list of forms that the database publishes,
    such as `{"train": "trainset.txt"}`; without it all is one part. Times in seconds and positions are kept as
    they stand; the database names no unit of length.

    Raises `Problem`: nothing usable, `target` exists, or (strict) the first bad file.
    """
    words = _parts(parts)
    with Target(target, "s", strict) as out:
        read = _IamForms()
        for path in files_of(source, ".xml"):
            try:
                read.take(path)
            except Refused as error:
                out.leave_out(str(error))
        ascii_ = _iam_ascii(source, out)
        for name in read.names():
            part = words.get(name) or words.get(re.sub(r"[a-z]$", "", name)) if words else "all"
            if not part:
                out.leave_out(f"{name}: in none of the lists of parts")
                continue
            out.add(f"{name.replace('/', '_')}.inkml", part, read.inks(name, ascii_.get(name, [])), f"form {name}")
    return out.done


class _IamForms:
    """What the files of IAM-OnDB hold, by name of the form."""

    def __init__(self) -> None:
        self.about: dict[str, tuple[str, str, dict[int, str]]] = {}
        self.lines: dict[str, dict[int, list[Trace]]] = {}
        self.whole: dict[str, list[Trace]] = {}
        self.paths: dict[tuple[str, int], str] = {}

    def take(self, path: str) -> None:
        """Reads a file: a form, or a line of one."""
        document = xml_of(path)
        stem, folder = os.path.splitext(os.path.basename(path))[0], os.path.basename(os.path.dirname(path))
        form, line = document.find("General/Form"), re.fullmatch(r"(.+)-([0-9]{1,9})", stem)
        traces = list(_iam_traces(document, path))
        if form is None and line is not None:
            name, number_of = line[1], int(line[2])
        else:
            # The file of form a01-001z is a01-001/strokesz.xml.
            own = folder + stem[len("strokes") :] if stem.startswith("strokes") else stem
            name, number_of = (form.get("id") if form is not None else None) or own, 0
        other = self.paths.setdefault((name, number_of), path)
        if other != path:
            what = f"line {number_of} of form {name}" if number_of else f"form {name}"
            raise Refused(f"{path}: {what} was read from {other} already")
        if form is not None:
            named: dict[int, str] = {}
            for item in document.iter("TextLine"):
                if known := re.fullmatch(r".*-([0-9]{1,9})", item.get("id", "")):
                    named.setdefault(int(known[1]), item.get("text", ""))
            text = (document.findtext("Transcription/Text") or "").strip()
            self.about[name] = (hand(form.get("writerID"), f"{path}: writerID"), text, named)
        if form is None and line is not None:
            self.lines.setdefault(name, {})[number_of] = traces
        else:
            self.whole[name] = traces

    def names(self) -> list[str]:
        """The forms, each once."""
        return sorted({*self.lines, *self.whole})

    def inks(self, name: str, corrected: list[str]) -> list[Ink]:
        """The lines of a form, or where there are none all of it."""
        writer, text, named = self.about.get(name, ("", "", {}))
        if name not in self.lines:
            return [Ink(text, writer, self.whole[name])]
        found = []
        for at, traces in sorted(self.lines[name].items()):
            text = named.get(at) or (corrected[at - 1] if 1 <= at <= len(corrected) else "")
            found.append(Ink(text, writer, traces))
        return found


def _iam_traces(document: ElementTree.Element, path: str) -> Iterator[Trace]:
    if document.tag != "WhiteboardCaptureSession":
        raise Refused(f"{path}: its document is <{document.tag[:40]}>; legal: <WhiteboardCaptureSession>")
    strokes = document.findall("StrokeSet/Stroke")
    if not strokes:
        raise Refused(f"{path}: no strokes (StrokeSet/Stroke)")
    for at, stroke in enumerate(strokes):
        points: list[tuple[str, str, str]] = []
        for point in stroke.findall("Point"):
            what = f"{path}: stroke {at}, point {len(points)}"
            x, y = (position(point.get(key), f"{what}: {key}") for key in ("x", "y"))
            points.append((x, y, number(point.get("time"), f"{what}: time")))
        if points:
            yield Trace(points)


def _iam_ascii(source: Name, out: Target) -> dict[str, list[str]]:
    """The corrected lines of `ascii/`, by form."""
    found: dict[str, list[str]] = {}
    folder = os.fsdecode(source)
    if not os.path.isdir(folder):
        return found
    for path in sorted(_walk(folder, ".txt")):
        try:
            text = content(path, LARGEST_TEXT).decode("utf-8", "replace")
            _, mark, rest = text.partition("CSR:")
        except Refused as error:
            out.leave_out(str(error))
            continue
        if mark:
            lines = [line.strip() for line in rest.splitlines()]
            found[os.path.splitext(os.path.basename(path))[0]] = [line for line in lines if line]
    return found


def _walk(folder: str, ends: str) -> Iterator[str]:
    for at, _, names in os.walk(folder):
        yield from (os.path.join(at, name) for name in names if name.lower().endswith(ends))


def _parts(parts: Mapping[str, Name] | None) -> dict[str, str]:
    words: dict[str, str] = {}
    for word, path in (parts or {}).items():
        if not word or clean(word) != word:
            raise Invalid(f"a part is called {word!r}; legal: a word without tabs and line breaks")
        try:
            lines = content(os.fsdecode(path)).decode().splitlines()
        except Refused as error:
            raise Problem(str(error)) from None
        except UnicodeDecodeError as error:
            raise Problem(f"{os.fsdecode(path)}: no text: {error.reason} at byte {error.start}") from None
        for line in lines:
            if line.strip():
                words.setdefault(line.split()[0], word)
    return words


def convert_svc2004(source: Name, target: Name, *, strict: bool = False) -> Converted:
    """Signatures of SVC2004 (text, `U1S1.TXT`) to a set that the lab reads.

    A line of the number of points, then per point x, y (upwards), time [ms], button (1: on the surface), and
    in task 2 azimuth, altitude and pressure, which are not kept. The hand is the user of the file's name for
    signatures 1 to 20; those from 21 on are forgeries by others: part `forgery`, hand unknown. Files keep
    their folders, so that both tasks may stand beside each other.
    """
    root = os.fsdecode(source)
    with Target(target, "ms", strict) as out:
        for path in files_of(root, ".txt"):
            name = os.path.splitext(os.path.basename(path))[0]
            try:
                match = re.fullmatch(r"(?i)u([0-9]+)s([0-9]+)", name)
                if match is None:
                    raise Refused(f"{path}: its name is not that of a signature, as U1S1.TXT")
                genuine = int(match[2]) <= 20
                ink = Ink("", f"u{int(match[1])}" if genuine else "", _svc_traces(path))
                folder = os.path.dirname(os.path.relpath(path, root)) if os.path.isdir(root) else ""
                out.add(os.path.join(folder, f"{name.lower()}.inkml"), "genuine" if genuine else "forgery", [ink], path)
            except Refused as error:
                out.leave_out(str(error))
    return out.done


def _svc_traces(path: str) -> list[Trace]:
    texts = content(path).decode("ascii", "replace").splitlines()
    lines = [(at, line.split()) for at, line in enumerate(texts, 1) if line.strip()]
    count = lines[0][1] if lines else []
    if len(count) != 1 or not re.fullmatch("[0-9]{1,9}", count[0]):
        raise Refused(f"{path}:1: legal: the number of points, alone in the first line")
    if int(count[0]) != len(lines) - 1:
        raise Refused(f"{path}: it holds {len(lines) - 1} points where its first line says {count[0]}")
    traces: list[Trace] = []
    for at, cells in lines[1:]:
        if len(cells) not in (4, 7):
            raise Refused(f"{path}:{at}: {len(cells)} numbers; legal: x y time button, or those and three more")
        x, y = (position(cell, f"{path}:{at}: {what}") for cell, what in zip(cells, ("x", "y")))
        t = number(cells[2], f"{path}:{at}: time")
        if cells[3] not in ("0", "1"):
            raise Refused(f"{path}:{at}: button is {cells[3][:40]!r}; legal: 0, 1")
        # InkML counts y downwards.
        y = y[1:] if y.startswith("-") else f"-{y.lstrip('+')}"
        contact = cells[3] == "1"
        if not traces or traces[-1].contact != contact:
            traces.append(Trace([], contact))
        traces[-1].points.append((x, y, t))
    if not any(trace.contact for trace in traces):
        raise Refused(f"{path}: the pen never touches the surface")
    return traces


def convert_quickdraw(
    source: Union[Name, Iterable[Name]], target: Name, *, limit: int | None = None, strict: bool = False
) -> Converted:
    """Raw drawings of Quick, Draw! (ndjson) to a set that the lab reads.

    `source`: a file, several, or a folder of them. Every line is a drawing with `word` and `drawing`: strokes
    of x, y and time [ms] lists. The simplified files have no times and are refused. The label is the word;
    every drawing counts as a hand of its own (its `key_id`). `limit`: drawings of each file at most.
    """
    if limit is not None and limit < 1:
        raise Invalid(f"limit is {limit}; legal: 1 and more")
    sources = [source] if isinstance(source, (str, os.PathLike)) else list(source)
    paths = [path for one in sources for path in files_of(one, ".ndjson")]
    with Target(target, "ms", strict) as out:
        for index, path in enumerate(paths):
            name = os.path.splitext(os.path.basename(path))[0]
            inks: list[Ink] = []
            part = 0
            for ink in _drawings(path, limit, out):
                inks.append(ink)
                if len(inks) == DRAWINGS_PER_FILE:
                    out.add(f"{index:03}-{name}/{part:05}.inkml", "all", inks, path)
                    inks, part = [], part + 1
            if inks:
                out.add(f"{index:03}-{name}/{part:05}.inkml", "all", inks, path)
    return out.done


def _drawings(path: str, limit: int | None, out: Target) -> Iterator[Ink]:
    found = 0
    try:
        for at, line in _lines(path):
            if limit is not None and found >= limit:
                return
            try:
                if line is None:
                    raise Refused(f"{path}:{at}: a line of more than {LONGEST_LINE} bytes, the most that are read")
                if line.strip():
                    yield _drawing(line, f"{path}:{at}")
                    found += 1
            except Refused as error:
                out.leave_out(str(error))
    except Refused as error:
        out.leave_out(str(error))


def _lines(path: str) -> Iterator[tuple[int, bytes | None]]:
    """Every line with its number; none for one that is too long."""
    with opened(path) as file:
        at = 0
        try:
            while line := file.readline(LONGEST_LINE + 1):
                at += 1
                rest = line
                while len(rest) > LONGEST_LINE and not rest.endswith(b"\n"):
                    rest = file.readline(LONGEST_LINE + 1)
                yield at, line if len(line) <= LONGEST_LINE or line.endswith(b"\n") else None
        except OSError as error:
            raise Refused(f"{path}: {_why(error)}") from None


def _drawing(line: bytes, where: str) -> Ink:
    try:
        drawing = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise Refused(f"{where}: not JSON: {str(error)[:80]}") from None
    strokes = drawing.get("drawing") if isinstance(drawing, dict) else None
    if not isinstance(strokes, list) or not strokes:
        raise Refused(f"{where}: no strokes; legal: an object with word and drawing")
    traces = []
    for number_of, stroke in enumerate(strokes):
        what = f"{where}: stroke {number_of}"
        if isinstance(stroke, list) and len(stroke) == 2:
            raise Refused(f"{what} has no times: this is a simplified file; take the raw one")
        if not (isinstance(stroke, list) and len(stroke) == 3 and all(isinstance(axis, list) for axis in stroke)):
            raise Refused(f"{what}: legal: three lists, x, y and time")
        if len({len(axis) for axis in stroke}) != 1:
            raise Refused(f"{what}: lists of {[len(axis) for axis in stroke]} numbers; legal: of one length")
        points = [
            (position(x, f"{what}: x"), position(y, f"{what}: y"), number(t, f"{what}: time"))
            for x, y, t in zip(*stroke)
        ]
        if points:
            traces.append(Trace(points))
    if not traces:
        raise Refused(f"{where}: no points")
    word, key = label(drawing.get("word"), f"{where}: word"), hand(drawing.get("key_id"), f"{where}: key_id")
    return Ink(word, key, traces)
