"""An arm in Python behind the law, in lock-step."""

import importlib.util
import math
import os
import socket
import subprocess
import sys
import unittest
from functools import partial
from unittest import mock

import foretrace
from foretrace import Invalid, Problem, lab
from support import ROOT, Scratch, needs_numpy, numpy, program

BEGIN = lab.Begin(0.002, 0, (0.5,) * 6)


def command(tick, q, enabled=True):
    return lab.ArmCommand(tick * 2_000_000, tick, enabled, (q,) * 6, (0.0,) * 6)


class Logging:
    """Goes where it is told, and keeps what it was told and what it said."""

    def __init__(self, begin):
        self.q, self.begin, self.log = list(begin.home), begin, []

    def step(self, command):
        before = list(self.q)
        if command.enabled:
            self.q = list(command.q)
        self.log.append((command, list(self.q), before))
        return self.q, command.qd


class FirstOrder(unittest.TestCase):
    def test_a_ramp_is_followed_as_the_differential_equation_says(self):
        tau, slope = 0.03, 0.4
        arm = lab.FirstOrder(BEGIN, tau, delay_ticks=0)
        for tick in range(1, 400):
            t = tick * 0.002
            answer = arm.step(command(tick, 0.5 + slope * t))
            wanted = 0.5 + slope * (t - tau * (1.0 - math.exp(-t / tau)))
            self.assertAlmostEqual(answer.q[3], wanted, 12)
            self.assertAlmostEqual(answer.qd[3], slope * (1.0 - math.exp(-t / tau)), 10)

    def test_a_delay_is_whole_ticks_and_an_arm_nobody_commands_comes_to_rest(self):
        plain, late = lab.FirstOrder(BEGIN, 0.02, 0), lab.FirstOrder(BEGIN, 0.02, 5)
        positions = [plain.step(command(tick, 0.5 + 0.01 * math.sin(tick / 9))).q[0] for tick in range(1, 100)]
        delayed = [late.step(command(tick, 0.5 + 0.01 * math.sin(tick / 9))).q[0] for tick in range(1, 105)]
        self.assertEqual(delayed[5:104], positions[:99])
        self.assertAlmostEqual(late.group_delay_s, 0.03, 12)
        for tick in range(105, 700):
            answer = late.step(command(tick, 9.0, enabled=False))
        self.assertLess(max(map(abs, answer.qd)), 1e-9)
        for wrong in ({"time_constant_s": 0.0}, {"delay_ticks": -1}):
            with self.assertRaises(Invalid):
                lab.FirstOrder(BEGIN, **wrong)


