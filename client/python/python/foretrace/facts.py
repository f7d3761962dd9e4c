"""A status as plain facts for other hosts, and how much trouble they tell of."""

from __future__ import annotations

import math
from typing import Any, Mapping

from . import messages
from .messages import FaultReason, Mode

#: Version of the facts; another one is read by name all the same.
VERSION = 1
#: A status that is older means that the daemon is gone or stuck [s].
STALE_S = 1.0

_NEVER = 2**64 - 1


def plain(value: Any) -> Any:
    """Numbers that JSON has no word for become none, also inside."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    return value


def number(value: Any) -> float | None:
    """A finite number; none for what is no number, or too large for one."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        told = float(value)
    except OverflowError:
        return None
    return told if math.isfinite(told) else None


def _age_s(age_ns: int) -> float | None:
    return None if age_ns == _NEVER else age_ns * 1e-9


def facts(status: messages.Status, now_ns: int) -> dict[str, Any]:
    """What others want to know of a status at `now_ns` [ns]: times in seconds, distances in metres, words for numbers."""
    told: dict[str, Any] = plain(
        {
            "version": VERSION,
            "mode": Mode.words(status.mode),
            "fault": FaultReason.words(status.fault),
            "status_age_s": max(0, now_ns - status.header.stamp_ns) * 1e-9,
            "daemon_id": f"{status.daemon_id:016x}",
            "pid": status.pid,
            "uptime_s": status.uptime_ns * 1e-9,
            "rate_hz": status.rate_hz,
            "measured_rate_hz": status.measured_rate_hz,
            "tick": status.tick,
            "trust": status.trust,
            "predictor": status.predictor.bytes.decode("ascii", "replace"),
            "pen_age_s": _age_s(status.pen_age_ns),
            "arm_age_s": _age_s(status.joint_state_age_ns),
            "tracking": status.tracking.to_dict(),
            "missing_rights": status.to_dict()["missing_rights"],
            "settings_revision": status.settings_revision,
            "settings_hash": f"{status.settings_hash:016x}",
            "note": status.note.text.decode("utf-8", "replace"),
            "note_to_do": status.note.to_do.decode("utf-8", "replace"),
            "joints_rad": list(status.joints_q),
        }
    )
    return told


#: Words of each rank, the worst first.
RANKS = ("no answer", "fault", "stopped", "stale", "slow", "silent arm", "runs", "idle")


def trouble(told: Mapping[str, Any] | None) -> tuple[int, str]:
    """Rank, 0 the worst, and the reason in words, of facts that may be anybody's; none: nobody answered."""
    if told is None:
        return 0, "its bridge is there, but gives no answer"
    mode, fault = str(told.get("mode")), str(told.get("fault"))
    note = str(told.get("note") or "")
    if mode == Mode.FAULT.label:
        return 1, note or fault
    if mode == Mode.STOPPED.label:
        return 2, note or fault
    age = number(told.get("status_age_s"))
    if age is None or not 0.0 <= age <= STALE_S:
        return 3, "the daemon is gone or stuck: no status for a second"
    rate, measured, uptime = (number(told.get(name)) for name in ("rate_hz", "measured_rate_hz", "uptime_s"))
    if rate is None or measured is None or uptime is None or rate <= 0.0:
        return 4, "its ticks per second are not told"
    if uptime > 2.0 and measured < 0.95 * rate:
        return 4, f"{measured:.0f} of {rate:.0f} ticks a second"
    arm_age = number(told.get("arm_age_s"))
    if mode != Mode.IDLE.label and not (arm_age is not None and 0.0 <= arm_age < 0.5):
        return 5, "no joint states"
    if mode == Mode.IDLE.label:
        return 7, note
    return 6, note
