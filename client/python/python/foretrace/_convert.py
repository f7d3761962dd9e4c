"""Sets in formats that the lab does not read, as folders of InkML with a `split.tsv` that it does.

Every converter writes a new folder, which appears whole or not at all. What cannot be used is left out and
named in the result; with `strict` it is an error. Points are in memory for one file that is written at a time.
"""

from __future__ import annotations

import json
import os
import re
import xml.etree.ElementTree as ElementTree
from typing import Iterable, Iterator, Mapping, Union

from ._ink import (
    Converted, Ink, Name, Refused, Target, Trace, clean, content, files_of, hand, label, number, opened, position, why,
)
from ._native import Invalid, Problem

LARGEST_TEXT = 1 << 20
LONGEST_LINE = 16 << 20
DRAWINGS_PER_FILE = 500
#: Of a file of drawings, but for its last drawing.
POINTS_PER_FILE = 500_000


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
            try:
                inks = read.inks(name, ascii_.get(name, []))
            except Refused as error:
                out.leave_out(f"form {name}: {error}")
                continue
            out.add(f"{name.replace('/', '_')}.inkml", part, inks, f"form {name}")
    return out.done


class _IamForms:
    """What the files of IAM-OnDB are, by name of the form; points are read again form by form."""

    def __init__(self) -> None:
        self.about: dict[str, tuple[str, str, dict[int, str]]] = {}
        #: Of the lines by number, of the whole form by None.
        self.paths: dict[str, dict[int | None, str]] = {}

    def take(self, path: str) -> None:
        """Checks a file, a form or a line of one; keeps what is no point."""
        document = xml_of(path)
        stem, folder = os.path.splitext(os.path.basename(path))[0], os.path.basename(os.path.dirname(path))
        form, line = document.find("General/Form"), re.fullmatch(r"(.+)-([0-9]{1,9})", stem)
        for _ in _iam_traces(document, path):
            pass
        number_of: int | None = None
        if form is None and line is not None:
            name, number_of = line[1], int(line[2])
        else:
            # The file of form a01-001z is a01-001/strokesz.xml.
            own = folder + stem[len("strokes") :] if stem.startswith("strokes") else stem
            name = (hand(form.get("id"), f"{path}: id") if form is not None else None) or own
        # Before the file counts: one that is refused is not read again.
        writer = hand(form.get("writerID"), f"{path}: writerID") if form is not None else ""
        other = self.paths.setdefault(name, {}).setdefault(number_of, path)
        if other != path:
            what = f"form {name}" if number_of is None else f"line {number_of} of form {name}"
            raise Refused(f"{path}: {what} was read from {other} already")
        if form is not None:
            named: dict[int, str] = {}
            for item in document.iter("TextLine"):
                if known := re.fullmatch(r".*-([0-9]{1,9})", item.get("id", "")):
                    named.setdefault(int(known[1]), item.get("text", ""))
            text = (document.findtext("Transcription/Text") or "").strip()
            self.about[name] = (writer, text, named)

    def names(self) -> list[str]:
        """The forms, each once."""
        return sorted(self.paths)

    def inks(self, name: str, corrected: list[str]) -> list[Ink]:
        """The lines of a form, or where there are none all of it."""
        writer, text, named = self.about.get(name, ("", "", {}))
        lines = sorted((at, path) for at, path in self.paths[name].items() if at is not None)
        if not lines:
            return [Ink(text, writer, _iam_points(self.paths[name][None]))]
        found = []
        for at, path in lines:
            text = named.get(at) or (corrected[at - 1] if 1 <= at <= len(corrected) else "")
            found.append(Ink(text, writer, _iam_points(path)))
        return found


def _iam_points(path: str) -> list[Trace]:
    return list(_iam_traces(xml_of(path), path))


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
            part = points = 0
            for ink in _drawings(path, limit, out):
                inks.append(ink)
                points += sum(len(trace.points) for trace in ink.traces)
                if len(inks) == DRAWINGS_PER_FILE or points >= POINTS_PER_FILE:
                    added = out.add(f"{index:03}-{name}/{part:05}.inkml", "all", inks, path)
                    inks, part, points = [], part + 1, 0
                    if not added:
                        break
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
            raise Refused(f"{path}: {why(error)}") from None


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
