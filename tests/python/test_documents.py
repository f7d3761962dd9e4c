"""Every block of Python in the documents is run, each in a program of its own, beside a daemon and what it needs."""

import os
import re
import signal
import subprocess
import sys
import time
import unittest

import foretrace
from foretrace.messages import Mode
from world import ROOT, World, until

#: The socket of the documents.
GATEWAY = "/tmp/foretrace-pen.socket"
#: What a reader brings: a tablet that is taken away after two seconds, and a switch that is let go.
HARNESS = """
import time
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
    # Those that need no daemon are run by the tests of the package.
    for page in [page for page in pages if page.name != "python-lab.md"]:
        for body in re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S):
            found.append((page.relative_to(ROOT), body))
    return found


class Documents(World):
    def test_every_block_runs(self):
        found = blocks()
        self.assertGreater(len(found), 4)
        for page, body in found:
            with self.subTest(page=str(page), block=body.splitlines()[0]):
                self.run_beside_a_daemon(body)

    def run_beside_a_daemon(self, body):
        if ".drain(" in body or "my_tablet.events" in body:
            try:
                import numpy  # noqa: F401
            except ImportError:
                compile(body, "block", "exec")
                return
        is_arm, is_pen = "arm_interface" in body, "ft.pen" in body or "foretrace.gateway" in body
        daemon = self.daemon()
        others = []
        if not is_arm:
            others.append(self.start("arm", "sim"))
            until("an arm", lambda: self.ask("request", "arm").returncode == 0)
            self.ask("request", "disarm")
        if "foretrace.gateway" in body:
            # A place of this test's own: another gateway may be at that of the documents.
            self.assertIn(GATEWAY, body)
            socket = f"{self.folder}/pen.socket"
            body = body.replace(GATEWAY, socket)
            others.append(self.start("gateway", "--socket", socket, "--allow-uid", str(os.getuid())))
            until("the gateway", lambda: os.path.exists(socket))
        elif not is_pen:
            others.append(self.start("play", "glyphs:a", "--loop"))
        child = subprocess.Popen(
            [sys.executable, "-c", HARNESS + body],
            # A predictor of the lab reads until its input ends.
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.children.append(child)
        endless = any(word in body for word in ("in arm:", "in predictor:", "ft.watch"))
        if is_arm:
            with foretrace.attach() as ft:
                self.armed(ft)
                ft.wait_until(lambda status: status.mode == Mode.FOLLOWING, timeout=20)
        if endless:
            time.sleep(1.0)
            self.assertIsNone(child.poll(), "a program without an end has ended")
            # As its user ends it.
            child.send_signal(signal.SIGINT)
        _, error = child.communicate(timeout=30)
        if endless:
            self.assertRegex(error, r"KeyboardInterrupt\s*$")
        else:
            self.assertEqual((child.returncode, error), (0, ""), body)
        for other in [*others, daemon]:
            other.terminate()
            other.communicate(timeout=20)


if __name__ == "__main__":
    unittest.main()
