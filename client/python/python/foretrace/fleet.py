"""All daemons in sight over zenoh, those in trouble first: python -m foretrace.fleet --connect tcp/HOST:7447

Asks the bridges (`python -m foretrace.zenoh_bridge`) that the endpoints reach; changes nothing. Exit code 0; 3 if one is in
trouble or an endpoint does not answer; 1 if none does.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any, NamedTuple

from ._native import Invalid, Problem
from .facts import RANKS, number, plain, trouble
from .zenoh_link import PREFIX, Tls, endpoint, is_name, open_session, read, tls

#: Daemons that are listed at most.
MOST = 1000
#: Ranks below this are trouble.
FINE = RANKS.index("runs")


class FleetRow(NamedTuple):
    """One daemon in sight."""

    host: str
    instance: str
    rank: int
    reason: str
    facts: dict[str, Any] | None


def shown(text: Any, most: int = 60) -> str:
    """A text of somebody else's, for a terminal."""
    plain_text = "".join(letter if letter.isprintable() else "?" for letter in str(text))
    return plain_text if len(plain_text) <= most else plain_text[: most - 1] + "…"


def rows(alive: set[tuple[str, str]], answers: dict[tuple[str, str], Any]) -> list[FleetRow]:
    """One row per daemon, those in trouble first."""
    found = []
    for host, instance in alive | set(answers):
        told = answers.get((host, instance))
        told = told if isinstance(told, dict) else None
        rank, reason = trouble(told)
        found.append(FleetRow(host, instance, rank, reason, told))
    return sorted(found, key=lambda row: (row.rank, row.host, row.instance))


def _place(key: Any) -> tuple[str, str] | None:
    parts = str(key).split("/")
    # Anybody may answer, under any key.
    if len(parts) == 4 and parts[0] == PREFIX and is_name(parts[1]) and is_name(parts[2]):
        return parts[1], parts[2]
    return None


def look(session: Any, seconds: float, alive: set[tuple[str, str]], answers: dict[tuple[str, str], Any]) -> None:
    """Asks everybody that `session` reaches, and waits for answers up to `seconds`."""
    for reply in session.liveliness().get(f"{PREFIX}/*/*/alive", timeout=seconds):
        if reply.ok is not None and len(alive) < MOST and (place := _place(reply.ok.key_expr)):
            alive.add(place)
    for reply in session.get(f"{PREFIX}/*/*/now", timeout=seconds):
        if reply.ok is not None and len(answers) < MOST and (place := _place(reply.ok.key_expr)):
            answers[place] = read(reply.ok.payload)


def table(found: list[FleetRow]) -> str:
    """For a terminal."""
    lines = [("host", "instance", "state", "mode", "trust", "lag ms", "why")]
    for row in found:
        told = row.facts or {}
        tracking = told.get("tracking")
        lag = number(tracking.get("recent_lag_s")) if isinstance(tracking, dict) else None
        trust = number(told.get("trust"))
        lines.append(
            (
                shown(row.host, 24), shown(row.instance, 8), RANKS[row.rank], shown(told.get("mode", "-"), 14),
                "-" if trust is None else shown(f"{trust:.2f}", 8), "-" if lag is None else shown(f"{lag * 1e3:.0f}", 8),
                shown(row.reason),
            )
        )
    widths = [max(len(line[at]) for line in lines) for at in range(len(lines[0]))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines)


def _problem(error: Exception, where: str) -> Problem:
    """What zenoh raises is of many kinds."""
    if isinstance(error, Problem):
        return error
    return Problem(f"{where}: {type(error).__name__}: {error}: is a bridge or a router of zenoh there?")


def main(arguments: list[str] | None = None) -> int:
    """Looks once, and prints."""
    parser = argparse.ArgumentParser(prog="python -m foretrace.fleet", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--connect", action="append", required=True, metavar="ENDPOINT", help="of a bridge or a router; may be repeated")
    parser.add_argument("--seconds", type=float, default=1.5, metavar="S", help="how long to wait for answers, 0.1 to 60 [1.5]")
    parser.add_argument("--json", action="store_true", help="as JSON")
    for file, what in (("root_ca", "who signed the certificates of others"), ("certificate", "of this end"), ("key", "of this end")):
        parser.add_argument(f"--tls-{file.replace('_', '-')}", dest=file, metavar="FILE", help=f"of endpoints tls/HOST:PORT, as PEM: {what}")
    given = parser.parse_args(arguments)
    if not 0.1 <= given.seconds <= 60.0:
        parser.error(f"--seconds {given.seconds}: from 0.1 to 60")
    try:
        files = tls("--tls", {key: path for key in Tls._fields if (path := getattr(given, key)) is not None})
    except Invalid as problem:
        parser.error(str(problem))
    alive: set[tuple[str, str]] = set()
    answers: dict[tuple[str, str], Any] = {}
    failed = 0
    for one in given.connect:
        try:
            session = open_session("client", [], [endpoint("--connect", one)], lasting=False, files=files)
            try:
                look(session, given.seconds, alive, answers)
            finally:
                session.close()
        except Exception as error:
            # One endpoint that fails, in whatever way, hides none of the others.
            failed += 1
            print(f"error: {_problem(error, one)}", file=sys.stderr)
    if failed == len(given.connect):
        return 1
    found = rows(alive, answers)
    if given.json:
        listed = [
            {"host": row.host, "instance": row.instance, "state": RANKS[row.rank], "why": row.reason, "facts": plain(row.facts)}
            for row in found
        ]
        print(json.dumps(listed, indent=2))
    else:
        print(table(found) if found else "no daemon is in sight")
    return 3 if failed or any(row.rank < FINE for row in found) else 0


if __name__ == "__main__":
    sys.exit(main())
