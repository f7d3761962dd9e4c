"""Pen, gateway, dead-man switch, and what can be watched.

Every handle may be used from any Python thread, is closed by `close()`, at the end of its `with` block or of its
attachment, and lasts over restarts of the daemon. None may be used in a process that `fork` made.
"""

from __future__ import annotations

import os
from types import TracebackType
from typing import Any, Iterator, Protocol, Sequence, TypeVar

from . import _native, messages
from ._given import told, whole
from ._native import Invalid, Problem
from .clocks import mapping

#: A status that is older is not what the daemon does now [ns]: one comes each 100 ms.
FRESH_NS = 250_000_000

_Self = TypeVar("_Self", bound="Closable")


class Closable:
    """Something that is closed at the end of its block."""

    def close(self) -> Any:
        """Closes it; a second time does nothing."""
        raise NotImplementedError

    def __enter__(self: _Self) -> _Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class _Sender(Protocol):
    def send(self, samples: list[Any]) -> tuple[int, int, Exception | None]: ...


class _Feed(Closable):
    """What pens and gateways have in common."""

    _native: _Sender

    def __init__(self, native: _Sender, clock: str) -> None:
        self._map = mapping(clock)
        self._native = native

    def send(
        self,
        x: float,
        y: float,
        contact: bool,
        *,
        stamp: int | None = None,
        pressure: float | None = None,
        tilt: tuple[float, float] | None = None,
        flags: int = 0,
    ) -> bool:
        """Sends one sample: where the pen was, and when. Returns whether a daemon heard it.

        `x`, `y`: position [m] in the tablet's plane, x to the right, y away from the writer. `contact`: it touches.
        `stamp`: when it was there [ns], on the clock of this handle; none: now. `pressure`: 0 to 1. `tilt`: towards x
        and y from the plane's normal [rad]. `flags`: further `messages.PenFlags`, of hovering pens `IN_RANGE`.

        Raises `Invalid` for a number outside its bounds or a stamp of another clock, `Taken` if another program asked
        for the pen or has it, `NoDaemon`: then the sample was not sent. After `NoAnswer` or Ctrl-C it may have been.
        """
        sample = self._sample(x, y, contact, stamp, pressure, tilt, flags)
        _, heard, error = self._native.send([sample])
        if error is not None:
            raise error
        return heard == 1

    def send_many(
        self,
        x: Sequence[float],
        y: Sequence[float],
        contact: Sequence[bool] | bool,
        stamp: Sequence[int],
        pressure: Sequence[float] | None = None,
        tilt: Sequence[tuple[float, float]] | None = None,
        flags: Sequence[int] | int = 0,
    ) -> int:
        """Sends samples that came together, oldest first: lists, tuples or arrays of equal lengths, as `send` takes
        them; one `contact` or `flags` may stand for all. Returns how many were sent.

        Raises what `send` raises, with the number of those sent before as `error.sent`.
        """
        count = len(x)
        absent = [None] * count
        lists: dict[str, Any] = {
            "y": y, "contact": _each(contact, count), "stamp": stamp, "pressure": absent if pressure is None else pressure,
            "tilt": absent if tilt is None else tilt, "flags": _each(flags, count),
        }
        for name, values in lists.items():
            if len(values) != count:
                raise Invalid(f"{name} has {len(values)} values, x has {count}: one of each per sample")
        samples = [self._sample(*one) for one in zip(x, *lists.values())]
        sent, _, error = self._native.send(samples)
        if error is not None:
            error.sent = sent  # type: ignore[attr-defined]
            raise error
        return sent

    def _sample(
        self, x: Any, y: Any, contact: Any, stamp: Any, pressure: Any, tilt: Any, flags: Any
    ) -> tuple[int, float, float, bool, float | None, list[float] | None, int]:
        when = _native.now_ns() if stamp is None else self._map(whole("stamp", stamp, "whole nanoseconds", "0 to 2^64 - 1 ns"))
        if not 0 <= when < 2**64:
            raise Invalid(f"stamp = {stamp} ns is {when} ns on the clock of time.monotonic_ns(), which begins at 0")
        bits = _bits("flags", flags)
        leaning = None
        if tilt is not None:
            try:
                leaning = [_number("tilt", value, "rad") for value in tilt]
            except TypeError:
                leaning = [_number("tilt", tilt, "rad")]
            if len(leaning) != 2:
                raise Invalid(f"tilt is {told(tilt)}; legal: two numbers, towards x and y [rad]")
        pressed = None if pressure is None else _number("pressure", pressure, "0 to 1")
        return when, _number("x", x, "m"), _number("y", y, "m"), bool(contact), pressed, leaning, bits


def _each(value: Any, count: int) -> Any:
    """A list as it is; one value as often as it is needed."""
    try:
        len(value)
    except TypeError:
        return [value] * count
    return value


