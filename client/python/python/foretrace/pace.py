"""A loop at a steady rate."""

from __future__ import annotations

import time

from ._native import Invalid


class Pace:
    """Iterates at `rate_hz` [1/s], by absolute deadlines: `for count in ft.pace(50): ...`.

    Yields the number of the period, from 0. A body that takes longer than a period loses whole periods, which the
    number jumps over; it never runs twice to catch up.
    """

    def __init__(self, rate_hz: float) -> None:
        if not 0.001 <= rate_hz <= 10_000.0:
            raise Invalid(f"rate_hz = {rate_hz} Hz: from 0.001 to 10000")
        self._period_ns = round(1e9 / rate_hz)
        self._begin_ns: int | None = None
        self._count = -1
        #: Whole periods that the body took too long for.
        self.skipped = 0
        #: How late the newest period began [s].
        self.late_s = 0.0

    def __iter__(self) -> Pace:
        return self

    def __next__(self) -> int:
        now_ns = time.monotonic_ns()
        if self._begin_ns is None:
            self._begin_ns, self._count = now_ns, 0
            return 0
        due = self._count + 1
        missed = (now_ns - self._begin_ns) // self._period_ns - due
        if missed > 0:
            self.skipped += missed
            due += missed
        while (left_ns := self._begin_ns + due * self._period_ns - time.monotonic_ns()) > 0:
            time.sleep(left_ns * 1e-9)
        self.late_s = -left_ns * 1e-9
        self._count = due
        return due