class ClosedLoop(Scratch):
    def run_with(self, arm, **options):
        options = {"text": "hi", "predictor": "mixture", **options}
        return lab.closed_loop(arm, program=program(), **options)

    def test_commands_and_answers_cross_bit_for_bit(self):
        found = self.run_with(Logging, ticks=True)
        [arm] = found.arms
        columns = found.tick_columns()
        self.assertEqual(len(columns["t_s"]), len(arm.log))
        self.assertGreater(len(arm.log), 500)
        self.assertEqual((arm.begin.period_s, len(arm.begin.home)), (0.002, 6))
        for joint in range(6):
            asked = columns[f"q{joint + 1}"]
            for tick, (told, _, before) in enumerate(arm.log):
                self.assertEqual(told.tick, tick)
                if told.enabled:
                    self.assertEqual(asked[tick], told.q[joint])
                self.assertEqual(columns[f"measured_q{joint + 1}"][tick], before[joint])
        again = self.run_with(Logging, ticks=True)
        self.assertEqual((again.rows, again.ticks_csv), (found.rows, found.ticks_csv))
        self.assertEqual(found.trials[0]["writer"], "built-in 1")
        self.assertIn("socket", found.output)

    def test_an_arm_with_more_lag_is_worse_and_prediction_helps(self):
        error = lambda **options: self.run_with(**options).rows[0]["mse_m2"]
        quick = error(arm=partial(lab.FirstOrder, time_constant_s=0.01))
        slow = error(arm=partial(lab.FirstOrder, time_constant_s=0.06))
        blind = error(arm=partial(lab.FirstOrder, time_constant_s=0.06), predictor="hold")
        self.assertLess(quick, slow)
        self.assertLess(slow, 0.8 * blind)

    @needs_numpy
    def test_a_stamp_may_be_a_whole_number_of_numpy(self):
        class Stamped(Logging):
            def step(self, command):
                q, qd = super().step(command)
                return lab.Answer(q, qd, stamp_ns=numpy.int64(command.until_ns))

        self.assertEqual(self.run_with(Stamped).rows, self.run_with(Logging).rows)

    def test_every_hand_gets_an_arm_of_its_own_and_settings_reach_the_law(self):
        found = self.run_with(Logging, text=["a", "b"], changes={"loop": {"rate_hz": 250}, "pen.step_ms": 8})
        self.assertEqual([arm.begin.period_s for arm in found.arms], [0.004, 0.004])
        self.assertEqual(len(found.trials), 2)
        path = self.write("own.toml", 'preset = "ur5"\nloop.rate_hz = 250\npen.step_ms = 8\n')
        by_file = self.run_with(Logging, text=["a", "b"], settings=path)
        self.assertEqual(by_file.rows, found.rows)

    def test_a_stop_that_is_asked_for_is_told(self):
        found = self.run_with(Logging, stop_at_s=1.0, after_stop_s=0.5)
        self.assertEqual(found.trials[0]["stop"]["reason"], "Requested")
        self.assertIn("stop after 1.0", found.notes)

    def test_a_data_set_is_written_too(self):
        import test_datasets

        folder = os.path.dirname(self.write("set/a.inkml", test_datasets.INKML))
        found = self.run_with(partial(lab.FirstOrder, time_constant_s=0.02), text=None, data=folder, limit=1)
        self.assertEqual(found.trials[0]["writer"], "w7")

    @needs_numpy
    def test_columns_of_ticks_are_arrays(self):
        found = self.run_with(Logging, ticks=True)
        steps = numpy.diff(found.tick_array("t_s"))
        self.assertLess(abs(steps - 0.002).max(), 1e-9)
        with self.assertRaisesRegex(KeyError, "no column nothing; there are: hand"):
            found.tick_array("nothing")

    def test_what_goes_wrong_is_said_and_the_program_is_gone(self):
        class Failing(Logging):
            def step(self, command):
                if command.tick == 30:
                    raise RuntimeError("the simulator fell over")
                return super().step(command)

        class Nan(Logging):
            def step(self, command):
                return [math.nan] * 6 if command.tick == 9 else self.q, [0.0] * 6

        class Short(Logging):
            def step(self, command):
                return self.q[:5], [0.0] * 6

        class Back(Logging):
            def step(self, command):
                return lab.Answer(self.q, [0.0] * 6, stamp_ns=command.until_ns + 1)

        class Wordless(Logging):
            def step(self, command):
                return None

        class Far(Logging):
            def step(self, command):
                return [1e3] * 6, [0.0] * 6

        class Unit(Logging):
            effort_unit = "lbf"

        class Huge(Logging):
            def step(self, command):
                return [10**400] * 6, [0.0] * 6

        class Rate(Logging):
            rate_hz = "fast"

        class Delay(Logging):
            group_delay_s = 10**400

        class Wordy(Logging):
            def step(self, command):
                return lab.Answer(self.q, [0.0] * 6, stamp_ns="now")

        class Fractional(Logging):
            def step(self, command):
                return lab.Answer(self.q, [0.0] * 6, stamp_ns=5.0)

        for arm, error, why in [
            (Failing, RuntimeError, "the simulator fell over"), (Nan, Invalid, "q at tick 9 is .*nan"),
            (Short, Invalid, "q at tick 0 is .*6 finite numbers"), (Back, Invalid, "stamp_ns at tick 0"),
            (Wordless, Invalid, "gave None; legal: Answer"), (Far, Problem, "1000"), (Unit, Invalid, "effort_unit is 'lbf'"),
            (Huge, Invalid, "q at tick 0 is"), (Rate, Invalid, "rate_hz is fast"), (Delay, Invalid, "group_delay_s is 1000"),
            (Wordy, Invalid, "stamp_ns at tick 0 is now; legal: whole nanoseconds"),
            (Fractional, Invalid, "stamp_ns at tick 0 is 5.0; legal: whole nanoseconds"),
        ]:
            with self.assertRaisesRegex(error, why):
                self.run_with(arm)
        for options, error, why in [
            ({"text": None}, Invalid, "either text"), ({"data": self.folder}, Invalid, "either text"),
            ({"predictor": "nobody"}, Problem, "nobody"), ({"changes": {"loop.rate_hz": 77}}, Problem, "rate_hz"),
            ({"settings": "ur6"}, Problem, "ur6"), ({"settings": 7}, Invalid, "settings are a int"),
            ({"settings": {"loop.rate_hz": 500}}, Invalid, "need a preset"), ({"settings": {"preset": 5}}, Invalid, "preset is 5"), ({"text": None, "data": self.path("none")}, Problem, "none"),
        ]:
            with self.assertRaisesRegex(error, why):
                self.run_with(Logging, **options)
        with self.assertRaisesRegex(Invalid, "arm is a int"):
            self.run_with(5)
        with self.assertRaisesRegex(Invalid, "cannot be run"):
            lab.closed_loop(Logging, text="a", program=self.path("nothing"))
        ours = subprocess.run(["ps", "--ppid", str(os.getpid()), "-o", "args="], capture_output=True, text=True).stdout
        self.assertNotIn("closed-loop", ours)

    def test_a_law_that_has_gone_ends_a_run_without_an_exception_of_the_socket(self):
        law, own = socket.socketpair()
        hello = lab.LAW_HELLO.pack(2_000_000, 0, *[0.5] * 6)
        law.sendall(lab._message(1, hello))
        law.close()
        with own:
            self.assertEqual(lab._run(own, Logging).log, [])

    def test_a_folder_for_sockets_that_is_too_deep_says_what_to_do(self):
        deep = self.path("d" * 120, "x")
        with mock.patch("tempfile.tempdir", os.path.dirname(deep)), self.assertRaisesRegex(Problem, "set TMPDIR"):
            self.run_with(Logging)

    def test_a_program_without_a_result_is_a_problem(self):
        program = self.write("nothing.sh", "#!/bin/sh\nexit 0\n")
        os.chmod(program, 0o755)
        with self.assertRaisesRegex(Problem, "wrote no result"):
            lab.closed_loop(Logging, text="a", program=program)


class Physics(unittest.TestCase):
    @unittest.skipUnless(importlib.util.find_spec("mujoco"), "mujoco is not installed")
    def test_mujoco_is_the_arm_as_in_the_example(self):
        example = os.path.join(ROOT, "client", "python", "examples", "mujoco_lockstep.py")
        path = os.pathsep.join([os.path.dirname(program()), os.environ.get("PATH", "")])
        done = subprocess.run(
            [sys.executable, "-W", "error", example, os.path.join(ROOT, "config", "robots", "ur5.urdf")],
            env={**os.environ, "PATH": path}, capture_output=True, text=True, timeout=300,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        told = dict(line.split(": ") for line in done.stdout.splitlines())
        self.assertEqual(told.pop("stopped"), "None")
        [error] = told.values()
        self.assertLess(float(error.split()[1]), 10.0)


if __name__ == "__main__":
    unittest.main()
