"""Shows the daemons of this host to others over zenoh: python -m foretrace.zenoh_bridge --config FILE

Out go, below foretrace/HOST/INSTANCE/: `status` (facts as JSON), `stop` (facts, when an arm has stopped), `telemetry` (a few
ticks per second as JSON), and a liveliness token `alive` while a daemon runs. Queries are answered: `now` (facts of this
moment) and `settings` (TOML). Nothing comes in: nobody can move, stop or set anything over zenoh. Nobody is looked for:
endpoints stand in FILE, as TOML:

    host = "cell-3"                 # default: this machine's name
    instances = [0, 1]              # default: [0]
    status_hz = 2.0                 # 0.1 to 10; default 2
    telemetry_hz = 10.0             # 0 (none) to 50; default 10
    [zenoh]
    mode = "peer"                   # or "client"; default "peer"
    listen = ["tcp/127.0.0.1:7447"]
    connect = []
    [zenoh.tls]                     # files for endpoints tls/HOST:PORT; with all three, others need a certificate as well
    root_ca = "ca.pem"
    certificate = "cell-3.pem"
    key = "cell-3.key"
"""

from __future__ import annotations

import argparse
import json
import math
import pathlib
import signal
import socket
import sys
import threading
import time
from typing import Any, Mapping, NamedTuple

from . import Foretrace, Problem, attach, now_ns
from ._native import Invalid
from .facts import facts, plain
from .handles import Records
from .messages import Mode
from .zenoh_link import PREFIX, Tls, endpoint, name, open_session, tls

#: Largest file of settings [bytes].
LARGEST = 1 << 16
#: Between two looks for a daemon that is away [s].
AGAIN_S = 1.0


class BridgeSettings(NamedTuple):
    """What the file says."""

    host: str
    instances: list[int]
    status_hz: float
    telemetry_hz: float
    mode: str
    listen: list[str]
    connect: list[str]
    tls: Tls


def settings(text: str, where: str) -> BridgeSettings:
    """Reads the settings. Raises `Invalid` with the key, its value and the bound."""
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        # The extra `zenoh` brings it.
        import tomli as tomllib
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise Invalid(f"{where}: no TOML: {error}") from None

    def known(part: Mapping[str, Any], keys: set[str], inside: str) -> None:
        for key in part:
            if key not in keys:
                raise Invalid(f"{where}: {inside}{key} is not a setting: {', '.join(sorted(keys))}")

    def number(key: str, default: float, least: float, most: float) -> float:
        value = table.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= most:
            raise Invalid(f"{where}: {key} = {value!r}: a number from {least} to {most}")
        return float(value)

    known(table, {"host", "instances", "status_hz", "telemetry_hz", "zenoh"}, "")
    zenoh = table.get("zenoh", {})
    if not isinstance(zenoh, dict):
        raise Invalid(f"{where}: zenoh = {zenoh!r}: a table, [zenoh]")
    known(zenoh, {"mode", "listen", "connect", "tls"}, "zenoh.")
    mode = zenoh.get("mode", "peer")
    if mode not in ("peer", "client"):
        raise Invalid(f'{where}: zenoh.mode = {mode!r}: "peer" or "client"')
    instances = table.get("instances", [0])
    legal = isinstance(instances, list) and 1 <= len(instances) <= 16 and len(set(map(repr, instances))) == len(instances)
    if not legal or not all(type(one) is int and 0 <= one < 2**32 for one in instances):
        raise Invalid(f"{where}: instances = {instances!r}: 1 to 16 different whole numbers")
    ends: dict[str, list[str]] = {}
    for key in ("listen", "connect"):
        given = zenoh.get(key, [])
        if not isinstance(given, list) or len(given) > 16:
            raise Invalid(f"{where}: zenoh.{key} = {given!r}: a list of at most 16 endpoints")
        ends[key] = [endpoint(f"{where}: zenoh.{key}", one) for one in given]
    if not ends["listen"] and not ends["connect"]:
        raise Invalid(f"{where}: zenoh.listen and zenoh.connect are empty: name an endpoint, nobody is looked for")
    host = name(f"{where}: host", table.get("host", socket.gethostname()))
    return BridgeSettings(
        host, instances, number("status_hz", 2.0, 0.1, 10.0), number("telemetry_hz", 10.0, 0.0, 50.0), mode, ends["listen"],
        ends["connect"], tls(f"{where}: zenoh.tls", zenoh.get("tls", {})),
    )


