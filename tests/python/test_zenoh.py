"""The bridge to other hosts, and the fleet: facts and files without zenoh, the rest where it is installed."""

import contextlib
import importlib.util
import io
import json
import math
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from unittest import mock

import foretrace
from foretrace import fleet, zenoh_bridge, zenoh_link
from foretrace.facts import facts, plain, trouble
from foretrace.messages import FaultReason, Mode, Status, TickRecord
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
            ({**fine, "status_age_s": -5}, 3), ({**fine, "status_age_s": math.nan}, 3), ({**fine, "status_age_s": True}, 3),
            ({**fine, "status_age_s": 10**400}, 3), ({**fine, "measured_rate_hz": 400.0}, 4), ({**fine, "rate_hz": []}, 4),
            ({**fine, "rate_hz": 10**400}, 4), ({**fine, "rate_hz": -500}, 4), ({**fine, "uptime_s": None}, 4),
            ({**fine, "measured_rate_hz": math.nan}, 4), ({**fine, "arm_age_s": None}, 5), ({**fine, "arm_age_s": -1}, 5),
            ({**fine, "arm_age_s": 10**400}, 5),
        ):
            self.assertEqual(trouble(worse)[0], rank, worse)
        found = fleet.rows({("a", "0"), ("b", "0"), ("c", "0")}, {("a", "0"): fine, ("b", "0"): "\x1b[2Jnonsense", ("d", "1"): {**fine, "mode": "idle"}})
        self.assertEqual([row.host for row in found], ["b", "c", "a", "d"])
        told = fleet.table([fleet.FleetRow("x\x1b[31m", "0", 2, "y" * 500, {"mode": {"a": 1}, "trust": "z", "tracking": 3})])
        told += fleet.table([fleet.FleetRow("x", "0", 2, "", {"trust": 10**400, "tracking": {"recent_lag_s": 1e300}})])
        self.assertNotIn("\x1b", told)
        self.assertLess(max(map(len, told.splitlines())), 200)

    def test_what_somebody_sent_is_read_or_none(self):
        nested = [b"[" * deep + b"]" * deep for deep in (zenoh_link.DEEPEST + 2, 500)]
        for bad in (b"", b"\xff\xfe", b"{", b"[" * 200_000, b" " * (zenoh_link.LARGEST + 1), *nested, b'{"a":' * 40 + b"1" + b"}" * 40):
            self.assertIsNone(zenoh_link.read(bad))
        self.assertEqual(zenoh_link.read(b'{"a": 1}'), {"a": 1})
        deep = zenoh_link.DEEPEST
        self.assertIsNotNone(zenoh_link.read(b"[" * deep + b"]" * deep))

    def test_an_error_of_any_kind_is_said_and_the_instance_goes_on(self):
        over = threading.Event()
        given = zenoh_bridge.BridgeSettings("cell-3", [0], 2.0, 10.0, "peer", [], [], zenoh_link.Tls())
        one = zenoh_bridge._Instance(None, given, 0, over)
        told, tries = [], []
        one.say = told.append

        def attach(number):
            tries.append(number)
            if len(tries) == 2:
                over.set()
            raise ZeroDivisionError("of zenoh")

        with mock.patch.object(zenoh_bridge, "attach", attach), mock.patch.object(zenoh_bridge, "AGAIN_S", 0.01):
            one.run()
        self.assertEqual(len(tries), 2)
        self.assertIn("ZeroDivisionError: of zenoh", told[0])

    def test_a_fleet_says_what_fails_at_one_endpoint_and_goes_on(self):
        def open_session(*_, **__):
            raise ZeroDivisionError("of zenoh")

        with mock.patch.object(fleet, "open_session", open_session), contextlib.redirect_stderr(io.StringIO()) as told:
            self.assertEqual(fleet.main(["--connect", "tcp/a:1", "--connect", "tcp/b:2"]), 1)
        self.assertEqual(told.getvalue().count("error: tcp/"), 2)
        self.assertIn("tcp/b:2: ZeroDivisionError", told.getvalue())

    def test_ticks_are_never_more_than_were_asked_for(self):
        given = zenoh_bridge.BridgeSettings("cell-3", [0], 2.0, 10.0, "peer", [], [], zenoh_link.Tls())
        one = zenoh_bridge._Instance(None, given, 0, threading.Event())
        for count in (0, 9, 10, 14, 149, 500):
            ticks = mock.Mock(lost=0, drain_records=lambda count=count: [TickRecord() for _ in range(count)])
            kept = one.decimated(ticks)["ticks"]
            self.assertLessEqual(len(kept), 10)
            self.assertGreaterEqual(len(kept), min(count, 5))

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
            (good + "scouting = true", "zenoh.scouting is not a setting"), (good + "tls = 3", "zenoh.tls = 3"),
            (good + 'tls = { root_ca = "/nowhere/ca.pem" }', "zenoh.tls.root_ca = '/nowhere/ca.pem': no such file"),
            (good + f'tls = {{ key = "{__file__}" }}', "certificate and key belong together"), (good + "tls = { cipher = 1 }", "root_ca"),
        ):
            with self.assertRaises(foretrace.Invalid) as raised:
                zenoh_bridge.settings(text, "file")
            self.assertIn(words, str(raised.exception))
            self.assertIn("file", str(raised.exception))


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@unittest.skipUnless(ZENOH and shutil.which("openssl"), "eclipse-zenoh or openssl is not installed")
@unittest.skipUnless(TOML, "Python 3.10 without tomli")
class Certificates(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="fp-", dir="/tmp"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def openssl(self, *arguments):
        subprocess.run(["openssl", *map(str, arguments)], cwd=self.folder, check=True, capture_output=True)

    def authority(self, name):
        self.openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", 2, "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.pem")

    def end(self, name, authority):
        """Files of an end, its certificate signed by `authority`."""
        self.openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.csr")
        (self.folder / "names").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\nextendedKeyUsage=serverAuth,clientAuth\n")
        self.openssl("x509", "-req", "-in", f"{name}.csr", "-CA", f"{authority}.pem", "-CAkey", f"{authority}.key", "-CAcreateserial", "-days", 2, "-extfile", "names", "-out", f"{name}.pem")
        return {"root_ca": str(self.folder / f"{authority}.pem"), "certificate": str(self.folder / f"{name}.pem"), "key": str(self.folder / f"{name}.key")}

    def test_only_ends_with_a_certificate_of_the_same_authority_take_part(self):
        self.authority("ours")
        self.authority("theirs")
        ours, friend, stranger = self.end("cell-3", "ours"), self.end("office", "ours"), self.end("stranger", "theirs")
        end = f"tls/localhost:{free_port()}"
        path = self.folder / "bridge.toml"
        files = ", ".join(f"{key} = {json.dumps(value)}" for key, value in ours.items())
        path.write_text(f'host = "cell-3"\n[zenoh]\nlisten = ["{end}"]\ntls = {{ {files} }}\n')
        given = zenoh_bridge.settings(path.read_text(), "file")
        bridge = zenoh_link.open_session(given.mode, given.listen, given.connect, lasting=True, files=given.tls)
        self.addCleanup(bridge.close)
        alive = bridge.liveliness().declare_token("foretrace/cell-3/0/alive")

        def options(files):
            return [part for key, value in files.items() for part in (f"--tls-{key.replace('_', '-')}", value)]

        def seen(files):
            with contextlib.redirect_stdout(io.StringIO()) as told, contextlib.redirect_stderr(io.StringIO()):
                fleet.main(["--connect", end, *options(files)])
            return "cell-3" in told.getvalue()

        until("a friend sees it", lambda: seen(friend))
        # Of another authority; without any certificate.
        self.assertFalse(seen({**stranger, "root_ca": ours["root_ca"]}))
        self.assertFalse(seen({"root_ca": ours["root_ca"]}))
        self.assertFalse(seen(stranger))
        self.assertTrue(seen(friend))
        alive.undeclare()


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
        # Nothing comes in: whatever is put or asked, the daemon and what is told of it stay as they were.
        watching.undeclare()
        for key in ("status", "stop", "now", "settings", "alive", "arm", "disarm"):
            session.put(f"foretrace/cell-3/0/{key}", b'{"mode": "idle"}')
            session.delete(f"foretrace/cell-3/0/{key}")
            list(session.get(f"foretrace/cell-3/0/{key}", payload=b'{"mode": "idle"}', timeout=2.0))
        time.sleep(0.5)
        (reply,) = list(session.get("foretrace/cell-3/0/now", timeout=10.0))
        self.assertEqual(zenoh_link.read(reply.ok.payload)["mode"], "stopped")
        with foretrace.attach() as ft:
            self.assertEqual(ft.query().mode, Mode.STOPPED)
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
