"""Data sets of handwriting: every format that `foretrace lab` reads, as sequences of samples in metres.

    for sequence in foretrace.datasets.load("unipen-ced", split="test"):
        print(sequence.writer, sequence.label, sequence.samples["x_m"].max())

Sets that the lab does not read become folders that it does by `convert_iam_ondb`, `convert_svc2004` and
`convert_quickdraw`.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from typing import Any, Iterator, Sequence as Many, Union

from . import _arrays, _native
from ._arrays import PATH, PATH_SIZE, SAMPLES, SAMPLES_SIZE, Rows
from ._convert import convert_iam_ondb, convert_quickdraw, convert_svc2004
from ._ink import Converted
from ._native import Invalid
from ._settings import Settings, named

__all__ = [
    "Converted", "DataSet", "File", "Path", "Sequence", "SetRemark", "Stroke", "convert_iam_ondb",
    "convert_quickdraw", "convert_svc2004", "load", "path", "splits",
]

Name = Union[str, "os.PathLike[str]"]


class SetRemark(UserWarning):
    """What a reader did not take as it stands, could not read, or found damaged."""


def _values(rows: Rows, what: str) -> Any:
    """A structured array, or without numpy a list of tuples."""
    if _arrays.numpy is None:
        return list(zip(*(rows.column(name) for name, *_ in rows.fields)))
    return rows.array(what)


@dataclass(frozen=True)
class Stroke:
    """A run of samples with the pen on or above the surface, without a gap."""

    contact: bool
    samples: int
    gap_s: float | None
    """Recorded time without samples before it [s]."""
    continues: bool
    """The stroke before goes on behind a gap: the pen was not lifted."""


class Sequence:
    """A character, word or path of one hand. Facts are read at once, samples when they are asked for."""

    def __init__(self, of: Any, number: int):
        self._of, self._number = of, number
        self._kept: dict[str, Any] | None = None
        about = of.about(number)
        self.label: str = about["label"]
        """What was written; empty where the file has no label."""
        self.writer: str = about["writer"]
        """The hand, unique within a set; empty if unknown."""
        self.split: str | None = about["split"]
        """The part that the set puts its file into."""
        self.file: str = about["file"]
        self.index: int = about["index"]
        """The n-th of its file, from 0."""
        self.rate_hz: float = about["rate_hz"]
        self.rate_assumed: bool = about["rate_assumed"]
        """The file does not state the rate; the format's usual one was taken."""
        self.stamped: bool = about["stamped"]
        """The samples have stamps of the file; otherwise they are one over the rate apart."""
        self.metres_per_unit: tuple[float, float] = about["metres_per_unit"]
        self.unit_stated: bool = about["unit_stated"]
        """The file states its unit of length; otherwise a glyph of median height has `height_m`."""
        self.integrated: bool = about["integrated"]
        """The file holds velocities, which were summed up."""

    def _read(self) -> dict[str, Any]:
        if self._kept is None:
            self._kept = self._of.samples(self._number)
        return self._kept

    @property
    def samples(self) -> Any:
        """`t_s` [s], `x_m`, `y_m` [m] (y upwards), `contact` (on the surface), `stroke` (index of `strokes`),
        in the order of writing: a structured numpy array, or without numpy a list of tuples."""
        return _values(Rows(self._read()["rows"], SAMPLES_SIZE, SAMPLES), "samples as an array")

    @property
    def strokes(self) -> list[Stroke]:
        """Strokes and hover paths in the order of writing."""
        return [Stroke(*stroke) for stroke in self._read()["strokes"]]

    @property
    def place_holders(self) -> int:
        """Points `0 0` that stand for no position, and are not among the samples."""
        count: int = self._read()["place_holders"]
        return count

    def __repr__(self) -> str:
        return f"<Sequence {self.label!r} of {self.writer or 'an unknown hand'}, {self.file}>"


@dataclass(frozen=True)
class File:
    """A file of a set."""

    name: str
    split: str | None
    rate_hz: float
    rate_assumed: bool
    damage: str | None
    """Why only its beginning was read; None: it is whole."""


