"""An arm in Python: it follows, brakes when commands end, and stands after a pause."""

import json
import math
import signal
import subprocess
import sys
import threading
import time
import unittest

import foretrace
from foretrace.messages import ArmFlags, CommandFlags, FaultReason, Mode, RobotMode, SafetyMode
from world import HOME, Hand, PerfectArm, World, following, until

#: Deceleration of the interface [rad/s²].
BRAKE = 20.0
#: Acceleration of the preset's joints [rad/s²].
FASTEST = 40.0


#: An arm in a process of its own, whose program comes before the package's loop wherever both may run, and so reads an old
#: target after it stood still. Says how far two moving targets lay apart at most that were read one after the other.
STOOD_STILL = f"""
import json, os, pathlib, sys, threading, time, foretrace
from foretrace.messages import RobotMode, SafetyMode
ft = foretrace.attach()
arm = ft.arm_interface(250, simulated=True)
cpu = min(os.sched_getaffinity(0))
for task in pathlib.Path("/proc/self/task").iterdir():
    try:
        os.sched_setaffinity(int(task.name), [cpu])
        if (task / "comm").read_text().strip() == "foretrace-arm":
            os.setpriority(os.PRIO_PROCESS, int(task.name), 19)
    except OSError:
        pass  # A thread that has ended meanwhile.
over = threading.Event()
threading.Thread(target=lambda: (sys.stdin.readline(), over.set()), daemon=True).start()
q, qd, last, moved, longest = {HOME}, [0.0] * 6, None, 0, 0
print("reports", flush=True)
newest = 0
while not over.is_set():
    target = arm.target()
    if target.at_ns == newest:
        time.sleep(0.0002)
        continue
    newest = target.at_ns
    if target.move:
        q, qd = target.q, target.qd
        moved += 1
        longest = max(longest, target.at_ns - last if last else 0)
        last = target.at_ns
    else:
        qd, last = [0.0] * 6, None
    arm.measured(q, qd, safety_mode=SafetyMode.NORMAL, robot_mode=RobotMode.RUNNING)
print(json.dumps({{"moved": moved, "longest_ns": longest, "pauses": arm.counts()["pauses"]}}))
"""


class Recorded:
    """The native attachment, and how the arms that it makes brake."""

    def __init__(self, native, made):
        self.native, self.made = native, made

    def __getattr__(self, name):
        return getattr(self.native, name)

    def arm_interface(self, rate_hz, braking, *others):
        self.made.append(braking)
        return self.native.arm_interface(rate_hz, braking, *others)