def _number(name: str, value: Any, unit: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise Invalid(f"{name} is {told(value)}; legal: a number [{unit}]") from None


def _bits(name: str, value: Any) -> int:
    return whole(name, value, "a whole number", f"0 to {2**32 - 1}", 2**32 - 1)


def _stamp(name: str, value: Any) -> int:
    return whole(name, value, "whole nanoseconds", "0 to 2^63 - 1 ns", 2**63 - 1)


def _seconds(name: str, value: Any) -> float:
    number = _number(name, value, "s")
    if not 0.0 <= number <= 3600.0:
        raise Invalid(f"{name} = {number} s: from 0 to 3600")
    return number


class Pen(_Feed):
    """Feeds the pen of an instance; made by `Foretrace.pen`.

    Repeat a pen at rest every 20 ms: silence means that it is gone. One pen per instance at a time; gives way to a
    program that asks for it.
    """

    _native: _native.PenHandle

    def handed_to(self) -> str | None:
        """Who asked for the pen and has it."""
        return self._native.handed_to()

    def close(self) -> None:
        """Leaves the pen to others."""
        self._native.close()


class Gateway(_Feed):
    """Feeds the pen through the socket of `foretrace gateway`, also as another user; made by `foretrace.gateway`."""

    _native: _native.GatewayHandle

    def close(self) -> str | None:
        """Ends the connection. Returns the gateway's last line: how many samples it passed on and refused, and why."""
        try:
            return self._native.close()
        except Problem:
            # It is over either way; what a send could not do was raised there.
            return None


def gateway(path: str | os.PathLike[str], *, clock: str = "monotonic") -> Gateway:
    """Connects to the socket of `foretrace gateway`; `clock` as in `Foretrace.pen`.

    Raises `NoDaemon` if nobody answers there, `Refused` with the gateway's reason.
    """
    mapping(clock)
    return Gateway(_native.GatewayHandle(os.fspath(path)), clock)


class DeadMan(Closable):
    """The dead-man switch of an instance; made by `Foretrace.dead_man`.

    Call `beat()` 50 times per second while it is held. Silence stops the arm: no thread beats for a program that
    hangs. It is not a safety function: that is the enabling device of the arm's own controller.
    """

    def __init__(self, native: _native.DeadManHandle) -> None:
        self._native = native

    def beat(self) -> None:
        """Says "go on". Raises `Taken` if another program asked for the switch."""
        self._native.beat()

    def stop(self) -> None:
        """Says "stop": sooner than silence does."""
        self._native.stop()

    def handed_to(self) -> str | None:
        """Who asked for the switch and has it."""
        return self._native.handed_to()

    def close(self) -> None:
        """Falls silent, which stops an arm that was enabled."""
        self._native.close()


class Records(Closable):
    """Every message of a kind from now on; made by `Foretrace.records`.

    A thread of the package collects them, so that a program that is busy loses none before 8 MiB wait.
    """

    def __init__(self, native: _native.WatchHandle, record: type[messages.Record]) -> None:
        self._native = native
        self._record = record

    def drain(self, timeout: float = 0.0) -> Any:
        """Takes all that has come, oldest first, as one numpy array of `messages`' dtype; waits up to `timeout` [s] for
        the first. The array is read-only, and empty where nothing came.

        Raises `Problem` where numpy is not installed: `drain_records` needs none.
        """
        try:
            import numpy
        except ImportError:
            raise Problem("numpy is not installed: `pip install numpy`, or use drain_records()") from None
        return numpy.frombuffer(self._native.drain(timeout), self._record.dtype())

    def drain_records(self, timeout: float = 0.0) -> list[Any]:
        """As `drain`, as a list of records of `messages`."""
        data = self._native.drain(timeout)
        size = self._native.record_size
        return [self._record.from_buffer_copy(data, at) for at in range(0, len(data), size)]

    @property
    def lost(self) -> int:
        """Messages that were sent and did not come here."""
        return self._native.lost

    @property
    def refused(self) -> int:
        """Messages that came and were no legal ones."""
        return self._native.refused

    def close(self) -> None:
        """Watches no longer."""
        self._native.close()


class StatusWatch:
    """The newest status whenever there is a newer one; made by `Foretrace.watch`. One that is overtaken by the next
    before it is asked for is not given. Where an error ends a loop over it, the next may go on."""

    def __init__(self, native: _native.StatusHandle, timeout: float) -> None:
        self._native = native
        self._timeout = timeout
        # What is older is the word of a daemon that may be gone.
        self._stamp_ns = max(0, _native.now_ns() - FRESH_NS)

    def __iter__(self) -> Iterator[messages.Status]:
        return self

    def __next__(self) -> messages.Status:
        status = messages.Status.from_buffer_copy(self._native.newer(self._stamp_ns, self._timeout))
        self._stamp_ns = status.header.stamp_ns
        return status
