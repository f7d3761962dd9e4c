"""What the tests share: a daemon of their own, other programs beside it, a perfect arm. FORETRACE is the program."""

import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import unittest

import foretrace
from foretrace.messages import Mode, RobotMode, SafetyMode

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("FORETRACE", str(ROOT / "target/debug/foretrace"))
#: Home of the preset ur5 [rad].
HOME = [3.1416, -1.3, 1.8, -2.0708, -1.5708, 0.0]
#: A machine with two busy cores starves programs without rights for longer than the preset's 50 ms.
PATIENT = ["--set", "safety.joint_state_timeout_ms=500"]
# A script in the background has its children ignore Ctrl-C; those of the tests obey it.
signal.signal(signal.SIGINT, signal.default_int_handler)


def until(what, condition, timeout=20.0):
    """Waits for what `condition` gives, which is then returned."""
    deadline = time.monotonic() + timeout
    while True:
        found = condition()
        if found:
            return found
        if time.monotonic() > deadline:
            raise AssertionError(f"not within {timeout} s: {what}")
        time.sleep(0.02)


class World(unittest.TestCase):
    """A run directory of its own, away from any daemon of this user."""

    #: Settings of the daemon.
    settings = PATIENT

    def setUp(self):
        # Sockets allow short paths only.
        self.folder = tempfile.mkdtemp(prefix="fp-", dir="/tmp")
        os.chmod(self.folder, 0o700)
        self._before = os.environ.get("XDG_RUNTIME_DIR")
        os.environ["XDG_RUNTIME_DIR"] = self.folder
        self.children = []

    def tearDown(self):
        for child in self.children:
            if child.poll() is None:
                child.kill()
            child.communicate()
        if self._before is None:
            del os.environ["XDG_RUNTIME_DIR"]
        else:
            os.environ["XDG_RUNTIME_DIR"] = self._before
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self, *arguments):
        child = subprocess.Popen([PROGRAM, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.children.append(child)
        return child

    def ask(self, *arguments):
        return subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, timeout=60)

    def daemon(self, *settings):
        daemon = self.start("daemon", "--no-rights", "--preset", "ur5", *self.settings, *settings)

        def up():
            if daemon.poll() is not None:
                raise AssertionError(daemon.communicate()[0])
            return self.ask("status").returncode == 0

        until("the daemon is up", up)
        return daemon

    @staticmethod
    def kill(child):
        child.send_signal(signal.SIGKILL)
        child.wait()

    def refuses(self, kind, *words):
        """A context in which `kind` is raised, and its text has all `words`."""
        return Refuses(self, kind, words)

    def armed(self, ft):
        """Arms as soon as the daemon lets it."""

        refusals = ["nobody asked"]

        def arm():
            try:
                return ft.arm()
            except foretrace.Refused as refused:
                refusals.append(str(refused))
                return None

        try:
            return until("the arm is armed", arm)
        except AssertionError:
            raise AssertionError(f"not armed: {refusals[-1]}") from None


class Refuses:
    def __init__(self, test, kind, words):
        self.test, self.kind, self.words = test, kind, words
        self.error = None

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        self.test.assertIsNotNone(error, f"{self.kind.__name__} was not raised")
        if not isinstance(error, self.kind):
            return False
        for word in self.words:
            self.test.assertIn(word, str(error))
        self.error = error
        return True


class PerfectArm(threading.Thread):
    """An arm that is at once where it is told to be, in a thread that may be made to fail."""

    def __init__(self, ft, rate_hz=250, **options):
        super().__init__(daemon=True)
        # As patient as the daemon of these tests.
        self.interface = ft.arm_interface(rate_hz, simulated=True, **{"pause_after": 0.4, **options})
        self.q, self.qd = list(HOME), [0.0] * 6
        self.targets = []
        self.block_s = 0.0
        self.wanted = True
        self.start()

    def run(self):
        try:
            for target in self.interface:
                if not self.wanted:
                    return
                if target.move:
                    self.q, self.qd = list(target.q), list(target.qd)
                else:
                    self.qd = [0.0] * 6
                self.targets.append((time.monotonic(), target))
                self.interface.measured(self.q, self.qd, safety_mode=SafetyMode.NORMAL, robot_mode=RobotMode.RUNNING)
                if self.block_s:
                    pause, self.block_s = self.block_s, 0.0
                    time.sleep(pause)
        except foretrace.Problem:
            if self.wanted:
                raise

    def end(self):
        self.wanted = False
        self.join()
        self.interface.close()


class Hand(threading.Thread):
    """Writes a circle of 2 cm until it is told to end."""

    def __init__(self, ft, **options):
        super().__init__(daemon=True)
        self.pen = ft.pen(**options)
        self.wanted = True
        self.error = None
        self.start()

    def run(self):
        import math

        try:
            for count in foretrace.Pace(200):
                if not self.wanted:
                    return
                angle = 2.0 * math.pi * count / 400.0
                self.pen.send(0.02 * math.sin(angle), 0.02 * math.cos(angle), True)
        except foretrace.Problem as problem:
            self.error = problem

    def end(self):
        self.wanted = False
        self.join()
        self.pen.close()


def following(ft):
    return ft.wait_until(lambda status: status.mode == Mode.FOLLOWING, timeout=20.0)