class Arms(World):
    def test_it_follows_a_hand_and_its_states_carry_stamp_and_echo(self):
        self.daemon()
        with foretrace.attach() as ft:
            arm = PerfectArm(ft)
            joints = ft.records("joints")
            self.armed(ft)
            hand = Hand(ft)
            status = following(ft)
            time.sleep(1.0)
            states = joints.drain_records(1.0)
            stamps = [state.header.stamp_ns for state in states]
            self.assertEqual(stamps, sorted(set(stamps)))
            self.assertGreater(states[-1].command_tick, 0)
            self.assertGreater(states[-1].pen_stamp_ns, 0)
            self.assertEqual(states[-1].safety_mode, SafetyMode.NORMAL)
            self.assertGreater(max(abs(a - b) for a, b in zip(states[-1].q, HOME)), 1e-4)
            counts = arm.interface.counts()
            self.assertGreater(counts["states_sent"], 100)
            self.assertEqual((counts["states_not_sent"], counts["trouble"]), (0, None))
            # The echo comes back: the daemon knows how long a command takes.
            status = ft.status()
            self.assertLess(status.chain.command_transport_ns, 2**63)
            self.assertTrue(status.arm_line.flags & ArmFlags.SIMULATED)
            hand.end()
            arm.end()

    def test_states_are_sent_for_new_measurements_only(self):
        self.daemon()
        with foretrace.attach() as ft, ft.arm_interface(500) as arm:
            joints = ft.records("joints")
            stamp = time.monotonic_ns()
            self.assertTrue(arm.measured(HOME, [0.0] * 6, stamp=stamp))
            self.assertFalse(arm.measured(HOME, [0.0] * 6, stamp=stamp))
            time.sleep(0.2)
            self.assertEqual([state.header.stamp_ns for state in joints.drain_records()], [stamp])
            with self.refuses(foretrace.Invalid, "before the measurement before it", "must grow"):
                arm.measured(HOME, [0.0] * 6, stamp=stamp - 1)
            with self.refuses(foretrace.Invalid, "stamp_ns", "in the future"):
                arm.measured(HOME, [0.0] * 6, stamp=time.time_ns())
            with self.refuses(foretrace.Invalid, "old", "time.monotonic_ns()"):
                arm.measured(HOME, [0.0] * 6, stamp=1)
            with self.refuses(foretrace.Invalid, "q"):
                arm.measured([math.nan] * 6, [0.0] * 6)
            # Degrees.
            with self.refuses(foretrace.Invalid, "q", "rad"):
                arm.measured([math.degrees(q) for q in HOME], [0.0] * 6)
            with self.refuses(foretrace.Invalid, "q has 5 values"):
                arm.measured(HOME[:5], [0.0] * 6)
            with self.refuses(foretrace.Invalid, "effort_unit"):
                arm.measured(HOME, [0.0] * 6, effort=[0.0] * 6)
            for number in (99, -1, 2**40, 0.5, 5.0, 10**5000):
                with self.refuses(foretrace.Invalid, "safety_mode"):
                    arm.measured(HOME, [0.0] * 6, safety_mode=number)
            for joint in (10**400, 10**5000):
                with self.refuses(foretrace.Invalid, "q is ", "legal: 6 numbers, one per joint [rad]"):
                    arm.measured([joint] * 6, [0.0] * 6)
            target = arm.target()
            self.assertEqual((target.move, target.state, target.q), (False, "stand", None))
            self.assertEqual(arm.counts()["states_sent"], 1)
            with self.refuses(foretrace.Taken, "slot"):
                foretrace.attach().arm_interface(500)

    def test_numbers_of_the_interface_are_bounded(self):
        self.daemon()
        with foretrace.attach() as ft:
            for arguments, name in (
                ({"rate_hz": 0}, "rate_hz"), ({"rate_hz": math.nan}, "rate_hz"), ({"rate_hz": 1e6}, "rate_hz"),
                ({"rate_hz": 500, "deceleration": 0}, "deceleration"), ({"rate_hz": 500, "pause_after": 0}, "pause_after"),
                ({"rate_hz": 20}, "pause_after = 0.05 s, two cycles at least"),
                ({"rate_hz": 500, "deceleration": [20.0] * 5 + [0.0]}, "deceleration of joint 6"),
            ):
                with self.refuses(foretrace.Invalid, name, "from"):
                    ft.arm_interface(**arguments)

    def test_it_brakes_as_the_settings_of_the_daemon_say(self):
        self.daemon("--set", "robot.stale_deceleration_radps2=[5, 6, 7, 8, 9, 10]")
        with foretrace.attach() as ft:
            made, native = [], ft._native
            ft._native = Recorded(native, made)
            for given, want in ((None, [5.0, 6.0, 7.0, 8.0, 9.0, 10.0]), (3, [3.0] * 6), ([1, 2, 3, 4, 5, 6], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])):
                ft.arm_interface(500, deceleration=given).close()
                self.assertEqual(made.pop(), want)
            for bad in ([1.0] * 5, "hard", [None] * 6):
                with self.refuses(foretrace.Invalid, "deceleration"):
                    ft.arm_interface(500, deceleration=bad)
            ft._native = native

    def test_a_process_that_stood_still_never_jumps(self):
        self.daemon()
        with foretrace.attach() as ft:
            child = subprocess.Popen([sys.executable, "-c", STOOD_STILL], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            self.children.append(child)
            self.assertTrue(child.stdout.readline(), "it reports")
            hand = Hand(ft)

            def follows():
                # A busy machine may stop the loop for reasons of its own, or answer late.
                try:
                    if ft.status().mode not in (Mode.ARMED, Mode.HOLDING, Mode.FOLLOWING):
                        ft.disarm()
                        self.armed(ft)
                    return ft.status().mode == Mode.FOLLOWING
                except foretrace.NoAnswer:
                    return False

            for _ in range(8):
                until("it follows", follows, timeout=60.0)
                time.sleep(0.3)
                child.send_signal(signal.SIGSTOP)
                time.sleep(0.08)
                child.send_signal(signal.SIGCONT)
                ft.wait_until(lambda status: status.mode == Mode.STOPPED, timeout=20.0)
            hand.end()
            out, error = child.communicate("\n", timeout=20)
            self.assertEqual((child.returncode, error), (0, ""))
            told = json.loads(out)
            # It moved, and whoever stood still for longer than pause_after was told to stand.
            self.assertGreater(told["moved"], 500)
            self.assertGreaterEqual(told["pauses"], 8)
            self.assertLessEqual(told["longest_ns"], 50_000_000)

    def test_when_the_daemon_dies_it_brakes_as_the_next_daemon_assumes(self):
        daemon = self.daemon()
        with foretrace.attach() as ft:
            arm = PerfectArm(ft)
            self.armed(ft)
            hand = Hand(ft)
            following(ft)
            until("it moves", lambda: max(map(abs, arm.qd)) > 0.05)
            self.kill(daemon)
            until("it stands", lambda: arm.targets[-1][1].state == "stand")
            # The last time: on a busy machine a command that came late may have been braked for before.
            told = [target for _, target in arm.targets]
            last = max(at for at, target in enumerate(told) if target.state == "follow")
            braking = [target for target in told[last:] if target.state == "brake"]
            for before, after in zip(braking, braking[1:]):
                seconds = (after.at_ns - before.at_ns) * 1e-9
                for q0, q1, v0, v1 in zip(before.q, after.q, before.qd, after.qd):
                    self.assertLessEqual(abs(v1), abs(v0) + 1e-12)
                    self.assertLessEqual(abs(v1 - v0), BRAKE * seconds + 1e-9)
                    self.assertLessEqual(abs(q1 - q0), abs(v0) * seconds + 1e-9)
            moving = [target for _, target in arm.targets if target.move]
            self.assertLess(max(jump(one, two) for one, two in zip(moving, moving[1:])), 1e-3)
            # The next daemon moves nothing until somebody arms; then the same interface follows it.
            self.daemon()
            ft.wait_until(lambda status: status.mode == Mode.IDLE, timeout=10)
            self.armed(ft)
            following(ft)
            hand.end()
            arm.end()

    def test_after_a_pause_of_python_the_arm_stands_until_it_is_armed_again(self):
        self.daemon()
        with foretrace.attach() as ft:
            arm = PerfectArm(ft)
            self.armed(ft)
            hand = Hand(ft)

            def pause():
                # A busy machine may stop the loop for reasons of its own at this very moment: then again.
                if ft.status().mode != Mode.FOLLOWING:
                    self.armed(ft)
                    following(ft)
                until("it moves", lambda: max(map(abs, arm.qd)) > 0.05)
                arm.block_s = 0.8
                until("it has blocked", lambda: arm.block_s == 0.0)
                time.sleep(1.0)
                return next((target for _, target in arm.targets if target.state == "paused"), None)

            paused = until("it is paused", pause, timeout=60.0)
            self.assertFalse(paused.move)
            told = [target for _, target in arm.targets if target.move]
            # Where it was last told to be.
            self.assertEqual(paused.q, told[-1].q)
            ft.wait_until(lambda status: status.mode == Mode.STOPPED, timeout=10)
            self.assertIn("the Python program read no target for", self.ask("status").stdout)
            time.sleep(0.3)
            self.assertEqual(arm.targets[-1][1].state, "paused")
            self.armed(ft)
            following(ft)
            begin = next(t for _, t in reversed(arm.targets) if t.state == "paused")
            after = next(t for _, t in arm.targets if t.at_ns > begin.at_ns and t.move)
            self.assertLess(jump(begin, after), 1e-3)
            self.assertEqual(arm.interface.counts()["pauses"], 1)
            hand.end()
            arm.end()

    def test_a_pause_of_the_reader_alone_makes_no_jump_either(self):
        self.daemon()
        with foretrace.attach() as ft, ft.arm_interface(250, pause_after=0.1, simulated=True) as arm:
            # One thread measures, and never pauses; another one reads, and does.
            where = {"q": list(HOME), "qd": [0.0] * 6, "wanted": True}

            def measure():
                for _ in foretrace.Pace(250):
                    if not where["wanted"]:
                        return
                    arm.measured(where["q"], where["qd"], safety_mode=SafetyMode.NORMAL, robot_mode=RobotMode.RUNNING)

            measuring = threading.Thread(target=measure)
            measuring.start()
            hand = Hand(ft)
            armed = threading.Thread(target=lambda: self.armed(ft))
            armed.start()
            told, paused = [], None
            for target in arm:
                if target.state == "paused":
                    paused = target
                    break
                if target.move:
                    where["q"], where["qd"] = target.q, target.qd
                    told.append(target)
                    if len(told) > 250 and max(map(abs, target.qd)) > 0.1:
                        time.sleep(0.3)
                        # Where a loop of one's own would go on.
                        self.assertFalse(arm.target().move)
            self.assertEqual(paused.q, told[-1].q)
            where["qd"] = [0.0] * 6
            status = ft.wait_until(lambda status: status.mode == Mode.STOPPED, timeout=10)
            self.assertEqual(status.fault, FaultReason.TRACKING_ERROR)
            where["wanted"] = False
            for thread in (armed, measuring):
                thread.join()
            hand.end()

    def test_what_the_arm_says_stands_in_the_status(self):
        self.daemon()
        with foretrace.attach() as ft, ft.arm_interface(100) as arm:
            arm.say("the door is open", "close it, then arm")

            def told():
                arm.measured(HOME, [0.0] * 6, safety_mode=SafetyMode.PROTECTIVE_STOP, robot_mode=RobotMode.RUNNING)
                return ft.status().note.text.decode() == "the door is open"

            until("the note", told)

            def refused():
                told()
                try:
                    ft.arm()
                except foretrace.Refused as problem:
                    return "the door is open" in str(problem) and "close it" in str(problem)

            until("a refusal with it", refused)
            arm.say_nothing()
            until("no note", lambda: arm.measured(HOME, [0.0] * 6) and ft.status().note_since_ns == 0)

    def test_what_the_arm_says_lasts_over_a_restart_and_a_pause(self):
        daemon = self.daemon()
        with foretrace.attach() as ft, ft.arm_interface(100) as arm:

            def told(words):
                arm.measured(HOME, [0.0] * 6, safety_mode=SafetyMode.PROTECTIVE_STOP, robot_mode=RobotMode.RUNNING)
                try:
                    return words in ft.status().note.text.decode()
                except foretrace.NoDaemon:
                    return False

            arm.say("the door is open", "close it, then arm")
            until("the note", lambda: told("the door is open"))
            daemon.terminate()
            daemon.communicate(timeout=20)
            daemon = self.daemon()
            until("the note, again", lambda: told("the door is open"))
            # Said while there is nobody to hear it.
            daemon.terminate()
            daemon.communicate(timeout=20)
            time.sleep(0.6)
            arm.say("the light is red", "")
            self.daemon()
            until("the other note", lambda: told("the light is red"))
        with foretrace.attach() as ft:
            arm = PerfectArm(ft)
            arm.interface.say("the window is open", "")
            self.armed(ft)
            hand = Hand(ft)
            following(ft)

            def note():
                return ft.status().note.text.decode()

            def pause():
                if ft.status().mode != Mode.FOLLOWING:
                    self.armed(ft)
                    following(ft)
                arm.block_s = 0.8
                time.sleep(1.2)
                return "read no target" in note()

            until("the pause is told", pause, timeout=60.0)
            self.armed(ft)
            until("what the program says is told again", lambda: note() == "the window is open")
            hand.end()
            arm.end()

    def test_the_messages_themselves(self):
        self.daemon()
        with foretrace.attach() as ft, ft.arm_ports() as ports:
            from foretrace.messages import JointCommand, JointState

            self.assertIsNone(ports.latest())
            state = JointState(safety_mode=SafetyMode.NORMAL, robot_mode=RobotMode.RUNNING)
            state.q[:] = HOME
            def send():
                ports.publish(state, time.monotonic_ns())
                time.sleep(0.01)
                try:
                    return ft.arm()
                except foretrace.Refused:
                    return None
            until("armed", send)
            command, echo = until("a command", ports.latest)
            self.assertTrue(command.flags & CommandFlags.ENABLED)
            self.assertEqual(echo.command_tick, command.tick)
            q, qd = foretrace.demand_at(command, command.header.stamp_ns)
            self.assertEqual(q, list(command.q))
            self.assertIsNone(foretrace.demand_at(command, command.valid_until_ns))
            for instant in (-1, 1.5, 5.0, 2**70, 10**5000):
                with self.refuses(foretrace.Invalid, "now_ns"):
                    foretrace.demand_at(command, instant)
            state.q[0] = math.inf
            with self.refuses(foretrace.Invalid, "q"):
                ports.publish(state, time.monotonic_ns())
            with self.refuses(foretrace.Invalid, "the command has 5 bytes"):
                foretrace._native.demand_at(b"short", 0)
            command.header.boot_id += 1
            with self.refuses(foretrace.Invalid, "last start"):
                foretrace.demand_at(command, command.header.stamp_ns)

    def test_the_state_at_an_instant_lies_between_two_states(self):
        self.daemon()
        with foretrace.attach() as ft, ft.arm_interface(100) as arm:
            with self.refuses(foretrace.Invalid, "no joint state"):
                ft.state_at(time.monotonic_ns())
            for instant in (-1, 1.5, 5.0, 2**70, 10**5000, "now"):
                with self.refuses(foretrace.Invalid, "t_ns"):
                    ft.state_at(instant)
            for timeout in (math.nan, math.inf, -1.0):
                with self.refuses(foretrace.Invalid, "timeout"):
                    ft.state_at(time.monotonic_ns(), timeout=timeout)
            begin = time.monotonic_ns()
            stamps = []
            for count in range(20):
                stamps.append(time.monotonic_ns())
                arm.measured([HOME[0] + 0.001 * count, *HOME[1:]], [0.1] + [0.0] * 5, stamp=stamps[-1])
                time.sleep(0.01)
            middle = (stamps[10] + stamps[11]) // 2
            joints = ft.state_at(middle)
            self.assertAlmostEqual(joints.q[0], HOME[0] + 0.0105, places=5)
            self.assertEqual(joints.gap_ns, stamps[11] - stamps[10])
            self.assertAlmostEqual(ft.state_at(stamps[5]).q[0], HOME[0] + 0.005, places=9)
            with self.refuses(foretrace.Invalid, "after the newest joint state"):
                ft.state_at(time.monotonic_ns() + 10**9, timeout=0.05)
            with self.refuses(foretrace.Invalid, "before the oldest state"):
                ft.state_at(begin - 10**9)
            time.sleep(0.3)
            arm.measured(HOME, [0.0] * 6)
            with self.refuses(foretrace.Invalid, "silence of the arm"):
                ft.state_at(stamps[-1] + 150_000_000)


def jump(one, two):
    """What no legal motion between two targets that were read one after the other explains [rad]: the faster of both
    speeds, and the arm's acceleration, for the time between them."""
    seconds = (two.at_ns - one.at_ns) * 1e-9
    legal = [max(abs(v0), abs(v1)) * seconds + FASTEST * seconds**2 for v0, v1 in zip(one.qd, two.qd)]
    return max(abs(q1 - q0) - most for q0, q1, most in zip(one.q, two.q, legal))


if __name__ == "__main__":
    unittest.main()
