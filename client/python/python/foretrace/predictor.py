"""A predictor in this process: steps of the pen's grid in, previews out."""

from __future__ import annotations

from typing import Any, Iterator, Sequence

from . import _native, messages
from ._given import whole
from ._native import Invalid
from .handles import Closable


class PredictorInterface(Closable):
    """The predictor's place of an instance; made by `Foretrace.predictor_interface`.

    One per instance at a time. Steps come only while predictor `external` is chosen: by `predictor.kind` in the settings,
    or by `Foretrace.predictor("external")`. A preview is used if it comes before `predictor.external.most_late_steps`
    further steps have closed, and as far as it has proven better than the built-in one that stands in for it.
    """

    def __init__(self, native: _native.PredictorHandle) -> None:
        self._native = native

    def next(self, timeout: float = 1.0) -> messages.PenStep | None:
        """The next unread step; None where none comes within `timeout` [s]. Raises `Taken` if another program has the place
        of a new daemon.

        Positions and displacements are in the plane's frame [m]. A step whose `motion` is not `PenMotion.CONTINUES` begins
        anew: nothing before it belongs to it. Nor does a network's memory lead to a step whose `index` is not one more
        than that of the step before: those between were lost.
        """
        data = self._native.next(timeout)
        return None if data is None else messages.PenStep.from_buffer_copy(data)

    def __iter__(self) -> Iterator[messages.PenStep]:
        """Every step as it comes, without end."""
        while True:
            step = self.next()
            if step is not None:
                yield step

    @property
    def lost(self) -> int:
        """Steps that this program will never see: 256 (2.56 s at 10 ms) wait for it, older ones make room."""
        return self._native.lost

    def send(self, step: messages.PenStep | int, positions: Any, radii: Sequence[float] | None = None) -> bool:
        """Sends where the pen will be after `step` (or after the step of this index). Returns whether a daemon heard it.

        `positions`: 1 to 64 points (x, y), a list or an array of two columns [m], the first one step later; give
        `step.wanted`. Fewer than the plan looks at are refused by the daemon, and counted as malformed. `radii`: of each,
        the radius in which the pen is expected in nine of ten cases [m].

        Raises `Invalid` for numbers that are not finite or another count than 1 to 64, `Taken` if another program asked
        for the place, `NoDaemon`. What the daemon refuses (malformed, late, repeated, wild) it counts:
        `Foretrace.status().external`.
        """
        given = step.index if isinstance(step, messages.PenStep) else step
        index = whole("step", given, "a step or its index", "an index from 0 to 2^64 - 1")
        try:
            points = [[float(x), float(y)] for x, y in positions]
            widths = [] if radii is None else [float(radius) for radius in radii]
        except (TypeError, ValueError, OverflowError) as error:
            raise Invalid(f"positions are pairs of numbers [m], radii are numbers [m]: {error}") from None
        return self._native.send(index, points, widths)

    def handed_to(self) -> str | None:
        """Who asked for the place and has it."""
        return self._native.handed_to()

    def close(self) -> None:
        """Leaves the place to others; the fallback serves."""
        self._native.close()
