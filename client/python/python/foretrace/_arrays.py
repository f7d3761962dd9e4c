"""Rows of bytes as numpy arrays, or without numpy as lists."""

from __future__ import annotations

import struct
from typing import Any

from ._native import Problem

try:
    import numpy as numpy
except ImportError:
    numpy = None  # type: ignore[assignment]

#: How numbers of the wire are called, by numpy and by `struct`.
NUMBERS = {
    "u8": ("<u1", "B"),
    "u16": ("<u2", "H"),
    "u32": ("<u4", "I"),
    "u64": ("<u8", "Q"),
    "i32": ("<i4", "i"),
    "i64": ("<i8", "q"),
    "f32": ("<f4", "f"),
    "f64": ("<f8", "d"),
    "bool": ("?", "?"),
}


def need_numpy(what: str) -> Any:
    """numpy, or a `Problem` that says how to get it."""
    if numpy is None:
        raise Problem(f"{what} needs numpy: pip install numpy (or: pip install 'foretrace[numpy]')")
    return numpy


class Rows:
    """Packed rows of one layout: `fields` are (name, number, offset, count) with `number` a key of NUMBERS."""

    def __init__(self, data: bytes, size: int, fields: list[tuple[str, str, int, int]]):
        self.data, self.size, self.fields = data, size, fields

    def __len__(self) -> int:
        return len(self.data) // self.size if self.size else 0

    def column(self, name: str) -> list[Any]:
        """The values of one field, one per row; of fields with several numbers, tuples."""
        for found, number, offset, count in self.fields:
            if found == name:
                form = struct.Struct(f"<{count}{NUMBERS[number][1]}")
                places = range(offset, len(self) * self.size, self.size)
                values = (form.unpack_from(self.data, place) for place in places)
                return [value[0] for value in values] if count == 1 else list(values)
        raise KeyError(f"no field {name}; there are: {', '.join(field[0] for field in self.fields)}")

    def array(self, what: str) -> Any:
        """A structured array over the same bytes (read-only)."""
        return need_numpy(what).frombuffer(self.data, dtype=self.dtype(what))

    def dtype(self, what: str) -> Any:
        """numpy's layout of a row."""
        return need_numpy(what).dtype(
            {
                "names": [name for name, *_ in self.fields],
                "formats": [
                    NUMBERS[number][0] if count == 1 else (NUMBERS[number][0], (count,))
                    for _, number, _, count in self.fields
                ],
                "offsets": [offset for _, _, offset, _ in self.fields],
                "itemsize": self.size,
            }
        )


#: A pen's samples on the path that a player feeds: t [s], x and y [m], contact.
PATH = [("t_s", "f64", 0, 1), ("x_m", "f64", 8, 1), ("y_m", "f64", 16, 1), ("contact", "bool", 24, 1)]
PATH_SIZE = 25
#: Those of a recording: stamp [ns].
PEN = [("stamp_ns", "u64", 0, 1), *PATH[1:]]
#: Those of a data set, with the number of their stroke.
SAMPLES = [*PATH, ("stroke", "u32", 25, 1)]
SAMPLES_SIZE = 29
