"""The examples, as their users start them: beside a daemon, a pen, and a simulated controller where they need one."""

import importlib.util
import signal
import subprocess
import sys
import unittest

import foretrace
from foretrace.messages import Mode
from world import ROOT, PerfectArm, World, following, until

EXAMPLES = ROOT / "client/python/examples"
#: An address of its own for the simulated controller, whose ports are fixed.
ROBOT = "127.0.0.23"


def there(module):
    return importlib.util.find_spec(module) is not None


class Examples(World):
    def example(self, name, *arguments):
        child = subprocess.Popen(
            [sys.executable, str(EXAMPLES / name), *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.children.append(child)
        return child

    def ends(self, child, seconds=30):
        child.send_signal(signal.SIGINT)
        out, error = child.communicate(timeout=seconds)
        self.assertIn("KeyboardInterrupt", error)
        self.assertNotIn("Problem", error)
        return out

    def test_a_pen_that_writes_and_a_status_line(self):
        self.daemon()
        with foretrace.attach() as ft:
            arm = PerfectArm(ft)
            line, pen = self.example("status_line.py"), self.example("write_circle.py")
            self.armed(ft)
            following(ft)
            self.assertIn("following", until("a line", lambda: (text := line.stdout.readline()) and "following" in text and text))
            self.ends(pen)
            self.ends(line)
            arm.end()

    @unittest.skipUnless(there("rtde_control"), "ur_rtde is not installed")
    def test_a_simulated_robot_of_universal_robots_follows_by_servoj(self):
        self.start("ur-sim", "--series", "cb3", "--bind", ROBOT)
        until("the controller", lambda: self.ask("doctor", "--robot", ROBOT).stdout)
        self.daemon("--set", "robot.controller_rate_hz=125")
        arm = self.example("ur_servoj.py", ROBOT)
        self.follows(arm)

    @unittest.skipUnless(there("mujoco"), "mujoco is not installed")
    def test_an_arm_with_physics_follows(self):
        self.daemon()
        arm = self.example("mujoco_arm.py", str(ROOT / "config/robots/ur5.urdf"))
        self.follows(arm)

    def follows(self, arm):
        with foretrace.attach() as ft:
            until("it reports", lambda: arm.poll() is not None or ft.status().joint_state_age_ns < 10**9, timeout=40)
            self.assertIsNone(arm.poll(), arm.stderr.read() if arm.poll() is not None else "")
            self.armed(ft)
            pen = self.example("write_circle.py")
            following(ft)
            status = ft.wait_until(lambda status: 0.0 < status.tracking.session_rms_m < 0.02, timeout=30)
            self.assertEqual(status.mode, Mode.FOLLOWING)
            ft.stop()
            ft.wait_until(lambda status: status.mode == Mode.STOPPED, timeout=5)
            self.ends(pen)
            self.ends(arm)


if __name__ == "__main__":
    unittest.main()