class DataSet:
    """One part of a set, or a file: a sequence of `Sequence`."""

    def __init__(self, of: Any):
        self._of = of
        self.name: str = of.name
        self.files = [File(*file) for file in of.files]
        self.errors: list[str] = of.errors
        """Files that could not be read and are left out, each with the reason."""
        self.remarks: list[str] = of.remarks
        """What was not taken as it stands, a line per kind; damaged files of which a beginning was read."""

    @property
    def writers(self) -> list[str]:
        """The hands, in order of appearance."""
        return list(dict.fromkeys(sequence.writer for sequence in self))

    def __len__(self) -> int:
        return len(self._of)

    def __getitem__(self, index: int) -> Sequence:
        number = index + len(self) if index < 0 else index
        if not 0 <= number < len(self):
            raise IndexError(f"sequence {index}; the set has {len(self)}")
        return Sequence(self._of, number)

    def __iter__(self) -> Iterator[Sequence]:
        return (Sequence(self._of, number) for number in range(len(self)))

    def __repr__(self) -> str:
        return f"<DataSet {self.name}: {len(self)} sequences in {len(self.files)} files>"


def load(
    source: Name,
    split: str = "all",
    *,
    strict: bool = False,
    unit: str | None = None,
    height_m: float = 0.03,
    quiet: bool = False,
) -> DataSet:
    """Loads a part of the set in a folder, or a single file.

    Formats are told by contents: UNIPEN, InkML, MATLAB (UCI Character Trajectories), CSV of tablets,
    browsers and phones, and recordings of `foretrace record`. `split`: a word of the set's `split.tsv` or
    file names (`splits` lists them), or `all`. `strict`: a bad file is an error instead of left out. `unit`:
    of CSV columns whose names have none (`mm`, `ms`, `mm,us`). `height_m` [m]: of a glyph of median height,
    where files state no unit of length. What was left out or mended is in `errors` and `remarks`, and shown
    as warnings unless `quiet`.

    Raises `Problem` with file, line and reason; `Invalid` for a split that the set has not.
    """
    found = DataSet(_native.load_set(os.fspath(source), split, strict, unit, height_m))
    if not quiet:
        for line in found.errors + found.remarks:
            warnings.warn(line, SetRemark, stacklevel=2)
    return found


def splits(folder: Name) -> list[str]:
    """The parts of the set in a folder, in order of appearance, then `all`."""
    return _native.set_splits(os.fspath(folder))


class Path:
    """A stamped pen path in the workspace of an arm, in the pen's own plane: what `foretrace play` feeds."""

    def __init__(self, found: dict[str, Any]):
        self._rows = Rows(found["rows"], PATH_SIZE, PATH)
        self.rate_hz: float = found["rate_hz"]
        self.spans: list[tuple[str, int, int]] = found["spans"]
        """Label, first sample and end of each character; travels are outside."""
        self.travels: int = found["travels"]
        """Lifts that were synthesised because the recording has none."""
        self.gaps: int = found["gaps"]
        self.notes: list[str] = found["notes"]
        """What was left out or taken otherwise, in words."""

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def samples(self) -> Any:
        """`t_s` [s], `x_m`, `y_m` [m], `contact`: a structured array, or without numpy a list of tuples."""
        return _values(self._rows, "samples as an array")

    def readings(self, begin_ns: int) -> list[tuple[int, float, float, bool]]:
        """The samples as `Follower.step` takes them: stamp [ns], x and y [m], contact; the first at
        `begin_ns`."""
        rows = [self._rows.column(name) for name, *_ in PATH]
        first = rows[0][0] if rows[0] else 0.0
        return [(begin_ns + round((t - first) * 1e9), x, y, contact) for t, x, y, contact in zip(*rows)]

    def __repr__(self) -> str:
        return f"<Path: {len(self)} samples at {self.rate_hz:g} Hz>"


def path(
    source: Union[Name, Many[Name]],
    settings: Settings = "ur5",
    *,
    height_m: float = 0.03,
    scale: float = 1.0,
    speed: float = 1.0,
    style: int = 1,
    label: str | None = None,
    segments: tuple[int, int] | None = None,
    unit: str | None = None,
    quiet: bool = False,
) -> Path:
    """A pen path from recordings, a set's folder, or the built-in writer (`glyphs:hello`).

    Recorded ink is put into the middle of the workspace of `settings`, `height_m` [m] high; a CSV in units of
    length is taken as it stands. `style`: the built-in writer's hand. `label`, `segments` (first, last): only
    these characters. Notes are shown as warnings unless `quiet`. Raises `Problem` or `Invalid`.
    """
    sources = [source] if isinstance(source, (str, os.PathLike)) else list(source)
    if not sources:
        raise Invalid("source is empty; legal: a path, several paths, or glyphs:TEXT")
    wishes = {
        "height_m": height_m, "scale": scale, "speed": speed, "style": style, "label": label,
        "segments": segments, "unit": unit,
    }
    found = Path(_native.pen_path([os.fspath(name) for name in sources], wishes, named(settings)))
    if not quiet:
        for line in found.notes:
            warnings.warn(line, SetRemark, stacklevel=2)
    return found
