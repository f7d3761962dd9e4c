"""The bridge to other hosts, and the fleet: facts and files without zenoh, the rest where it is installed."""

import importlib.util
import json
import math
import os
import signal
import socket
import subprocess
import sys
import unittest

import foretrace
from foretrace import fleet, zenoh_bridge, zenoh_link
from foretrace.facts import facts, plain, trouble
from foretrace.messages import FaultReason, Mode, Status
from world import PerfectArm, World, until

ZENOH = importlib.util.find_spec("zenoh") is not None
TOML = any(importlib.util.find_spec(name) for name in ("tomllib", "tomli"))


class Facts(unittest.TestCase):
    def test_facts_are_json_whatever_the_status_holds(self):
        status = Status(mode=Mode.STOPPED, fault=FaultReason.JOINT_STATE_STALE, trust=math.nan)
        status.pen_age_ns = 2**64 - 1
        told = json.loads(json.dumps(facts(status, 10**9), allow_nan=False))
        self.assertEqual((told["mode"], told["trust"], told["pen_age_s"]), ("stopped", None, None))
        noise = Status.from_buffer_copy(os.urandom(len(bytes(status))))
        json.dumps(facts(noise, 5), allow_nan=False)
        self.assertEqual(plain({"a": [math.inf, (1.0, -math.inf)]}), {"a": [None, [1.0, None]]})

    def test_trouble_comes_first_and_nonsense_is_trouble(self):
        fine = {"mode": "following", "status_age_s": 0.1, "rate_hz": 500, "measured_rate_hz": 499.0, "uptime_s": 9, "arm_age_s": 0.01}
        self.assertEqual(trouble(fine)[0], fleet.FINE)
        for worse, rank in (
            (None, 0), ({**fine, "mode": "fault", "fault": "robot stopped"}, 1), ({**fine, "mode": "stopped", "note": "door"}, 2),
            ({**fine, "status_age_s": 5.0}, 3), ({}, 3), ({**fine, "status_age_s": "now"}, 3),
            ({**fine, "measured_rate_hz": 400.0}, 4), ({**fine, "arm_age_s": None}, 5), ({**fine, "rate_hz": []}, fleet.FINE),
        ):
            self.assertEqual(trouble(worse)[0], rank, worse)
        found = fleet.rows({("a", "0"), ("b", "0"), ("c", "0")}, {("a", "0"): fine, ("b", "0"): "\x1b[2Jnonsense", ("d", "1"): {"mode": "idle", "status_age_s": 0}})
        self.assertEqual([row.host for row in found], ["b", "c", "a", "d"])
        told = fleet.table([fleet.FleetRow("x\x1b[31m", "0", 2, "y" * 500, {"mode": {"a": 1}, "trust": "z", "tracking": 3})])
        self.assertNotIn("\x1b", told)
        self.assertLess(max(map(len, told.splitlines())), 200)

    def test_what_somebody_sent_is_read_or_none(self):
        for bad in (b"", b"\xff\xfe", b"{", b"[" * 200_000, b" " * (zenoh_link.LARGEST + 1)):
            self.assertIsNone(zenoh_link.read(bad))
        self.assertEqual(zenoh_link.read(b'{"a": 1}'), {"a": 1})

    @unittest.skipUnless(TOML, "Python 3.10 without tomli")
    def test_settings_are_refused_with_key_value_and_bound(self):
        good = 'host = "cell-3"\n[zenoh]\nlisten = ["tcp/127.0.0.1:7447"]\n'
        given = zenoh_bridge.settings(good, "file")
        self.assertEqual((given.host, given.instances, given.telemetry_hz, given.connect), ("cell-3", [0], 10.0, []))
        for text, words in (
            ("host = [", "no TOML"), ("", "listen and zenoh.connect are empty"), (f"hots = 1\n{good}", "hots is not a setting: host"),
            (good.replace("cell-3", "a/b"), "host = 'a/b'"), (f"telemetry_hz = 900\n{good}", "from 0.0 to 50.0"),
            (f"telemetry_hz = nan\n{good}", "telemetry_hz"), (f"status_hz = true\n{good}", "status_hz"),
            (f"instances = [0, 0]\n{good}", "different"), (f"instances = [-1]\n{good}", "instances"), ("zenoh = 3", "a table"),
            (good.replace("tcp/", "http://"), "an endpoint of zenoh"), (good + 'mode = "router"', '"peer" or "client"'),
            (good + "scouting = true", "zenoh.scouting is not a setting"),
        ):
            with self.assertRaises(foretrace.Invalid) as raised:
                zenoh_bridge.settings(text, "file")
            self.assertIn(words, str(raised.exception))
            self.assertIn("file", str(raised.exception))


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@unittest.skipUnless(ZENOH and TOML, "eclipse-zenoh is not installed")
class Bridge(World):
    def run_module(self, name, *arguments):
        return subprocess.run(
            [sys.executable, "-m", f"foretrace.{name}", *arguments], capture_output=True, text=True, timeout=60
        )

    def test_a_fleet_sees_the_daemons_of_a_host_and_who_is_in_trouble(self):
        end = f"tcp/127.0.0.1:{free_port()}"
        path = f"{self.folder}/bridge.toml"
        with open(path, "w", encoding="utf-8") as file:
            file.write(f'host = "cell-3"\ninstances = [0, 1]\n[zenoh]\nlisten = ["{end}"]\n')
        self.assertEqual(self.run_module("fleet", "--connect", end).returncode, 1)
        self.daemon()
        bridge = subprocess.Popen([sys.executable, "-m", "foretrace.zenoh_bridge", "--config", path], stderr=subprocess.PIPE, text=True)
        self.children.append(bridge)

        def seen():
            self.assertIsNone(bridge.poll(), "the bridge ended")
            told = self.run_module("fleet", "--connect", end, "--json")
            return told.returncode in (0, 3) and json.loads(told.stdout)

        found = until("the daemon is seen", seen)
        self.assertEqual(len(found), 1, found)
        (row,) = found
        self.assertEqual((row["host"], row["instance"], row["state"]), ("cell-3", "0", "idle"))

        import zenoh

        session = zenoh_link.open_session("client", [], [end], lasting=False)
        came = {"status": [], "stop": [], "telemetry": []}
        watching = session.declare_subscriber(
            "foretrace/cell-3/0/*", lambda sample: came[str(sample.key_expr).rsplit("/", 1)[1]].append(zenoh_link.read(sample.payload))
        )
        with foretrace.attach() as ft:
            arm = PerfectArm(ft)
            self.armed(ft)
            until("an armed status", lambda: any(one["mode"] != "idle" for one in came["status"]))
            until("telemetry", lambda: came["telemetry"] and came["telemetry"][-1]["ticks"])
            ft.stop()
            until("the stop", lambda: came["stop"])
            self.assertEqual(came["stop"][0]["mode"], "stopped")
            arm.end()
        self.assertLessEqual(len(came["telemetry"][-1]["ticks"]), 21)
        self.assertGreater(came["telemetry"][-1]["of"], 100)
        (reply,) = list(session.get("foretrace/cell-3/0/settings", timeout=10.0))
        self.assertIn("joint_state_timeout_ms", bytes(reply.ok.payload).decode())
        # Nothing comes in.
        session.put("foretrace/cell-3/0/status", b"{}")
        watching.undeclare()
        session.close()
        told = self.run_module("fleet", "--connect", end)
        self.assertEqual(told.returncode, 3, told.stderr)
        self.assertIn("stopped", told.stdout)
        bridge.send_signal(signal.SIGTERM)
        self.assertEqual(bridge.wait(15), 0)
        self.assertIn("no daemon running for instance 1", bridge.stderr.read())
        self.assertEqual(self.run_module("fleet", "--connect", end).returncode, 1)

    def test_a_bridge_without_a_file_or_a_place_ends_with_a_reason(self):
        told = self.run_module("zenoh_bridge", "--config", "/nowhere/bridge.toml")
        self.assertEqual((told.returncode, "/nowhere/bridge.toml" in told.stderr), (2, True))
        path = f"{self.folder}/bridge.toml"
        with open(path, "w", encoding="utf-8") as file:
            file.write('[zenoh]\nlisten = ["tcp/192.0.2.1:7447"]\n')
        told = self.run_module("zenoh_bridge", "--config", path)
        self.assertEqual(told.returncode, 1, told.stderr)
        self.assertIn("tcp/192.0.2.1:7447", told.stderr)
        self.assertNotIn("Traceback", told.stderr)


if __name__ == "__main__":
    unittest.main()
