"""Every block of Python in the documents is run, each in a program of its own, beside a daemon and what it needs."""

import os
import re
import subprocess
import sys
import unittest

import foretrace
from foretrace.messages import Mode
from world import PROGRAM, ROOT, World, until

#: What a reader brings, and an end for programs that have none: (words in the block, lines before it).
HARNESS = """
import os, sys, threading, time
class _Pen:
    def __init__(self): self.left = 400
    def read(self):
        import math
        time.sleep(0.005)
        self.left -= 1
        if self.left < 0: raise SystemExit(0)
        return 0.02 * math.sin(self.left / 60), 0.02 * math.cos(self.left / 60), True
    def events(self):
        import numpy
        time.sleep(0.02)
        now = time.monotonic_ns()
        self.left -= 40
        if self.left < 0: raise SystemExit(0)
        return numpy.zeros(2), numpy.zeros(2), numpy.array([True, True]), numpy.array([now - 1000, now])
my_tablet = _Pen()
class _Switch:
    left = 20
    def is_held(self):
        self.left -= 1
        return self.left > 0
my_switch = _Switch()
"""


def blocks():
    found = []
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), ROOT / "client/python/README.md"]
    for page in pages:
        for body in re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S):
            found.append((page.relative_to(ROOT), body))
    return found


class Documents(World):
    def test_every_block_runs(self):
        found = [(page, body) for page, body in blocks() if "ft." in body or "foretrace.gateway" in body]
        self.assertGreater(len(found), 4)
        for page, body in found:
            with self.subTest(page=str(page), block=body.splitlines()[0]):
                self.run_beside_a_daemon(body)

    def run_beside_a_daemon(self, body):
        for wanted in ("numpy", "rtde_control", "mujoco"):
            if f"import {wanted}" in body or (wanted == "numpy" and ".drain(" in body):
                try:
                    __import__(wanted)
                except ImportError:
                    compile(body, "block", "exec")
                    return
        daemon = self.daemon("--set", "safety.enable_required=false")
        others = []
        if "arm_interface" in body:
            others.append(self.start("play", "glyphs:a", "--loop"))
        else:
            others.append(self.start("arm", "sim"))
            if "ft.pen" not in body and "gateway" not in body:
                others.append(self.start("play", "glyphs:a", "--loop"))
        if "gateway" in body:
            others.append(self.start("gateway", "--socket", "/tmp/foretrace-pen.socket", "--allow-uid", str(os.getuid())))
            until("the gateway", lambda: os.path.exists("/tmp/foretrace-pen.socket"))
        if "arm_interface" not in body:
            until("an arm", lambda: self.ask("request", "arm").returncode == 0)
            self.ask("request", "disarm")
            until("idle", lambda: '"idle"' in self.ask("status", "--json", "-").stdout or True)
        code = HARNESS + body
        child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.children.append(child)
        if "while True" in body or "in arm:" in body or "ft.watch" in body or "ft.pace" in body:
            # Programs without an end: seen to go on for a while, then ended as a user does.
            import signal
            import time

            if "arm_interface" in body:
                with foretrace.attach() as ft:
                    self.armed(ft)
                    ft.wait_until(lambda status: status.mode == Mode.FOLLOWING, timeout=20)
                    time.sleep(1.0)
            else:
                time.sleep(2.0)
            if child.poll() is None:
                child.send_signal(signal.SIGINT)
        out, error = child.communicate(timeout=30)
        if "KeyboardInterrupt" not in error:
            self.assertEqual(child.returncode, 0, f"{body}\n{error}")
        self.assertNotIn("Problem", error)
        self.assertNotIn("Error", error)
        for other in [*others, daemon]:
            other.terminate()
            other.communicate(timeout=20)


if __name__ == "__main__":
    unittest.main()
