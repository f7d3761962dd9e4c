"""What docs/operate/faults.md promises, seen from Python: killed, restarted, of another layout."""

import os
import pathlib
import re
import signal
import subprocess
import sys
import time
import unittest

import foretrace
from foretrace.messages import FaultReason, Mode
from test_threads import ARM
from world import Hand, PerfectArm, World, following, until


class Faults(World):
    def test_a_killed_daemon_is_told_and_the_next_one_is_found(self):
        daemon = self.daemon()
        with foretrace.attach() as ft:
            pen, ticks, switch = ft.pen(), ft.records("ticks"), ft.dead_man()
            until("the daemon hears", lambda: pen.send(0.0, 0.0, True))
            first = ft.status().daemon_id
            self.kill(daemon)
            with self.refuses(foretrace.NoDaemon, "instance 0"):
                until("it is gone", lambda: not ft.query())
            time.sleep(0.3)
            with self.refuses(foretrace.NoDaemon, "foretrace daemon"):
                ft.status()
            with self.refuses(foretrace.NoDaemon):
                ft.stop()
            self.assertFalse(ft.daemon_is_up())
            # Not heard, or refused: never an error that is none.
            try:
                until("nobody hears", lambda: not pen.send(0.0, 0.0, True))
            except foretrace.NoDaemon:
                pass
            self.daemon()
            self.assertTrue(ft.daemon_is_up())
            self.assertEqual(ft.query().mode, Mode.IDLE)
            until("the new daemon hears", lambda: pen.send(0.0, 0.0, True))
            until("the new daemon's status", lambda: ft.status(timeout=3.0).daemon_id != first)
            ticks.drain_records()
            until("the new daemon's ticks", lambda: any(tick.tick > 10 for tick in ticks.drain_records(0.5)))
            until("the switch beats", lambda: switch.beat() is None and ft.status().mode == Mode.IDLE)

    def test_a_block_that_armed_a_daemon_that_died_leaves_the_next_one_alone(self):
        daemon = self.daemon()
        with foretrace.attach() as outside:
            arm = PerfectArm(outside)
            with foretrace.attach() as ft:
                self.armed(ft)
                self.kill(daemon)
                self.daemon()
                until("the new one is there", lambda: outside.query().mode == Mode.IDLE)
                self.armed(outside)
            self.assertNotEqual(outside.query().mode, Mode.STOPPED)
            arm.end()

    def test_a_killed_arm_stops_the_loop_and_the_next_one_has_to_be_armed(self):
        self.daemon()
        with foretrace.attach() as ft:
            self.kill_arm(ft)
            status = ft.wait_until(lambda status: status.mode == Mode.STOPPED, timeout=10)
            self.assertEqual(status.fault, FaultReason.JOINT_STATE_STALE)
            arm = PerfectArm(ft)
            time.sleep(0.5)
            self.assertEqual(ft.query().mode, Mode.STOPPED)
            self.armed(ft)
            arm.end()

    def kill_arm(self, ft):
        child = subprocess.Popen(
            [sys.executable, "-c", ARM.replace('flush=True)\n        break', 'flush=True)')], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self.children.append(child)
        self.assertEqual(child.stdout.readline().strip(), "armed")
        self.assertNotEqual(ft.query().mode, Mode.IDLE)
        self.kill(child)

    def test_an_exception_in_the_block_is_told_before_a_stop_that_failed(self):
        daemon = self.daemon()
        arms = foretrace.attach()
        arm = PerfectArm(arms)
        with self.assertRaises(KeyError):
            with foretrace.attach() as ft:
                self.armed(ft)
                # Frozen: it takes no stop.
                os.kill(daemon.pid, 19)
                with self.assertWarnsRegex(RuntimeWarning, "did not stop the arm.*stop button"):
                    ft.__exit__(KeyError, KeyError("mine"), None)
                raise KeyError("mine")
        os.kill(daemon.pid, 18)
        arm.wanted = False
        arms.close()

    def test_a_daemon_of_another_layout_is_refused_with_both(self):
        self.daemon()
        ours, theirs = self.alter_the_layout()
        with self.refuses(foretrace.OtherVersion, ours, theirs, "PenSample", "one version of foretrace", "0.1.0"):
            foretrace.attach()

    def alter_the_layout(self):
        """Makes the daemon's pen one of another layout; the layouts, ours and theirs."""
        service = next(
            path
            for path in pathlib.Path(self.folder).rglob("*.service")
            if '"foretrace/pen"' in path.read_text(errors="replace")
        )
        text = service.read_text()
        ours = re.search(r'"foretrace.layout"\s*\n\s*value = "([0-9a-f]{16})"', text)[1]
        theirs = f"{int(ours, 16) ^ 1:016x}"
        mode = service.stat().st_mode
        service.chmod(0o600)
        service.write_text(text.replace(ours, theirs))
        service.chmod(mode)
        return ours, theirs

    def stands_still_over_a_restart(self, code, meanwhile):
        """A program that begins with `code` stands still while a daemon ends, a new one begins, and `meanwhile` is done;
        then it is told to go on. What it says."""
        daemon = self.daemon()
        child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.children.append(child)
        self.assertTrue(child.stdout.readline(), "it has begun")
        child.send_signal(signal.SIGSTOP)
        daemon.terminate()
        daemon.communicate(timeout=20)
        # As after an update: the new daemon makes its services anew.
        for service in pathlib.Path(self.folder).rglob("*.service"):
            service.unlink()
        self.daemon()
        try:
            meanwhile()
        finally:
            child.send_signal(signal.SIGCONT)
        out, error = child.communicate("\n", timeout=30)
        self.assertEqual(error, "")
        return out

    def test_a_new_daemon_of_another_layout_is_named_to_who_watches_already(self):
        layouts = []
        told = self.stands_still_over_a_restart(
            "import foretrace\n"
            "ft = foretrace.attach()\n"
            "ft.status()\n"
            "print('begun', flush=True)\n"
            "input()\n"
            "try:\n"
            "    print(ft.status(timeout=3.0))\n"
            "except foretrace.OtherVersion as problem:\n"
            "    print('other version:', problem)\n",
            lambda: layouts.extend(self.alter_the_layout()),
        )
        self.assertTrue(told.startswith("other version:"), told)
        for layout in layouts:
            self.assertIn(layout, told)

    def test_who_finds_his_place_taken_at_a_new_daemon_is_told(self):
        def take():
            self.other = foretrace.attach()
            self.addCleanup(self.other.close)
            self.other.arm_interface(100)

        told = self.stands_still_over_a_restart(
            "import foretrace, time\n"
            "from foretrace.messages import JointState\n"
            "ft = foretrace.attach()\n"
            "ports = ft.arm_ports()\n"
            "print('begun', flush=True)\n"
            "input()\n"
            "end = time.monotonic() + 10.0\n"
            "while time.monotonic() < end:\n"
            "    try:\n"
            "        ports.publish(JointState(), time.monotonic_ns())\n"
            "    except foretrace.Problem as problem:\n"
            "        print(type(problem).__name__, problem)\n"
            "        break\n"
            "    time.sleep(0.05)\n",
            take,
        )
        self.assertTrue(told.startswith("Taken"), told)

    def test_a_watch_never_begins_with_the_word_of_a_daemon_that_is_gone(self):
        daemon = self.daemon()
        with foretrace.attach() as ft:
            ft.status()
            self.kill(daemon)
            time.sleep(1.0)
            with self.refuses(foretrace.NoDaemon):
                next(ft.watch(timeout=0.3))

    def test_a_package_with_messages_of_another_layout_is_refused_at_import(self):
        # The module beside the library, altered.
        code = (
            "import sys, types, importlib.util, pathlib\n"
            "folder = pathlib.Path(importlib.util.find_spec('foretrace').submodule_search_locations[0])\n"
            "text = (folder / 'messages.py').read_text()\n"
            "module = types.ModuleType('foretrace.messages')\n"
            "sys.modules['foretrace.messages'] = module\n"
            "at = text.index('LAYOUT_HASH = ')\n"
            "exec(text[:at] + 'LAYOUT_HASH = 7\\n', module.__dict__)\n"
            "import foretrace\n"
        )
        told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        self.assertEqual(told.returncode, 1)
        self.assertIn("ImportError: foretrace/messages.py has layout 0000000000000007", told.stderr)
        self.assertIn("install the package again", told.stderr)

    def test_the_pen_falls_silent_when_its_program_ends(self):
        self.daemon()
        with foretrace.attach() as ft:
            arm = PerfectArm(ft)
            self.armed(ft)
            hand = Hand(ft)
            following(ft)
            hand.end()
            ft.wait_until(lambda status: status.mode == Mode.HOLDING, timeout=10)
            hand = Hand(ft)
            following(ft)
            hand.end()
            arm.end()


if __name__ == "__main__":
    unittest.main()
