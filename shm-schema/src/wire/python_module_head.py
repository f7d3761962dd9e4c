"""Messages of foretrace. Made by `foretrace schema python`; do not edit.

Lengths are metres, angles radians, times nanoseconds of CLOCK_MONOTONIC, which `time.monotonic_ns()` reads.
A record is a ctypes structure: `Status.from_buffer_copy(data)` reads one, `bytes(record)` writes it,
`Status.dtype()` is its numpy dtype. Enumerations and flags stand in its fields as numbers.
"""

from __future__ import annotations

import builtins
import ctypes
import enum
from typing import Any, ClassVar


class Enumeration(enum.IntEnum):
    """Numbers with words: `Mode.IDLE == 0`, `Mode.IDLE.label == "idle"`."""

    label: str

    def __new__(cls, number: int, label: str) -> Enumeration:
        member = int.__new__(cls, number)
        member._value_ = number
        member.label = label
        return member

    @classmethod
    def words(cls, number: int) -> str:
        """The label of a number, also of one that this version does not know."""
        return next((member.label for member in cls if member == number), f"unknown ({number})")


class Record(ctypes.LittleEndianStructure):
    """A message or a part of one."""

    #: The class of the enumeration or flags in a field.
    _kinds_: ClassVar[dict[str, type]] = {}

    def to_dict(self) -> dict[str, Any]:
        """All fields as plain values: words for enumerations, names for flags, lists for arrays."""
        return {name: self._plain(name, getattr(self, name)) for name, *_ in self._fields_}

    def _plain(self, name: str, value: Any) -> Any:
        if isinstance(value, ctypes.Array):
            # Each item is of the field's kind.
            return [self._plain(name, item) for item in value]
        kind = self._kinds_.get(name)
        if kind is not None and issubclass(kind, Enumeration):
            return kind.words(value)
        if kind is not None and issubclass(kind, enum.IntFlag):
            return [flag.name for flag in kind if value & flag]
        if isinstance(value, builtins.bytes):
            return value.decode("utf-8", "replace")
        if isinstance(value, Record):
            return value.to_dict()
        return value

    @classmethod
    def dtype(cls) -> Any:
        """The numpy dtype of this record; an array of it is `numpy.frombuffer(data, Status.dtype())`."""
        import numpy

        return numpy.dtype(cls)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and bytes(self) == bytes(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={value!r}" for name, value in self.to_dict().items())
        return f"{type(self).__name__}({fields})"


def _check(record: type[Record], size: int) -> None:
    if ctypes.sizeof(record) != size:
        raise ImportError(f"{record.__name__} has {ctypes.sizeof(record)} bytes here, {size} on the wire")