class _Instance(threading.Thread):
    """One daemon, as long as the bridge runs."""

    def __init__(self, session: Any, given: BridgeSettings, number: int, over: threading.Event) -> None:
        super().__init__(name=f"foretrace-{number}", daemon=True)
        self.session, self.given, self.number, self.over = session, given, number, over
        self.base = f"{PREFIX}/{given.host}/{number}"
        self.said = ""

    def say(self, text: str) -> None:
        """Once, until something else is to be said."""
        if text != self.said:
            self.said = text
            print(f"{self.base}: {text}", file=sys.stderr, flush=True)

    def run(self) -> None:
        while not self.over.is_set():
            try:
                with attach(self.number) as ft:
                    self.say("its daemon is there")
                    self.show(ft)
            except Problem as problem:
                self.say(str(problem))
            except Exception as error:
                # Of zenoh, or a defect: the other instances go on, and so does this one.
                self.say(f"{type(error).__name__}: {error}: trying again")
            self.over.wait(AGAIN_S)

    def show(self, ft: Foretrace) -> None:
        """Until the daemon is gone."""
        token = self.session.liveliness().declare_token(f"{self.base}/alive")
        now = self.session.declare_queryable(f"{self.base}/now", lambda query: self.answer(query, ft, "now", self.now))
        asked = self.session.declare_queryable(f"{self.base}/settings", lambda query: self.answer(query, ft, "settings", self.toml))
        try:
            ticks = ft.records("ticks") if self.given.telemetry_hz > 0.0 else None
            self.publish(ft, ticks)
        finally:
            for one in (asked, now, token):
                one.undeclare()

    def publish(self, ft: Foretrace, ticks: Records | None) -> None:
        stopped = (Mode.STOPPED, Mode.FAULT)
        mode, next_status, next_ticks = -1, 0.0, 0.0
        for status in ft.watch(timeout=2.0):
            if self.over.is_set():
                return
            moment = time.monotonic()
            if status.mode in stopped and status.mode != mode:
                self.put("stop", {**facts(status, now_ns()), "cause": plain(status.stop.to_dict())})
            if status.mode != mode or moment >= next_status:
                mode, next_status = status.mode, moment + 1.0 / self.given.status_hz
                self.put("status", facts(status, now_ns()))
            if ticks is not None and moment >= next_ticks:
                next_ticks = moment + 1.0
                self.put("telemetry", self.decimated(ticks))

    def decimated(self, ticks: Records) -> dict[str, Any]:
        """A few ticks of the last second, evenly."""
        records = ticks.drain_records()
        every = max(1, math.ceil(len(records) / self.given.telemetry_hz))
        kept = [
            {
                "tick": one.tick, "stamp_ns": one.header.stamp_ns, "mode": Mode.words(one.mode), "pen_m": list(one.pen_m),
                "measured_rad": list(one.measured_q), "slack_ns": one.slack_ns,
            }
            for one in records[::every]
        ]
        return {"of": len(records), "lost": ticks.lost, "ticks": plain(kept)}

    def put(self, key: str, value: Any) -> None:
        self.session.put(f"{self.base}/{key}", json.dumps(value, allow_nan=False))

    @staticmethod
    def now(ft: Foretrace) -> str:
        return json.dumps(facts(ft.status(), now_ns()), allow_nan=False)

    @staticmethod
    def toml(ft: Foretrace) -> str:
        return ft.settings().text

    def answer(self, query: Any, ft: Foretrace, key: str, give: Any) -> None:
        try:
            # Under its own key: a question may be for many.
            query.reply(f"{self.base}/{key}", give(ft))
        except Exception as error:
            if not isinstance(error, Problem):
                self.say(f"{key}: {type(error).__name__}: {error}")
            query.reply_err(json.dumps({"problem": str(error)}))


def main(arguments: list[str] | None = None) -> int:
    """Runs until SIGINT or SIGTERM; 2 for settings that cannot be used, 1 for what failed."""
    parser = argparse.ArgumentParser(prog="python -m foretrace.zenoh_bridge", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--config", required=True, metavar="FILE", help="settings, as TOML")
    path = pathlib.Path(parser.parse_args(arguments).config)
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
        if len(data) > LARGEST:
            raise Invalid(f"{path}: more than {LARGEST} bytes: no settings of a bridge")
        given = settings(data.decode("utf-8"), str(path))
    except (OSError, UnicodeDecodeError, Invalid) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    try:
        session = open_session(given.mode, given.listen, given.connect, lasting=True, files=given.tls)
    except Problem as problem:
        print(f"error: {problem}", file=sys.stderr)
        return 1
    threads = [_Instance(session, given, number, over) for number in given.instances]
    for thread in threads:
        thread.start()
    over.wait()
    for thread in threads:
        thread.join(5.0)
    session.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
