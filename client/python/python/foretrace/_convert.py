"""Sets in formats that the lab does not read, as folders of InkML with a `split.tsv` that it does.

Every converter writes a new folder, which appears whole or not at all. What cannot be used is left out and
named in the result; with `strict` it is an error.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from typing import Any, Iterable, Iterator, Mapping, NamedTuple, Sequence, Union
from xml.sax.saxutils import escape

from ._native import Invalid, Problem

Name = Union[str, "os.PathLike[str]"]

LARGEST_FILE = 128 << 20
LONGEST_LINE = 16 << 20
DRAWINGS_PER_FILE = 500


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
        self.final = os.fspath(folder)
        if os.path.lexists(self.final):
            raise Problem(f"{self.final} exists already; give a new name, or remove it")
        self.part = ""
        self.unit, self.strict = time_unit, strict
        self.done = Converted(self.final)
        self.rows: list[tuple[str, str, str]] = []

    def __enter__(self) -> "Target":
        above, name = os.path.split(os.path.abspath(self.final))
        try:
            os.makedirs(above, exist_ok=True)
            self.part = tempfile.mkdtemp(prefix=f".{name}-", dir=above)
            os.chmod(self.part, 0o755)
        except OSError as error:
            raise Problem(f"cannot write {self.final}: {error.strerror}") from None
        return self

    def leave_out(self, why: str) -> None:
        """Remembers what is not used; an error where strict."""
        if self.strict:
            raise Problem(why)
        self.done.left_out.append(why)

    def add(self, name: str, part: str, inks: Sequence[Ink]) -> None:
        """One file with these sequences."""
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
        except OSError as error:
            raise Problem(f"cannot write {path}: {error.strerror}") from None
        writers = {ink.writer for ink in inks}
        self.rows.append((part, name, writers.pop() if len(writers) == 1 else ""))
        self.done.files += 1
        self.done.sequences += len(inks)

    def __exit__(self, kind: Any, *_: Any) -> None:
        if kind is None and self.rows:
            table = "".join(f"{part}\t{name}\t{writer}\n" for part, name, writer in self.rows)
            with open(os.path.join(self.part, "split.tsv"), "w", encoding="utf-8") as file:
                file.write("set\tfile\twriter\n" + table)
            os.rename(self.part, self.final)
            return
        shutil.rmtree(self.part, ignore_errors=True)
        if kind is None:
            first = f"; the first: {self.done.left_out[0]}" if self.done.left_out else ""
            raise Problem(f"nothing could be converted ({len(self.done.left_out)} left out{first}); no folder was written")


def clean(text: str) -> str:
    """In one line, without what XML and tables do not hold."""
    return re.sub(r"[\x00-\x1f\x7f\ufffe\uffff\ud800-\udfff]+", " ", text).strip()


def number(text: Any, what: str, most: float = 1e12) -> str:
    """`text`, if it is a finite number of ordinary size."""
    try:
        value = float(text)
    except (TypeError, ValueError):
        value = float("nan")
    if isinstance(text, bool) or not -most <= value <= most:
        raise Refused(f"{what} is {str(text)[:40]!r}; legal: numbers from -{most:g} to {most:g}")
    return str(text).strip()


def files_of(source: Name, ends: str) -> list[str]:
    """The file, or all files below the folder whose names end so, by name."""
    source = os.fspath(source)
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


def small(path: str) -> None:
    """Refuses what is no regular file of ordinary size."""
    if not os.path.isfile(path):
        raise Refused(f"{path}: not a regular file")
    if os.path.getsize(path) > LARGEST_FILE:
        raise Refused(f"{path}: it has {os.path.getsize(path)} bytes, {LARGEST_FILE} are the most that are read")


def xml_of(path: str) -> ElementTree.Element:
    """The document of a file; entities of its own are refused, which could fill the memory."""
    small(path)
    with open(path, "rb") as file:
        data = file.read()
    if b"<!ENTITY" in data:
        raise Refused(f"{path}: it defines entities; give files as IAM-OnDB publishes them")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise Refused(f"{path}: not XML: {error}") from None


def convert_iam_ondb(
    source: Name, target: Name, *, parts: Mapping[str, Name] | None = None, strict: bool = False
) -> Converted:
    """IAM-OnDB (XML, `WhiteboardCaptureSession`) to a set that the lab reads.

    `source`: the unpacked folder. Lines (`lineStrokes/`) become sequences where there are any, whole forms
    (`original/`) otherwise. Text and writer come from the forms (`Form writerID`, `TextLine`) or `ascii/`
    beside them. `parts`: a word for each list of forms that the database publishes, such as `{"train":
    "trainset.txt"}`; without it all is one part. Times in seconds and positions are kept as they stand; the
    database names no unit of length.

    Raises `Problem`: nothing usable, `target` exists, or (strict) the first bad file.
    """
    words = _parts(parts)
    with Target(target, "s", strict) as out:
        forms: dict[str, tuple[str, str, dict[str, str]]] = {}
        inks: dict[str, list[tuple[str, list[Trace]]]] = {}
        whole: dict[str, list[Trace]] = {}
        for path in files_of(source, ".xml"):
            try:
                document = xml_of(path)
                stem = os.path.splitext(os.path.basename(path))[0]
                form = document.find("General/Form")
                if form is not None:
                    name = form.get("id", "") or os.path.basename(os.path.dirname(path))
                    lines = {line.get("id", ""): line.get("text", "") for line in document.iter("TextLine")}
                    text = (document.findtext("Transcription/Text") or "").strip()
                    forms[name] = (form.get("writerID", ""), text, lines)
                traces = list(_iam_traces(document, path))
                if form is not None:
                    whole[name] = traces
                elif re.fullmatch(r".+-\d+", stem):
                    inks.setdefault(stem.rsplit("-", 1)[0], []).append((stem, traces))
                else:
                    whole[stem] = traces
            except Refused as error:
                out.leave_out(str(error))
        ascii_ = _iam_ascii(source)
        for name in sorted(inks or whole):
            part = words.get(name) or words.get(re.sub(r"[a-z]$", "", name)) if words else "all"
            if not part:
                out.leave_out(f"{name}: in none of the lists of parts")
                continue
            writer, text, lines = forms.get(name, ("", "", {}))
            if inks:
                found = []
                for line, traces in sorted(inks[name]):
                    at = int(line.rsplit("-", 1)[1]) - 1
                    csr = ascii_.get(name, [])
                    label = lines.get(line) or (csr[at] if 0 <= at < len(csr) else "")
                    found.append(Ink(label, writer, traces))
            else:
                found = [Ink(text, writer, whole[name])]
            out.add(f"{re.sub(r'[^A-Za-z0-9._-]', '_', name)}.inkml", part, found)
    return out.done


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
            x, y, t = (number(point.get(key), f"{what}: {key}") for key in ("x", "y", "time"))
            points.append((x, y, t))
        if points:
            yield Trace(points)


def _iam_ascii(source: Name) -> dict[str, list[str]]:
    """The corrected lines of `ascii/`, by form."""
    found: dict[str, list[str]] = {}
    folder = os.fspath(source)
    if not os.path.isdir(folder):
        return found
    for path in (p for p in _walk(folder, ".txt") if os.path.getsize(p) < 1 << 20):
        with open(path, encoding="utf-8", errors="replace") as file:
            _, mark, rest = file.read().partition("CSR:")
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
            with open(path, encoding="utf-8") as file:
                for line in file:
                    if line.strip():
                        words.setdefault(line.split()[0], word)
        except (OSError, UnicodeDecodeError) as error:
            raise Problem(f"{os.fspath(path)}: {error}") from None
    return words


def convert_svc2004(source: Name, target: Name, *, strict: bool = False) -> Converted:
    """Signatures of SVC2004 (text, `U1S1.TXT`) to a set that the lab reads.

    A line of the number of points, then per point x, y (upwards), time [ms], button (1: on the surface), and
    in task 2 azimuth, altitude and pressure, which are not kept. The hand is the user of the file's name for
    signatures 1 to 20; those from 21 on are forgeries by others: part `forgery`, hand unknown.
    """
    with Target(target, "ms", strict) as out:
        for path in files_of(source, ".txt"):
            name = os.path.splitext(os.path.basename(path))[0]
            try:
                match = re.fullmatch(r"(?i)u(\d+)s(\d+)", name)
                if match is None:
                    raise Refused(f"{path}: its name is not that of a signature, as U1S1.TXT")
                genuine = int(match[2]) <= 20
                ink = Ink("", f"u{int(match[1])}" if genuine else "", _svc_traces(path))
                out.add(f"{name.lower()}.inkml", "genuine" if genuine else "forgery", [ink])
            except Refused as error:
                out.leave_out(str(error))
    return out.done


def _svc_traces(path: str) -> list[Trace]:
    small(path)
    with open(path, encoding="ascii", errors="replace") as file:
        lines = [line.split() for line in file if line.strip()]
    if not lines or len(lines[0]) != 1 or not lines[0][0].isdigit():
        raise Refused(f"{path}:1: legal: the number of points, alone in the first line")
    if int(lines[0][0]) != len(lines) - 1:
        raise Refused(f"{path}: it holds {len(lines) - 1} points where its first line says {lines[0][0]}")
    traces: list[Trace] = []
    for at, cells in enumerate(lines[1:], 2):
        if len(cells) not in (4, 7):
            raise Refused(f"{path}:{at}: {len(cells)} numbers; legal: x y time button, or those and three more")
        x, y, t = (number(cell, f"{path}:{at}: {what}") for cell, what in zip(cells, ("x", "y", "time")))
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
            name = re.sub(r"[^A-Za-z0-9._-]", "_", os.path.splitext(os.path.basename(path))[0])
            inks: list[Ink] = []
            part = 0
            for ink in _drawings(path, limit, out):
                inks.append(ink)
                if len(inks) == DRAWINGS_PER_FILE:
                    out.add(f"{index:03}-{name}/{part:05}.inkml", "all", inks)
                    inks, part = [], part + 1
            if inks:
                out.add(f"{index:03}-{name}/{part:05}.inkml", "all", inks)
    return out.done


def _drawings(path: str, limit: int | None, out: Target) -> Iterator[Ink]:
    found = 0
    with open(path, "rb") as file:
        at = 0
        while (line := file.readline(LONGEST_LINE)) and (limit is None or found < limit):
            at += 1
            try:
                if len(line) == LONGEST_LINE:
                    while (more := file.readline(LONGEST_LINE)) and not more.endswith(b"\n"):
                        pass
                    raise Refused(f"{path}:{at}: a line of {LONGEST_LINE} bytes and more")
                if line.strip():
                    yield _drawing(line, f"{path}:{at}")
                    found += 1
            except Refused as error:
                out.leave_out(str(error))


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
            (number(x, f"{what}: x"), number(y, f"{what}: y"), number(t, f"{what}: time")) for x, y, t in zip(*stroke)
        ]
        if points:
            traces.append(Trace(points))
    if not traces:
        raise Refused(f"{where}: no points")
    return Ink(str(drawing.get("word", "")), str(drawing.get("key_id", "")), traces)
