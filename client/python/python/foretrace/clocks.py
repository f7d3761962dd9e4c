"""Stamps of other clocks, on the clock of foretrace (CLOCK_MONOTONIC, `time.monotonic_ns()`)."""

from __future__ import annotations

import time
from typing import Callable

from ._native import Invalid

#: Two clocks drift apart by less than this.
_DRIFT = 100e-6


def _monotonic(stamp_ns: int) -> int:
    return stamp_ns


def _realtime(stamp_ns: int) -> int:
    """`time.time_ns()`, by the distance of both clocks at this moment."""
    before = time.monotonic_ns()
    there = time.time_ns()
    after = time.monotonic_ns()
    return stamp_ns - there + (before + after) // 2


class _Device:
    """A device's own counter of nanoseconds: the smallest delay seen counts as none, less what two clocks may drift."""

    def __init__(self) -> None:
        self._offset_ns: float | None = None
        self._seen_ns = 0
        self._stamp_ns = 0
        self._given_ns = 0

    def __call__(self, stamp_ns: int) -> int:
        now_ns = time.monotonic_ns()
        here_ns = float(now_ns - stamp_ns)
        if self._offset_ns is None or stamp_ns < self._stamp_ns:
            # The first stamp, or a device that began to count anew.
            self._offset_ns = here_ns
        else:
            self._offset_ns = min(self._offset_ns + _DRIFT * (now_ns - self._seen_ns), here_ns)
        self._seen_ns, self._stamp_ns = now_ns, stamp_ns
        # A better estimate may move stamps back; they must grow.
        self._given_ns = max(stamp_ns + round(self._offset_ns), self._given_ns + 1)
        return self._given_ns


def mapping(clock: str) -> Callable[[int], int]:
    """What maps stamps of `clock` [ns]: `"monotonic"`, `"realtime"` (`time.time_ns()`) or `"device"`."""
    if clock == "monotonic":
        return _monotonic
    if clock == "realtime":
        return _realtime
    if clock == "device":
        return _Device()
    raise Invalid(f"clock = {clock!r}: monotonic, realtime or device")
